// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A file that is made from a result but written only after the result has been held against its hashes.
#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <string>

namespace accessvdb::tools {

struct PreparedFile {
  std::filesystem::path path;
  std::string words;  ///< what is in it, behind "wrote PATH with"
  std::function<void(std::ostream&)> write;
};

}  // namespace accessvdb::tools
