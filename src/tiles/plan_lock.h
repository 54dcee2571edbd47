// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Between a look at the plan and what follows from it, nobody writes another one.
#pragma once

#include <filesystem>

namespace accessvdb::tiles {

/// Of plan.json as it is now. Where there is none, or the file system has no locks, it holds nothing; nor to read after
/// ten seconds, or a fifth of one over NFS, where the driver of the tiles holds it, too.
class PlanLock {
 public:
  enum class Kind { ToRead, ToWrite };
  /// Waits for others, who hold it for moments only. @throws OutputError "output.locked" to write, after ten seconds
  PlanLock(const std::filesystem::path& out, Kind kind);
  ~PlanLock();
  PlanLock(const PlanLock&) = delete;
  PlanLock& operator=(const PlanLock&) = delete;

 private:
  int descriptor_ = -1;
};

}  // namespace accessvdb::tiles
