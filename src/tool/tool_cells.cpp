// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_cells.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstdlib>
#include <limits>
#include <span>

#include "hostdev/cell_counts.h"

namespace accessvdb::internal {
namespace {

using kernels::CellRun;
using kernels::kCellLog2;
using kernels::kCellPhases;

constexpr int kSide = 1 << kCellLog2;
constexpr std::size_t kRunCells = 8 * sizeof(CellRun::bits);

/// Voxels of the tool at one direction as a dense box of bits, z in words of 64.
class DenseTool {
 public:
  explicit DenseTool(std::span<const kernels::VoxelColumn> columns) {
    if (columns.empty()) return;
    std::array<int, 3> high;
    low_.fill(std::numeric_limits<int>::max());
    high.fill(std::numeric_limits<int>::min());
    for (const auto& c : columns) {
      // Cells that hold a voxel begin up to three voxels below it.
      const std::array<int, 3> bottom = {c.dx - kSide + 1, c.dy - kSide + 1, c.dz - kSide + 1};
      const std::array<int, 3> top = {c.dx, c.dy, c.dz + 63};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        low_[axis] = std::min(low_[axis], bottom[axis]);
        high[axis] = std::max(high[axis], top[axis]);
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) size_[axis] = high[axis] - low_[axis] + 1;
    words_ = (size_[2] + 63) / 64 + 1;  // one more, so that a shift may always read the next
    bits_.assign(
        static_cast<std::size_t>(size_[0]) * static_cast<std::size_t>(size_[1]) * static_cast<std::size_t>(words_), 0);
    for (const auto& c : columns) {
      std::uint64_t* row = at(c.dx - low_[0], c.dy - low_[1]);
      const int z = c.dz - low_[2];
      row[z / 64] |= c.bits << (z % 64);
      if (z % 64 != 0) row[z / 64 + 1] |= c.bits >> (64 - z % 64);
    }
  }

  /// Leaves the voxels at which a cube of kSide begins that is full.
  void keepFullCubes() {
    joinCubes([](std::uint64_t a, std::uint64_t b) { return a & b; });
  }
  /// Leaves the voxels at which a cube of kSide begins that is not empty.
  void keepTouchedCubes() {
    joinCubes([](std::uint64_t a, std::uint64_t b) { return a | b; });
  }
  /// Takes away what `other` has.
  void remove(const DenseTool& other) {
    for (int x = 0; x < size_[0]; ++x) {
      for (int y = 0; y < size_[1]; ++y) {
        for (int z = 0; z < size_[2]; ++z) {
          const int i = x + low_[0] - other.low_[0], j = y + low_[1] - other.low_[1], k = z + low_[2] - other.low_[2];
          if (i < 0 || j < 0 || k < 0 || i >= other.size_[0] || j >= other.size_[1] || k >= other.size_[2]) continue;
          if (other.test(i, j, k)) at(x, y)[z / 64] &= ~(std::uint64_t{1} << (z % 64));
        }
      }
    }
  }

  [[nodiscard]] const std::array<int, 3>& low() const { return low_; }
  [[nodiscard]] const std::array<int, 3>& size() const { return size_; }
  [[nodiscard]] bool test(int x, int y, int z) const {
    return (bits_[index(x, y) + static_cast<std::size_t>(z / 64)] >> (z % 64) & 1u) != 0;
  }
  [[nodiscard]] bool any(int x, int y) const {
    return std::any_of(bits_.begin() + static_cast<std::ptrdiff_t>(index(x, y)),
                       bits_.begin() + static_cast<std::ptrdiff_t>(index(x, y)) + words_,
                       [](std::uint64_t word) { return word != 0; });
  }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return (static_cast<std::size_t>(x) * static_cast<std::size_t>(size_[1]) + static_cast<std::size_t>(y)) *
           static_cast<std::size_t>(words_);
  }
  std::uint64_t* at(int x, int y) { return bits_.data() + index(x, y); }
  /// Joins each voxel with those of the cube that begins at it, axis by axis. Upwards, so that those are still as they
  /// were; outside there is nothing.
  template <class Join>
  void joinCubes(const Join& join) {
    for (int x = 0; x < size_[0]; ++x) {
      for (int y = 0; y < size_[1]; ++y) {
        std::uint64_t* row = at(x, y);
        for (int w = 0; w < words_; ++w) {
          const std::uint64_t own = row[w], next = w + 1 < words_ ? row[w + 1] : 0;
          for (int step = 1; step < kSide; ++step) row[w] = join(row[w], own >> step | next << (64 - step));
        }
      }
    }
    const auto joinRows = [&](int step_x, int step_y) {
      for (int x = 0; x < size_[0]; ++x) {
        for (int y = 0; y < size_[1]; ++y) {
          std::uint64_t* row = at(x, y);
          for (int step = 1; step < kSide; ++step) {
            const int other_x = x + step * step_x, other_y = y + step * step_y;
            const bool inside = other_x < size_[0] && other_y < size_[1];
            for (int w = 0; w < words_; ++w) row[w] = join(row[w], inside ? at(other_x, other_y)[w] : 0);
          }
        }
      }
    };
    joinRows(0, 1);
    joinRows(1, 0);
  }

  std::array<int, 3> low_ = {}, size_ = {0, 0, 0};
  int words_ = 0;
  std::vector<std::uint64_t> bits_;
};

using PhaseRuns = std::array<std::vector<CellRun>, kCellPhases>;

/// Appends the runs of cells that begin at (x, y) of the box.
void appendRuns(const DenseTool& tool, int x, int y, PhaseRuns& runs) {
  // A cell begins at a multiple of kSide in the map: that fixes where in its cell the point's voxel lies.
  const auto phaseOf = [](int offset) { return -offset & (kSide - 1); };
  const auto cellOf = [&](int offset) { return static_cast<std::int16_t>((offset + phaseOf(offset)) >> kCellLog2); };
  const int dx = tool.low()[0] + x, dy = tool.low()[1] + y;
  for (int z = 0; z < tool.size()[2]; ++z) {
    if (!tool.test(x, y, z)) continue;
    const int dz = tool.low()[2] + z;
    std::vector<CellRun>& list =
        runs[static_cast<std::size_t>((phaseOf(dx) << (2 * kCellLog2)) | (phaseOf(dy) << kCellLog2) | phaseOf(dz))];
    const CellRun cell = {cellOf(dx), cellOf(dy), cellOf(dz), 1};
    if (!list.empty() && list.back().dx == cell.dx && list.back().dy == cell.dy &&
        static_cast<std::size_t>(cell.dz - list.back().dz) < kRunCells) {
      list.back().bits = static_cast<std::uint16_t>(list.back().bits | 1u << (cell.dz - list.back().dz));
    } else {
      list.push_back(cell);
    }
  }
}

/// Rings of leaves around the tip: counted from the inside, each in the order of the map.
int ringOf(const kernels::VoxelColumn& c) { return std::max(std::abs(c.dx), std::abs(c.dy)) >> 3; }

/// Orders the columns of a direction. @param eroded  where cells of the tool may begin
/// @return how many lie outside all cells
std::size_t orderColumns(const DenseTool& full, std::span<kernels::VoxelColumn> columns) {
  const auto liesInside = [&](const kernels::VoxelColumn& c) {
    const int x = c.dx - full.low()[0], y = c.dy - full.low()[1];
    for (int i = std::max(x - kSide + 1, 0); i <= x; ++i) {
      for (int j = std::max(y - kSide + 1, 0); j <= y; ++j) {
        if (full.any(i, j)) return true;
      }
    }
    return false;
  };
  const auto middle = std::stable_partition(columns.begin(), columns.end(),
                                            [&](const kernels::VoxelColumn& c) { return !liesInside(c); });
  const auto nearer = [](const kernels::VoxelColumn& a, const kernels::VoxelColumn& b) {
    return ringOf(a) < ringOf(b);
  };
  std::stable_sort(columns.begin(), middle, nearer);
  return static_cast<std::size_t>(middle - columns.begin());
}

/// @param begins  where cells begin
PhaseRuns runsOf(const DenseTool& begins) {
  PhaseRuns runs;
  for (int x = 0; x < begins.size()[0]; ++x) {
    for (int y = 0; y < begins.size()[1]; ++y) {
      if (begins.any(x, y)) appendRuns(begins, x, y, runs);
    }
  }
  return runs;
}

std::uint64_t countOf(const PhaseRuns& runs) {
  std::uint64_t count = 0;
  for (const auto& list : runs) count += list.size();
  return count;
}

CellRuns joined(const std::vector<PhaseRuns>& of_direction) {
  CellRuns all;
  all.begin.push_back(0);
  for (const PhaseRuns& runs : of_direction) {
    for (const auto& list : runs) {
      all.runs.insert(all.runs.end(), list.begin(), list.end());
      all.begin.push_back(static_cast<std::uint32_t>(all.runs.size()));
    }
  }
  return all;
}

}  // namespace

ToolCells ToolCells::make(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes) {
  if (tool.use_samples) return {};
  const auto directions = static_cast<std::size_t>(num_directions);
  ToolCells cells;
  cells.columns.assign(tool.columns, tool.columns + tool.column_begin[num_directions]);
  cells.inner.resize(directions);
  std::vector<PhaseRuns> inside(directions), beside(directions);
  std::atomic<std::uint64_t> count{0}, count_inside{0};
  const std::uint64_t most = most_bytes / sizeof(CellRun);
  tbb::parallel_for(std::size_t{0}, directions, [&](std::size_t d) {
    if (count.load(std::memory_order_relaxed) > most) return;
    const std::uint32_t begin = tool.column_begin[d];
    const std::span columns = std::span(cells.columns).subspan(begin, tool.column_begin[d + 1] - begin);
    DenseTool full(columns);
    full.keepFullCubes();
    const std::size_t outer = orderColumns(full, columns);
    cells.inner[d] = begin + static_cast<std::uint32_t>(outer);
    DenseTool touched(columns.subspan(outer));
    touched.keepTouchedCubes();
    touched.remove(full);
    inside[d] = runsOf(full);
    beside[d] = runsOf(touched);
    count_inside.fetch_add(countOf(inside[d]), std::memory_order_relaxed);
    count.fetch_add(countOf(inside[d]) + countOf(beside[d]), std::memory_order_relaxed);
  });
  if (count_inside == 0 || count > most) return {};
  cells.inside = joined(inside);
  cells.beside = joined(beside);
  std::vector<std::span<const kernels::VoxelColumn>> inner;
  for (std::size_t d = 0; d < directions; ++d) {
    inner.push_back(std::span<const kernels::VoxelColumn>(cells.columns)
                        .subspan(cells.inner[d], tool.column_begin[d + 1] - cells.inner[d]));
  }
  cells.rows = InnerRows::make(inner);
  return cells;
}

}  // namespace accessvdb::internal
