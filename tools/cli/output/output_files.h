// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Nothing of the user's is overwritten: what a run reads and what it writes are compared before it writes anything.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "options/map_options.h"

namespace accessvdb::tools {

using Paths = std::vector<std::filesystem::path>;

/// Two outputs under one name, whatever it is called, of which only the last would be left.
/// @throws InvalidArgument "output.twice"
void requireDistinct(const Paths& outputs);
/// Outputs that the user named do not go among the tiles of a map.
/// @throws InvalidArgument "output.is_input"
void requireNotInTiles(const std::filesystem::path& out, const Paths& outputs);
/// Outputs that are distinct, but exist and are one of the inputs, whatever they are called: the same file by another
/// spelling, a link or a hard link. Standard output and /dev/null are no such outputs.
/// @throws InvalidArgument "output.twice", "output.is_input"; OutputError "output.is_folder", "output.not_a_file"
void requireNoInputs(const Paths& outputs, const Paths& inputs);
/// For a run in tiles: its files in OUT are no inputs, and none lies in OUT/rays or OUT/tiles, which it fills and
/// clears.
/// @throws InvalidArgument "output.is_input"
void requireNoInputsInTiles(const std::filesystem::path& out, const Paths& inputs);
/// Files whose names this program chose, not the user: those that exist have to be results of ours.
/// @throws OutputError "output.foreign"
void requireOwn(const Paths& outputs);
/// Whether the content of a regular file says that this program wrote it. A picture cannot say it; it is ours where the
/// results beside it are.
[[nodiscard]] bool isOwn(const std::filesystem::path& output);

[[nodiscard]] Paths joined(Paths paths, const Paths& more);
[[nodiscard]] Paths inFolder(const std::filesystem::path& folder, const std::vector<std::string>& names);
/// What a verb may read of a map, in one piece or in tiles, or of a checkpoint; or one state and its manifest.
[[nodiscard]] Paths filesOfMap(const std::filesystem::path& map);
/// Meshes of one or several tools.
[[nodiscard]] Paths filesOfTools(const ToolOptions& tool);
/// All files that flags of map name, but for those in a folder of scans.
[[nodiscard]] Paths namedInputs(const MapOptions& options);
/// The same, and the scans.
[[nodiscard]] Paths inputsWith(const MapOptions& options, const io::ScanSequence& scans);

}  // namespace accessvdb::tools
