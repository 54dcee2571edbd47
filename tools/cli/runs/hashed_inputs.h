// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files that a run reads: each is hashed once.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "accessvdb/program/path_facts.h"
#include "accessvdb/scan_io.h"

namespace accessvdb::tools {

class HashedInputs {
 public:
  HashedInputs() = default;
  explicit HashedInputs(const std::vector<io::InputFile>& hashed) {
    for (const io::InputFile& input : hashed) known_.insert(input.path);
  }
  /// @param path  maybe no file  @param to  gets it, if it is one and is new
  void add(const std::filesystem::path& path, std::vector<io::InputFile>& to) {
    if (!io::isFile(path) || !known_.insert(path.string()).second) return;
    to.push_back({path.string(), io::sha256OfFile(path)});
  }
  [[nodiscard]] bool has(const std::string& path) const { return known_.contains(path); }

 private:
  std::set<std::string> known_;
};

}  // namespace accessvdb::tools
