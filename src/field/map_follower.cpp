// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/map_follower.h"

#include <algorithm>
#include <utility>

#include "field/thread_count.h"

namespace accessvdb::internal {

MapFollower::MapFollower(Fuse fuse, int threads)
    : fuse_(std::move(fuse)), arena_(makeArena(threads, tbb::task_arena::priority::low)) {}

MapFollower::~MapFollower() {
  {
    const std::scoped_lock lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
}

void MapFollower::take(Scan& scan, std::uint64_t flips_hash) {
  bool beside;
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return error_ || given_ - taken_ < kMostBehind; });
    if (error_) std::rethrow_exception(error_);
    beside = thread_.begin([this] { takeNext(); });  // which waits for the lock, so for the scan
    Place& place = places_[given_ % kMostBehind];
    std::swap(place.scan, scan);
    place.flips_hash = flips_hash;
    ++given_;
    most_behind_ = std::max(most_behind_, given_ - taken_);
  }
  scan.p_L.clear();
  scan.q_L.clear();
  if (!beside) takeNext();
}

void MapFollower::takeNext() {
  {
    const std::scoped_lock lock(mutex_);
    if (stop_ || error_) return;
  }
  const Place& place = places_[taken_ % kMostBehind];  // nobody else writes taken_, or fills this place
  std::uint64_t flips_hash = 0;
  std::exception_ptr error;
  try {
    arena_.execute([&] { flips_hash = fuse_(place.scan); });
  } catch (...) {
    error = std::current_exception();
  }
  {
    const std::scoped_lock lock(mutex_);
    error_ = error;
    if (!error) {
      if (!diverged_ && flips_hash != place.flips_hash) diverged_ = taken_;
      ++taken_;
    }
  }
  changed_.notify_all();
}

void MapFollower::join() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return error_ || taken_ == given_; });
  if (error_) std::rethrow_exception(error_);
}

std::uint64_t MapFollower::taken() const {
  const std::scoped_lock lock(mutex_);
  return taken_;
}

std::uint64_t MapFollower::behind() const {
  const std::scoped_lock lock(mutex_);
  return given_ - taken_;
}

std::uint64_t MapFollower::mostBehind() const {
  const std::scoped_lock lock(mutex_);
  return most_behind_;
}

std::optional<std::uint64_t> MapFollower::diverged() const {
  const std::scoped_lock lock(mutex_);
  return diverged_;
}

}  // namespace accessvdb::internal
