// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/tool_fits.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/pose_query.h"
#include "accessvdb/scan_io.h"
#include "options/tools_given.h"
#include "output/json_text.h"
#include "runs/state_file.h"

namespace accessvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

std::string csvOf(const std::vector<FitAnswer>& answers) {
  std::string text = "collisions,collision_limit,unknown_voxels,collision,unknown,valid,free\n";
  for (const FitAnswer& answer : answers) {
    for (const std::uint32_t number : {answer.collisions, answer.collision_limit, answer.unknown_voxels})
      text += std::to_string(number) + ",";
    for (const bool is : {answer.collision(), answer.unknown(), answer.valid}) text += is ? "1," : "0,";
    text += answer.free() ? "1\n" : "0\n";
  }
  return text;
}

Json jsonOf(const std::vector<FitAnswer>& answers) {
  Json all = Json::array();
  for (const FitAnswer& answer : answers) {
    all.push_back({{"collisions", answer.collisions},
                   {"collision_limit", answer.collision_limit},
                   {"unknown_voxels", answer.unknown_voxels},
                   {"collision", answer.collision()},
                   {"unknown", answer.unknown()},
                   {"valid", answer.valid},
                   {"free", answer.free()}});
  }
  return all;
}

std::string alongInWords(const PathFitAnswer& answer) {
  if (!answer.valid) return "not examined: a pose is out of the map's range, or the way is too long\n";
  std::string text = answer.free() ? "free" : answer.collision ? "collides" : "unknown";
  if (answer.collision) text += " at " + numberText(answer.first_hit) + (answer.unknown ? ", unknown before" : "");
  return text + "\n";
}

Json jsonOf(const PathFitAnswer& answer) {
  return {{"first_hit", std::isnan(answer.first_hit) ? Json(nullptr) : Json(answer.first_hit)},
          {"collision", answer.collision},
          {"unknown", answer.unknown},
          {"valid", answer.valid},
          {"free", answer.free()}};
}

}  // namespace

void printToolFits(const ToolFitOptions& options, Messages& messages) {
  if (options.contact && options.along) {
    throw InvalidArgument("usage.fits", "--contact", "is of single poses, and --along of a way", "Leave one out");
  }
  const std::vector<Eigen::Isometry3d> T_WT = io::readToolPoses(options.poses);
  if (T_WT.empty()) {
    throw InputError("input.empty", options.poses, "has no poses", "Write one 'x y z qw qx qy qz' per line");
  }
  const std::filesystem::path file =
      stateFile(options.map, "usage.fits", "no pose can be tried", {options.allow_changed, messages});
  const AccessibilityField field = loadField(file, options.given, options.common, messages);
  const std::size_t tool = options.for_tool.empty() ? 0 : toolNamed(options.for_tool, field.tools(), "usage.fits");
  const PoseQuery query = field.poseQuery();
  if (options.along) {
    const PathFitAnswer answer = query.fitsAlong(T_WT, {.tool = tool});
    printData(options.json ? jsonText(jsonOf(answer), 2) + "\n" : alongInWords(answer));
    return;
  }
  const std::vector<FitAnswer> answers = query.fits(T_WT, {.tool = tool, .contact = options.contact});
  printData(options.json ? jsonText(jsonOf(answers), 2) + "\n" : csvOf(answers));
}

}  // namespace accessvdb::tools
