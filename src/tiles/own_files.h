// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which files below rays/ and tiles/ this library wrote: nothing else is ever deleted, and no link is followed.
///
/// A file is ours if it is a regular file with a name that we make, and if what lies beside it says so: a tile's files
/// are listed by its tile.json, a file of rays or a state of a tile says it in its first bytes, or is listed by
/// rays.json.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "accessvdb/tiles.h"

namespace accessvdb::tiles {

struct OwnFiles {
  std::vector<std::filesystem::path> files;
  std::vector<std::filesystem::path> folders;    ///< that held them, inner ones first
  std::optional<std::filesystem::path> foreign;  ///< the first one that is not ours
};

/// @param out  the folder of the plan; nothing is found where it has no such folder
[[nodiscard]] OwnFiles ownRays(const std::filesystem::path& out);
[[nodiscard]] OwnFiles ownTiles(const std::filesystem::path& out);
/// Of the folder of one finished tile, or of one attempt at it.
[[nodiscard]] OwnFiles ownFilesOfTile(const std::filesystem::path& folder);

/// Between the name of a tile and a number, in the name of an attempt's folder.
inline constexpr std::string_view kAttemptMark = ".attempt-";
/// Whether a name is that of an attempt's folder.
[[nodiscard]] bool isAttemptName(const std::string& name);

/// Deletes the files, and the folders that are empty then. @return the first one that could not be deleted
std::optional<std::filesystem::path> removeOwn(const OwnFiles& own);

/// @throws OutputError "output.foreign"
void refuseForeign(const OwnFiles& own);

}  // namespace accessvdb::tiles
