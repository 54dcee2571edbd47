// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is in a folder, to be compared before and after a run.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>

namespace accessvdb::cli_test {

/// Content of a regular file, target of a link, else what kind of thing it is.
inline std::string describeFile(const std::filesystem::path& path) {
  namespace fs = std::filesystem;
  const fs::file_status status = fs::symlink_status(path);
  if (fs::is_symlink(status)) return "link to " + fs::read_symlink(path).string();
  if (!fs::is_regular_file(status)) return fs::exists(status) ? "no regular file" : "missing";
  std::ifstream in(path, std::ios::binary);
  return "file: " + std::string(std::istreambuf_iterator<char>(in), {});
}

/// All files and links, by path; links are not followed.
inline std::map<std::string, std::string> snapshotOf(const std::filesystem::path& folder) {
  namespace fs = std::filesystem;
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!fs::is_directory(entry.symlink_status())) files[entry.path().string()] = describeFile(entry.path());
  }
  return files;
}

}  // namespace accessvdb::cli_test
