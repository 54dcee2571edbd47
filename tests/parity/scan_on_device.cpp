// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "parity/scan_on_device.h"

#include <cuda_runtime_api.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <map>

#include "cuda/memory/cuda_check.h"
#include "cuda/memory/owned_event.h"
#include "tsdf/leaf_fusion.h"
#include "tsdf/platform_balls.h"
#include "tsdf/return_bins.h"
#include "tsdf/scan_news.h"

namespace accessvdb::test {
namespace {

using kernels::FusedLeaf;
using kernels::FusedOutcome;
using Origin = std::array<std::int32_t, 3>;

constexpr std::size_t kValues = 512, kCleared = 16, kVotes = 48;
constexpr std::array<std::uint32_t, kValues> kNoValues = {};
static_assert(sizeof(internal::VoxelVotes) == kVotes * sizeof(std::uint32_t));
static_assert(sizeof(kernels::FusedFlips::collides_on) == sizeof(LeafBits));

LeafBits maskOf(const internal::PackedLeaf& leaf) {
  LeafBits bits;
  for (openvdb::Index word = 0; word < 8; ++word) bits[word] = leaf.getValueMask().getWord<std::uint64_t>(word);
  return bits;
}

const internal::PackedLeaf* leafAt(const internal::PackedMap& map, const Origin& origin) {
  return map.tree().probeConstLeaf({origin[0], origin[1], origin[2]});
}

template <typename T>
void upload(kernels::DeviceMemory& memory, const std::vector<T>& from, kernels::DeviceArray<T>& to) {
  to.grow(memory, std::max<std::size_t>(from.size(), 1), 0);
  to.upload(from.data(), from.size());
}

template <typename T>
void download(kernels::DeviceMemory& memory, const kernels::DeviceArray<T>& from, std::size_t count,
              std::vector<T>& to) {
  to.resize(count);
  if (count > 0) memory.download(to.data(), from.data(), count * sizeof(T));
}

std::uint64_t differs(const void* a, const void* b, std::size_t bytes) { return std::memcmp(a, b, bytes) == 0 ? 0 : 1; }

}  // namespace

void ScanOnDevice::addLeaf(const internal::PackedMap& map, const Origin& origin_ijk,
                           std::span<const kernels::LeafEntry> entries, std::uint32_t slot) {
  const auto is_cone = [](kernels::LeafEntry entry) { return entry.cone(); };
  const auto is_news = [&](kernels::LeafEntry entry) { return is_cone(entry) && rays_[entry.index()].news != 0; };
  const internal::PackedLeaf* leaf = leafAt(map, origin_ijk);
  internal::LeafValues::Room room;
  const std::uint32_t* values = leaf == nullptr ? nullptr : internal::LeafValues(*leaf).all(room);
  const internal::VoxelVotes* votes = leaf == nullptr || !map.blocksNewThings() ? nullptr : map.votesOf(*leaf);
  FusedLeaf fused = {};
  std::copy(origin_ijk.begin(), origin_ijk.end(), fused.origin_ijk);
  fused.begin = static_cast<std::uint32_t>(entries_.size());
  entries_.insert(entries_.end(), entries.begin(), entries.end());
  fused.end = static_cast<std::uint32_t>(entries_.size());
  fused.slot = slot;
  fused.values = fused.votes = FusedLeaf::kNone;
  existed_.push_back(leaf != nullptr ? 1 : 0);
  had_values_.push_back(values != nullptr ? 1 : 0);
  if (values != nullptr || std::any_of(entries.begin(), entries.end(), is_cone)) {
    fused.values = static_cast<std::uint32_t>(values_.size() / kValues);
    const std::uint32_t* from = values != nullptr ? values : kNoValues.data();
    values_.insert(values_.end(), from, from + kValues);
  }
  for (const std::uint64_t bits : leaf == nullptr ? LeafBits{} : maskOf(*leaf)) {
    cleared_.push_back(static_cast<std::uint32_t>(bits));
    cleared_.push_back(static_cast<std::uint32_t>(bits >> 32));
  }
  if (votes != nullptr || (map.blocksNewThings() && std::any_of(entries.begin(), entries.end(), is_news))) {
    fused.votes = static_cast<std::uint32_t>(votes_.size() / kVotes);
    votes_.resize(votes_.size() + kVotes);
    if (votes != nullptr) std::memcpy(votes_.data() + votes_.size() - kVotes, votes->bit.data(), sizeof(votes->bit));
  }
  wide_ += std::count_if(entries.begin(), entries.end(), is_cone) > kernels::LeafSums::kMostSamples ? 1 : 0;
  leaves_.push_back(fused);
}

void ScanOnDevice::take(const internal::PackedMap& map, std::span<const Eigen::Vector3f> p_L,
                        std::span<const Eigen::Vector3f> q_L) {
  const internal::RegionShape shape(map.params());
  rays_.clear();
  for (std::size_t n = 0; n < p_L.size(); ++n) {
    rays_.push_back(internal::makeRay(p_L[n].data(), q_L[q_L.size() == 1 ? 0 : n].data(), map.params().voxel_size_m));
  }
  if (map.blocksNewThings()) internal::markNews(map, rays_);
  news_ = 0;
  for (const kernels::ReturnRay& ray : rays_) news_ += ray.news;
  const internal::PlatformBalls platform = internal::platformBalls(map, shape, rays_, q_L);
  rays_.insert(rays_.end(), platform.balls.begin(), platform.balls.end());
  internal::ReturnBins bins;
  bins.bin(shape, rays_, platform.balls.size(), &map);
  entries_.clear();
  leaves_.clear();
  values_.clear();
  cleared_.clear();
  votes_.clear();
  existed_.clear();
  had_values_.clear();
  wide_ = 0;
  for (std::size_t bucket = 0; bucket < internal::ReturnBins::kBuckets; ++bucket) {
    internal::BucketLeaves group;
    bins.group(bucket, group);
    for (std::size_t n = 0; n < group.places.size(); ++n) {
      addLeaf(map, group.originOf(n), {group.entries.data() + group.begin[n], group.begin[n + 1] - group.begin[n]},
              static_cast<std::uint32_t>(leaves_.size()));
    }
  }
  const auto is_heavy = [](const FusedLeaf& leaf) { return leaf.end - leaf.begin > kernels::kMostLightEntries; };
  const auto light = std::stable_partition(leaves_.begin(), leaves_.end(), is_heavy);
  std::stable_sort(leaves_.begin(), light, [](const FusedLeaf& a, const FusedLeaf& b) {
    return a.end - a.begin > b.end - b.begin;  // those that take longest first
  });
  upload(memory_, rays_, d_rays_);
  upload(memory_, entries_, d_entries_);
  upload(memory_, leaves_, d_leaves_);
  d_outcomes_.grow(memory_, std::max<std::size_t>(leaves_.size(), 1), 0);
  d_flips_.grow(memory_, std::max<std::size_t>(leaves_.size(), 1), 0);
  view_.count = static_cast<std::uint32_t>(leaves_.size());
  view_.heavy = static_cast<std::uint32_t>(light - leaves_.begin());
  view_.full_cube = shape.full_cube;
  view_.thin_band = shape.thinBand();
  view_.constants = internal::kernelConstants(map, shape);
}

float ScanOnDevice::fuse() {
  upload(memory_, values_, d_values_);
  upload(memory_, cleared_, d_cleared_);
  upload(memory_, votes_, d_votes_);
  view_.rays = d_rays_.data();
  view_.entries = d_entries_.data();
  view_.leaves = d_leaves_.data();
  view_.values = d_values_.data();
  view_.cleared = d_cleared_.data();
  view_.votes = d_votes_.data();
  view_.outcomes = d_outcomes_.data();
  view_.flips = d_flips_.data();
  cudaStream_t stream = nullptr;
  ACCESSVDB_CUDA(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
  const kernels::OwnedEvent begin(cudaEventDefault), end(cudaEventDefault);
  ACCESSVDB_CUDA(cudaEventRecord(begin.get(), stream));
  kernels::launchFuseLeaves(view_, stream);
  ACCESSVDB_CUDA(cudaEventRecord(end.get(), stream));
  ACCESSVDB_CUDA(cudaStreamSynchronize(stream));
  float milliseconds = 0;
  ACCESSVDB_CUDA(cudaEventElapsedTime(&milliseconds, begin.get(), end.get()));
  ACCESSVDB_CUDA(cudaStreamDestroy(stream));
  return milliseconds;
}

void ScanOnDevice::download() {
  test::download(memory_, d_values_, values_.size(), new_values_);
  test::download(memory_, d_cleared_, cleared_.size(), new_cleared_);
  test::download(memory_, d_votes_, votes_.size(), new_votes_);
  test::download(memory_, d_outcomes_, leaves_.size(), outcomes_);
  test::download(memory_, d_flips_, leaves_.size(), flips_);
}

FusionDifferences ScanOnDevice::compare(const internal::PackedMap& map, const internal::IntegrationResult& result) {
  download();
  std::map<Origin, const LeafChange*> changes;
  for (const auto& part : result.changes) {
    for (const LeafChange& change : part) changes[change.origin_ijk] = &change;
  }
  FusionDifferences found;
  internal::FoldCounts counts;
  std::uint64_t reached = 0, flipped = 0, fresh = 0;
  for (std::size_t n = 0; n < leaves_.size(); ++n) {
    const FusedLeaf& fused = leaves_[n];
    const FusedOutcome& outcome = outcomes_[n];
    const Origin origin = {fused.origin_ijk[0], fused.origin_ijk[1], fused.origin_ijk[2]};
    const internal::PackedLeaf* leaf = leafAt(map, origin);
    const bool is_reached = (outcome.flags & FusedOutcome::kReached) != 0, existed = existed_[fused.slot] != 0;
    reached += is_reached ? 1 : 0;
    fresh += is_reached && !existed ? 1 : 0;
    if ((leaf != nullptr) != (is_reached || existed)) {
      ++found.reached;
      continue;
    }
    if (leaf == nullptr) continue;
    internal::LeafValues::Room room;
    const std::uint32_t* values = internal::LeafValues(*leaf).all(room);
    const bool sampled = (outcome.flags & FusedOutcome::kSampled) != 0;
    if ((values != nullptr) != (had_values_[fused.slot] != 0 || sampled)) ++found.reached;
    const std::uint32_t* own =
        fused.values == FusedLeaf::kNone ? kNoValues.data() : new_values_.data() + kValues * fused.values;
    found.values += differs(values != nullptr ? values : kNoValues.data(), own, sizeof(kNoValues));
    found.cleared += differs(maskOf(*leaf).data(), new_cleared_.data() + kCleared * fused.slot, sizeof(LeafBits));
    const internal::VoxelVotes none, *votes = map.blocksNewThings() ? map.votesOf(*leaf) : nullptr;
    const bool has_votes = fused.votes != FusedLeaf::kNone;
    found.votes += differs((votes != nullptr ? *votes : none).bit.data(),
                           has_votes ? static_cast<const void*>(new_votes_.data() + kVotes * fused.votes) : &none.bit,
                           sizeof(none.bit));
    if (is_reached && (votes != nullptr) != ((outcome.flags & FusedOutcome::kHasVotes) != 0)) ++found.votes;
    const auto change = changes.find(origin);
    const bool is_flipped = (outcome.flags & FusedOutcome::kFlipped) != 0;
    flipped += is_flipped ? 1 : 0;
    if (is_flipped != (change != changes.end())) {
      ++found.flips;
    } else if (is_flipped) {
      const LeafChange& of = *change->second;
      found.flips += differs(of.collides_on.data(), flips_[n].collides_on, sizeof(LeafBits)) |
                     differs(of.collides_off.data(), flips_[n].collides_off, sizeof(LeafBits)) |
                     differs(of.arm_free_on.data(), flips_[n].arm_free_on, sizeof(LeafBits)) |
                     differs(of.arm_free_off.data(), flips_[n].arm_free_off, sizeof(LeafBits));
    }
    counts.distance_updates += outcome.distance_updates;
    counts.cleared_updates += outcome.cleared_updates;
    counts.newly_observed += outcome.newly_observed;
    counts.flipped_voxels += outcome.flipped_voxels;
  }
  found.counts += (reached != result.touched_leaves ? 1 : 0) + (fresh != result.new_leaves ? 1 : 0) +
                  (flipped != changes.size() ? 1 : 0) +
                  (counts.distance_updates != result.counts.distance_updates ? 1 : 0) +
                  (counts.cleared_updates != result.counts.cleared_updates ? 1 : 0) +
                  (counts.newly_observed != result.counts.newly_observed ? 1 : 0) +
                  (counts.flipped_voxels != result.counts.flipped_voxels ? 1 : 0);
  return found;
}

}  // namespace accessvdb::test
