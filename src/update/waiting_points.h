// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points wait for their turn in a backlog. What was found out about them may be out of date, so nobody is told:
/// until then they are unscored. Their state stays as it is, for scoring goes on from it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace accessvdb::internal {

class WaitingPoints {
 public:
  /// At the end of each update. @param ids  each once
  void set(std::vector<std::uint32_t> ids) {
    for (const std::uint32_t id : ids_) marks_[id] = 0;
    ids_ = std::move(ids);
    if (ids_.empty()) return;
    marks_.resize(std::max<std::size_t>(marks_.size(), *std::ranges::max_element(ids_) + std::size_t{1}), 0);
    for (const std::uint32_t id : ids_) marks_[id] = 1;
  }
  /// By id: not 0 if the point waits. Those beyond its end do not; empty if none does.
  [[nodiscard]] std::span<const std::uint8_t> marks() const {
    return ids_.empty() ? std::span<const std::uint8_t>() : std::span<const std::uint8_t>(marks_);
  }
  [[nodiscard]] std::uint64_t bytes() const { return marks_.capacity() + ids_.capacity() * sizeof(std::uint32_t); }

 private:
  std::vector<std::uint32_t> ids_;
  std::vector<std::uint8_t> marks_;
};

}  // namespace accessvdb::internal
