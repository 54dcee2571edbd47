// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Several tools from repeated flags: the k-th --tool-unit, --orientations ... belongs to the k-th --tool.
#pragma once

#include <string>
#include <vector>

#include "accessvdb/tool_spec.h"
#include "map_options.h"
#include "report.h"

namespace accessvdb::tools {

/// Adds --tool and the flags that belong to one, each of which may be repeated. --orientations and --rolls are added by
/// addOrientationOptions().
void addToolsOptions(FlagParser& flags, MapOptions& options);

/// The values of a repeated flag, which holds them with line ends between.
[[nodiscard]] std::vector<std::string> valuesOf(const std::string& repeated);
/// For people: with commas.
[[nodiscard]] std::string valuesInWords(const std::string& repeated);

/// What belongs to each tool, as if it had been given alone.
/// @throws InvalidArgument "usage.tool"  for a flag that is neither given once nor once for each tool
[[nodiscard]] std::vector<MapOptions> optionsOfEach(const MapOptions& options);

/// @throws InvalidArgument "usage.tool"  if there are several
void requireOneTool(const MapOptions& options, const std::string& verb);

/// Reads them, or the one. @throws what loadTool() throws; InvalidArgument "usage.tool", "tool.name", "tool.count"
[[nodiscard]] std::vector<ToolSpec> loadTools(const MapOptions& options);
/// Their repairs and the twins in their orientations as notices; what looks wrong as warnings.
void sayToolsNotes(const MapOptions& options, const std::vector<ToolSpec>& tools, Messages& messages);
/// The list of the one tool that these parameters belong to.
[[nodiscard]] std::vector<ToolSpec> onlyTool(const ToolGeometry& tool, const FieldParams& params);
/// Their names, for people.
[[nodiscard]] std::string namesOf(const std::vector<ToolSpec>& tools);

/// What each is, one line per tool.
[[nodiscard]] std::vector<std::string> toolsInWords(const MapOptions& options, const std::vector<ToolSpec>& tools);

/// For report.json; none of one tool. Limits are filled in by the caller.
[[nodiscard]] std::vector<ReportedTool> reportedTools(const MapOptions& options, const std::vector<ToolSpec>& tools);

/// --max-collisions: "auto", a number of voxels, or litres ("0.5l") in whole voxels.
/// @return as ScoringParams::max_collisions  @throws InvalidArgument "usage.max_collisions"
[[nodiscard]] int parseMaxCollisions(const std::string& text, double voxel_size_m);
/// --rolls. @return as ApproachParams::rolls  @throws InvalidArgument "usage.rolls"
[[nodiscard]] int parseRolls(const std::string& text);

}  // namespace accessvdb::tools
