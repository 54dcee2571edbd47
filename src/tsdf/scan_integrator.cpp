// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/scan_integrator.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <utility>

#include "hostdev/flips_hash.h"
#include "tsdf/bucket_fusion.h"
#include "tsdf/platform_balls.h"
#include "tsdf/projective_integrator.h"
#include "tsdf/scan_news.h"

namespace accessvdb::internal {
namespace {

/// The projective baseline takes distances from its range image: returns only mark their cleared band. A cube of
/// negative size contains no voxel and reaches no leaf.
RegionShape shapeOf(const TsdfParams& params) {
  RegionShape shape(params);
  if (params.region == UpdateRegion::Projective) shape.tau = -1;
  return shape;
}

}  // namespace

struct ScanIntegrator::Workers {
  Workers(PackedMap& map, const RegionShape& shape) : local([&map, &shape] { return BucketFusion(map, shape); }) {}
  tbb::enumerable_thread_specific<BucketFusion> local;
};

ScanIntegrator::ScanIntegrator(PackedMap& map)
    : map_(map), shape_(shapeOf(map.params())), workers_(std::make_unique<Workers>(map_, shape_)) {
  if (map.params().region == UpdateRegion::Projective) projective_ = std::make_unique<ProjectiveIntegrator>(map);
}
ScanIntegrator::~ScanIntegrator() = default;

void ScanIntegrator::noteDistances(bool wanted) {
  for (BucketChanges& changes : changes_) changes.wants_distances = wanted;
  if (projective_) projective_->noteDistances(wanted);
}

void ScanIntegrator::hashFlips(bool wanted) {
  if (projective_) {
    wants_hash_ = wanted;
    return;
  }
  for (BucketChanges& changes : changes_) changes.wants_hash = wanted;
}

void ScanIntegrator::visitChanges(const ChangeVisitor& visit) {
  if (projective_) {
    visit_ = visit;
    return;
  }
  for (std::size_t part = 0; part < changes_.size(); ++part) {
    changes_[part].visit = [visit, part](const LeafChange& change) { visit(part, change); };
  }
}

void ScanIntegrator::bin(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L) {
  if (p_L.empty() || (projective_ && !map_.params().projective.cleared_band)) return;
  // Where free space ages, what is clear has to be confirmed again.
  const PackedMap* const clear = map_.agesFreeSpace() ? nullptr : &map_;
  rays_.resize(p_L.size());
  const double v = map_.params().voxel_size_m;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, p_L.size(), 256), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      rays_[n] = makeRay(p_L[n].data(), q_L[q_L.size() == 1 ? 0 : n].data(), v);
    }
    if (map_.blocksNewThings()) markNews(map_, std::span(rays_).subspan(range.begin(), range.size()));
  });
  PlatformBalls platform = platformBalls(map_, shape_, rays_, q_L);
  contradicted_platforms_ = platform.contradicted;
  rays_.insert(rays_.end(), platform.balls.begin(), platform.balls.end());
  bins_.bin(shape_, rays_, platform.balls.size(), clear);
  binned_ = true;
}

IntegrationResult ScanIntegrator::integrate(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                            const ScanFrame& frame) {
  IntegrationResult result;
  const bool binned = std::exchange(binned_, false);
  if (p_L.empty()) return result;
  if (projective_) {
    ProjectiveIntegrator::requireOneSensor(q_L);
    if (!map_.params().projective.cleared_band) {
      integrateProjected(p_L, q_L[0], frame, result);
      return result;
    }
  }
  if (!binned) {
    bin(p_L, q_L);
    binned_ = false;
  }

  result.contradicted_platforms = std::exchange(contradicted_platforms_, 0);
  reserve_.begin();
  // The largest buckets first, so that no thread starts one when the others are done.
  std::array<std::pair<std::size_t, std::size_t>, ReturnBins::kBuckets> order;  // pairs, bucket
  for (std::size_t b = 0; b < ReturnBins::kBuckets; ++b) order[b] = {bins_.pairCount(b), b};
  std::sort(order.begin(), order.end(), std::greater<>());
  std::array<BucketResult, ReturnBins::kBuckets> buckets;
  std::atomic<std::size_t> next = 0;
  try {
    // A task for each, so that threads can leave for more urgent work in between.
    tbb::parallel_for(
        std::size_t{0}, order.size(),
        [&](std::size_t) {
          const std::size_t b = order[next++].second;
          workers_->local.local().fuse(bins_, b, rays_.data(), changes_[b], buckets[b], leaves_[b]);
        },
        tbb::simple_partitioner());
    const std::lock_guard lock(tree_);
    for (BucketResult& bucket : buckets) linkNodes(map_.tree(), bucket.new_nodes);
  } catch (...) {
    map_.cold().forget();
    throw;
  }
  for (BucketResult& bucket : buckets) {
    result.new_leaves += bucket.new_leaves;
    result.touched_leaves += bucket.touched;
    result.counts.distance_updates += bucket.counts.distance_updates;
    result.counts.cleared_updates += bucket.counts.cleared_updates;
    result.counts.newly_observed += bucket.counts.newly_observed;
    result.counts.flipped_voxels += bucket.counts.flipped_voxels;
    result.flips_hash += bucket.flips_hash;
    map_.allocated_leaf_count += bucket.allocated;
    for (const auto& [origin, voxels] : bucket.left_out) {
      if (!map_.grows()) result.left_out.push_back(origin);
      map_.leftOut().set(origin, voxels);
    }
  }
  for (const auto& changes : changes_) {
    if (!changes.facts.empty()) result.changes.emplace_back(changes.facts);
    if (!changes.distances.empty()) result.distances.emplace_back(changes.distances);
  }
  map_.leaf_count += result.new_leaves;
  map_.observed_voxels += result.counts.newly_observed;
  if (projective_) integrateProjected(p_L, q_L[0], frame, result);
  reserve_.refill();
  return result;
}

void ScanIntegrator::readLeaves(std::span<const std::array<std::int32_t, 3>> origins_ijk,
                                const std::function<void(std::size_t n, const PackedLeaf* leaf)>& read) {
  const std::shared_lock lock(tree_);
  // Isolated: a thread that waits here must not begin other work, which may want the locks.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, origins_ijk.size(), 64), [&](const auto& range) {
      ConstPackedAccessor accessor(map_.tree());
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const auto& [x, y, z] = origins_ijk[n];
        const std::lock_guard leaves(leaves_[ReturnBins::bucketOf(leafKeyOf(x >> 3, y >> 3, z >> 3))]);
        read(n, accessor.probeConstLeaf({x, y, z}));
      }
    });
  });
}

void ScanIntegrator::integrateProjected(std::span<const Eigen::Vector3f> p_L, const Eigen::Vector3f& q_L,
                                        const ScanFrame& frame, IntegrationResult& result) {
  projective_->integrate(p_L, q_L, frame, result);
  for (const auto& part : result.changes) {
    for (const LeafChange& change : part) {
      if (visit_) visit_(0, change);
      if (wants_hash_) result.flips_hash += kernels::flipsHash(change);
    }
  }
}

}  // namespace accessvdb::internal
