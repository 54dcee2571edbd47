// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/plan_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

namespace accessvdb::tiles {

PlanLock::PlanLock(const std::filesystem::path& out, Kind kind) {
  const std::filesystem::path plan = out / "plan.json";
  constexpr int kAttempts = 100;
  for (int n = 0; n < kAttempts; ++n) {
    // Over NFS only a file that is open for writing can be locked against readers.
    descriptor_ = ::open(plan.c_str(), (kind == Kind::ToRead ? O_RDONLY : O_RDWR) | O_CLOEXEC);
    if (descriptor_ < 0 && errno == EACCES) descriptor_ = ::open(plan.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor_ < 0) return;
    while (::flock(descriptor_, kind == Kind::ToRead ? LOCK_SH : LOCK_EX) != 0 && errno == EINTR) {
    }
    // While this waited, the file may have given way to a new one.
    struct stat held, now;
    const bool same = ::fstat(descriptor_, &held) == 0 && ::stat(plan.c_str(), &now) == 0 &&
                      held.st_dev == now.st_dev && held.st_ino == now.st_ino;
    if (same) return;
    ::close(std::exchange(descriptor_, -1));
  }
}

PlanLock::~PlanLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

}  // namespace accessvdb::tiles
