// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Several tools from repeated flags: the k-th --tool-unit, --orientations ... belongs to the k-th --tool.
#pragma once

#include <string>
#include <vector>

#include "accessvdb/tool_spec.h"
#include "options/map_options.h"
#include "output/report.h"

namespace accessvdb::tools {

/// Edges of voxels that are proposed.
inline constexpr double kVoxels_m[] = {0.001, 0.002, 0.003, 0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1};

/// Adds --tool and the flags that belong to one, each of which may be repeated. --orientations and --rolls are added by
/// addOrientationOptions().
void addToolsOptions(FlagParser& flags, MapOptions& options);
/// Only what says where each tool is read from and how it is held.
void addToolPlaces(FlagParser& flags, ToolOptions& options);

/// Adds --allow-open-tool and --allow-hidden-tool, for verbs whose labels such a tool would make worthless.
void addDoubtfulToolOptions(FlagParser& flags, MapOptions& options);
/// @throws UnusableInput "tool.open"  if one has an opening too wide to be closed, unless --allow-open-tool
void requireClosedTools(const MapOptions& options, const std::vector<ToolSpec>& tools);
/// Warns, too, where a tool hides less, but much.
/// @param params  of the field  @param share  largestShareHidden()
/// @throws UnusableInput "tool.hidden"  if it is more than half, unless --allow-hidden-tool
void requireShownTools(const MapOptions& options, const std::vector<ToolSpec>& tools, const FieldParams& params,
                       double share, Messages& messages);
/// As AccessibilityField::toolShareHidden(), without a field.
[[nodiscard]] double largestShareHidden(const std::vector<ToolSpec>& tools, const FieldParams& params);
/// The largest of the usual edges of voxels, no larger than `most_m`, at which the tool hides no more than half of
/// itself; 0: none.
[[nodiscard]] double voxelThatShows_m(const ToolGeometry& tool, FieldParams params, double most_m);

/// The values of a repeated flag, which holds them with kBetweenValues between.
[[nodiscard]] std::vector<std::string> valuesOf(const std::string& repeated);
/// For people: with commas.
[[nodiscard]] std::string valuesInWords(const std::string& repeated);

/// --margins: "0,0.02,0.05", metres. @throws InvalidArgument "usage.margins"
[[nodiscard]] std::vector<double> parseMargins(const std::string& text);

/// What belongs to each tool, as if it had been given alone.
/// @throws InvalidArgument "usage.tool"  for a flag that is neither given once nor once for each tool
[[nodiscard]] std::vector<MapOptions> optionsOfEach(const MapOptions& options);
/// The same for tools as loadTools() makes them: those that are grown by a margin have those of the tool itself.
[[nodiscard]] std::vector<MapOptions> optionsOfEach(const MapOptions& options, const std::vector<ToolSpec>& tools);

/// @throws InvalidArgument "usage.tool"  if there are several
void requireOneTool(const MapOptions& options, const std::string& verb);

/// Reads them, or the one; with --margins each is followed by itself, grown. @throws what loadTool() throws;
/// InvalidArgument "usage.tool", "usage.margins", "tool.name", "tool.count", "tool.margin"
[[nodiscard]] std::vector<ToolSpec> loadTools(const MapOptions& options);
/// Their repairs and the twins in their orientations as notices; what looks wrong as warnings.
void sayToolsNotes(const MapOptions& options, const std::vector<ToolSpec>& tools, Messages& messages);
/// Their names, for people.
[[nodiscard]] std::string namesOf(const std::vector<ToolSpec>& tools);
/// The one that --for-tool names. @param id  of the error if it is none of them
[[nodiscard]] std::size_t toolNamed(const std::string& name, const std::vector<ToolSpec>& tools, const std::string& id);

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
