// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/scan_integrator.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>

#include "tsdf/projective_integrator.h"

namespace accessvdb::internal {
namespace {

ReturnRay makeRay(const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L, double voxel_size_m) {
  ReturnRay ray;
  const Eigen::Vector3d p = p_L.cast<double>() / voxel_size_m;
  const Eigen::Vector3d to_sensor = q_L.cast<double>() / voxel_size_m - p;
  const double range = to_sensor.norm();
  for (int axis = 0; axis < 3; ++axis) {
    const double base = std::floor(p[axis] + 0.5);
    ray.base_ijk[axis] = static_cast<std::int32_t>(base);
    ray.offset[axis] = static_cast<float>(p[axis] - base);
    ray.to_sensor[axis] = static_cast<float>(to_sensor[axis] / range);
  }
  ray.range = static_cast<float>(range);
  return ray;
}

/// The projective baseline takes distances from its range image: returns mark their cleared band and nothing else. A
/// cube of negative size holds no voxel and reaches no leaf.
RegionShape shapeOf(const TsdfParams& params) {
  RegionShape shape(params);
  if (params.region == UpdateRegion::Projective) shape.tau = -1;
  return shape;
}

/// Result of one bucket, joined in bucket order.
struct BucketResult {
  std::vector<std::unique_ptr<PackedLeaf>> new_leaves;
  FoldCounts counts;
  std::uint64_t touched = 0, allocated = 0;
};

/// A leaf whose sums wait to be folded.
struct Reached {
  PackedLeaf* leaf = nullptr;  ///< nullptr: it is new
  LeafFusion* fusion = nullptr;
  std::array<std::int32_t, 3> origin = {};
};

}  // namespace

struct ScanIntegrator::Workers {
  struct Worker {
    Worker(const PackedMap& map, const RegionShape& shape) : fusions{{{map, shape}, {map, shape}}} {}
    std::array<LeafFusion, 2> fusions;
    LeafGroups groups;
  };
  Workers(const PackedMap& map, const RegionShape& shape) : local([&map, &shape] { return Worker(map, shape); }) {}
  tbb::enumerable_thread_specific<Worker> local;
};

ScanIntegrator::ScanIntegrator(PackedMap& map)
    : map_(map), shape_(shapeOf(map.params())), workers_(std::make_unique<Workers>(map_, shape_)) {
  if (map.params().region == UpdateRegion::Projective) projective_ = std::make_unique<ProjectiveIntegrator>(map);
}
ScanIntegrator::~ScanIntegrator() = default;

IntegrationResult ScanIntegrator::integrate(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                            const ScanFrame& frame) {
  IntegrationResult result;
  if (p_L.empty()) return result;
  if (projective_) {
    ProjectiveIntegrator::requireOneSensor(q_L);
    if (!map_.params().projective.cleared_band) {
      projective_->integrate(p_L, q_L[0], frame, result);
      return result;
    }
  }
  rays_.resize(p_L.size());
  const double v = map_.params().voxel_size_m;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, p_L.size(), 1024), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      rays_[n] = makeRay(p_L[n], q_L[q_L.size() == 1 ? 0 : n], v);
    }
  });
  bins_.bin(shape_, rays_);

  std::array<BucketResult, ReturnBins::kBuckets> buckets;
  PackedTree& tree = map_.tree();
  tbb::parallel_for(std::size_t{0}, ReturnBins::kBuckets, [&](std::size_t b) {
    Workers::Worker& worker = workers_->local.local();
    std::vector<LeafChange>& changes = changes_[b];
    changes.clear();
    BucketResult& bucket = buckets[b];
    bins_.group(b, worker.groups);
    const LeafGroups& groups = worker.groups;
    // Unregistered: a registered accessor would take a lock in the tree for every thread.
    PackedAccessor accessor(tree);
    const auto find = [&](std::size_t g) -> PackedLeaf* {
      const auto origin = originOf(groups.keys[g]);
      PackedLeaf* leaf = accessor.probeLeaf(openvdb::Coord(origin[0], origin[1], origin[2]));
      if (leaf != nullptr) prefetch(leaf, sizeof(PackedLeaf));
      return leaf;
    };
    const auto fold = [&](const Reached& reached) {
      PackedLeaf* leaf = reached.leaf;
      LeafFusion& fusion = *reached.fusion;
      if (leaf == nullptr) {
        bucket.new_leaves.push_back(std::make_unique<PackedLeaf>(
            openvdb::PartialCreate(), openvdb::Coord(reached.origin[0], reached.origin[1], reached.origin[2])));
        leaf = bucket.new_leaves.back().get();
      }
      if (fusion.hasSamples() && leaf->buffer().empty()) {
        leaf->buffer().allocate();
        std::memset(packedValues(*leaf), 0, PackedLeaf::SIZE * sizeof(PackedVoxel));
        ++bucket.allocated;
      }
      changes.emplace_back();
      if (!fusion.fold(*leaf, changes.back(), bucket.counts)) changes.pop_back();
    };
    // A leaf is found one step before it is summed and folded one step after, so that its memory arrives in between.
    Reached waiting;
    PackedLeaf* next = groups.keys.empty() ? nullptr : find(0);
    for (std::size_t g = 0; g < groups.keys.size(); ++g) {
      PackedLeaf* leaf = next;
      if (g + 1 < groups.keys.size()) next = find(g + 1);
      const std::span<const LeafEntry> entries(groups.entries.data() + groups.begin[g],
                                               groups.begin[g + 1] - groups.begin[g]);
      LeafFusion& fusion = waiting.fusion == &worker.fusions[0] ? worker.fusions[1] : worker.fusions[0];
      const auto origin = originOf(groups.keys[g]);
      if (!fusion.accumulate(origin, entries, rays_.data())) continue;
      ++bucket.touched;
      if (leaf != nullptr) fusion.prefetchTouched(*leaf);
      if (waiting.fusion != nullptr) fold(waiting);
      waiting = {leaf, &fusion, origin};
    }
    if (waiting.fusion != nullptr) fold(waiting);
  });

  PackedAccessor accessor(tree);
  for (BucketResult& bucket : buckets) {
    for (auto& leaf : bucket.new_leaves) accessor.addLeaf(leaf.release());
    result.new_leaves += bucket.new_leaves.size();
    result.touched_leaves += bucket.touched;
    result.counts.distance_updates += bucket.counts.distance_updates;
    result.counts.cleared_updates += bucket.counts.cleared_updates;
    result.counts.newly_observed += bucket.counts.newly_observed;
    map_.allocated_leaf_count += bucket.allocated;
  }
  for (const auto& changes : changes_) {
    if (!changes.empty()) result.changes.emplace_back(changes);
  }
  map_.leaf_count += result.new_leaves;
  map_.observed_voxels += result.counts.newly_observed;
  if (projective_) projective_->integrate(p_L, q_L[0], frame, result);
  return result;
}

}  // namespace accessvdb::internal
