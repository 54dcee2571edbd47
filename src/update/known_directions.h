// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the exact policy remembers on the host of the directions of points (hostdev/known_levels.h), and how it ages. A
/// voxel that stops colliding removes at most one collision from a direction. So we count for each block of points and
/// direction, as an upper bound, how many did since the block's levels were last lowered; a level guarantees that many
/// fewer. Counting too many costs time but changes nothing.
#pragma once

#include <tbb/parallel_for.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "hostdev/due_evaluation.h"
#include "processor/prefetch.h"
#include "update/cell_directions.h"
#include "update/known_rows.h"

namespace accessvdb::internal {

/// Upper bounds of the voxels that stopped colliding in the tool at each direction, from a point of a block.
class FreedVoxels {
 public:
  static constexpr std::size_t kDirections = 64 * kernels::kMaxDirectionWords;
  /// So that no 32-bit sum overflows: a leaf has 512 voxels, and counters may hold as much again.
  static constexpr std::uint32_t kMostLeaves = 1u << 21;

  /// @param freed  of a leaf: voxels by cell as in countCells()  @param offset  of the leaf, in leaves from the block
  void add(const CellDirections& cells, int num_directions, const Index3& offset, std::uint64_t freed);
  /// Turns steps into sums. @return [kDirections]
  const std::uint32_t* sum(int num_directions);
  [[nodiscard]] bool any() const { return leaves_ > 0; }
  /// Whether the sums cannot be trusted.
  [[nodiscard]] bool tooMany() const { return leaves_ > kMostLeaves; }

 private:
  std::uint32_t leaves_ = 0;
  std::array<std::uint32_t, kDirections> steps_ = {};  ///< minus that of the direction before, modulo 2^32
};

class KnownDirections {
 public:
  /// Memory limit of the table of directions by cell; beyond it, and for tools tested by samples, the directions that
  /// a flip may affect are forgotten.
  static constexpr std::size_t kMostWords = FreedVoxels::kDirections / kernels::kKnownPerWord;

  /// @param any_directions  they are not all yaws in order
  KnownDirections(const kernels::ToolKernelView& tool, int num_directions, bool any_directions = false);

  /// Makes room; nothing is known about new points.
  void grow(std::size_t points, std::size_t blocks);
  [[nodiscard]] kernels::KnownPoint of(std::uint32_t id, std::uint32_t block) {
    return {levelsOf(id), freed_.row(block), static_cast<int>(words_)};
  }
  /// For each direction, the lowest level that guarantees more collisions than the base (baseCollisions()). The same
  /// for all points of a block.
  using LowestLevels = std::array<std::uint64_t, kMostWords>;
  [[nodiscard]] LowestLevels lowestWithMore(std::uint32_t block);
  /// The `asked` directions that may be better than what the levels count from, and whose corridor is not known to be
  /// blocked. @param w, asked  directions 64 w .. 64 w + 63
  [[nodiscard]] static std::uint64_t notKnownWorse(const kernels::KnownPoint& known, const LowestLevels& lowest, int w,
                                                   std::uint64_t asked) {
    const std::size_t first = known_rows::kWords * static_cast<std::size_t>(w);
    return asked == 0 ? 0 : asked & ~known_rows::worse(known.levels + first, lowest.data() + first);
  }
  void prefetch(std::uint32_t id) { prefetchRead(levelsOf(id), words_ * sizeof(std::uint64_t)); }
  [[nodiscard]] const CellDirections& cells() const { return cells_; }
  [[nodiscard]] const kernels::KnownScale& scale() const { return scale_; }

  /// Ages what is known about tool collisions at the points of a block. Safe in parallel for different blocks.
  /// @param better_tool  directions that flips for the better may affect
  void age(std::uint32_t block, std::span<const std::uint32_t> ids, FreedVoxels& freed,
           const DirectionMask& better_tool);
  /// Forgets that these corridors of a point are blocked.
  void forgetCorridors(std::uint32_t id, const DirectionMask& better_arm);

  [[nodiscard]] std::uint64_t bytes() const { return levels_.bytes() + freed_.bytes() + cells_.bytes(); }

 private:
  /// Rows of a length that is known only at run time; they keep their addresses.
  template <typename T>
  class Rows {
   public:
    explicit Rows(std::size_t length) : length_(length) {}
    void grow(std::size_t rows) {
      const std::size_t before = chunks_.size(), wanted = (rows + kRows - 1) / kRows;
      if (wanted <= before) return;
      chunks_.resize(wanted);
      try {
        // The system clears fresh memory when it is first written: several threads do that sooner.
        tbb::parallel_for(before, wanted, [&](std::size_t n) { chunks_[n] = std::make_unique<T[]>(kRows * length_); });
      } catch (...) {
        chunks_.resize(before);
        throw;
      }
    }
    [[nodiscard]] T* row(std::size_t n) { return chunks_[n / kRows].get() + n % kRows * length_; }
    [[nodiscard]] std::uint64_t bytes() const { return chunks_.size() * kRows * length_ * sizeof(T); }

   private:
    static constexpr std::size_t kRows = 256;
    std::size_t length_;
    std::vector<std::unique_ptr<T[]>> chunks_;
  };

  struct alignas(64) Levels {
    std::uint64_t words[known_rows::kWords] = {};
  };
  [[nodiscard]] std::uint64_t* levelsOf(std::uint32_t id) { return levels_.row(id)->words; }

  int num_directions_;
  std::size_t words_;
  kernels::KnownScale scale_;
  CellDirections cells_;
  Rows<Levels> levels_;             ///< by id
  Rows<kernels::FreedWord> freed_;  ///< by block
};

}  // namespace accessvdb::internal
