// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// An array that grows with the map. Growing never moves or copies existing elements: its cost depends only on the new
/// elements, so no frame pays for all of them.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <type_traits>
#include <vector>

namespace accessvdb::internal {

/// Elements keep their addresses until the end. Many threads may read and write elements, as with a plain array;
/// growing is not thread-safe.
template <typename T>
class ChunkedArray {
 public:
  /// Elements per chunk: a power of two, 64 KiB or less. This keeps directories of pointers small, and the first
  /// element of a small map cheap.
  static constexpr std::size_t kChunk = std::bit_floor(std::size_t{1 << 16} / sizeof(T));

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  [[nodiscard]] T& operator[](std::size_t n) { return chunks_[n / kChunk][n % kChunk]; }
  [[nodiscard]] const T& operator[](std::size_t n) const { return chunks_[n / kChunk][n % kChunk]; }

  /// Grows to at least this size. New elements are as `new T` leaves them: numbers are not initialised, so that threads
  /// can initialise them in parallel.
  void growRaw(std::size_t size) {
    const std::size_t before = chunks_.size(), wanted = (size + kChunk - 1) / kChunk;
    if (wanted > before) {
      chunks_.resize(wanted);
      try {
        // The system clears fresh memory when it is first written: several threads do that sooner.
        if (wanted - before < kFewChunks || std::is_trivially_default_constructible_v<T>) {
          for (std::size_t n = before; n < wanted; ++n) chunks_[n] = std::make_unique_for_overwrite<T[]>(kChunk);
        } else {
          tbb::parallel_for(before, wanted,
                            [&](std::size_t n) { chunks_[n] = std::make_unique_for_overwrite<T[]>(kChunk); });
        }
      } catch (...) {
        chunks_.resize(before);
        throw;
      }
    }
    size_ = std::max(size_, size);
  }
  /// The same, but sets the new elements to a value.
  void grow(std::size_t size, const T& value = T()) {
    const std::size_t before = size_;
    growRaw(size);
    for (std::size_t n = before; n < size_;) {
      const std::size_t count = std::min(size_ - n, kChunk - n % kChunk);
      std::fill_n(&(*this)[n], count, value);
      n += count;
    }
  }
  void push_back(const T& value) { grow(size_ + 1, value); }

  /// Heap memory in use.
  [[nodiscard]] std::uint64_t bytes() const {
    return chunks_.size() * kChunk * sizeof(T) + chunks_.capacity() * sizeof(chunks_[0]);
  }

 private:
  static constexpr std::size_t kFewChunks = 4;

  std::vector<std::unique_ptr<T[]>> chunks_;
  std::size_t size_ = 0;
};

}  // namespace accessvdb::internal
