// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_slabs.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <limits>
#include <optional>
#include <span>
#include <utility>

namespace accessvdb::internal {
namespace {

using kernels::LeafBox;
using kernels::LeafRows;
using kernels::SlabBox;
using kernels::VoxelColumn;

constexpr int kLog2 = 3, kSide = 1 << kLog2;  // of a leaf

/// A row of leaves that a kernel can number: 2048.
constexpr std::int32_t kMostWordsLog2 = 5;

std::int16_t narrow(std::ptrdiff_t n) { return static_cast<std::int16_t>(n); }

/// The box of a direction's slabs, for a point at place y of its leaf. Empty where there are none, and nothing where it
/// is wider than a SlabBox can say.
std::optional<SlabBox> boxOf(std::span<const VoxelColumn> columns, int y) {
  std::array<int, 3> low, high;
  low.fill(std::numeric_limits<int>::max());
  high.fill(std::numeric_limits<int>::min());
  const auto include = [&](std::size_t axis, int bottom, int top) {
    low[axis] = std::min(low[axis], bottom);
    high[axis] = std::max(high[axis], top);
  };
  for (const VoxelColumn& c : columns) {
    if (c.bits == 0) continue;
    include(0, c.dx, c.dx);
    include(1, (c.dy + y) >> kLog2, (c.dy + y) >> kLog2);
    include(2, (c.dz + std::countr_zero(c.bits)) >> kLog2, (c.dz + 63 - std::countl_zero(c.bits)) >> kLog2);
  }
  SlabBox box;
  if (low[0] > high[0]) return box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (high[axis] - low[axis] >= std::numeric_limits<std::int16_t>::max()) return std::nullopt;
  }
  box.dx = narrow(low[0]);
  box.leaf_dy = narrow(low[1]);
  box.slab_dz = narrow(low[2]);
  box.size_x = narrow(high[0] - low[0] + 1);
  box.size_y = narrow(high[1] - low[1] + 1);
  box.size_z = narrow(high[2] - low[2] + 1);
  return box;
}

std::uint64_t wordsOf(const SlabBox& box) {
  return static_cast<std::uint64_t>(box.size_x) * static_cast<std::uint64_t>(box.size_y) *
         static_cast<std::uint64_t>(box.size_z);
}

/// The slabs of a direction, for a point at place y of its leaf.
class Slabs {
 public:
  /// @param box  of the columns
  Slabs(std::span<const VoxelColumn> columns, int y, const SlabBox& box) : box_(box), words_(wordsOf(box), 0) {
    for (const VoxelColumn& c : columns) add(c, y);
  }

  [[nodiscard]] const SlabBox& box() const { return box_; }
  [[nodiscard]] std::vector<std::uint64_t> takeWords() { return std::move(words_); }

  /// The leaves that they touch for a point at place x of its leaf.
  /// @param[out] words  the rows' words; LeafRows::first counts from their beginning
  [[nodiscard]] LeafRows leafRows(int x, const LeafBox& all, std::vector<std::uint64_t>& words) const {
    LeafRows rows;
    rows.first = static_cast<std::uint32_t>(words.size());
    if (box_.size_x == 0) return rows;
    const int begin = (box_.dx + x) >> kLog2, end = ((box_.dx + box_.size_x - 1 + x) >> kLog2) + 1;
    const int row_words = 1 << all.words_log2, count = (end - begin) * row_words;
    rows.at = static_cast<std::uint16_t>((begin - all.low[0]) * row_words);
    rows.count = static_cast<std::uint16_t>(count);
    rows.reciprocal = (1u << LeafRows::kReciprocalLog2) / static_cast<std::uint32_t>(count) + 1;
    words.resize(words.size() + static_cast<std::size_t>(count * all.size[2]), 0);
    for (int leaf_x = begin; leaf_x < end; ++leaf_x) {
      for (int y = 0; y < box_.size_y; ++y) {
        const int bit = y + box_.leaf_dy - all.low[1];
        for (int z = 0; z < box_.size_z; ++z) {
          if (!touches(leaf_x * kSide - x - box_.dx, y, z)) continue;
          const int level = z + box_.slab_dz - all.low[2];
          words[rows.first + static_cast<std::size_t>(level * count + (leaf_x - begin) * row_words + bit / 64)] |=
              std::uint64_t{1} << bit % 64;
        }
      }
    }
    return rows;
  }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return (static_cast<std::size_t>(y) * static_cast<std::size_t>(box_.size_x) + static_cast<std::size_t>(x)) *
           static_cast<std::size_t>(box_.size_z);
  }
  /// Is any voxel in the slabs from x on that make a leaf?
  [[nodiscard]] bool touches(int x, int y, int z) const {
    for (int own = std::max(x, 0); own < std::min<int>(x + kSide, box_.size_x); ++own) {
      if (words_[index(own, y) + static_cast<std::size_t>(z)] != 0) return true;
    }
    return false;
  }
  void add(const VoxelColumn& c, int place_y) {
    const int y = c.dy + place_y, row = y & (kSide - 1);
    std::uint64_t* to = words_.data() + index(c.dx - box_.dx, (y >> kLog2) - box_.leaf_dy);
    for (std::uint64_t bits = c.bits; bits != 0; bits &= bits - 1) {
      const int z = c.dz + std::countr_zero(bits);
      to[(z >> kLog2) - box_.slab_dz] |= std::uint64_t{1} << (kSide * row + (z & (kSide - 1)));
    }
  }

  SlabBox box_;
  std::vector<std::uint64_t> words_;
};

/// The tables of a direction and a place y.
struct Part {
  std::vector<std::uint64_t> words, rows;
  std::array<LeafRows, kSide> leaves;  ///< by x

  Part() = default;
  Part(Slabs slabs, const LeafBox& box) {
    for (std::size_t x = 0; x < kSide; ++x) leaves[x] = slabs.leafRows(static_cast<int>(x), box, rows);
    words = slabs.takeWords();
  }
  [[nodiscard]] std::uint64_t rowBytes() const {
    return rows.size() * sizeof(std::uint64_t) + leaves.size() * sizeof(LeafRows);
  }
};

/// All leaves that boxes of slabs touch; nothing where they are too many.
std::optional<LeafBox> leafBoxOf(std::span<const SlabBox> boxes) {
  std::array<int, 3> low, high;
  low.fill(std::numeric_limits<int>::max());
  high.fill(std::numeric_limits<int>::min());
  const auto include = [&](std::size_t axis, int bottom, int top) {
    low[axis] = std::min(low[axis], bottom);
    high[axis] = std::max(high[axis], top);
  };
  for (const SlabBox& box : boxes) {
    if (box.size_x == 0) continue;
    include(0, box.dx >> kLog2, (box.dx + box.size_x - 1 + kSide - 1) >> kLog2);
    include(1, box.leaf_dy, box.leaf_dy + box.size_y - 1);
    include(2, box.slab_dz, box.slab_dz + box.size_z - 1);
  }
  LeafBox all;
  if (low[0] > high[0]) return all;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    all.low[axis] = low[axis];
    all.size[axis] = high[axis] - low[axis] + 1;
  }
  while (all.size[1] > 64 << all.words_log2) ++all.words_log2;
  constexpr std::int64_t kMostWords = ToolSlabs::kMostRowBytes / static_cast<std::int64_t>(sizeof(std::uint64_t));
  // n / count by LeafRows::reciprocal: it is too large by less than count / 2^20, and n and count are below this.
  static_assert(kMostWords * kMostWords < 1 << LeafRows::kReciprocalLog2);
  if (all.words_log2 > kMostWordsLog2 || all.levels() > ToolSlabs::kMostLevels ||
      (static_cast<std::int64_t>(all.size[0]) << all.words_log2) * all.levels() > kMostWords) {
    return std::nullopt;
  }
  return all;
}

/// Parts behind each other; they are given up on the way.
ToolSlabs joined(std::vector<Part>& parts, std::vector<SlabBox> boxes, const LeafBox& box) {
  ToolSlabs all;
  all.box = box;
  std::size_t num_words = 0, num_rows = 0;
  for (const Part& part : parts) {
    num_words += part.words.size();
    num_rows += part.rows.size();
  }
  all.words.reserve(num_words);
  all.rows.reserve(num_rows);
  all.leaves.resize(parts.size() * kSide);
  for (std::size_t n = 0; n < parts.size(); ++n) {
    Part& part = parts[n];
    boxes[n].first = static_cast<std::uint32_t>(all.words.size());
    const auto first = static_cast<std::uint32_t>(all.rows.size());
    for (std::size_t x = 0; x < kSide; ++x) {
      LeafRows& leaves = all.leaves[(n / kSide * kSide + x) * kSide + n % kSide];
      leaves = part.leaves[x];
      leaves.first += first;
    }
    all.words.insert(all.words.end(), part.words.begin(), part.words.end());
    all.rows.insert(all.rows.end(), part.rows.begin(), part.rows.end());
    part = {};
  }
  all.boxes = std::move(boxes);
  return all;
}

}  // namespace

ToolSlabs ToolSlabs::make(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes) {
  if (tool.use_samples) return {};
  std::vector<SlabBox> boxes(static_cast<std::size_t>(num_directions) * kSide);
  std::atomic<std::uint64_t> bytes{0};
  std::atomic<bool> fits{true};
  const auto columnsOf = [&](std::size_t part) {
    const std::uint32_t begin = tool.column_begin[part / kSide], end = tool.column_begin[part / kSide + 1];
    return std::span(tool.columns + begin, end - begin);
  };
  tbb::parallel_for(std::size_t{0}, boxes.size(), [&](std::size_t n) {
    const std::optional<SlabBox> box = boxOf(columnsOf(n), static_cast<int>(n % kSide));
    if (box) {
      boxes[n] = *box;
    } else {
      fits = false;
    }
  });
  if (!fits) return {};
  const std::optional<LeafBox> leaves = leafBoxOf(boxes);
  if (!leaves) return {};

  std::vector<Part> parts(boxes.size());
  /// Before they are taken.
  const auto reserve = [&](std::uint64_t more) {
    if (bytes.fetch_add(more, std::memory_order_relaxed) + more > most_bytes) fits = false;
    return fits.load();
  };
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t n) {
    if (!fits || !reserve(wordsOf(boxes[n]) * sizeof(std::uint64_t))) return;
    parts[n] = Part(Slabs(columnsOf(n), static_cast<int>(n % kSide), boxes[n]), *leaves);
    reserve(parts[n].rowBytes());
  });
  if (!fits) return {};
  return joined(parts, std::move(boxes), *leaves);
}

}  // namespace accessvdb::internal
