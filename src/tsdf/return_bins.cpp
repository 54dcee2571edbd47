// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/return_bins.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kReturnsPerChunk = 1024;
constexpr std::int64_t kKeyBias = 1 << 20;

std::uint64_t mix(std::uint64_t key) {
  key ^= key >> 31;
  key *= 0x9e3779b97f4a7c15ull;
  return key ^ key >> 29;
}

/// Buckets hold blocks of 4x4x4 leaves.
std::size_t bucketOf(LeafKey key) {
  constexpr std::uint64_t kBlock = ~std::uint64_t{3 | 3ull << 21 | 3ull << 42};
  return mix(key & kBlock) >> 56;
}
static_assert(ReturnBins::kBuckets == 256, "bucketOf() takes eight bits");

/// std::floor() is a call on x86-64 without SSE4.1.
std::int32_t floorOf(float value) {
  const auto n = static_cast<std::int32_t>(value);
  return n - (static_cast<float>(n) > value ? 1 : 0);
}

/// First and last leaf along one axis for voxels with offsets in [low, high] from the return.
struct LeafSpan {
  std::int32_t first, last;
};
LeafSpan leafSpan(const ReturnRay& ray, int axis, Interval offsets) {
  const auto low = -floorOf(-(offsets.low + ray.offset[axis]));
  const auto high = floorOf(offsets.high + ray.offset[axis]);
  return {(ray.base_ijk[axis] + low) >> 3, (ray.base_ijk[axis] + high) >> 3};
}

/// Visits the leaves of one part (cone or band) layer by layer across the ray's dominant axis.
template <typename Across, typename Visit>
void visitLayers(const ReturnRay& ray, const RegionSlices& slices, Interval along, const Across& across,
                 const Visit& visit) {
  if (along.empty()) return;
  const int a = slices.dominantAxis(), b = slices.axisB(), c = slices.axisC();
  const LeafSpan layers = leafSpan(ray, a, along);
  for (std::int32_t layer = layers.first; layer <= layers.last; ++layer) {
    const float first = static_cast<float>(layer * 8 - ray.base_ijk[a]) - ray.offset[a];
    const Interval slice = {std::max(along.low, first), std::min(along.high, first + 7.0f)};
    if (slice.empty()) continue;
    const LeafSpan rows = leafSpan(ray, b, across(slice, 0)), columns = leafSpan(ray, c, across(slice, 1));
    std::array<std::int32_t, 3> leaf;
    leaf[a] = layer;
    for (leaf[b] = rows.first; leaf[b] <= rows.last; ++leaf[b]) {
      for (leaf[c] = columns.first; leaf[c] <= columns.last; ++leaf[c]) visit(leafKeyOf(leaf[0], leaf[1], leaf[2]));
    }
  }
}

}  // namespace

LeafKey leafKeyOf(std::int32_t x, std::int32_t y, std::int32_t z) {
  return static_cast<LeafKey>(x + kKeyBias) << 42 | static_cast<LeafKey>(y + kKeyBias) << 21 |
         static_cast<LeafKey>(z + kKeyBias);
}

std::array<std::int32_t, 3> originOf(LeafKey key) {
  constexpr std::uint64_t kAxis = (1ull << 21) - 1;
  const auto axis = [&](int shift) {
    return static_cast<std::int32_t>(static_cast<std::int64_t>(key >> shift & kAxis) - kKeyBias) * 8;
  };
  return {axis(42), axis(21), axis(0)};
}

/// Calls visit(LeafKey, LeafEntry) for every leaf that the return's region may reach. Conservative.
template <typename Visit>
void forEachReachedLeaf(const RegionShape& shape, const RegionSlices& slices, const ReturnRay& ray, std::uint32_t index,
                        const Visit& visit) {
  visitLayers(
      ray, slices, slices.coneAlong(), [&](Interval slice, int n) { return slices.coneAcross(slice, n); },
      [&](LeafKey key) { visit(key, LeafEntry{index << 1}); });
  if (!shape.thinBand()) {
    visitLayers(
        ray, slices, slices.bandAlong(), [&](Interval slice, int n) { return slices.bandAcross(slice, n); },
        [&](LeafKey key) { visit(key, LeafEntry{index << 1 | LeafEntry::kBand}); });
    return;
  }
  LeafKey last = ~LeafKey{0};
  for (int m = 1;; ++m) {  // the same samples as LeafFusion's
    const float s = shape.band_begin + 0.5f * static_cast<float>(m);
    if (!(s <= std::min(shape.band_end, ray.range))) break;
    std::int32_t leaf[3];
    for (int axis = 0; axis < 3; ++axis) {
      leaf[axis] = (ray.base_ijk[axis] +
                    static_cast<std::int32_t>(std::floor(ray.offset[axis] + s * ray.to_sensor[axis] + 0.5f))) >>
                   3;
    }
    const LeafKey key = leafKeyOf(leaf[0], leaf[1], leaf[2]);
    if (key != last) visit(key, LeafEntry{index << 1 | LeafEntry::kBand});  // a straight line never comes back
    last = key;
  }
}

void ReturnBins::bin(const RegionShape& shape, std::span<ReturnRay> rays) {
  chunk_count_ = (rays.size() + kReturnsPerChunk - 1) / kReturnsPerChunk;
  if (chunks_.size() < chunk_count_) chunks_.resize(chunk_count_);
  tbb::parallel_for(std::size_t{0}, chunk_count_, [&](std::size_t n) {
    Chunk& chunk = chunks_[n];
    for (auto& bucket : chunk) bucket.clear();
    const std::size_t end = std::min(rays.size(), (n + 1) * kReturnsPerChunk);
    for (std::size_t i = n * kReturnsPerChunk; i < end; ++i) {
      const RegionSlices slices(shape, rays[i]);
      rays[i].cone_x = slices.coneX();
      rays[i].band_x = slices.bandX();
      forEachReachedLeaf(shape, slices, rays[i], static_cast<std::uint32_t>(i), [&](LeafKey key, LeafEntry entry) {
        chunk[bucketOf(key)].push_back({key, entry});
      });
    }
  });
}

void ReturnBins::group(std::size_t bucket, LeafGroups& groups) const {
  groups.keys.clear();
  groups.begin.clear();
  groups.entries.clear();
  std::size_t pairs = 0;
  for (std::size_t n = 0; n < chunk_count_; ++n) pairs += chunks_[n][bucket].size();
  if (pairs == 0) return;

  constexpr std::uint32_t kEmpty = ~std::uint32_t{0};
  const std::size_t capacity = std::bit_ceil(pairs * 2);
  thread_local std::vector<std::uint32_t> table, counts, group_of_pair;
  table.assign(capacity, kEmpty);
  counts.clear();
  group_of_pair.clear();
  group_of_pair.reserve(pairs);
  for (std::size_t n = 0; n < chunk_count_; ++n) {
    for (const Pair& pair : chunks_[n][bucket]) {
      std::size_t slot = mix(pair.key) & (capacity - 1);
      while (table[slot] != kEmpty && groups.keys[table[slot]] != pair.key) slot = (slot + 1) & (capacity - 1);
      if (table[slot] == kEmpty) {
        table[slot] = static_cast<std::uint32_t>(groups.keys.size());
        groups.keys.push_back(pair.key);
        counts.push_back(0);
      }
      ++counts[table[slot]];
      group_of_pair.push_back(table[slot]);
    }
  }
  groups.begin.assign(groups.keys.size() + 1, 0);
  for (std::size_t g = 0; g < counts.size(); ++g) groups.begin[g + 1] = groups.begin[g] + counts[g];
  groups.entries.assign(pairs + LeafFusion::kLookAhead, LeafEntry{});
  counts.assign(groups.begin.begin(), groups.begin.end() - 1);
  std::size_t pair_number = 0;
  for (std::size_t n = 0; n < chunk_count_; ++n) {
    for (const Pair& pair : chunks_[n][bucket]) groups.entries[counts[group_of_pair[pair_number++]]++] = pair.entry;
  }
}

}  // namespace accessvdb::internal
