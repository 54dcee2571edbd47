// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// That scans are those of the plan, and their hashes.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <unordered_map>
#include <vector>

#include "accessvdb/tiles.h"

namespace accessvdb::tiles {

class PlannedInputs {
 public:
  /// @param plan  must outlive it
  explicit PlannedInputs(const Plan& plan);
  /// A step was read from this file. @throws UnusableInput "plan.changed"
  void note(const std::string& given_path);
  /// Of all files that were read so far, by path.
  [[nodiscard]] const std::map<std::string, std::string>& hashes() {
    hashLast();
    return sha256_;
  }
  /// Of an earlier call that read them.
  void restore(std::map<std::string, std::string> hashes) { sha256_ = std::move(hashes); }
  /// All inputs with their hashes. @param out  folder of the plan  @param before  of an earlier bin()
  /// @throws UnusableInput "plan.changed"
  [[nodiscard]] std::vector<io::InputFile> all(const std::filesystem::path& out,
                                               const std::vector<io::InputFile>& before) const;

 private:
  void hashLast();

  const Plan& plan_;
  std::unordered_map<std::string, const PlannedInput*> planned_;
  std::map<std::string, std::string> sha256_;
  std::string last_given_path_, last_path_;
};

}  // namespace accessvdb::tiles
