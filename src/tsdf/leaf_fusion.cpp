// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/leaf_fusion.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace accessvdb::internal {

namespace {

constexpr std::size_t kCompactBytesAhead = 512;  ///< of a compact leaf, fetched before it is read

}  // namespace

KernelConstants kernelConstants(const PackedMap& map, const RegionShape& shape) {
  const TsdfParams& p = map.params();
  KernelConstants constants;
  constants.tau = shape.tau;
  constants.cone_cos = shape.cone_cos;
  constants.cone_cos_squared = shape.cone_cos_squared;
  constants.clamp_low = static_cast<float>(p.clamp_min_m / p.voxel_size_m);
  constants.clamp_high = shape.tau;
  constants.sample_scale = static_cast<float>(kSampleSteps) / (constants.clamp_high - constants.clamp_low);
  constants.band_begin = shape.band_begin;
  constants.band_end = shape.band_end;
  constants.band_radius_squared = shape.band_radius * shape.band_radius;
  constants.line_end = shape.line_end;
  constants.ball_radius_squared = shape.ball_radius * shape.ball_radius;
  constants.max_weight = static_cast<std::int32_t>(p.max_weight);
  constants.collision_mean = static_cast<std::int32_t>(map.collisionMean());
  // Votes exist only with a collision distance that no longer changes.
  constants.collision_sample = static_cast<std::int32_t>((map.newsRule().collision_mean + 15) / 16);
  constants.zero_mean = static_cast<std::int32_t>(std::lround(-constants.clamp_low * constants.sample_scale * 16));
  return constants;
}

LeafFusion::LeafFusion(const PackedMap& map, const RegionShape& shape, const LeafKernels& kernels)
    : map_(map), shape_(shape), kernels_(kernels), constants_(kernelConstants(map, shape)) {}

void LeafFusion::clearSums() { std::fill(std::begin(sums_.packed), std::end(sums_.packed), 0u); }

void LeafFusion::flushSums() {
  if (!wide_) wide_sums_ = WideSums{};
  wide_ = true;
  for (std::size_t n = 0; n < 512; ++n) {
    wide_sums_.distance[n] += LeafSums::distanceOf(sums_.packed[n]);
    wide_sums_.samples[n] += LeafSums::samplesOf(sums_.packed[n]);
  }
  clearSums();
}

void LeafFusion::markThinBand(const std::array<std::int32_t, 3>& origin_ijk, const ReturnRay& ray) {
  int last = -1;
  kernels::forEachThinBandVoxel(shape_, ray, [&](const std::int32_t* ijk) {
    std::array<int, 3> local;
    bool inside = true;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      local[axis] = ijk[axis] - (origin_ijk[axis] - ray.base_ijk[axis]);
      inside = inside && local[axis] >= 0 && local[axis] < 8;
    }
    const int voxel = local[0] << 6 | local[1] << 3 | local[2];
    if (!inside || voxel == last) return;  // two samples in one voxel; a straight line never returns
    last = voxel;
    pass(voxel);
  });
}

void LeafFusion::pass(int voxel) {
  passed_[static_cast<std::size_t>(voxel >> 6)] |= std::uint64_t{1} << (voxel & 63);
  ++passes_;
}

void LeafFusion::markLine(const std::array<std::int32_t, 3>& origin_ijk, const ReturnRay& ray) {
  const kernels::ClearedLine line(ray, constants_.band_end, constants_.line_end);
  const auto axis = static_cast<std::size_t>(line.axis);
  const kernels::LineLayers layers(line, origin_ijk[axis] - ray.base_ijk[axis]);
  for (std::int32_t n = layers.first; n <= layers.last; ++n) {
    const int voxel = kernels::lineVoxelIn(origin_ijk.data(), ray, line, n);
    if (voxel >= 0) pass(voxel);
  }
}

void LeafFusion::markBall(const std::array<std::int32_t, 3>& origin_ijk, const ReturnRay& ball) {
  for (int voxel = 0; voxel < 512; ++voxel)
    if (kernels::isInBall(origin_ijk.data(), voxel, ball, constants_.ball_radius_squared)) pass(voxel);
}

bool LeafFusion::accumulate(const std::array<std::int32_t, 3>& origin_ijk, std::span<const LeafEntry> entries,
                            const ReturnRay* rays) {
  if (touched_ != 0) clearSums();  // left over if fold() was never called
  wide_ = false;
  touched_ = 0;
  passes_ = 0;
  passed_ = {};
  contra_ = {};
  found_news_ = false;
  const auto add_samples = shape_.full_cube ? kernels_.add_full_cube : kernels_.add_double_cone;
  std::size_t since_flush = 0;
  for (std::size_t n = 0; n < entries.size(); ++n) {
    prefetchWrite(rays + entries.data()[n + kLookAhead].index(), sizeof(ReturnRay));
    const LeafEntry entry = entries[n];
    const ReturnRay& ray = rays[entry.index()];
    if (entry.part() == LeafEntry::kLine) {
      markLine(origin_ijk, ray);
      continue;
    }
    if (entry.part() == LeafEntry::kBall) {
      markBall(origin_ijk, ray);
      continue;
    }
    if (entry.band() && shape_.thinBand()) {
      markThinBand(origin_ijk, ray);
      continue;
    }
    const ReturnInLeaf local = kernels::seenFrom(origin_ijk.data(), ray, entry.band());
    if (entry.band()) {
      passes_ += kernels_.mark_band(local, constants_, passed_);
      continue;
    }
    if (++since_flush > LeafSums::kMostSamples) {
      flushSums();
      since_flush = 1;
    }
    if (ray.news != 0) {
      touched_ |= kernels_.add_news(local, constants_, sums_, contra_);
      continue;
    }
    touched_ |= add_samples(local, constants_, sums_);
  }
  for (const std::uint64_t word : contra_) found_news_ = found_news_ || word != 0;
  if (wide_) flushSums();
  return touched_ != 0 || passes_ != 0;
}

LeafBits LeafFusion::sampled() const {
  LeafBits bits = {};
  for (std::size_t n = 0; n < 512; ++n) {
    const bool any = wide_ ? wide_sums_.samples[n] != 0
                           : (touched_ >> (n / 16) & 1) != 0 && LeafSums::samplesOf(sums_.packed[n]) != 0;
    bits[n >> 6] |= std::uint64_t{any ? 1u : 0u} << (n & 63);
  }
  return bits;
}

void LeafFusion::dropSamples() {
  clearSums();
  wide_ = false;
  touched_ = 0;
  contra_ = {};
  found_news_ = false;
}

void LeafFusion::prefetchValues(const PackedLeaf& leaf) const {
  const LeafValues values(leaf);
  if (!values) return;
  std::uint32_t pairs = touched_ | gainedPairs(leaf);
  if (values.compact() != nullptr) {
    if (pairs != 0) prefetchRead(values.compact(), kCompactBytesAhead);
    return;
  }
  for (; pairs != 0; pairs &= pairs - 1) values.prefetchPair(std::countr_zero(pairs));
}

/// Of those without samples fold() looks at voxels that are cleared for the first time.
std::uint32_t LeafFusion::gainedPairs(const PackedLeaf& leaf) const {
  return passes_ == 0 ? 0 : kernels_.gained_pairs(passed_, map_.confirmedIn(leaf));
}

bool LeafFusion::fold(PackedLeaf& leaf, VoxelVotes* votes, LeafChange& change, FoldCounts& counts) {
  const auto& origin = leaf.origin();
  change.origin_ijk = {origin.x(), origin.y(), origin.z()};
  constants_.collision_mean = static_cast<std::int32_t>(map_.collisionMean());  // it may change between scans
  LeafValues::Room room;
  std::uint32_t* values = nullptr;
  if (const CompactLeaf* const compact = LeafValues(leaf).compact(); compact == nullptr) {
    values = plainValues(leaf);
  } else if (gainedPairs(leaf) != 0) {  // to be read only
    compact->writeTo(room);
    values = room;
  }
  const LeafTarget target = {values, &leaf.getValueMask().template getWord<std::uint64_t>(0), votes, &contra_};
  counts.cleared_updates += passes_;
  bool flipped;
  if (map_.agesFreeSpace()) {
    flipped = foldAged(leaf, target, change, counts);
  } else {
    flipped = wide_ ? foldWide(target, constants_, change, counts)
                    : kernels_.fold(target, constants_, touched_, sums_, passed_, change, counts);
  }
  touched_ = 0;
  return flipped;
}

/// Where free space ages, an observed voxel is free for an arm only if a ray confirms it: one that passes, or samples
/// that are free together. So what flips for the arm is found here, from what collides.
bool LeafFusion::foldAged(const PackedLeaf& leaf, const LeafTarget& target, LeafChange& change, FoldCounts& counts) {
  const LeafBits was_free = map_.confirmedIn(leaf);
  LeafBits confirmed = passed_, collided = {};
  if (wide_) {
    markWideFree(confirmed);
  } else {
    kernels_.mark_measured_free(sums_, constants_, touched_, confirmed);
  }
  if (target.packed != nullptr) {
    const std::uint32_t pairs = touched_ | kernels_.gained_pairs(confirmed, was_free);
    kernels_.mark_colliding(target.packed, constants_, pairs, collided);
    if (target.votes != nullptr) {
      for (std::size_t x = 0; x < 8; ++x) collided[x] |= target.votes->blocked(x);
    }
  }
  FoldCounts of_fold;
  // What was free before this generation gains nothing: else its values would be read again in each generation.
  LeafBits cleared = was_free;
  LeafTarget values = target;
  values.cleared = cleared.data();
  if (wide_) {
    foldWide(values, constants_, change, of_fold);
  } else {
    kernels_.fold(values, constants_, touched_, sums_, passed_, change, of_fold);
  }
  counts.distance_updates += of_fold.distance_updates;
  counts.newly_observed += of_fold.newly_observed;
  const std::uint64_t flipped = kernels_.flip_arm({was_free, confirmed, collided}, target.cleared, change);
  counts.flipped_voxels += flipped;
  return flipped != 0;
}

/// As the kernels mark narrow sums.
void LeafFusion::markWideFree(LeafBits& free) const {
  const auto limit = static_cast<std::uint64_t>(constants_.collision_mean);
  for (std::size_t n = 0; n < 512; ++n) {
    const std::uint64_t samples = wide_sums_.samples[n];
    if (samples > 0 && 16 * wide_sums_.distance[n] >= limit * samples) free[n >> 6] |= std::uint64_t{1} << (n & 63);
  }
}

/// As the kernels judge narrow sums.
ScanVerdict LeafFusion::judgeWide(const LeafTarget& leaf, const KernelConstants& constants) const {
  ScanVerdict scan;
  scan.contra = contra_;
  for (std::size_t n = 0; n < 512; ++n) {
    const std::uint64_t samples = wide_sums_.samples[n];
    if (samples == 0) continue;
    const std::uint64_t bit = std::uint64_t{1} << (n & 63);
    const std::uint32_t old = leaf.packed[n];
    const bool contradicts = kernels::contradictsWide(old, wide_sums_.distance[n], samples, constants.zero_mean);
    const bool free = weightOf(old) > 0 && meanOf(old) >= static_cast<std::uint32_t>(constants.collision_mean);
    scan.sampled[n >> 6] |= bit;
    if (contradicts) scan.contradicts[n >> 6] |= bit;
    if (free) scan.free[n >> 6] |= bit;
  }
  return scan;
}

/// Rare case: more returns reach the leaf than narrow sums can hold. Works voxel by voxel.
bool LeafFusion::foldWide(const LeafTarget& leaf, const KernelConstants& constants, LeafChange& change,
                          FoldCounts& counts) {
  change.collides_on = change.collides_off = change.arm_free_on = change.arm_free_off = {};
  const auto max_weight = static_cast<std::uint64_t>(constants.max_weight);
  const auto collision_mean = static_cast<std::uint32_t>(constants.collision_mean);
  LeafBits old_blocked = {}, now_blocked = {};
  if (leaf.votes != nullptr) castVotes(*leaf.votes, judgeWide(leaf, constants), old_blocked, now_blocked);
  bool flipped = false;
  for (std::size_t n = 0; n < 512; ++n) {
    const std::size_t word = n >> 6;
    const std::uint64_t bit = std::uint64_t{1} << (n & 63);
    const std::uint32_t old = leaf.packed == nullptr ? 0 : leaf.packed[n];
    std::uint32_t now = old;
    if (const std::uint64_t samples = wide_sums_.samples[n]; samples > 0) {
      now = kernels::foldedWide(old, wide_sums_.distance[n], samples, max_weight);
      leaf.packed[n] = now;
      counts.distance_updates += samples;
      counts.newly_observed += weightOf(old) == 0 ? 1u : 0u;
    }
    const bool was_cleared = (leaf.cleared[word] & bit) != 0;
    const bool is_cleared = was_cleared || (passed_[word] & bit) != 0;
    const auto collides = [&](std::uint32_t packed, const LeafBits& blocked) {
      return weightOf(packed) > 0 && (meanOf(packed) < collision_mean || (blocked[word] & bit) != 0);
    };
    const auto armFree = [&](std::uint32_t packed, bool cleared, const LeafBits& blocked) {
      return weightOf(packed) > 0 ? !collides(packed, blocked) : cleared;
    };
    bool voxel_flipped = false;
    const auto note = [&](bool before, bool after, LeafBits& on, LeafBits& off) {
      if (before == after) return;
      (after ? on : off)[word] |= bit;
      voxel_flipped = true;
    };
    note(collides(old, old_blocked), collides(now, now_blocked), change.collides_on, change.collides_off);
    note(armFree(old, was_cleared, old_blocked), armFree(now, is_cleared, now_blocked), change.arm_free_on,
         change.arm_free_off);
    counts.flipped_voxels += voxel_flipped ? 1u : 0u;
    flipped = flipped || voxel_flipped;
  }
  for (std::size_t word = 0; word < 8; ++word) leaf.cleared[word] |= passed_[word];
  return flipped;
}

}  // namespace accessvdb::internal
