// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The folder of one rolling field at a time, in this program. Other processes are kept out by
/// io::prepareOutputFolder().
#pragma once

#include <filesystem>

namespace accessvdb::tiles {

class FolderInUse {
 public:
  /// Nothing of the user's lies where tiles are written and deleted.
  /// @throws OutputError "output.foreign" unless the folder is empty or not there
  static void requireEmpty(const std::filesystem::path& folder);

  FolderInUse() = default;
  /// @throws OutputError "output.locked"
  explicit FolderInUse(const std::filesystem::path& folder);
  FolderInUse(FolderInUse&& other) noexcept;
  FolderInUse& operator=(FolderInUse&& other) noexcept;
  ~FolderInUse();

 private:
  std::filesystem::path folder_;
};

}  // namespace accessvdb::tiles
