// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/map_outputs.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "runs/tile_job.h"
#include "runs/written_table.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kOutputs[] = {"field.vdb", "field_points.vdb", "points.ply", "preview.png", "report.json"};

}  // namespace

void MapOutputs::claim() {
  const fs::path out = options_.out;
  if (options_.no_clobber) {
    std::vector<std::string> outputs(std::begin(kOutputs), std::end(kOutputs));
    if (options_.exported.points_format == "las") outputs.emplace_back("points.las");
    if (options_.exported.sequence > 0) outputs.push_back(frameName(std::max<std::uint64_t>(lastFrameIn(out), 1)));
    if (options_.html) outputs.emplace_back(kPageFile);
    if (!options_.survey.carry.empty()) outputs.emplace_back(kTableFile);
    if (options_.fresh || !options_.rolling.empty()) outputs.emplace_back("plan.json");
    if (!options_.rolling.empty()) outputs.insert(outputs.end(), {"field.json", "rays.json", "tiles"});
    for (const std::string& file : outputs) {
      if (!io::isTaken(out / file, ErrorCode::Output)) continue;
      refused_ = true;
      throw OutputError("output.exists", (out / file).string(), "exists, and --no-clobber was given",
                        "Choose another --out folder");
    }
  }
  requireNoInputs(files(), namedInputs(options_));
  if (options_.tiles == "off" && !options_.fresh && tiles::hasPlan(out)) {
    refused_ = true;
    throw UnusableInput("plan.changed", out.string(), "holds tiles of another run",
                        "Use another folder, or --fresh to delete them");
  }
  io::prepareOutputFolder(out);
}

void MapOutputs::check(const Paths& inputs) const {
  requireNoInputs(files(), inputs);
  requireOwn(files());
  if (options_.fresh) requireNoInputsInTiles(options_.out, inputs);
}

void MapOutputs::startOver() const {
  if (options_.fresh) tiles::removePlan(options_.out);
}

Paths MapOutputs::files() const {
  std::vector<std::string> names(std::begin(kOutputs), std::end(kOutputs));
  if (options_.exported.points_format == "las") names.emplace_back("points.las");
  if (options_.html) names.emplace_back(kPageFile);
  if (!options_.survey.carry.empty()) names.emplace_back(kTableFile);
  std::error_code error;
  if (options_.exported.sequence > 0) {  // some of these will be frames
    for (const auto& entry : fs::directory_iterator(options_.out, error)) {
      const std::string name = entry.path().filename().string();
      if (name != "field_points.vdb" && name.starts_with("field_") && name.ends_with(".vdb")) names.push_back(name);
    }
  }
  return inFolder(options_.out, names);
}

}  // namespace accessvdb::tools
