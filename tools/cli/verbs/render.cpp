// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb render: a picture of a field, or of a tool in its frame.
#include "accessvdb/render.h"

#include <filesystem>
#include <memory>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/tiles.h"
#include "options/command_line.h"
#include "options/options.h"
#include "output/output_files.h"
#include "output/output_record.h"
#include "output/stop_signal.h"
#include "runs/checked_results.h"
#include "runs/plausibility.h"
#include "runs/tiled_map.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {

int runRender(const Arguments& arguments, Messages& messages) {
  CommonOptions common;
  ToolOptions tool_options;
  PictureOptions picture;
  std::string map, out;
  bool allow_changed = false;
  FlagParser flags;
  flags.describe("render", "Draws a field, or a tool in its frame (tip, axes, size), into a PNG file.",
                 "accessvdb render --map out/ --out top.png --view top\n"
                 "  accessvdb render --tool pruner.stl --tool-unit mm --tool-tip -100,0,0 --out tool.png");
  addCommonOptions(flags, common);
  flags.option("--map", &map, "output folder of accessvdb map");
  flags.option("--out", &out, "the PNG file to write");
  addPictureOptions(flags, picture);
  addToolOptions(flags, tool_options);
  addAllowChanged(flags, allow_changed);
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);

  if (map.empty() == tool_options.tool.empty()) {
    throw InvalidArgument("usage.missing", "render", "needs either --map DIR or --tool MESH",
                          "See accessvdb render --help");
  }
  if (out.empty()) throw InvalidArgument("usage.missing", "--out", "is missing", "Name the PNG file to write");
  endOnStopSignals(messages);
  const io::RenderOptions render = renderOptions(picture);
  requireNoInputs({out}, joined(joined(filesOfTools(tool_options), {common.config}), filesOfMap(map)));
  if (!map.empty()) {
    bool empty = true;
    const auto check = std::make_shared<io::OutputCheck>(allow_changed);
    if (tiles::hasIndex(map)) {
      const io::FieldParts parts = tiles::partsOf(tiles::readIndex(map, *check), kPicturePoints, check);
      for (const std::uint64_t count : parts.labels) empty = empty && count == 0;
      io::renderField(out, parts, render);
    } else {
      check->begin(map, {"points.ply"});
      const FieldSnapshot field =
          io::readChecked(*check, [&] { return io::readPointsPly(std::filesystem::path(map) / "points.ply"); });
      empty = field.points.empty();
      io::renderField(out, field, render);
    }
    sayFindings(*check, messages);
    recordOutput(map, out);
    if (empty) messages.warning("field.empty", map + " holds no surface points");
  } else {
    const ToolGeometry tool = loadTool(tool_options);
    sayToolNotes(tool, messages);
    const Eigen::Vector3d size_m = (tool.max_T() - tool.min_T()).cast<double>();
    if (const auto warning = toolUnitWarning(size_m)) messages.warning(warning->id, warning->text);
    messages.notice(toolInWords(tool, tool_options));
    io::renderTool(out, tool, render);
  }
  messages.notice("wrote " + out);
  return 0;
}

}  // namespace accessvdb::tools
