// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The files with the points of a result, in one piece or in tiles.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/output_check.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// Begins to hash them. @param verb  that asks, for the id of an error
/// @param why  what would be wrong with a map of which tiles are missing
/// @throws InputError "input.missing"; UnusableInput "VERB.unfinished"
[[nodiscard]] std::vector<std::filesystem::path> pointFilesOf(const std::filesystem::path& map, const std::string& verb,
                                                              const std::string& why, io::OutputCheck& check,
                                                              Messages& messages);

}  // namespace accessvdb::tools
