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

using kernels::kSlabGroup;
using kernels::SlabColumn;
using kernels::VoxelColumn;

constexpr int kLog2 = 3, kSide = 1 << kLog2;  // of a leaf

/// The tables of one direction, for one place of the point in its leaf's rows of y.
struct Part {
  std::vector<SlabColumn> columns;
  std::vector<std::uint64_t> words;
  std::vector<std::uint32_t> first_word;
};

/// The slabs of a direction as a dense box: [x][leaf y][slab z], z from the point's voxel upwards.
class DenseSlabs {
 public:
  /// @param phase_y  voxel y of the point in its leaf
  DenseSlabs(std::span<const VoxelColumn> columns, int phase_y) {
    low_.fill(std::numeric_limits<int>::max());
    std::array<int, 3> high;
    high.fill(std::numeric_limits<int>::min());
    const auto include = [&](std::size_t axis, int bottom, int top) {
      low_[axis] = std::min(low_[axis], bottom);
      high[axis] = std::max(high[axis], top);
    };
    for (const VoxelColumn& c : columns) {
      if (c.bits == 0) continue;
      include(0, c.dx, c.dx);
      include(1, (c.dy + phase_y) >> kLog2, (c.dy + phase_y) >> kLog2);
      include(2, (c.dz + std::countr_zero(c.bits)) >> kLog2, (c.dz + 63 - std::countl_zero(c.bits)) >> kLog2);
    }
    if (low_[0] > high[0]) return;
    for (std::size_t axis = 0; axis < 3; ++axis) size_[axis] = high[axis] - low_[axis] + 1;
    words_.assign(
        static_cast<std::size_t>(size_[0]) * static_cast<std::size_t>(size_[1]) * static_cast<std::size_t>(size_[2]),
        0);
    for (const VoxelColumn& c : columns) add(c, phase_y);
  }

  /// Columns of slabs that are not empty, cut off where only empty ones follow; near ones first, so that a search that
  /// stops at some number of collisions meets them early.
  [[nodiscard]] std::vector<SlabColumn> columns() const {
    std::vector<SlabColumn> list;
    for (int x = 0; x < size_[0]; ++x) {
      for (int y = 0; y < size_[1]; ++y) {
        const std::span<const std::uint64_t> all = column(x, y);
        const auto some = [](std::uint64_t word) { return word != 0; };
        const auto begin = std::find_if(all.begin(), all.end(), some);
        if (begin == all.end()) continue;
        const auto count = std::find_if(all.rbegin(), all.rend(), some).base() - begin;
        list.push_back({static_cast<std::int16_t>(x + low_[0]), static_cast<std::int16_t>(y + low_[1]),
                        static_cast<std::int16_t>(begin - all.begin() + low_[2]), static_cast<std::int16_t>(count)});
      }
    }
    const auto ring = [](const SlabColumn& c) {
      return std::max(std::abs(static_cast<int>(c.dx)) >> kLog2, std::abs(static_cast<int>(c.leaf_dy)));
    };
    std::stable_sort(list.begin(), list.end(), [&](const SlabColumn& a, const SlabColumn& b) {
      return ring(a) != ring(b) ? ring(a) < ring(b) : a.count > b.count;
    });
    return list;
  }

  /// The slabs of such a column.
  [[nodiscard]] std::span<const std::uint64_t> slabs(const SlabColumn& c) const {
    return column(c.dx - low_[0], c.leaf_dy - low_[1])
        .subspan(static_cast<std::size_t>(c.slab_dz - low_[2]), static_cast<std::size_t>(c.count));
  }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return (static_cast<std::size_t>(x) * static_cast<std::size_t>(size_[1]) + static_cast<std::size_t>(y)) *
           static_cast<std::size_t>(size_[2]);
  }
  [[nodiscard]] std::span<const std::uint64_t> column(int x, int y) const {
    return std::span(words_).subspan(index(x, y), static_cast<std::size_t>(size_[2]));
  }
  void add(const VoxelColumn& c, int phase_y) {
    const int y = c.dy + phase_y, row = y & (kSide - 1);
    std::uint64_t* to = words_.data() + index(c.dx - low_[0], (y >> kLog2) - low_[1]);
    for (std::uint64_t bits = c.bits; bits != 0; bits &= bits - 1) {
      const int z = c.dz + std::countr_zero(bits);
      to[(z >> kLog2) - low_[2]] |= std::uint64_t{1} << (kSide * row + (z & (kSide - 1)));
    }
  }

  std::array<int, 3> low_ = {}, size_ = {0, 0, 0};
  std::vector<std::uint64_t> words_;
};

Part partOf(const DenseSlabs& slabs) {
  Part part;
  part.columns = slabs.columns();
  for (std::size_t first = 0; first < part.columns.size(); first += kSlabGroup) {
    const auto group = std::span(part.columns).subspan(first, std::min(part.columns.size() - first, kSlabGroup));
    const auto deeper = [](const SlabColumn& a, const SlabColumn& b) { return a.count < b.count; };
    const auto depth = static_cast<std::size_t>(std::max_element(group.begin(), group.end(), deeper)->count);
    const std::size_t begin = part.words.size();
    part.first_word.push_back(static_cast<std::uint32_t>(begin));
    part.words.resize(begin + depth * kSlabGroup, 0);
    for (std::size_t n = 0; n < group.size(); ++n) {
      const std::span<const std::uint64_t> own = slabs.slabs(group[n]);
      for (std::size_t k = 0; k < own.size(); ++k) part.words[begin + k * kSlabGroup + n] = own[k];
    }
  }
  part.columns.resize(part.first_word.size() * kSlabGroup);  // whole groups; those added have no slabs
  return part;
}

std::uint64_t bytesOf(const Part& part) {
  return part.columns.size() * sizeof(SlabColumn) + part.words.size() * sizeof(std::uint64_t) +
         part.first_word.size() * sizeof(std::uint32_t);
}

}  // namespace

ToolSlabs ToolSlabs::make(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes) {
  if (tool.use_samples) return {};
  std::vector<Part> parts(static_cast<std::size_t>(num_directions) * kSide);
  std::atomic<std::uint64_t> bytes{0};
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t n) {
    if (bytes.load(std::memory_order_relaxed) > most_bytes) return;
    const std::uint32_t begin = tool.column_begin[n / kSide], end = tool.column_begin[n / kSide + 1];
    parts[n] = partOf(DenseSlabs({tool.columns + begin, end - begin}, static_cast<int>(n % kSide)));
    bytes.fetch_add(bytesOf(parts[n]), std::memory_order_relaxed);
  });
  if (bytes > most_bytes) return {};
  ToolSlabs all;
  all.group_begin.push_back(0);
  for (const Part& part : parts) {
    const auto words_before = static_cast<std::uint32_t>(all.words.size());
    all.columns.insert(all.columns.end(), part.columns.begin(), part.columns.end());
    all.words.insert(all.words.end(), part.words.begin(), part.words.end());
    for (const std::uint32_t first : part.first_word) all.first_word.push_back(words_before + first);
    all.group_begin.push_back(static_cast<std::uint32_t>(all.first_word.size()));
  }
  return all;
}

}  // namespace accessvdb::internal
