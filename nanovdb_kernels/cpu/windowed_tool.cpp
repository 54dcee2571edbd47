// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cpu/windowed_tool.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <tuple>

namespace accessvdb::kernels {
namespace {

/// Points of inner leaves share a window: 2 x 2 columns of leaves, and all that their searches read around them.
constexpr int kGroupXyLog2 = 1, kMostGroupZLog2 = 3;
/// Rounding of float32 positions far from the origin, in voxels. A sample that falls outside the box all the same is
/// read from the map itself.
constexpr double kRounding = 0.25;
/// Gaps of a run that are filled with empty words.
constexpr std::int32_t kMostGap = 2;

/// Box of voxel offsets from the point's voxel.
struct OffsetBox {
  std::array<std::int32_t, 3> low, high;

  OffsetBox() {
    low.fill(std::numeric_limits<std::int32_t>::max());
    high.fill(std::numeric_limits<std::int32_t>::min());
  }
  [[nodiscard]] bool empty() const { return low[0] > high[0]; }
  void add(std::size_t axis, std::int32_t first, std::int32_t last) {
    low[axis] = std::min(low[axis], first);
    high[axis] = std::max(high[axis], last);
  }
  void add(const float* offset_m, float inverse_voxel_size) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double voxels = static_cast<double>(offset_m[axis]) * static_cast<double>(inverse_voxel_size);
      if (voxels == 0) {
        add(axis, 0, 0);
      } else {
        add(axis, static_cast<std::int32_t>(std::floor(voxels - kRounding)),
            static_cast<std::int32_t>(std::ceil(voxels + kRounding)));
      }
    }
  }
  void add(const VoxelColumn& column) {
    if (column.bits == 0) return;
    add(0, column.dx, column.dx);
    add(1, column.dy, column.dy);
    add(2, column.dz + std::countr_zero(column.bits), column.dz + 63 - std::countl_zero(column.bits));
  }
};

/// A word of the tool.
struct ToolWord {
  std::int32_t layer, dx, dy;
  std::uint64_t bits;
};

std::vector<ToolWord> wordsOf(std::span<const VoxelColumn> columns, std::int32_t low_z) {
  std::vector<ToolWord> words;
  words.reserve(columns.size());
  for (const VoxelColumn& column : columns) {
    if (column.bits == 0) continue;
    const int lowest = std::countr_zero(column.bits);
    const std::int32_t from = column.dz + lowest - low_z;
    const std::uint64_t bits = column.bits >> lowest;
    const int shift = from & 63;
    words.push_back({from >> 6, column.dx, column.dy, bits << shift});
    const std::uint64_t rest = shift == 0 ? 0 : bits >> (64 - shift);
    if (rest != 0) words.push_back({(from >> 6) + 1, column.dx, column.dy, rest});
  }
  const auto place = [](const ToolWord& word) { return std::tuple(word.layer, word.dx, word.dy); };
  std::ranges::sort(words, [&](const ToolWord& a, const ToolWord& b) { return place(a) < place(b); });
  std::size_t out = 0;
  for (const ToolWord& word : words) {
    if (out > 0 && place(words[out - 1]) == place(word)) {
      words[out - 1].bits |= word.bits;
    } else {
      words[out++] = word;
    }
  }
  words.resize(out);
  return words;
}

}  // namespace

struct WindowedTool::Part {
  std::vector<Layer> layers;
  std::vector<WindowRun> runs;
  std::vector<std::uint64_t> words;
  std::vector<std::int32_t> leaves;
};

WindowedTool::WindowedTool(const ToolKernelView& tool, const ApproachView& approach, float inverse_voxel_size) {
  chooseShape(tool, approach, inverse_voxel_size);
  if (shape_.bytes() > kMostWindowBytes) return;
  const int directions = approach.num_directions;
  usable_ = true;
  makeCorridors(approach, inverse_voxel_size);
  if (tool.use_samples) return;
  const int parts = directions * tool.parts;
  if (std::uint64_t{tool.column_begin[parts]} * sizeof(VoxelColumn) > kMostColumnBytes) {
    usable_ = false;
    return;
  }
  std::vector<Part> made(static_cast<std::size_t>(parts));
  tbb::parallel_for(0, parts, [&](int part) { made[static_cast<std::size_t>(part)] = makePart(tool, part); });
  const auto reserve = [&](auto& list, auto Part::*member) {
    std::size_t size = 0;
    for (const Part& from : made) size += (from.*member).size();
    list.reserve(size);
  };
  reserve(layers_, &Part::layers);
  reserve(runs_, &Part::runs);
  reserve(words_, &Part::words);
  reserve(leaves_, &Part::leaves);
  layer_begin_ = {0};
  leaf_begin_ = {0};
  for (Part& from : made) {
    const auto runs = static_cast<std::uint32_t>(runs_.size()), words = static_cast<std::uint32_t>(words_.size());
    for (const Layer& layer : from.layers) layers_.push_back({layer.dz, layer.begin + runs, layer.end + runs});
    for (const WindowRun& run : from.runs) runs_.push_back({run.offset, run.first + words, run.count});
    words_.insert(words_.end(), from.words.begin(), from.words.end());
    leaves_.insert(leaves_.end(), from.leaves.begin(), from.leaves.end());
    layer_begin_.push_back(static_cast<std::uint32_t>(layers_.size()));
    leaf_begin_.push_back(static_cast<std::uint32_t>(leaves_.size()));
    from = {};
  }
}

void WindowedTool::chooseShape(const ToolKernelView& tool, const ApproachView& approach, float inverse_voxel_size) {
  OffsetBox box;
  for (std::size_t axis = 0; axis < 3; ++axis) box.add(axis, 0, 0);
  const int directions = approach.num_directions, parts = directions * tool.parts;
  if (tool.use_samples) {
    for (std::uint32_t n = 0; n < tool.sample_begin[parts]; ++n) {
      box.add(tool.samples + 3 * std::size_t{n}, inverse_voxel_size);
    }
  } else {
    for (std::uint32_t n = 0; n < tool.column_begin[parts]; ++n) box.add(tool.columns[n]);
  }
  for (std::ptrdiff_t n = 0; n < std::ptrdiff_t{directions} * approach.num_arm; ++n) {
    box.add(approach.arm_offsets + 3 * n, inverse_voxel_size);
  }
  // A point may lie anywhere in its leaf, and its leaf anywhere among the inner ones.
  const auto fit = [&](std::size_t axis, int log2) {
    shape_.low[axis] = box.low[axis] >> 3;
    shape_.size[axis] = ((box.high[axis] + 7) >> 3) - shape_.low[axis] + (1 << log2);
  };
  shape_.xy_log2 = kGroupXyLog2;
  fit(0, kGroupXyLog2);
  fit(1, kGroupXyLog2);
  fit(2, 0);
  // As tall as it gets without another word.
  const std::int32_t words = shape_.words();
  for (int log2 = kMostGroupZLog2; log2 >= 0; --log2) {
    shape_.z_log2 = log2;
    fit(2, log2);
    if (shape_.words() == words) break;
  }
}

void WindowedTool::makeCorridors(const ApproachView& approach, float inverse_voxel_size) {
  constexpr std::int32_t kMostColumns = 400;  // of leaves; more are only copied where they are needed
  const auto samples = static_cast<std::size_t>(approach.num_arm);
  OffsetBox box;
  for (std::size_t n = 0; n < samples * static_cast<std::size_t>(approach.num_directions); ++n) {
    if (approach.arm_offsets[3 * n + 2] != 0) return;
    box.add(approach.arm_offsets + 3 * n, inverse_voxel_size);
  }
  if (box.empty()) return;
  // From any inner leaf, in leaves of the window.
  const auto first = [&](std::size_t axis) { return (box.low[axis] >> 3) - shape_.low[axis]; };
  const auto last = [&](std::size_t axis) {
    return ((box.high[axis] + 7) >> 3) - shape_.low[axis] + (1 << shape_.xy_log2) - 1;
  };
  corridor_leaves_ = {first(0), first(1), last(0), last(1)};
  const std::int32_t columns = (last(0) - first(0) + 1) * (last(1) - first(1) + 1);
  if (columns > kMostColumns) return;
  constexpr std::size_t kLanes = FlatSamples::kLanes;
  corridor_length_ = (samples + kLanes - 1) / kLanes;
  corridors_.resize(corridor_length_ * static_cast<std::size_t>(approach.num_directions), FlatSamples{});
  for (std::size_t d = 0; d < static_cast<std::size_t>(approach.num_directions); ++d) {
    for (std::size_t n = 0; n < samples; ++n) {
      FlatSamples& to = corridors_[d * corridor_length_ + n / kLanes];
      to.x[n % kLanes] = approach.arm_offsets[3 * (d * samples + n)];
      to.y[n % kLanes] = approach.arm_offsets[3 * (d * samples + n) + 1];
    }
  }
}

WindowedTool::Part WindowedTool::makePart(const ToolKernelView& tool, int part) const {
  Part made;
  const std::uint32_t begin = tool.column_begin[part], end = tool.column_begin[part + 1];
  const std::span columns(tool.columns + begin, end - begin);
  OffsetBox box;
  for (const VoxelColumn& column : columns) box.add(column);
  if (box.empty()) return made;
  const auto stride = static_cast<std::int32_t>(shape_.stride());
  std::int32_t layer = -1, dx = 0, dy = 0;  // of the last word
  for (const ToolWord& word : wordsOf(columns, box.low[2])) {
    if (word.layer != layer) {
      const auto runs = static_cast<std::uint32_t>(made.runs.size());
      made.layers.push_back({box.low[2] + 64 * word.layer, runs, runs});
    }
    const bool follows = word.layer == layer && word.dx == dx && word.dy - dy <= kMostGap + 1;
    if (!follows) {
      made.runs.push_back({word.dx * stride + word.dy, static_cast<std::uint32_t>(made.words.size()), 0});
      ++made.layers.back().end;
    } else {
      made.words.insert(made.words.end(), static_cast<std::size_t>(word.dy - dy - 1), 0);
    }
    made.words.push_back(word.bits);
    made.runs.back().count = static_cast<std::uint32_t>(made.words.size()) - made.runs.back().first;
    layer = word.layer, dx = word.dx, dy = word.dy;
  }
  for (const VoxelColumn& column : columns) {
    if (column.bits == 0) continue;
    for (std::int32_t x = column.dx >> 3; x <= (column.dx + 7) >> 3; ++x) {
      for (std::int32_t y = column.dy >> 3; y <= (column.dy + 7) >> 3; ++y) {
        made.leaves.push_back(x * shape_.size[1] + y);
      }
    }
  }
  std::ranges::sort(made.leaves);
  const auto repeats = std::ranges::unique(made.leaves);
  made.leaves.erase(repeats.begin(), repeats.end());
  return made;
}

std::uint64_t WindowedTool::bytes() const {
  const auto bytesOf = [](const auto& list) { return list.capacity() * sizeof(list[0]); };
  return bytesOf(layers_) + bytesOf(runs_) + bytesOf(words_) + bytesOf(leaves_) + bytesOf(layer_begin_) +
         bytesOf(leaf_begin_) + bytesOf(corridors_);
}

}  // namespace accessvdb::kernels
