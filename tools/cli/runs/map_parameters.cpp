// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/map_parameters.h"

#include <sstream>
#include <string>

#include "options/tools_given.h"

namespace accessvdb::tools {

ReportedParameters reportedParameters(const MapOptions& options, const FieldParams& params,
                                      const std::vector<ToolSpec>& tools) {
  ReportedParameters parameters = {{"scans", options.scans},
                                   {"poses", options.poses},
                                   {"pose_format", options.pose_format},
                                   {"tool", valuesInWords(options.tool.tool)},
                                   {"tool_unit", valuesInWords(options.tool.unit)},
                                   {"tool_tip", valuesInWords(options.tool.tip)},
                                   {"tool_axis", valuesInWords(options.tool.axis)},
                                   {"tool_up", valuesInWords(options.tool.up)},
                                   {"profile", options.profile},
                                   {"every", std::to_string(options.every)},
                                   {"update_every", std::to_string(options.update_every)},
                                   {"mirror_distance", options.mirror_distance ? "true" : "false"},
                                   {"half", options.exported.half ? "true" : "false"},
                                   {"compression", options.exported.compression},
                                   {"up_axis", options.exported.up_axis},
                                   {"points_format", options.exported.points_format},
                                   {"surface", options.exported.surface ? "true" : "false"},
                                   {"sequence", std::to_string(options.exported.sequence)}};
  if (!options.replay_log.empty()) parameters.emplace_back("replay_log", options.replay_log);
  for (const auto& given : givenSurveyOptions(options.survey)) parameters.push_back(given);
  for (const auto& given : givenRecordingOptions(options.recording)) parameters.push_back(given);
  for (const auto& given : givenSensorOptions(options.sensor)) parameters.push_back(given);
  std::istringstream lines(tools.empty() ? params.describe() : describeTools(tools, params));
  for (std::string line; std::getline(lines, line);) {
    const auto space = line.find(' ');
    if (space != std::string::npos) parameters.emplace_back(line.substr(0, space), line.substr(space + 1));
  }
  return parameters;
}

}  // namespace accessvdb::tools
