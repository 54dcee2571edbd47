// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// FIFO queue of points that wait to be evaluated, each at most once, together with what was requested for it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "launch/queue_age.h"
#include "points/chunked_array.h"

namespace accessvdb::internal {

class Backlog {
 public:
  /// The points to evaluate now.
  struct Turn {
    std::vector<std::uint32_t> ids;
    std::vector<std::uint8_t> asked;  ///< per id
  };

  /// Makes room for ids below `points`.
  void grow(std::uint32_t points) { asked_.grow(points, 0); }

  /// Appends a point or, if it is already waiting, adds to its requests. @param what  not 0
  void ask(std::uint32_t id, std::uint8_t what) {
    if (asked_[id] == 0) queue_.push_back(id);
    asked_[id] = static_cast<std::uint8_t>(asked_[id] | what);
  }
  [[nodiscard]] bool holds(std::uint32_t id) const { return asked_[id] != 0; }

  /// Removes the first points, once per update. @param budget_points  at most this many; 0: all
  [[nodiscard]] Turn take(int budget_points) {
    const auto most = budget_points > 0 ? static_cast<std::size_t>(budget_points) : queue_.size();
    const auto end = queue_.begin() + static_cast<std::ptrdiff_t>(std::min(most, queue_.size()));
    Turn turn;
    turn.ids.assign(queue_.begin(), end);
    age_.note(queue_.size() - left_, turn.ids.size());
    queue_.erase(queue_.begin(), end);
    left_ = queue_.size();
    turn.asked.reserve(turn.ids.size());
    for (const std::uint32_t id : turn.ids) turn.asked.push_back(std::exchange(asked_[id], std::uint8_t{0}));
    return turn;
  }

  [[nodiscard]] std::size_t size() const { return queue_.size(); }
  /// Those that wait, in order.
  [[nodiscard]] const std::vector<std::uint32_t>& ids() const { return queue_; }
  /// How many calls of take() have left the first point.
  [[nodiscard]] std::uint64_t updates() const { return age_.updates(); }
  [[nodiscard]] std::uint64_t bytes() const { return asked_.bytes() + queue_.capacity() * sizeof(std::uint32_t); }

 private:
  std::vector<std::uint32_t> queue_;
  std::size_t left_ = 0;  ///< by the last turn
  kernels::QueueAge age_;
  ChunkedArray<std::uint8_t> asked_;  ///< by id; 0: not in the queue
};

}  // namespace accessvdb::internal
