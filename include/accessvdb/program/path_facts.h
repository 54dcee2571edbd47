// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is at a path. "There is nothing" is only said where the system says so: not to be able to look (permissions, a
/// disk that fails, too many open files) is an error, because a file of calibration, a checkpoint or a map that is
/// there must not be treated as if it were not. Made for the program `accessvdb`: unlike the headers above this folder,
/// it may change with every version.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "accessvdb/error.h"
#include "accessvdb/export.h"

namespace accessvdb::io {

/// Follows links. @return not_found if there is nothing, or no path of this name can be
/// @param of  ErrorCode::Input or Output: what the path is to the caller
/// @throws InputError "input.unreadable", or OutputError "output.unreadable"
[[nodiscard]] ACCESSVDB_API std::filesystem::file_type typeAt(const std::filesystem::path& path,
                                                              ErrorCode of = ErrorCode::Input);
/// The same, but of a link itself.
[[nodiscard]] ACCESSVDB_API std::filesystem::file_type entryAt(const std::filesystem::path& path,
                                                               ErrorCode of = ErrorCode::Input);

[[nodiscard]] inline bool isFile(const std::filesystem::path& path, ErrorCode of = ErrorCode::Input) {
  return typeAt(path, of) == std::filesystem::file_type::regular;
}
[[nodiscard]] inline bool isFolder(const std::filesystem::path& path, ErrorCode of = ErrorCode::Input) {
  return typeAt(path, of) == std::filesystem::file_type::directory;
}
[[nodiscard]] inline bool isThere(const std::filesystem::path& path, ErrorCode of = ErrorCode::Input) {
  return typeAt(path, of) != std::filesystem::file_type::not_found;
}
/// Also a link that leads nowhere.
[[nodiscard]] inline bool isTaken(const std::filesystem::path& path, ErrorCode of = ErrorCode::Input) {
  return entryAt(path, of) != std::filesystem::file_type::not_found;
}

/// Content of a small file, such as JSON: "" if it is empty, no regular file, or larger than `max_bytes`.
/// @throws InputError "input.unreadable" where the system fails to read it, so that it is not taken for a damaged one
[[nodiscard]] ACCESSVDB_API std::string contentAt(const std::filesystem::path& path,
                                                  std::uint64_t max_bytes = std::uint64_t{1} << 28);
/// The first bytes of a file of any size. @throws as contentAt()
[[nodiscard]] ACCESSVDB_API std::string beginningAt(const std::filesystem::path& path, std::uint64_t bytes);

}  // namespace accessvdb::io
