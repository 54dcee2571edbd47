// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The voxels of a small box as bits: to collect those of many triangles, most of which touch voxels that others have
/// touched before them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tool/voxelize.h"

namespace accessvdb::internal {

class VoxelBitmap {
 public:
  /// 4 MiB: larger boxes are mostly empty, and lists of runs serve them better.
  static constexpr double kMostBits = 33554432;

  /// Both ends included. All that is added must be inside.
  struct Box {
    std::array<std::int32_t, 3> low, high;
    /// Of a bitmap of it, words counted as they are taken.
    [[nodiscard]] double bits() const;
  };

  explicit VoxelBitmap(const Box& box);

  void add(const VoxelRun& run) {
    const std::uint32_t lo = static_cast<std::uint32_t>(run.lo - box_.low[2]),
                        hi = static_cast<std::uint32_t>(run.hi - box_.low[2]);
    std::uint64_t* const column = words_.data() + index(run.i, run.j);
    const std::uint32_t last = hi / 64;
    std::uint64_t bits = ~std::uint64_t{0} << (lo % 64);
    for (std::uint32_t word = lo / 64; word < last; ++word) {
      column[word] |= bits;
      bits = ~std::uint64_t{0};
    }
    column[last] |= bits & (~std::uint64_t{0} >> (63 - hi % 64));
  }

  /// Voxels (i, j, k .. k + 63), the first as the lowest bit. Above the box: anything.
  [[nodiscard]] std::uint64_t from(std::int32_t i, std::int32_t j, std::int32_t k) const {
    const std::uint32_t bit = static_cast<std::uint32_t>(k - box_.low[2]), shift = bit % 64;
    const std::uint64_t* const word = words_.data() + index(i, j) + bit / 64;
    return shift == 0 ? word[0] : word[0] >> shift | word[1] << (64 - shift);
  }

  /// As voxelize().
  [[nodiscard]] std::vector<VoxelRun> runs() const;

 private:
  [[nodiscard]] std::size_t index(std::int32_t i, std::int32_t j) const {
    return (static_cast<std::size_t>(i - box_.low[0]) * size_y_ + static_cast<std::size_t>(j - box_.low[1])) * words_z_;
  }

  Box box_;
  std::size_t size_y_, words_z_;
  std::vector<std::uint64_t> words_;  ///< [x, y, z / 64] and one more, for from()
};

}  // namespace accessvdb::internal
