// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Records that not every leaf has, kept beside the map: a leaf refers to its own by a number.
#pragma once

#include <tbb/concurrent_vector.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <vector>

namespace accessvdb::internal {

/// Numbers begin at 1 and say nothing about a leaf: which one it gets depends on the threads. All members may be called
/// from several threads at once, for different numbers.
template <typename Record>
class RecordPool {
  using Numbers = std::array<std::uint32_t, 64>;

 public:
  /// @return its number, for get() and remove()  @throws std::bad_alloc
  std::uint32_t add(const Record& record) {
    const std::lock_guard lock(mutex_);
    if (free_.empty()) addFree();
    const std::uint32_t number = free_.back();
    free_.pop_back();
    all_[number - 1] = record;
    return number;
  }
  void remove(std::uint32_t number) {
    const std::lock_guard lock(mutex_);
    free_.push_back(number);
  }

  /// For a thread that adds and removes many: takes numbers from the pool 64 at a time, so that threads do not wait for
  /// each other at every record. Numbers that are left go back when it is destroyed; until then size() counts them.
  class Batch {
   public:
    explicit Batch(RecordPool& pool) : pool_(pool) {}
    Batch(const Batch&) = delete;
    Batch& operator=(const Batch&) = delete;
    ~Batch() { pool_.giveBack(numbers_, count_); }

    /// As those of the pool.
    std::uint32_t add(const Record& record) {
      if (count_ == 0) count_ = pool_.take(numbers_);
      const std::uint32_t number = numbers_[--count_];
      pool_.get(number) = record;
      return number;
    }
    void remove(std::uint32_t number) {
      if (count_ == numbers_.size()) {
        pool_.giveBack(numbers_, count_);
        count_ = 0;
      }
      numbers_[count_++] = number;
    }
    [[nodiscard]] Record& get(std::uint32_t number) { return pool_.get(number); }

   private:
    RecordPool& pool_;
    Numbers numbers_;
    std::size_t count_ = 0;
  };

  [[nodiscard]] Record& get(std::uint32_t number) { return all_[number - 1]; }
  [[nodiscard]] const Record& get(std::uint32_t number) const { return all_[number - 1]; }

  /// Leaves that have a record.
  [[nodiscard]] std::uint64_t size() const { return all_.size() - free_.size(); }
  [[nodiscard]] std::uint64_t bytes() const { return size() * (sizeof(Record) + sizeof(std::uint32_t)); }

 private:
  /// Makes new numbers. The lock is held.
  void addFree() {
    const std::size_t count = Numbers{}.size();
    // So that no number that is given back is ever refused.
    if (free_.capacity() < all_.size() + count) free_.reserve(2 * (all_.size() + count));
    const auto begin = static_cast<std::uint32_t>(all_.grow_by(count) - all_.begin());
    for (std::size_t n = count; n > 0; --n) free_.push_back(begin + static_cast<std::uint32_t>(n));
  }
  /// @return how many; at least one
  std::size_t take(Numbers& numbers) {
    const std::lock_guard lock(mutex_);
    if (free_.empty()) addFree();
    const std::size_t count = std::min(numbers.size(), free_.size());
    std::copy(free_.end() - static_cast<std::ptrdiff_t>(count), free_.end(), numbers.begin());
    free_.resize(free_.size() - count);
    return count;
  }
  void giveBack(const Numbers& numbers, std::size_t count) {
    if (count == 0) return;
    const std::lock_guard lock(mutex_);
    free_.insert(free_.end(), numbers.begin(), numbers.begin() + static_cast<std::ptrdiff_t>(count));
  }

  tbb::concurrent_vector<Record> all_;  ///< never move while others are added
  std::vector<std::uint32_t> free_;
  std::mutex mutex_;
};

}  // namespace accessvdb::internal
