// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/leaf_fusion.h"

#include <algorithm>
#include <cmath>
#include <cstring>

// The inner loops are compiled for several instruction sets and chosen at load time. Results are the same: every step is
// an IEEE operation that rounds once (no contraction), in the same order for every lane width.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define ACCESSVDB_SIMD_CLONES __attribute__((target_clones("arch=skylake-avx512", "arch=haswell", "default")))
#else
#define ACCESSVDB_SIMD_CLONES
#endif

namespace accessvdb::internal {
namespace {

/// Most entries between two flushes: 32 767 samples of 65 535 steps fit into 31 bits, and counts into 16.
constexpr std::size_t kEntriesPerFlush = 32767;
constexpr std::uint32_t kPass = 1u << 16;

/// What the slab loops need, in registers.
struct SlabTask {
  float ux, uy, uz, range;
  float ex;                          ///< of the slab
  float leaf_y, leaf_z;              ///< leaf origin minus base voxel
  float offset_y, offset_z;
  int first_lane, last_lane;         ///< [first, last)
  float tau, cone_cos, cone_cos_squared;
  float clamp_low, clamp_high, sample_scale, sample_offset;
  float band_begin, band_end, band_radius_squared;
};

ACCESSVDB_SIMD_CLONES
void fuseDoubleCone(const SlabTask t, std::uint32_t* __restrict sum, std::uint32_t* __restrict counts) {
  const float range_squared = t.range * t.range;
  for (int n = t.first_lane; n < t.last_lane; ++n) {
    const float ey = (t.leaf_y + static_cast<float>(n >> 3)) - t.offset_y;
    const float ez = (t.leaf_z + static_cast<float>(n & 7)) - t.offset_z;
    const float s = (t.ex * t.ux + ey * t.uy) + ez * t.uz;
    const float e2 = (t.ex * t.ex + ey * ey) + ez * ez;
    const bool in_cube = (std::fabs(ey) <= t.tau) & (std::fabs(ez) <= t.tau);
    const bool in_cone = (s * s > t.cone_cos_squared * e2) | (e2 <= 1.0f);
    // R - |x - q|, without the cancellation of two large numbers
    const float two_rs = 2.0f * (t.range * s);
    const float to_sensor = std::sqrt(std::max((range_squared - two_rs) + e2, 0.0f));
    const float d = (two_rs - e2) / (t.range + to_sensor);
    const float clamped = std::min(std::max(d, t.clamp_low), t.clamp_high);
    const auto sample = static_cast<std::int32_t>((clamped - t.sample_offset) * t.sample_scale + 0.5f);
    const bool inside = in_cube & in_cone;
    sum[n] += inside ? static_cast<std::uint32_t>(sample) : 0u;
    counts[n] += inside ? 1u : 0u;
  }
}

ACCESSVDB_SIMD_CLONES
void fuseFullCube(const SlabTask t, std::uint32_t* __restrict sum, std::uint32_t* __restrict counts) {
  const float range_squared = t.range * t.range;
  for (int n = t.first_lane; n < t.last_lane; ++n) {
    const float ey = (t.leaf_y + static_cast<float>(n >> 3)) - t.offset_y;
    const float ez = (t.leaf_z + static_cast<float>(n & 7)) - t.offset_z;
    const float s = (t.ex * t.ux + ey * t.uy) + ez * t.uz;
    const float e2 = (t.ex * t.ex + ey * ey) + ez * ez;
    const bool in_cube = (std::fabs(ey) <= t.tau) & (std::fabs(ez) <= t.tau);
    const float two_rs = 2.0f * (t.range * s);
    const float to_sensor = std::sqrt(std::max((range_squared - two_rs) + e2, 0.0f));
    const bool in_cone = t.range - s > t.cone_cos * to_sensor;
    const float d = (two_rs - e2) / (t.range + to_sensor);
    const float clamped = std::min(std::max(d, t.clamp_low), t.clamp_high);
    const auto sample = static_cast<std::int32_t>((clamped - t.sample_offset) * t.sample_scale + 0.5f);
    const bool inside = in_cube & in_cone;
    sum[n] += inside ? static_cast<std::uint32_t>(sample) : 0u;
    counts[n] += inside ? 1u : 0u;
  }
}

ACCESSVDB_SIMD_CLONES
void passBand(const SlabTask t, std::uint32_t* __restrict counts) {
  for (int n = t.first_lane; n < t.last_lane; ++n) {
    const float ey = (t.leaf_y + static_cast<float>(n >> 3)) - t.offset_y;
    const float ez = (t.leaf_z + static_cast<float>(n & 7)) - t.offset_z;
    const float s = (t.ex * t.ux + ey * t.uy) + ez * t.uz;
    const float e2 = (t.ex * t.ex + ey * ey) + ez * ez;
    const bool along = (s > t.band_begin) & (s <= t.band_end);
    const bool near = e2 - s * s <= t.band_radius_squared;
    counts[n] += (along & near) ? kPass : 0u;
  }
}

/// Facts of a row of eight voxels, bit z each, before and after the fold.
struct RowFacts {
  std::uint32_t old_collides = 0, now_collides = 0, old_observed = 0, now_observed = 0;
};

/// Folds the sums of one row: new mean = (mean * weight + sum) / (weight + samples), rounded to nearest. Exact in
/// double: all terms are integers below 2^53.
[[gnu::always_inline]] inline RowFacts foldRow(std::uint32_t* __restrict packed, const double* __restrict sum,
                                               const std::int32_t* __restrict samples, std::int32_t max_weight,
                                               std::int32_t collision_mean) {
  alignas(64) std::uint32_t facts[8];
  for (int z = 0; z < 8; ++z) {
    const auto mean = static_cast<std::int32_t>(packed[z] >> kWeightBits);
    const auto weight = static_cast<std::int32_t>(packed[z] & kWeightMask);
    const std::int32_t total = weight + samples[z];
    const double numerator = static_cast<double>(mean) * static_cast<double>(weight) + 16.0 * sum[z];
    // Lanes without any observation would divide zero by zero; their mean stays 0.
    const double quotient = numerator / static_cast<double>(std::max(total, 1));
    const auto new_mean = static_cast<std::int32_t>(quotient + 0.5);
    const std::int32_t now_mean = samples[z] > 0 ? new_mean : mean;
    const std::int32_t now_weight = samples[z] > 0 ? std::min(total, max_weight) : weight;
    packed[z] = static_cast<std::uint32_t>(now_mean) << kWeightBits | static_cast<std::uint32_t>(now_weight);
    const std::uint32_t was_observed = weight > 0 ? 1u : 0u, is_observed = now_weight > 0 ? 1u : 0u;
    const std::uint32_t did_collide = (mean < collision_mean) & (weight > 0) ? 1u : 0u;
    const std::uint32_t does_collide = (now_mean < collision_mean) & (now_weight > 0) ? 1u : 0u;
    facts[z] = (did_collide | does_collide << 8 | was_observed << 16 | is_observed << 24) << z;
  }
  std::uint32_t all = 0;
  for (int z = 0; z < 8; ++z) all |= facts[z];
  return {all & 0xffu, all >> 8 & 0xffu, all >> 16 & 0xffu, all >> 24};
}

/// What a fold reads: sums of one scan, narrow or wide.
struct NarrowSums {
  const LeafSums& sums;
  [[gnu::always_inline]] inline void row(int first, double* sum, std::int32_t* samples, std::uint32_t* passes) const {
    for (int z = 0; z < 8; ++z) {
      sum[z] = static_cast<double>(static_cast<std::int32_t>(sums.distance[static_cast<std::size_t>(first + z)]));
      samples[z] = static_cast<std::int32_t>(sums.counts[static_cast<std::size_t>(first + z)] & 0xffffu);
      passes[z] = sums.counts[static_cast<std::size_t>(first + z)] >> 16;
    }
  }
};
struct WideRows {
  const WideSums& sums;
  [[gnu::always_inline]] inline void row(int first, double* sum, std::int32_t* samples, std::uint32_t* passes) const {
    for (int z = 0; z < 8; ++z) {
      sum[z] = static_cast<double>(sums.distance[static_cast<std::size_t>(first + z)]);
      samples[z] = static_cast<std::int32_t>(sums.samples[static_cast<std::size_t>(first + z)]);
      passes[z] = sums.passes[static_cast<std::size_t>(first + z)];
    }
  }
};

/// Folds a leaf row by row. `packed` may be null where there are no samples; `cleared` are the leaf's eight mask words.
template <typename Sums>
[[gnu::always_inline]] inline bool foldRows(const Sums& sums, std::uint32_t* packed, std::uint64_t* cleared,
                                            std::int32_t max_weight, std::int32_t collision_mean, LeafChange& change,
                                            FoldCounts& counts) {
  bool flipped = false;
  std::uint64_t samples_total = 0, passes_total = 0, newly_observed = 0;
  for (int x = 0; x < 8; ++x) {
    std::uint64_t collides_on = 0, collides_off = 0, arm_on = 0, arm_off = 0, cleared_now = 0;
    for (int y = 0; y < 8; ++y) {
      const int first = x * 64 + y * 8;
      alignas(64) double sum[8];
      alignas(64) std::int32_t samples[8];
      alignas(64) std::uint32_t passes[8];
      sums.row(first, sum, samples, passes);
      std::uint32_t sample_count = 0, pass_count = 0, passed = 0;
      for (int z = 0; z < 8; ++z) {
        sample_count += static_cast<std::uint32_t>(samples[z]);
        pass_count += passes[z];
        passed |= (passes[z] > 0 ? 1u : 0u) << z;
      }
      if ((sample_count | pass_count) == 0) continue;
      samples_total += sample_count;
      passes_total += pass_count;
      RowFacts facts;
      if (packed != nullptr) facts = foldRow(packed + first, sum, samples, max_weight, collision_mean);
      newly_observed += static_cast<std::uint64_t>(__builtin_popcount(facts.now_observed & ~facts.old_observed));

      const auto old_cleared = static_cast<std::uint32_t>(cleared[x] >> (y * 8) & 0xffu);
      const std::uint32_t now_cleared = old_cleared | passed;
      const std::uint32_t old_arm = (facts.old_observed & ~facts.old_collides) | (~facts.old_observed & old_cleared);
      const std::uint32_t now_arm = (facts.now_observed & ~facts.now_collides) | (~facts.now_observed & now_cleared);
      const auto at_row = [y](std::uint32_t bits) { return static_cast<std::uint64_t>(bits & 0xffu) << (y * 8); };
      cleared_now |= at_row(passed);
      collides_on |= at_row(facts.now_collides & ~facts.old_collides);
      collides_off |= at_row(facts.old_collides & ~facts.now_collides);
      arm_on |= at_row(now_arm & ~old_arm);
      arm_off |= at_row(old_arm & ~now_arm);
    }
    const auto word = static_cast<std::size_t>(x);
    cleared[x] |= cleared_now;
    change.collides_on[word] = collides_on;
    change.collides_off[word] = collides_off;
    change.arm_free_on[word] = arm_on;
    change.arm_free_off[word] = arm_off;
    flipped |= (collides_on | collides_off | arm_on | arm_off) != 0;
  }
  counts.distance_updates += samples_total;
  counts.cleared_updates += passes_total;
  counts.newly_observed += newly_observed;
  return flipped;
}

ACCESSVDB_SIMD_CLONES
bool foldNarrow(const LeafSums& sums, std::uint32_t* packed, std::uint64_t* cleared, std::int32_t max_weight,
                std::int32_t collision_mean, LeafChange& change, FoldCounts& counts) {
  return foldRows(NarrowSums{sums}, packed, cleared, max_weight, collision_mean, change, counts);
}

/// Rare: more returns reach the leaf than narrow sums hold.
bool foldWide(const WideSums& sums, std::uint32_t* packed, std::uint64_t* cleared, std::int32_t max_weight,
              std::int32_t collision_mean, LeafChange& change, FoldCounts& counts) {
  return foldRows(WideRows{sums}, packed, cleared, max_weight, collision_mean, change, counts);
}

}  // namespace

LeafFusion::LeafFusion(const PackedMap& map, const RegionShape& shape) : map_(map), shape_(shape) {
  const TsdfParams& p = map.params();
  clamp_low_ = static_cast<float>(p.clamp_min_m / p.voxel_size_m);
  clamp_high_ = shape.tau;
  sample_offset_ = clamp_low_;
  sample_scale_ = static_cast<float>(kSampleSteps) / (clamp_high_ - clamp_low_);
}

void LeafFusion::flushSums() {
  if (!wide_) wide_sums_ = WideSums{};
  wide_ = true;
  for (std::size_t n = 0; n < 512; ++n) {
    wide_sums_.distance[n] += sums_.distance[n];
    wide_sums_.samples[n] += sums_.counts[n] & 0xffffu;
    wide_sums_.passes[n] += sums_.counts[n] >> 16;
  }
  sums_.distance.fill(0);
  sums_.counts.fill(0);
}

bool LeafFusion::accumulate(const std::array<std::int32_t, 3>& origin_ijk, std::span<const LeafEntry> entries,
                            const ReturnRay* rays) {
  sums_.distance.fill(0);
  sums_.counts.fill(0);
  wide_ = false;
  std::size_t since_flush = 0;
  for (const LeafEntry entry : entries) {
    if (++since_flush > kEntriesPerFlush) {
      flushSums();
      since_flush = 1;
    }
    const ReturnRay& ray = rays[entry.index()];
    std::array<float, 3> leaf;
    for (int axis = 0; axis < 3; ++axis) leaf[axis] = static_cast<float>(origin_ijk[axis] - ray.base_ijk[axis]);

    if (entry.band() && shape_.thinBand()) {
      // Paper: the voxels nearest to samples every v/2 along the ray.
      for (int m = 1;; ++m) {
        const float s = shape_.band_begin + 0.5f * static_cast<float>(m);
        if (!(s <= std::min(shape_.band_end, ray.range))) break;
        int local[3];
        bool inside = true;
        for (int axis = 0; axis < 3; ++axis) {
          local[axis] = static_cast<int>(std::floor(ray.offset[axis] + s * ray.to_sensor[axis] + 0.5f)) -
                        (origin_ijk[axis] - ray.base_ijk[axis]);
          inside = inside && local[axis] >= 0 && local[axis] < 8;
        }
        if (inside) {
          std::uint32_t& count = sums_.counts[static_cast<std::size_t>(local[0] << 6 | local[1] << 3 | local[2])];
          if (count >> 16 < 0xffffu) count += kPass;
        }
      }
      continue;
    }

    // Bounds of the region inside this leaf, from its slice along the ray's dominant axis.
    const RegionSlices slices(shape_, ray);
    const int a = slices.dominantAxis(), b = slices.axisB(), c = slices.axisC();
    const Interval whole = entry.band() ? slices.bandAlong() : slices.coneAlong();
    const float first = leaf[a] - ray.offset[a];
    std::array<Interval, 3> bounds;
    bounds[a] = {std::max(whole.low, first), std::min(whole.high, first + 7.0f)};
    if (bounds[a].empty()) continue;
    bounds[b] = entry.band() ? slices.bandAcross(bounds[a], 0) : slices.coneAcross(bounds[a], 0);
    bounds[c] = entry.band() ? slices.bandAcross(bounds[a], 1) : slices.coneAcross(bounds[a], 1);
    const auto firstIndex = [&](int axis) {
      return std::max(0, static_cast<int>(std::ceil(bounds[axis].low - (leaf[axis] - ray.offset[axis]) - 1e-3f)));
    };
    const auto lastIndex = [&](int axis) {
      return std::min(7, static_cast<int>(std::floor(bounds[axis].high - (leaf[axis] - ray.offset[axis]) + 1e-3f)));
    };
    const int x0 = firstIndex(0), x1 = lastIndex(0);
    const int y0 = firstIndex(1), y1 = lastIndex(1);
    if (y0 > y1 || firstIndex(2) > lastIndex(2)) continue;

    SlabTask task;
    task.ux = ray.to_sensor[0], task.uy = ray.to_sensor[1], task.uz = ray.to_sensor[2];
    task.range = ray.range;
    task.leaf_y = leaf[1], task.leaf_z = leaf[2];
    task.offset_y = ray.offset[1], task.offset_z = ray.offset[2];
    task.tau = shape_.tau, task.cone_cos = shape_.cone_cos, task.cone_cos_squared = shape_.cone_cos_squared;
    task.clamp_low = clamp_low_, task.clamp_high = clamp_high_;
    task.sample_scale = sample_scale_, task.sample_offset = sample_offset_;
    task.band_begin = shape_.band_begin, task.band_end = std::min(shape_.band_end, ray.range);
    task.band_radius_squared = shape_.band_radius * shape_.band_radius;
    task.first_lane = y0 * 8, task.last_lane = y1 * 8 + 8;
    for (int x = x0; x <= x1; ++x) {
      task.ex = (leaf[0] + static_cast<float>(x)) - ray.offset[0];
      std::uint32_t* sum = sums_.distance.data() + x * 64;
      std::uint32_t* counts = sums_.counts.data() + x * 64;
      if (a == 0) {  // the slab is a slice: bound its rows again
        const Interval slice = {task.ex, task.ex};
        const Interval across = entry.band() ? slices.bandAcross(slice, b == 1 ? 0 : 1) : slices.coneAcross(slice, b == 1 ? 0 : 1);
        const float row0 = leaf[1] - ray.offset[1];
        const int first_row = std::max(0, static_cast<int>(std::ceil(across.low - row0 - 1e-3f)));
        const int last_row = std::min(7, static_cast<int>(std::floor(across.high - row0 + 1e-3f)));
        if (first_row > last_row) continue;
        task.first_lane = first_row * 8, task.last_lane = last_row * 8 + 8;
      }
      if (entry.band()) {
        passBand(task, counts);
      } else if (!(std::fabs(task.ex) <= shape_.tau)) {
        continue;
      } else if (shape_.region == UpdateRegion::DoubleCone) {
        fuseDoubleCone(task, sum, counts);
      } else {
        fuseFullCube(task, sum, counts);
      }
    }
  }
  std::uint32_t any = 0;
  if (wide_) {
    flushSums();
    for (std::size_t n = 0; n < 512; ++n) {
      any |= (wide_sums_.samples[n] > 0 ? 1u : 0u) | (wide_sums_.passes[n] > 0 ? kPass : 0u);
    }
  } else {
    for (std::size_t n = 0; n < 512; ++n) any |= sums_.counts[n];
  }
  has_samples_ = (any & 0xffffu) != 0;
  return any != 0;
}

bool LeafFusion::fold(PackedLeaf& leaf, LeafChange& change, FoldCounts& counts) const {
  const auto& origin = leaf.origin();
  change.origin_ijk = {origin.x(), origin.y(), origin.z()};
  const auto max_weight = static_cast<std::int32_t>(map_.params().max_weight);
  const auto collision_mean = static_cast<std::int32_t>(map_.collisionMean());
  std::uint64_t* cleared = &leaf.getValueMask().template getWord<std::uint64_t>(0);
  return wide_ ? foldWide(wide_sums_, packedValues(leaf), cleared, max_weight, collision_mean, change, counts)
               : foldNarrow(sums_, packedValues(leaf), cleared, max_weight, collision_mean, change, counts);
}

}  // namespace accessvdb::internal
