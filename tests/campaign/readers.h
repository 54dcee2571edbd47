// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Everything that is read, one function for each kind of file. The corpus has a folder for each of them.
#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string_view>

namespace accessvdb::campaign {

struct Reader {
  std::string_view name;
  /// Reads all of the file, as the program would; empty where only the program can. @param seed  chooses among options
  std::function<void(const std::filesystem::path&, std::uint64_t seed)> read;
  /// How many points are accessible in the set of a damaged file, and are not in the whole set; empty where a file has
  /// no labels. Throws as read does where the file is refused.
  std::function<std::size_t(const std::filesystem::path& file, const std::filesystem::path& whole)> opened = {};
};

[[nodiscard]] std::span<const Reader> readers();

}  // namespace accessvdb::campaign
