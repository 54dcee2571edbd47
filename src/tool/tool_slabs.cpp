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
#include <optional>
#include <span>
#include <utility>

namespace accessvdb::internal {
namespace {

using kernels::LeafColumn;
using kernels::SlabBox;
using kernels::VoxelColumn;

constexpr int kLog2 = 3, kSide = 1 << kLog2;  // of a leaf

/// Leaves of a box, in y and z, that a kernel can number.
constexpr int kMostLeaves = 255;

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
  explicit Part(Slabs slabs) : box(slabs.box()) {
    for (std::size_t x = 0; x < kSide; ++x) columns[x] = slabs.leafColumns(static_cast<int>(x));
    words = slabs.takeWords();
  }
  [[nodiscard]] std::uint64_t columnBytes() const {
    std::uint64_t sum = 0;
    for (const auto& of_x : columns) sum += of_x.size() * sizeof(LeafColumn);
    return sum;
  }
  [[nodiscard]] bool canBeNumbered() const { return box.size_y <= kMostLeaves && box.size_z <= kMostLeaves; }
};

/// Parts behind each other; they are given up on the way.
ToolSlabs joined(std::vector<Part>& parts) {
  ToolSlabs all;
  std::size_t num_words = 0, num_columns = 0;
  for (const Part& part : parts) {
    num_words += part.words.size();
    num_columns += part.columnBytes() / sizeof(LeafColumn);
  }
  all.words.reserve(num_words);
  all.columns.reserve(num_columns);
  for (Part& part : parts) {
    part.box.first = static_cast<std::uint32_t>(all.words.size());
    all.words.insert(all.words.end(), part.words.begin(), part.words.end());
    all.boxes.push_back(part.box);
    part.words = {};
  }
  all.begin.push_back(0);
  for (std::size_t first = 0; first < parts.size(); first += kSide) {
    for (std::size_t x = 0; x < kSide; ++x) {
      for (std::size_t y = 0; y < kSide; ++y) {
        const std::vector<LeafColumn>& columns = parts[first + y].columns[x];
        all.columns.insert(all.columns.end(), columns.begin(), columns.end());
        all.begin.push_back(static_cast<std::uint32_t>(all.columns.size()));
      }
    }
  }
  return all;
}

}  // namespace

ToolSlabs ToolSlabs::make(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes) {
  if (tool.use_samples) return {};
  std::vector<Part> parts(static_cast<std::size_t>(num_directions) * kSide);
  std::atomic<std::uint64_t> bytes{0};
  std::atomic<bool> fits{true};
  /// Before they are taken.
  const auto reserve = [&](std::uint64_t more) {
    if (bytes.fetch_add(more, std::memory_order_relaxed) + more > most_bytes) fits = false;
    return fits.load();
  };
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t n) {
    if (!fits) return;
    const std::uint32_t begin = tool.column_begin[n / kSide], end = tool.column_begin[n / kSide + 1];
    const std::span columns(tool.columns + begin, end - begin);
    const auto y = static_cast<int>(n % kSide);
    const std::optional<SlabBox> box = boxOf(columns, y);
    if (!box) fits = false;
    if (!box || !reserve(wordsOf(*box) * sizeof(std::uint64_t))) return;
    parts[n] = Part(Slabs(columns, y, *box));
    if (!parts[n].canBeNumbered() || !reserve(parts[n].columnBytes())) fits = false;
  });
  if (!fits) return {};
  return joined(parts);
}

}  // namespace accessvdb::internal
