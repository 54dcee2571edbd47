// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_slabs.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstdlib>
#include <limits>
#include <span>

namespace accessvdb::internal {
namespace {

using kernels::LeafColumn;
using kernels::SlabBox;
using kernels::VoxelColumn;

constexpr int kLog2 = 3, kSide = 1 << kLog2;  // of a leaf

/// Leaf columns that a kernel can number.
constexpr std::size_t kMostColumns = 1 << 15;

std::int16_t narrow(std::ptrdiff_t n) { return static_cast<std::int16_t>(n); }

/// The slabs of a direction, for a point at place y of its leaf.
class Slabs {
 public:
  Slabs(std::span<const VoxelColumn> columns, int y) {
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
    if (low[0] > high[0]) return;
    box_ = {0,
            narrow(low[0]),
            narrow(low[1]),
            narrow(low[2]),
            narrow(high[0] - low[0] + 1),
            narrow(high[1] - low[1] + 1),
            narrow(high[2] - low[2] + 1)};
    words_.assign(index(0, box_.size_y), 0);
    for (const VoxelColumn& c : columns) add(c, y);
  }

  [[nodiscard]] const SlabBox& box() const { return box_; }
  [[nodiscard]] const std::vector<std::uint64_t>& words() const { return words_; }

  /// The leaves that they touch for a point at place x of its leaf, from the lowest slab with a voxel to the highest.
  /// Near ones first: a search that stops at some number of collisions meets them early.
  [[nodiscard]] std::vector<LeafColumn> leafColumns(int x) const {
    std::vector<LeafColumn> list;
    const int begin = (box_.dx + x) >> kLog2, end = (box_.dx + box_.size_x - 1 + x) >> kLog2;
    for (int leaf_x = begin; box_.size_x > 0 && leaf_x <= end; ++leaf_x) {
      for (int y = 0; y < box_.size_y; ++y) {
        int low = box_.size_z, high = -1;
        for (int dx = leaf_x * kSide - x; dx < leaf_x * kSide - x + kSide; ++dx) widen(dx - box_.dx, y, low, high);
        if (high < low) continue;
        list.push_back({narrow(leaf_x), narrow(y + box_.leaf_dy), narrow(low + box_.slab_dz), narrow(high - low + 1)});
      }
    }
    const auto ring = [](const LeafColumn& c) {
      return std::max(std::abs(static_cast<int>(c.leaf_dx)), std::abs(static_cast<int>(c.leaf_dy)));
    };
    std::stable_sort(list.begin(), list.end(),
                     [&](const LeafColumn& a, const LeafColumn& b) { return ring(a) < ring(b); });
    return list;
  }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return (static_cast<std::size_t>(y) * static_cast<std::size_t>(box_.size_x) + static_cast<std::size_t>(x)) *
           static_cast<std::size_t>(box_.size_z);
  }
  /// Takes the slabs that are not empty of a column of the box into low .. high.
  void widen(int x, int y, int& low, int& high) const {
    if (x < 0 || x >= box_.size_x) return;
    const auto slabs = std::span(words_).subspan(index(x, y), static_cast<std::size_t>(box_.size_z));
    for (int z = 0; z < box_.size_z; ++z) {
      if (slabs[static_cast<std::size_t>(z)] == 0) continue;
      low = std::min(low, z);
      high = std::max(high, z);
    }
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
  SlabBox box;
  std::vector<std::uint64_t> words;
  std::array<std::vector<LeafColumn>, kSide> columns;  ///< by x

  Part() = default;
  explicit Part(const Slabs& slabs) : box(slabs.box()), words(slabs.words()) {
    for (std::size_t x = 0; x < kSide; ++x) columns[x] = slabs.leafColumns(static_cast<int>(x));
  }
  [[nodiscard]] std::uint64_t bytes() const {
    std::uint64_t sum = words.size() * sizeof(std::uint64_t);
    for (const auto& of_x : columns) sum += of_x.size() * sizeof(LeafColumn);
    return sum;
  }
};

}  // namespace

ToolSlabs ToolSlabs::make(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes) {
  if (tool.use_samples) return {};
  std::vector<Part> parts(static_cast<std::size_t>(num_directions) * kSide);
  std::atomic<std::uint64_t> bytes{0};
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t n) {
    if (bytes.load(std::memory_order_relaxed) > most_bytes) return;
    const std::uint32_t begin = tool.column_begin[n / kSide], end = tool.column_begin[n / kSide + 1];
    parts[n] = Part(Slabs({tool.columns + begin, end - begin}, static_cast<int>(n % kSide)));
    bytes.fetch_add(parts[n].bytes(), std::memory_order_relaxed);
  });
  if (bytes > most_bytes) return {};
  for (const Part& part : parts) {
    for (const auto& columns : part.columns) {
      if (columns.size() > kMostColumns) return {};
    }
  }
  ToolSlabs all;
  all.begin.push_back(0);
  for (Part& part : parts) {
    part.box.first = static_cast<std::uint32_t>(all.words.size());
    all.words.insert(all.words.end(), part.words.begin(), part.words.end());
    all.boxes.push_back(part.box);
  }
  for (std::size_t d = 0; d < static_cast<std::size_t>(num_directions); ++d) {
    for (std::size_t x = 0; x < kSide; ++x) {
      for (std::size_t y = 0; y < kSide; ++y) {
        const std::vector<LeafColumn>& columns = parts[d * kSide + y].columns[x];
        all.columns.insert(all.columns.end(), columns.begin(), columns.end());
        all.begin.push_back(static_cast<std::uint32_t>(all.columns.size()));
      }
    }
  }
  return all;
}

}  // namespace accessvdb::internal
