// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How long the points of a queue have waited, counted in updates. First come, first served, so sizes are enough.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>

namespace accessvdb::kernels {

class QueueAge {
 public:
  /// Once per update with a queue. @param came  appended  @param served  then taken from the front, of all that wait
  void note(std::uint64_t came, std::uint64_t served) {
    ++update_;
    if (came > 0) waiting_.push_back({update_, came});
    while (served > 0 && !waiting_.empty()) {
      const std::uint64_t some = std::min(served, waiting_.front().points);
      served -= some;
      waiting_.front().points -= some;
      if (waiting_.front().points == 0) waiting_.pop_front();
    }
  }
  /// Updates that the first one has been left by; 0 if none waits.
  [[nodiscard]] std::uint64_t updates() const { return waiting_.empty() ? 0 : update_ - waiting_.front().update + 1; }

 private:
  /// Points that came with one update.
  struct Waiting {
    std::uint64_t update, points;
  };
  std::deque<Waiting> waiting_;
  std::uint64_t update_ = 0;
};

}  // namespace accessvdb::kernels
