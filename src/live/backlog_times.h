// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Since when points wait for their labels.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <optional>

namespace accessvdb::internal {

class BacklogTimes {
 public:
  using Time = std::chrono::steady_clock::time_point;

  /// After each update. @param due  when what it scored or left had come  @param updates  UpdateStats::backlog_updates
  void note(Time due, std::uint64_t updates) {
    due_.push_back(due);
    while (due_.size() > updates) due_.pop_front();
  }
  void clear() { due_.clear(); }
  /// When what the oldest point waits for had come; nothing if none waits.
  [[nodiscard]] std::optional<Time> oldest() const { return due_.empty() ? std::nullopt : std::optional(due_.front()); }

 private:
  std::deque<Time> due_;  ///< of the last updates, back to the one since which the oldest point waits
};

}  // namespace accessvdb::internal
