// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Records of the leaves that have one: few leaves of a map, so beside it.
#pragma once

#include <tbb/concurrent_vector.h>

#include <cstdint>
#include <mutex>
#include <vector>

namespace accessvdb::internal {

/// Numbers begin at 1 and say nothing about a leaf: which one it gets depends on the threads. All members may be called
/// from several threads at once, for different numbers.
template <typename Record>
class RecordPool {
 public:
  /// @return its number, for get() and remove()  @throws std::bad_alloc
  std::uint32_t add(const Record& record) {
    const std::lock_guard lock(mutex_);
    std::uint32_t number;
    if (free_.empty()) {
      if (free_.capacity() <= all_.size()) free_.reserve(2 * all_.size() + 64);  // so that remove() cannot fail
      number = static_cast<std::uint32_t>(all_.push_back(record) - all_.begin()) + 1;
    } else {
      number = free_.back();
      free_.pop_back();
      all_[number - 1] = record;
    }
    return number;
  }
  void remove(std::uint32_t number) {
    const std::lock_guard lock(mutex_);
    free_.push_back(number);
  }

  [[nodiscard]] Record& get(std::uint32_t number) { return all_[number - 1]; }
  [[nodiscard]] const Record& get(std::uint32_t number) const { return all_[number - 1]; }

  /// Leaves that have a record.
  [[nodiscard]] std::uint64_t size() const { return all_.size() - free_.size(); }
  [[nodiscard]] std::uint64_t bytes() const { return size() * (sizeof(Record) + sizeof(std::uint32_t)); }

 private:
  tbb::concurrent_vector<Record> all_;  ///< never move while others are added
  std::vector<std::uint32_t> free_;
  std::mutex mutex_;
};

}  // namespace accessvdb::internal
