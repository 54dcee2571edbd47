// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_slabs.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstdlib>
#include <iterator>
#include <limits>
#include <optional>
#include <span>
#include <unordered_set>
#include <utility>

namespace accessvdb::internal {
namespace {

using kernels::LeafColumn;
using kernels::SlabBox;
using kernels::SlabRow;
using kernels::VoxelColumn;

constexpr int kLog2 = 3, kSide = 1 << kLog2;  // of a leaf

/// Most leaves of a box, in y and z, that a kernel can number.
constexpr int kMostLeaves = 255;

/// With less than this share of full slabs, looking for them takes longer than they save.
constexpr double kLeastFullShare = 0.2;

std::int16_t narrow(std::ptrdiff_t n) { return static_cast<std::int16_t>(n); }

/// The box of a direction's slabs, for a point at place y of its leaf. Empty if there are none, and nothing if it is
/// wider than a SlabBox can hold.
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

/// Words of a row: its slabs and the empty one behind it.
std::size_t rowWords(const SlabBox& box) { return static_cast<std::size_t>(box.size_z) + 1; }

std::uint64_t rowsOf(const SlabBox& box) {
  return static_cast<std::uint64_t>(box.size_x) * static_cast<std::uint64_t>(box.size_y);
}
std::uint64_t wordsOf(const SlabBox& box) { return rowsOf(box) * rowWords(box); }
bool canBeNumbered(const SlabBox& box) { return box.size_y <= kMostLeaves && box.size_z <= kMostLeaves; }

/// The slabs of a direction, for a point at place y of its leaf.
class Slabs {
 public:
  /// @param box  the columns' box
  Slabs(std::span<const VoxelColumn> columns, int y, const SlabBox& box) : box_(box), words_(wordsOf(box), 0) {
    for (const VoxelColumn& c : columns) add(c, y);
  }

  [[nodiscard]] const SlabBox& box() const { return box_; }
  [[nodiscard]] std::vector<std::uint64_t> takeWords() { return std::move(words_); }

  /// The leaves that they touch for a point at place x of its leaf, from the lowest slab with a voxel to the highest.
  /// Columns with full leaves come first, and within each group the near ones: a search that stops at a number of
  /// collisions meets them early.
  [[nodiscard]] std::vector<LeafColumn> leafColumns(int x) const {
    std::vector<LeafColumn> list;
    const int begin = (box_.dx + x) >> kLog2, end = (box_.dx + box_.size_x - 1 + x) >> kLog2;
    for (int leaf_x = begin; box_.size_x > 0 && leaf_x <= end; ++leaf_x) {
      for (int y = 0; y < box_.size_y; ++y) addColumn(leaf_x * kSide - x - box_.dx, y, list);
    }
    const auto place = [&](const LeafColumn& c) {
      const int leaf_dx = (c.x - kSide + x + box_.dx) / kSide, leaf_dy = c.y + box_.leaf_dy;
      return std::pair(c.num_full == 0, std::max(std::abs(leaf_dx), std::abs(leaf_dy)));
    };
    std::stable_sort(list.begin(), list.end(),
                     [&](const LeafColumn& a, const LeafColumn& b) { return place(a) < place(b); });
    return list;
  }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return (static_cast<std::size_t>(y) * static_cast<std::size_t>(box_.size_x) + static_cast<std::size_t>(x)) *
           rowWords(box_);
  }
  /// Slab at any x inside or outside the box.
  [[nodiscard]] std::uint64_t slabAt(int x, int y, int z) const {
    return x >= 0 && x < box_.size_x ? words_[index(x, y) + static_cast<std::size_t>(z)] : 0;
  }
  /// The column of a leaf whose eight x begin at `first` of the box, if the tool touches it.
  void addColumn(int first, int y, std::vector<LeafColumn>& list) const {
    int low = box_.size_z, high = -1, run = 0, full_end = 0, full_count = 0;
    for (int z = 0; z < box_.size_z; ++z) {
      std::uint64_t any = 0, all = ~std::uint64_t{0};
      for (int x = first; x < first + kSide; ++x) {
        any |= slabAt(x, y, z);
        all &= slabAt(x, y, z);
      }
      if (any != 0) {
        low = std::min(low, z);
        high = z;
      }
      run = all == ~std::uint64_t{0} ? run + 1 : 0;
      if (run > full_count) {
        full_count = run;
        full_end = z + 1;
      }
    }
    if (high < low) return;
    // None is too high or too wide for these numbers (canBeNumbered).
    LeafColumn column;
    column.x = static_cast<std::uint16_t>(first + kSide);
    column.y = static_cast<std::uint8_t>(y);
    column.z = static_cast<std::uint8_t>(low);
    column.count = static_cast<std::uint8_t>(high - low + 1);
    if (full_count > 0) column.full = static_cast<std::uint8_t>(full_end - full_count - low);
    column.num_full = static_cast<std::uint8_t>(full_count);
    list.push_back(column);
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

/// The tables of a direction, or of a part of one, and a place y.
struct Part {
  SlabBox box;
  std::vector<std::uint64_t> words;
  std::vector<SlabRow> rows;                           ///< if by row; their `first` counts from the part's words
  std::array<std::vector<LeafColumn>, kSide> columns;  ///< by x

  Part() = default;
  explicit Part(Slabs slabs) : box(slabs.box()) {
    for (std::size_t x = 0; x < kSide; ++x) columns[x] = slabs.leafColumns(static_cast<int>(x));
    words = slabs.takeWords();
  }
  /// Leaves out the empty slabs at the ends of rows.
  void packRows() {
    std::vector<std::uint64_t> packed;
    for (std::size_t at = 0; at < words.size(); at += rowWords(box)) {
      const auto row = words.begin() + static_cast<std::ptrdiff_t>(at), end = row + box.size_z;
      const auto isAny = [](std::uint64_t slab) { return slab != 0; };
      const auto low = std::find_if(row, end, isAny);
      const auto high = std::find_if(std::make_reverse_iterator(end), std::make_reverse_iterator(low), isAny).base();
      rows.push_back({static_cast<std::uint32_t>(packed.size()), static_cast<std::uint16_t>(low - row),
                      static_cast<std::uint16_t>(high - low)});
      packed.insert(packed.end(), low, high);
    }
    packed.shrink_to_fit();
    words = std::move(packed);
  }
  [[nodiscard]] std::uint64_t slabBytes() const {
    return words.size() * sizeof(std::uint64_t) + rows.size() * sizeof(SlabRow);
  }
  [[nodiscard]] std::uint64_t columnBytes() const {
    std::uint64_t sum = 0;
    for (const auto& of_x : columns) sum += of_x.size() * sizeof(LeafColumn);
    return sum;
  }
};

/// Words of rows, with those of equal rows kept once: of the rolls of `builtin:pruner`, two rows
/// in three are like another.
class SharedRows {
 public:
  /// @param words  outlives this; nothing else adds to it
  explicit SharedRows(std::vector<std::uint64_t>& words) : words_(words), rows_(0, Hash{words}, Equal{words}) {}

  /// @return where its words begin
  std::uint32_t add(std::span<const std::uint64_t> row) {
    const Row added = {static_cast<std::uint32_t>(words_.size()), static_cast<std::uint32_t>(row.size())};
    words_.insert(words_.end(), row.begin(), row.end());
    const auto [kept, is_new] = rows_.insert(added);
    if (!is_new) words_.resize(added.first);
    return kept->first;
  }

 private:
  struct Row {
    std::uint32_t first, count;
  };
  struct Hash {
    const std::vector<std::uint64_t>& words;
    std::size_t operator()(const Row& row) const {
      std::uint64_t hash = row.count;
      for (std::uint32_t n = 0; n < row.count; ++n) {
        hash = (hash ^ words[row.first + n]) * 0x9e3779b97f4a7c15u;
        hash ^= hash >> 29;
      }
      return hash;
    }
  };
  struct Equal {
    const std::vector<std::uint64_t>& words;
    bool operator()(const Row& a, const Row& b) const {
      const auto at = [this](const Row& row) { return words.begin() + row.first; };
      return a.count == b.count && std::equal(at(a), at(a) + a.count, at(b));
    }
  };

  std::vector<std::uint64_t>& words_;
  std::unordered_set<Row, Hash, Equal> rows_;
};

/// Concatenates parts, freeing each on the way.
ToolSlabs joined(std::vector<Part>& parts) {
  ToolSlabs all;
  std::size_t num_words = 0, num_columns = 0, num_rows = 0;
  for (const Part& part : parts) {
    num_words += part.words.size();
    num_rows += part.rows.size();
    for (const auto& of_x : part.columns) num_columns += of_x.size();
  }
  if (num_rows == 0) {
    all.words.reserve(num_words + 1);
    all.words.push_back(0);  // in front of the first row
  }
  all.columns.reserve(num_columns);
  all.rows.reserve(num_rows);
  SharedRows shared(all.words);
  for (Part& part : parts) {
    if (num_rows > 0) {
      part.box.first = static_cast<std::uint32_t>(all.rows.size());
      for (const SlabRow& row : part.rows) {
        const std::span words(part.words.data() + row.first, row.count);
        all.rows.push_back({row.count > 0 ? shared.add(words) : 0, row.begin, row.count});
      }
    } else {
      part.box.first = static_cast<std::uint32_t>(all.words.size());
      all.words.insert(all.words.end(), part.words.begin(), part.words.end());
    }
    all.boxes.push_back(part.box);
    part.words = {};
    part.rows = {};
  }
  all.begin.push_back(0);
  double num_slabs = 0, num_full = 0;
  for (std::size_t first = 0; first < parts.size(); first += kSide) {
    for (std::size_t x = 0; x < kSide; ++x) {
      for (std::size_t y = 0; y < kSide; ++y) {
        for (const LeafColumn& column : parts[first + y].columns[x]) {
          all.columns.push_back(column);
          num_slabs += column.count;
          num_full += column.num_full;
        }
        all.begin.push_back(static_cast<std::uint32_t>(all.columns.size()));
      }
    }
  }
  all.thick = num_full > 0 && num_full >= kLeastFullShare * num_slabs;
  return all;
}

}  // namespace

ToolSlabs::Limits ToolSlabs::Limits::dividedBy(double share) const {
  const auto part = [&](std::uint64_t limit) { return static_cast<std::uint64_t>(static_cast<double>(limit) / share); };
  return {part(bytes), part(box_bytes)};
}

ToolSlabs ToolSlabs::make(const kernels::ToolKernelView& tool, int num_directions, const Limits& limits) {
  if (tool.use_samples) return {};
  std::vector<Part> parts(static_cast<std::size_t>(num_directions) * static_cast<std::size_t>(tool.parts) * kSide);
  const auto columnsOf = [&](std::size_t n) {
    const std::uint32_t begin = tool.column_begin[n / kSide], end = tool.column_begin[n / kSide + 1];
    return std::span(tool.columns + begin, end - begin);
  };
  const auto placeOf = [](std::size_t n) { return static_cast<int>(n % kSide); };
  std::atomic<std::uint64_t> box_bytes{0}, row_bytes{0}, bytes{0};
  std::atomic<bool> fits{true};
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t n) {
    const std::optional<SlabBox> box = boxOf(columnsOf(n), placeOf(n));
    if (!box || !canBeNumbered(*box)) {
      fits = false;
      return;
    }
    box_bytes.fetch_add(wordsOf(*box) * sizeof(std::uint64_t), std::memory_order_relaxed);
    row_bytes.fetch_add(rowsOf(*box) * sizeof(SlabRow), std::memory_order_relaxed);
  });
  const bool by_row = tool.parts > 1 || box_bytes > limits.box_bytes;
  if (!fits || (by_row && row_bytes > limits.bytes)) return {};
  /// Checks the limit before allocating.
  const auto reserve = [&](std::uint64_t more) {
    if (bytes.fetch_add(more, std::memory_order_relaxed) + more > limits.bytes) fits = false;
    return fits.load();
  };
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t n) {
    if (!fits) return;
    const std::optional<SlabBox> box = boxOf(columnsOf(n), placeOf(n));
    const std::uint64_t of_box = wordsOf(*box) * sizeof(std::uint64_t);
    if (of_box > limits.bytes) fits = false;
    if (!fits || (!by_row && !reserve(of_box))) return;
    parts[n] = Part(Slabs(columnsOf(n), placeOf(n), *box));
    if (by_row) parts[n].packRows();
    if (by_row && !reserve(parts[n].slabBytes())) return;
    if (!reserve(parts[n].columnBytes())) fits = false;
  });
  if (!fits) return {};
  return joined(parts);
}

}  // namespace accessvdb::internal
