// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/fusion/fuse_leaves.h"

#include "cuda/fusion/lanes_cuda.cuh"
#include "cuda/memory/cuda_check.h"
#include "launch/leaf_patch.h"

namespace accessvdb::kernels {
namespace {

namespace lanes = warp_lanes;
using lanes::Bits;

constexpr unsigned kWarps = 8, kThreads = kWarps * kWarp, kBlocksEach = 4;
static_assert(kMostLightEntries <= LeafSums::kMostSamples, "sums of a warp of its own are never emptied");

/// What the warps of a block found in one leaf, which has more returns than one of them should sum.
struct WideLeaf {
  unsigned long long distance[512];
  std::uint32_t samples[512];
  std::uint32_t passed[kWarp], contra[kWarp];  ///< of each lane, as Bits
  std::uint32_t touched, passes;

  /// All threads of the block call it.
  __device__ void clear() {
    for (unsigned n = threadIdx.x; n < 512; n += kThreads) {
      distance[n] = 0;
      samples[n] = 0;
    }
    if (threadIdx.x < kWarp) passed[threadIdx.x] = contra[threadIdx.x] = 0;
    if (threadIdx.x == 0) touched = passes = 0;
    __syncthreads();
  }
};

struct FusionScratch {
  LeafSums sums[kWarps];
  WideLeaf wide;
};

/// What returns did to a leaf, besides its sums.
struct SummedLeaf {
  Bits passed, contra;
  std::uint32_t touched = 0, passes = 0;
};

/// Empties the sums of a warp.
__device__ void addToWide(LeafSums& sums, WideLeaf& wide) {
#pragma unroll 1
  for (unsigned n = threadIdx.x % kWarp; n < 512; n += kWarp) {
    const std::uint32_t packed = sums.packed[n];
    if (packed == 0) continue;
    atomicAdd(&wide.distance[n], static_cast<unsigned long long>(LeafSums::distanceOf(packed)));
    atomicAdd(&wide.samples[n], LeafSums::samplesOf(packed));
    sums.packed[n] = 0;
  }
}

/// Marks a voxel of each lane that names one. @param names  lanes with a voxel, 0 .. 511
__device__ void markEach(unsigned names, int voxel, Bits& passed) {
  const unsigned lane = threadIdx.x % kWarp;
  for (unsigned left = names; left != 0; left &= left - 1) {
    const unsigned marked = __shfl_sync(kAllLanes, voxel, lanes::lowestBit(left));
    if (marked % kWarp == lane) passed.of_lane |= 1u << marked / kWarp;
  }
}

/// LeafFusion::markLine(), a layer per lane. @return how many voxels
__device__ std::uint32_t markLine(const FusedLeaf& leaf, const ReturnRay& ray, const KernelConstants& c, Bits& passed) {
  const ClearedLine line(ray, c.band_end, c.line_end);
  const LineLayers layers(line, leaf.origin_ijk[line.axis] - ray.base_ijk[line.axis]);
  const std::int32_t n = layers.first + static_cast<std::int32_t>(threadIdx.x % kWarp);
  const int voxel = n <= layers.last ? lineVoxelIn(leaf.origin_ijk, ray, line, n) : -1;
  const unsigned names = __ballot_sync(kAllLanes, voxel >= 0);
  markEach(names, voxel, passed);
  return __popc(names);
}

/// LeafFusion::markBall(). @return how many voxels
__device__ std::uint32_t markBall(const FusedLeaf& leaf, const ReturnRay& ball, const KernelConstants& c,
                                  Bits& passed) {
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  std::uint32_t count = 0;
  for (int strip = 0; strip < lanes::kStrips; ++strip) {
    if (!isInBall(leaf.origin_ijk, strip * static_cast<int>(kWarp) + lane, ball, c.ball_radius_squared)) continue;
    passed.of_lane |= 1u << strip;
    ++count;
  }
  return lanes::sumOfLanes(count);
}

/// Marks the voxels of a leaf in a thin band, the next sample per lane: LeafFusion::markThinBand(). @return their
/// number
__device__ std::uint32_t markThinBand(const FusedLeaf& leaf, const ReturnRay& ray, const KernelConstants& c,
                                      Bits& passed) {
  const unsigned lane = threadIdx.x % kWarp;
  const float end = c.band_end < ray.range ? c.band_end : ray.range;
  std::uint32_t count = 0;
  int last = -1;
  for (unsigned first = 1; c.band_begin + 0.5f * static_cast<float>(first) <= end; first += kWarp) {
    const float s = c.band_begin + 0.5f * static_cast<float>(first + lane);
    int voxel = 0;
    bool inside = s <= end;
    for (int axis = 0; axis < 3; ++axis) {
      const int local = thinBandVoxel(ray, s, axis) - (leaf.origin_ijk[axis] - ray.base_ijk[axis]);
      inside = inside && local >= 0 && local < 8;
      voxel = voxel << 3 | (local & 7);
    }
    if (!inside) voxel = -1;
    const int above = __shfl_up_sync(kAllLanes, voxel, 1), before = lane == 0 ? last : above;
    // Two samples in one voxel count once; a straight line never returns.
    const unsigned names = __ballot_sync(kAllLanes, voxel >= 0 && voxel != before);
    count += __popc(names);
    markEach(names, voxel, passed);
    last = __shfl_sync(kAllLanes, voxel, kWarp - 1);
  }
  return count;
}

/// Sums every `step`th return of a leaf.
template <bool kFullCube>
__device__ SummedLeaf sumReturns(const FusionView& view, const FusedLeaf& leaf, std::uint32_t first, std::uint32_t step,
                                 LeafSums& sums, WideLeaf& wide) {
  SummedLeaf of;
  std::uint32_t since_emptied = 0;
#pragma unroll 1
  for (std::uint32_t n = leaf.begin + first; n < leaf.end; n += step) {
    const LeafEntry entry = view.entries[n];
    const ReturnRay ray = view.rays[entry.index()];
    if (entry.part() == LeafEntry::kLine) {
      of.passes += markLine(leaf, ray, view.constants, of.passed);
      continue;
    }
    if (entry.part() == LeafEntry::kBall) {
      of.passes += markBall(leaf, ray, view.constants, of.passed);
      continue;
    }
    if (entry.band() && view.thin_band) {
      of.passes += markThinBand(leaf, ray, view.constants, of.passed);
      continue;
    }
    const ReturnInLeaf local = seenFrom(leaf.origin_ijk, ray, entry.band());
    if (entry.band()) {
      of.passes += lanes::markBand(local, view.constants, of.passed);
      continue;
    }
    if (++since_emptied > LeafSums::kMostSamples) {
      addToWide(sums, wide);
      since_emptied = 1;
    }
    if (kFullCube && ray.news == 0) {
      of.touched |= lanes::addFullCube(local, view.constants, sums);
      continue;
    }
    Bits contra;
    of.touched |= lanes::addNews(local, view.constants, sums, contra);
    if (ray.news != 0) of.contra.of_lane |= contra.of_lane;
  }
  return of;
}

/// Joins what the warps of the block found. All its threads call it.
__device__ SummedLeaf joinWarps(const SummedLeaf& of_warp, LeafSums& sums, WideLeaf& wide) {
  const unsigned lane = threadIdx.x % kWarp;
  addToWide(sums, wide);
  atomicOr(&wide.passed[lane], of_warp.passed.of_lane);
  atomicOr(&wide.contra[lane], of_warp.contra.of_lane);
  if (lane == 0) {
    atomicOr(&wide.touched, of_warp.touched);
    atomicAdd(&wide.passes, of_warp.passes);
  }
  __syncthreads();
  SummedLeaf of;
  of.passed.of_lane = wide.passed[lane];
  of.contra.of_lane = wide.contra[lane];
  of.touched = wide.touched;
  of.passes = wide.passes;
  return of;
}

/// As the lanes' fold() folds narrow sums.
__device__ bool foldWide(const lanes::LeafTarget& leaf, const KernelConstants& c, const SummedLeaf& of,
                         const WideLeaf& wide, lanes::Flips& change, FoldCounts& counts) {
  const unsigned lane = threadIdx.x % kWarp;
  const auto limit = static_cast<std::uint32_t>(c.collision_mean);
  Bits old_blocked, now_blocked;
  if (leaf.votes != nullptr) {
    lanes::ScanVerdict scan;
    scan.contra = of.contra;
#pragma unroll 1
    for (std::uint32_t left = of.touched; left != 0; left &= left - 1) {
      const int strip = lanes::lowestBit(left);
      const unsigned n = strip * kWarp + lane;
      const std::uint32_t samples = wide.samples[n], old = leaf.packed[n];
      lanes::setStrip(scan.sampled, strip, {samples > 0});
      lanes::setStrip(scan.contradicts, strip,
                      {samples > 0 && contradictsWide(old, wide.distance[n], samples, c.zero_mean)});
      lanes::setStrip(scan.free, strip, {weightOf(old) > 0 && meanOf(old) >= limit});
    }
    castVotes(*leaf.votes, scan, old_blocked, now_blocked);
  }
  lanes::LeafFacts facts;
  std::uint32_t updates = 0;
#pragma unroll 1
  for (std::uint32_t left = of.touched; left != 0; left &= left - 1) {
    const int strip = lanes::lowestBit(left);
    const unsigned n = strip * kWarp + lane;
    const std::uint32_t samples = wide.samples[n], old = leaf.packed[n];
    const std::uint32_t now =
        samples > 0 ? foldedWide(old, wide.distance[n], samples, static_cast<std::uint64_t>(c.max_weight)) : old;
    leaf.packed[n] = now;
    updates += samples;
    lanes::setStrip(facts.old_observed, strip, {weightOf(old) > 0});
    lanes::setStrip(facts.now_observed, strip, {weightOf(now) > 0});
    lanes::setStrip(facts.old_collides, strip, {weightOf(old) > 0 && meanOf(old) < limit});
    lanes::setStrip(facts.now_collides, strip, {weightOf(now) > 0 && meanOf(now) < limit});
  }
  counts.distance_updates += lanes::sumOfLanes(updates);
  return lanes::finishFold(leaf, of.touched, of.passed, facts, old_blocked, now_blocked, change, counts);
}

/// Loads the votes of a leaf.
__device__ lanes::Votes loadVotes(const std::uint32_t* words) {
  lanes::Votes votes;
  for (int plane = 0; plane < 3; ++plane) votes.bit[plane] = lanes::loadBits(words + lanes::kStrips * plane);
  return votes;
}

/// A leaf's slot in a list.
struct SlotOfLeaf {
  bool any, fresh;
  std::uint32_t number;
  __device__ explicit SlotOfLeaf(std::uint32_t slot)
      : any(slot != FusedLeaf::kNone),
        fresh(any && (slot & FusedLeaf::kFresh) != 0),
        number(slot & ~FusedLeaf::kFresh) {}
};

/// What rays passed before the scan.
__device__ Bits clearedBefore(const FusionView& view, const FusedLeaf& leaf, const SlotOfLeaf& slot) {
  if (slot.any && !slot.fresh) return lanes::loadBits(view.cleared + std::size_t{lanes::kStrips} * slot.number);
  if (leaf.facts == FusedLeaf::kNone) return {};
  const std::byte* const free = view.grid + std::uint64_t{leaf.facts} * LeafPatch::kUnit + kLeafBitsBytes;
  return lanes::loadBits(reinterpret_cast<const std::uint32_t*>(free));
}

/// Folds what was found into the leaf. One warp calls it. @param wide  nullptr: the sums are narrow
__device__ void foldLeaf(const FusionView& view, const FusedLeaf& leaf, const SummedLeaf& of, LeafSums& sums,
                         const WideLeaf* wide, std::uint32_t n) {
  const bool is_first = threadIdx.x % kWarp == 0, is_sampled = of.touched != 0;
  FusedOutcome outcome = {};
  if (!is_sampled && of.passes == 0) {
    if (is_first) view.outcomes[n] = outcome;
    return;
  }
  const SlotOfLeaf slot(leaf.values), vote_slot(leaf.votes);
  const bool has_values = slot.any && (is_sampled || !slot.fresh);
  std::uint32_t* const values = has_values ? view.values + std::size_t{512} * slot.number : nullptr;
  if (has_values && slot.fresh) {
#pragma unroll 4
    for (unsigned voxel = threadIdx.x % kWarp; voxel < 512; voxel += kWarp) values[voxel] = 0;
  }
  const Bits old_cleared = clearedBefore(view, leaf, slot);
  Bits cleared = old_cleared;
  const bool may_vote = vote_slot.any;
  std::uint32_t* const vote_words =
      may_vote ? view.votes + std::size_t{3 * lanes::kStrips} * vote_slot.number : nullptr;
  lanes::Votes votes;
  if (may_vote && !vote_slot.fresh) votes = loadVotes(vote_words);
  const lanes::LeafTarget target = {values, &cleared.of_lane, may_vote ? &votes : nullptr, &of.contra};
  lanes::Flips change;
  FoldCounts counts;
  const bool flipped = wide != nullptr
                           ? foldWide(target, view.constants, of, *wide, change, counts)
                           : lanes::fold(target, view.constants, of.touched, sums, of.passed, change, counts);
  if (has_values && (slot.fresh || lanes::stripsOf({cleared.of_lane ^ old_cleared.of_lane}) != 0)) {
    lanes::storeBits(cleared, view.cleared + std::size_t{lanes::kStrips} * slot.number);
  }
  if (may_vote) {
    bool any = false;
    for (int plane = 0; plane < 3; ++plane) {
      lanes::storeBits(votes.bit[plane], vote_words + lanes::kStrips * plane);
      any = any || votes.bit[plane].of_lane != 0;
    }
    if (__any_sync(kAllLanes, any)) outcome.flags |= FusedOutcome::kHasVotes;
  }
  if (flipped) {
    outcome.flipped_collisions =
        lanes::sumOfLanes(static_cast<std::uint32_t>(__popc(change.collides_on.of_lane | change.collides_off.of_lane)));
    FusedFlips& flips = view.flips[n];
    lanes::storeBits(change.collides_on, flips.collides_on);
    lanes::storeBits(change.collides_off, flips.collides_off);
    lanes::storeBits(change.arm_free_on, flips.arm_free_on);
    lanes::storeBits(change.arm_free_off, flips.arm_free_off);
  }
  outcome.flags |=
      FusedOutcome::kReached | (of.touched != 0 ? FusedOutcome::kSampled : 0) | (flipped ? FusedOutcome::kFlipped : 0);
  outcome.distance_updates = static_cast<std::uint32_t>(counts.distance_updates);
  outcome.cleared_updates = of.passes;
  outcome.newly_observed = static_cast<std::uint32_t>(counts.newly_observed);
  outcome.flipped_voxels = static_cast<std::uint32_t>(counts.flipped_voxels);
  if (is_first) view.outcomes[n] = outcome;
}

/// The first blocks take a leaf each, the others one per warp.
template <bool kFullCube>
__global__ void __launch_bounds__(kThreads, kBlocksEach) fuseLeaves(const __grid_constant__ FusionView view) {
  // Bytes, as variables in shared memory have no constructor.
  alignas(FusionScratch) __shared__ unsigned char bytes[sizeof(FusionScratch)];
  FusionScratch& scratch = reinterpret_cast<FusionScratch&>(bytes);
  const unsigned warp = threadIdx.x / kWarp;
  const bool is_heavy = blockIdx.x < view.heavy;
  const std::uint32_t n = is_heavy ? blockIdx.x : view.heavy + (blockIdx.x - view.heavy) * kWarps + warp;
  LeafSums& sums = scratch.sums[warp];
  for (unsigned voxel = threadIdx.x % kWarp; voxel < 512; voxel += kWarp) sums.packed[voxel] = 0;
  if (is_heavy) scratch.wide.clear();
  if (n >= view.count) return;
  const std::uint32_t number = view.order[n];
  const FusedLeaf leaf = view.leaves[number];
  SummedLeaf of = sumReturns<kFullCube>(view, leaf, is_heavy ? warp : 0, is_heavy ? kWarps : 1, sums, scratch.wide);
  if (is_heavy) {
    of = joinWarps(of, sums, scratch.wide);
    if (warp != 0) return;
  }
  foldLeaf(view, leaf, of, sums, is_heavy ? &scratch.wide : nullptr, number);
}

}  // namespace

void launchFuseLeaves(const FusionView& view, cudaStream_t stream) {
  if (view.count == 0) return;
  const unsigned blocks = view.heavy + (view.count - view.heavy + kWarps - 1) / kWarps;
  (view.full_cube ? fuseLeaves<true> : fuseLeaves<false>)<<<blocks, kThreads, 0, stream>>>(view);
  checkLaunch("fuseLeaves");
}

}  // namespace accessvdb::kernels
