// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/options.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>

#include "accessvdb/error.h"
#include "output/error_output.h"

namespace accessvdb::tools {
namespace {

constexpr int kMaxPicture_px = 16384;
/// Of coordinates, in any unit that is used: beyond what the library takes as a position, nothing is meant.
constexpr double kFarthest = 1e8;

/// Reads one finite number from the front of text.
std::optional<double> takeNumber(std::string_view& text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  if (text.size() > 1 && text[0] == '+' && text[1] != '-')
    text.remove_prefix(1);  // from_chars does not accept a plus sign
  double value = 0;
  const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc() || !std::isfinite(value)) return std::nullopt;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  return value;
}

std::string vectorText(const Eigen::Vector3f& v) {
  return numberText(v.x()) + "," + numberText(v.y()) + "," + numberText(v.z());
}

}  // namespace

Eigen::Vector3d parseVector(const std::string& flag, const std::string& text) {
  std::string_view rest = text;
  Eigen::Vector3d value;
  for (int axis = 0; axis < 3; ++axis) {
    const auto number = takeNumber(rest);
    const bool comma = axis < 2;
    if (!number || std::abs(*number) > kFarthest || (comma ? rest.empty() || rest.front() != ',' : !rest.empty())) {
      throw InvalidArgument("usage.vector", flag, "\"" + text + "\" is not three finite numbers within 1e8",
                            "Write X,Y,Z without spaces, for example -0.1,0,0");
    }
    value[axis] = *number;
    if (comma) rest.remove_prefix(1);
  }
  return value;
}

std::vector<double> parseNumbers(const std::string& flag, const std::string& text,
                                 std::initializer_list<std::size_t> counts, const std::string& form) {
  std::vector<double> numbers;
  std::string_view rest = text;
  bool good = true;
  while (good) {
    const auto number = takeNumber(rest);
    good = number.has_value() && std::abs(*number) <= kFarthest;
    if (good) numbers.push_back(*number);
    if (!good || rest.empty()) break;
    good = rest.front() == ',';
    rest.remove_prefix(1);
  }
  if (!good || std::count(counts.begin(), counts.end(), numbers.size()) == 0)
    throw InvalidArgument("usage.numbers", flag, "\"" + text + "\" is not " + form,
                          "Write finite numbers within 1e8, without spaces");
  return numbers;
}

Eigen::Vector3d parseDirection(const std::string& flag, const std::string& text) {
  const bool has_sign = !text.empty() && (text.front() == '-' || text.front() == '+');
  const std::string_view name = std::string_view(text).substr(has_sign ? 1 : 0);
  if (name == "x" || name == "y" || name == "z") {
    return (text.front() == '-' ? -1.0 : 1.0) * Eigen::Vector3d::Unit(name.front() - 'x');
  }
  return parseVector(flag, text);
}

double parseLength_m(const std::string& flag, const std::string& text, double voxel_size_m) {
  std::string_view rest = text;
  const auto number = takeNumber(rest);
  if (number && *number >= 0 && rest.empty()) return *number;
  if (number && *number >= 0 && rest == "v") return *number * voxel_size_m;
  throw InvalidArgument("usage.length", flag, "\"" + text + "\" is not a length",
                        "Write metres, for example 0.05, or voxels, for example 4v");
}

std::uint64_t parseBytes(const std::string& flag, const std::string& text) {
  std::string_view rest = text;
  const auto number = takeNumber(rest);
  double factor = 1;
  bool known = number.has_value() && *number > 0;
  if (known && !rest.empty()) {
    constexpr std::string_view kUnits = "kmgt";
    const auto unit = kUnits.find(static_cast<char>(std::tolower(static_cast<unsigned char>(rest.front()))));
    rest.remove_prefix(1);
    known = unit != std::string_view::npos && (rest.empty() || rest == "B" || rest == "iB");
    if (known) factor = std::exp2(10.0 * static_cast<double>(unit + 1));
  }
  if (!known || *number * factor >= 9e18) {
    throw InvalidArgument("usage.bytes", flag, "\"" + text + "\" is not an amount of memory",
                          "Write bytes, or a number with k, M, G or T, for example 2G");
  }
  return static_cast<std::uint64_t>(*number * factor);
}

std::string bytesInWords(double bytes) {
  constexpr std::array kUnits = {"B", "KiB", "MiB", "GiB", "TiB"};
  std::size_t unit = 0;
  for (; bytes >= 1024 && unit + 1 < kUnits.size(); ++unit) bytes /= 1024;
  char text[32];
  std::snprintf(text, sizeof text, unit == 0 ? "%.0f %s" : "%.1f %s", bytes, kUnits[unit]);
  return text;
}

std::string numberText(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

void addToolOptions(FlagParser& flags, ToolOptions& options) {
  flags.option("--tool", &options.tool, "tool mesh, or builtin:pencil or builtin:pruner");
  flags.option("--tool-unit", &options.unit, "unit of the mesh: m, cm, mm or in (required for STL, OBJ, PLY)");
  flags.option("--tool-tip", &options.tip, "X,Y,Z of the tool's tip, in the mesh's own units and frame");
  flags.option("--tool-axis", &options.axis,
               "direction from the tip along the body, in the mesh's frame: X,Y,Z or x, -x, y ...");
  flags.option("--tool-up", &options.up, "direction that becomes up, in the mesh's frame: X,Y,Z or x, -x, y ...");
}

ToolGeometry loadTool(const ToolOptions& options) {
  std::optional<LengthUnit> unit;
  if (!options.unit.empty()) {
    if (options.unit == "m") unit = LengthUnit::Metre;
    if (options.unit == "cm") unit = LengthUnit::Centimetre;
    if (options.unit == "mm") unit = LengthUnit::Millimetre;
    if (options.unit == "in") unit = LengthUnit::Inch;
    if (!unit) {
      throw InvalidArgument("usage.tool_unit", "--tool-unit", "\"" + options.unit + "\" is not a unit",
                            "Use m, cm, mm or in");
    }
  }
  ToolPose pose;
  if (!options.tip.empty()) pose.tip = parseVector("--tool-tip", options.tip);
  if (!options.axis.empty()) pose.axis = parseDirection("--tool-axis", options.axis);
  if (!options.up.empty()) pose.up = parseDirection("--tool-up", options.up);
  if (options.tool.rfind("builtin:", 0) == 0) {
    if (unit || !options.tip.empty() || !options.axis.empty() || !options.up.empty()) {
      throw InvalidArgument("usage.builtin_pose", options.tool, "a built-in tool already has its unit and pose",
                            "Omit --tool-unit, --tool-tip, --tool-axis and --tool-up");
    }
    return ToolGeometry::builtin(options.tool);
  }
  return ToolGeometry::fromMesh(options.tool, unit, pose);
}

void sayToolNotes(const ToolGeometry& tool, Messages& messages) {
  const std::string mark = "warning: ";
  for (const std::string& note : tool.notes()) {
    if (note.starts_with(mark)) {
      messages.warning("tool.pose", "tool: " + note.substr(mark.size()) + "; see accessvdb render --tool");
    } else if (note.starts_with("the mesh is open")) {
      messages.warning("tool.open", "tool: " + note);
    } else {
      messages.notice("tool: " + note);
    }
  }
}

std::string toolInWords(const ToolGeometry& tool, const ToolOptions& options) {
  const Eigen::Vector3f size = tool.max_T() - tool.min_T();
  char text[320];
  std::snprintf(text, sizeof text,
                "tool %s: %.4g x %.4g x %.4g m (length x width x height), reach %.4g m, box %s to %s",
                printable(tool.name()).c_str(), size.x(), size.y(), size.z(), tool.reach_m(),
                vectorText(tool.min_T()).c_str(), vectorText(tool.max_T()).c_str());
  std::string line = std::string(text) + "; tip at 0,0,0, axis +x along the body, up +z";
  if (options.tool.rfind("builtin:", 0) != 0) {
    line += " (in the mesh: tip " + (options.tip.empty() ? std::string("0,0,0") : options.tip) + ", axis " +
            (options.axis.empty() ? std::string("1,0,0") : options.axis) + ", up " +
            (options.up.empty() ? std::string("0,0,1") : options.up) + ")";
  }
  return line;
}

void sayAboutScans(const io::ScanSequence& scans, Messages& messages) {
  for (const std::string& note : scans.notices()) messages.notice(note);
  for (const io::ScanWarning& warning : scans.warnings()) messages.warning(warning.id, warning.text);
}

void sayAboutReading(const io::ScanSequence& scans, Messages& messages) {
  for (const io::ScanWarning& warning : scans.readWarnings()) messages.warning(warning.id, warning.text);
}

void addPictureOptions(FlagParser& flags, PictureOptions& options) {
  flags.option("--view", &options.view, "top, iso, or X,Y,Z towards the viewer");
  flags.option("--colour", &options.colour, "colour of the points: label, or reason (why a point is not accessible)");
  flags.option("--width", &options.width_px, "width of the picture in pixels");
  flags.option("--height", &options.height_px, "height of the picture in pixels");
}

io::RenderOptions renderOptions(const PictureOptions& options) {
  io::RenderOptions render;
  for (const auto& [flag, value] : {std::pair{"--width", options.width_px}, std::pair{"--height", options.height_px}}) {
    if (value < 16 || value > kMaxPicture_px) {
      throw InvalidArgument("usage.picture", flag, "must be in 16 .. 16384 pixels");
    }
  }
  render.width_px = options.width_px;
  render.height_px = options.height_px;
  if (options.colour != "label" && options.colour != "reason") {
    throw InvalidArgument("usage.word", "--colour", "\"" + options.colour + "\" is not known", "Use label or reason");
  }
  render.colour = options.colour == "reason" ? io::RenderColour::Reason : io::RenderColour::Label;
  if (options.view == "top") {
    render.view_W = {0, 0, 1};
  } else if (options.view != "iso") {
    render.view_W = parseVector("--view", options.view);
    if (!(render.view_W.norm() > 0))
      throw InvalidArgument("usage.view", "--view", "is zero", "Use top, iso or a direction");
  }
  return render;
}

}  // namespace accessvdb::tools
