// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/plan_lock.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <thread>
#include <utility>

#include "accessvdb/error.h"

namespace accessvdb::tiles {
namespace {

using Clock = std::chrono::steady_clock;

enum class Outcome { Locked, Busy, NoLocks };

/// Over NFS both kinds of locks are one: a tile waits for its own driver in vain, which keeps writers out as well.
bool isOverNfs(const std::filesystem::path& folder) {
  constexpr long kNfs = 0x6969;  // NFS_SUPER_MAGIC
  struct statfs system;
  return ::statfs(folder.c_str(), &system) == 0 && system.f_type == kNfs;
}

/// A lock of this open file. Beside it, a driver of tiles holds plan.json by flock(), which is another kind on a local
/// disk, for the whole of its run (accessvdb.tiles).
Outcome lockUntil(int descriptor, short kind, Clock::time_point end) {
  for (;;) {
    struct flock all = {};
    all.l_type = kind;
    all.l_whence = SEEK_SET;
    if (::fcntl(descriptor, F_OFD_SETLK, &all) == 0) return Outcome::Locked;
    if (errno != EAGAIN && errno != EACCES && errno != EINTR) return Outcome::NoLocks;
    if (Clock::now() >= end) return Outcome::Busy;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

}  // namespace

PlanLock::PlanLock(const std::filesystem::path& out, Kind kind) {
  const std::filesystem::path plan = out / "plan.json";
  const bool writes = kind == Kind::ToWrite;
  const bool waits = writes || !isOverNfs(out);
  const auto end = Clock::now() + (waits ? std::chrono::milliseconds(10'000) : std::chrono::milliseconds(200));
  for (;;) {
    descriptor_ = ::open(plan.c_str(), (writes ? O_RDWR : O_RDONLY) | O_CLOEXEC);
    if (descriptor_ < 0) return;
    const Outcome outcome = lockUntil(descriptor_, static_cast<short>(writes ? F_WRLCK : F_RDLCK), end);
    if (outcome == Outcome::NoLocks) return;
    if (outcome == Outcome::Busy) {
      ::close(std::exchange(descriptor_, -1));
      if (!writes) return;
      throw OutputError("output.locked", out.string(), "its tiles are being run", "Wait for it, or stop it");
    }
    // While this waited, the file may have given way to a new one.
    struct stat held, now;
    const bool same = ::fstat(descriptor_, &held) == 0 && ::stat(plan.c_str(), &now) == 0 &&
                      held.st_dev == now.st_dev && held.st_ino == now.st_ino;
    if (same || Clock::now() >= end) return;
    ::close(std::exchange(descriptor_, -1));
  }
}

PlanLock::~PlanLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

}  // namespace accessvdb::tiles
