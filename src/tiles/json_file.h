// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Small JSON files of a folder of tiles: written durably with a hash of their content, read with one kind of error for
/// whatever is wrong in them.
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

namespace accessvdb::tiles {

using Json = nlohmann::ordered_json;

/// @throws OutputError
void writeJson(const std::filesystem::path& path, Json json);

/// Parses the file and hands it to `take`.
/// @param what  for the error's id: "plan" gives "plan.missing" and "plan.damaged"
/// @throws InputError also for whatever nlohmann::json throws in `take`
void readJson(const std::filesystem::path& path, const std::string& what, const std::function<void(const Json&)>& take);

}  // namespace accessvdb::tiles
