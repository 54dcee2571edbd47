// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/projective_integrator.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>

#include "accessvdb/error.h"

namespace accessvdb::internal {
namespace {

/// nvblox's defaults (sensors/lidar.h, commit 2ecd5722), in voxels.
constexpr float kMostStepBetweenBins = 2.0f, kMostDistanceFromRay = 0.5f;
/// Bins are cut into pieces of this length on their way through the band, so that their boxes stay small.
constexpr double kPieceVoxels = 8;
/// Margin around those boxes, against rounding.
constexpr double kSlackVoxels = 0.01;
constexpr std::size_t kBinsPerTask = 64, kLeavesPerTask = 64;
constexpr float kSkip = 0, kFree = -1;  // instead of a range

struct TaskResult {
  std::vector<std::unique_ptr<PackedLeaf>> new_leaves;
  std::vector<LeafChange> changes;
  std::vector<DistanceChange> distances;
  FoldCounts counts;
  std::uint64_t touched = 0, allocated = 0;
};

bool before(const LeafChange& a, const LeafChange& b) { return a.origin_ijk < b.origin_ijk; }

/// Combines `first` followed by `second` into one change.
LeafChange joined(const LeafChange& first, const LeafChange& second) {
  LeafChange both;
  both.origin_ijk = first.origin_ijk;
  const auto join = [](std::uint64_t on1, std::uint64_t off1, std::uint64_t on2, std::uint64_t off2, std::uint64_t& on,
                       std::uint64_t& off) {
    on = (on1 & ~off2) | (on2 & ~off1);
    off = (off1 & ~on2) | (off2 & ~on1);
  };
  for (std::size_t w = 0; w < 8; ++w) {
    join(first.collides_on[w], first.collides_off[w], second.collides_on[w], second.collides_off[w],
         both.collides_on[w], both.collides_off[w]);
    join(first.arm_free_on[w], first.arm_free_off[w], second.arm_free_on[w], second.arm_free_off[w],
         both.arm_free_on[w], both.arm_free_off[w]);
  }
  return both;
}

bool empty(const LeafChange& change) {
  std::uint64_t any = 0;
  for (std::size_t w = 0; w < 8; ++w) {
    any |= change.collides_on[w] | change.collides_off[w] | change.arm_free_on[w] | change.arm_free_off[w];
  }
  return any == 0;
}

}  // namespace

struct ProjectiveIntegrator::Workers {
  struct Worker {
    LeafSums sums;
    LeafProjection seen;
  };
  tbb::enumerable_thread_specific<Worker> local;
};

ProjectiveIntegrator::ProjectiveIntegrator(PackedMap& map)
    : map_(map), params_(map.params().projective), image_(params_.bin_rad), workers_(std::make_unique<Workers>()) {
  const TsdfParams& p = map.params();
  tau_ = static_cast<float>(p.truncation_distance_m / p.voxel_size_m);
  clamp_low_ = static_cast<float>(p.clamp_min_m / p.voxel_size_m);
  sample_scale_ = static_cast<float>(kSampleSteps) / (tau_ - clamp_low_);
  view_low_ = static_cast<float>((params_.elevation_min_rad + std::numbers::pi / 2) / image_.bin_rad());
  view_high_ = static_cast<float>((params_.elevation_max_rad + std::numbers::pi / 2) / image_.bin_rad());
}
ProjectiveIntegrator::~ProjectiveIntegrator() = default;

void ProjectiveIntegrator::requireOneSensor(std::span<const Eigen::Vector3f> q_L) {
  if (q_L.size() == 1) return;
  throw InvalidArgument("projective.rays", "", "the projective baseline needs scans with one sensor pose",
                        "Use integrateScan()");
}

void ProjectiveIntegrator::collectBandLeaves(const Eigen::Vector3f& q_L, const Eigen::Matrix3d& R_W_S) {
  const Eigen::Vector3d q = q_L.cast<double>() / map_.params().voxel_size_m;
  const double reach = static_cast<double>(tau_) + (params_.guarded ? kMostStepBetweenBins : 0.0f);
  const std::span<const std::uint32_t> bins = image_.filled();
  tbb::enumerable_thread_specific<std::vector<LeafKey>> found;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, bins.size(), kBinsPerTask), [&](const auto& range) {
    std::vector<LeafKey>& keys = found.local();
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const int column = static_cast<int>(bins[n]) % image_.columns(),
                row = static_cast<int>(bins[n]) / image_.columns();
      std::array<Eigen::Vector3d, 4> edges;
      for (int corner = 0; corner < 4; ++corner) {
        edges[static_cast<std::size_t>(corner)] =
            R_W_S * image_.directionAt(column + (corner & 1), row + (corner >> 1));
      }
      const double r = image_.at(column, row), begin = std::max(r - reach, 0.0), end = r + reach;
      const int pieces = static_cast<int>(std::ceil((end - begin) / kPieceVoxels));
      for (int piece = 0; piece < pieces; ++piece) {
        const double near = begin + (end - begin) * piece / pieces, far = begin + (end - begin) * (piece + 1) / pieces;
        Eigen::Vector3d low = q + near * edges[0], high = low;
        for (const Eigen::Vector3d& edge : edges) {
          low = low.cwiseMin(q + near * edge).cwiseMin(q + far * edge);
          high = high.cwiseMax(q + near * edge).cwiseMax(q + far * edge);
        }
        // The patch bulges beyond its corners by less than r bin^2 / 4 (two arcs of half angle bin / 2).
        const double slack = 0.25 * far * image_.bin_rad() * image_.bin_rad() + kSlackVoxels;
        std::array<std::int32_t, 3> first, last;
        for (int axis = 0; axis < 3; ++axis) {
          first[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(std::ceil(low[axis] - slack)) >> 3;
          last[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(std::floor(high[axis] + slack)) >> 3;
        }
        for (std::int32_t x = first[0]; x <= last[0]; ++x) {
          for (std::int32_t y = first[1]; y <= last[1]; ++y) {
            for (std::int32_t z = first[2]; z <= last[2]; ++z) keys.push_back(leafKeyOf(x, y, z));
          }
        }
      }
    }
  });
  leaves_.clear();
  for (const auto& keys : found) leaves_.insert(leaves_.end(), keys.begin(), keys.end());
  tbb::parallel_sort(leaves_.begin(), leaves_.end());
  leaves_.erase(std::unique(leaves_.begin(), leaves_.end()), leaves_.end());
}

void ProjectiveIntegrator::collectBoxLeaves(const Eigen::Vector3d& origin_W) {
  if (!leaves_.empty()) return;  // the origin never moves
  std::array<std::int32_t, 3> first, last;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double origin = origin_W[static_cast<Eigen::Index>(axis)], v = map_.params().voxel_size_m;
    const auto leafOf = [&](double x_W) {
      return static_cast<std::int32_t>(std::floor(std::floor((x_W - origin) / v + 0.5) / 8));
    };
    first[axis] = leafOf(params_.box_min_W_m[axis]);
    last[axis] = leafOf(params_.box_max_W_m[axis]);
  }
  for (std::int32_t x = first[0]; x <= last[0]; ++x) {
    for (std::int32_t y = first[1]; y <= last[1]; ++y) {
      for (std::int32_t z = first[2]; z <= last[2]; ++z) leaves_.push_back(leafKeyOf(x, y, z));
    }
  }
}

/// The range that voxel n of a leaf uses: voxels, kSkip or kFree.
float ProjectiveIntegrator::measuredRange(const LeafProjection& seen, std::size_t n, const Eigen::Vector3f& first_S,
                                          const Eigen::Matrix3f& steps) const {
  const float u = seen.column[n], v = seen.row[n];
  const int column = static_cast<int>(u), row = static_cast<int>(v);
  const float own = image_.at(column, row);
  if (own == 0) return params_.empty_is_free && v >= view_low_ && v < view_high_ ? kFree : kSkip;
  if (!params_.guarded) return own;

  const float shifted_u = u - 0.5f, shifted_v = v - 0.5f;
  const float floor_u = std::floor(shifted_u), floor_v = std::floor(shifted_v);
  const int row0 = static_cast<int>(floor_v);
  if (row0 >= 0 && row0 + 1 < image_.rows()) {
    const int left = static_cast<int>(floor_u), column0 = left < 0 ? image_.columns() - 1 : left;
    const int column1 = column0 + 1 < image_.columns() ? column0 + 1 : 0;
    const float p00 = image_.at(column0, row0), p10 = image_.at(column1, row0);
    const float p01 = image_.at(column0, row0 + 1), p11 = image_.at(column1, row0 + 1);
    if (p00 > 0 && p10 > 0 && p01 > 0 && p11 > 0) {
      const float a = shifted_u - floor_u, b = shifted_v - floor_v;
      const float r = (p00 * (1 - a) + p10 * a) * (1 - b) + (p01 * (1 - a) + p11 * a) * b;
      const float step =
          std::max(std::max(std::fabs(p00 - r), std::fabs(p10 - r)), std::max(std::fabs(p01 - r), std::fabs(p11 - r)));
      if (step <= kMostStepBetweenBins) return r;
    }
  }
  const Eigen::Vector3f ray = image_.centreOf(column, row);
  const Eigen::Vector3i local(static_cast<int>(n >> 6), static_cast<int>(n >> 3 & 7), static_cast<int>(n & 7));
  const Eigen::Vector3f x_S = first_S + steps * local.cast<float>();
  return (x_S - x_S.dot(ray) * ray).squaredNorm() <= kMostDistanceFromRay * kMostDistanceFromRay ? own : kSkip;
}

std::uint32_t ProjectiveIntegrator::sample(const LeafProjection& seen, const Eigen::Vector3f& first_S,
                                           const Eigen::Matrix3f& steps, LeafSums& sums) const {
  std::uint32_t touched = 0;
  for (std::size_t n = 0; n < 512; ++n) {
    const float r = measuredRange(seen, n, first_S, steps);
    if (r == kSkip) continue;
    float d = tau_;
    if (r != kFree) {
      d = r - seen.range[n];
      if (d < -tau_ || (d > tau_ && !params_.in_front)) continue;
    }
    const float clamped = std::min(std::max(d, clamp_low_), tau_);
    sums.packed[n] = LeafSums::pack(static_cast<std::uint32_t>((clamped - clamp_low_) * sample_scale_ + 0.5f), 1);
    touched |= 1u << (n >> 4);
  }
  return touched;
}

void ProjectiveIntegrator::integrate(std::span<const Eigen::Vector3f> p_L, const Eigen::Vector3f& q_L,
                                     const ScanFrame& frame, IntegrationResult& result) {
  const double v = map_.params().voxel_size_m;
  image_.fill(p_L, q_L, frame.R_W_S, v);
  if (params_.in_front || params_.empty_is_free) {
    collectBoxLeaves(frame.origin_W);
  } else {
    collectBandLeaves(q_L, frame.R_W_S);
  }
  const Eigen::Vector3d q = q_L.cast<double>() / v;
  const Eigen::Matrix3d R_S_W = frame.R_W_S.transpose();
  const Eigen::Matrix3f steps = R_S_W.cast<float>();
  const LeafKernels& kernels = leafKernels();
  KernelConstants constants = {};
  constants.max_weight = static_cast<std::int32_t>(map_.params().max_weight);
  constants.collision_mean = static_cast<std::int32_t>(map_.collisionMean());

  const std::size_t tasks = (leaves_.size() + kLeavesPerTask - 1) / kLeavesPerTask;
  std::vector<TaskResult> done(tasks);
  PackedTree& tree = map_.tree();
  tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t t) {
    Workers::Worker& worker = workers_->local.local();
    TaskResult& task = done[t];
    PackedAccessor accessor(tree);
    const std::size_t end = std::min(leaves_.size(), (t + 1) * kLeavesPerTask);
    for (std::size_t n = t * kLeavesPerTask; n < end; ++n) {
      const auto origin = originOf(leaves_[n]);
      const Eigen::Vector3f first_S = (R_S_W * (Eigen::Vector3d(origin[0], origin[1], origin[2]) - q)).cast<float>();
      image_.project(first_S, steps, worker.seen);
      const std::uint32_t touched = sample(worker.seen, first_S, steps, worker.sums);
      if (touched == 0) continue;
      ++task.touched;
      const openvdb::Coord ijk(origin[0], origin[1], origin[2]);
      PackedLeaf* leaf = accessor.probeLeaf(ijk);
      if (leaf == nullptr) {
        task.new_leaves.push_back(std::make_unique<PackedLeaf>(openvdb::PartialCreate(), ijk));
        leaf = task.new_leaves.back().get();
      }
      if (leaf->buffer().empty()) {
        allocateZeroed(*leaf);
        ++task.allocated;
      }
      const LeafTarget target = {map_.openValues(*leaf), &leaf->getValueMask().template getWord<std::uint64_t>(0)};
      if (wants_distances_) task.distances.push_back({origin, touched, target.packed});
      LeafChange change;
      change.origin_ijk = origin;
      if (kernels.fold(target, constants, touched, worker.sums, LeafBits{}, change, task.counts)) {
        task.changes.push_back(change);
      }
    }
  });

  changes_.clear();
  distances_.clear();
  PackedAccessor accessor(tree);
  for (TaskResult& task : done) {
    for (auto& leaf : task.new_leaves) accessor.addLeaf(leaf.release());
    changes_.insert(changes_.end(), task.changes.begin(), task.changes.end());
    distances_.insert(distances_.end(), task.distances.begin(), task.distances.end());
    result.new_leaves += task.new_leaves.size();
    result.touched_leaves += task.touched;
    result.counts.distance_updates += task.counts.distance_updates;
    result.counts.newly_observed += task.counts.newly_observed;
    result.counts.flipped_voxels += task.counts.flipped_voxels;
    map_.leaf_count += task.new_leaves.size();
    map_.allocated_leaf_count += task.allocated;
    map_.observed_voxels += task.counts.newly_observed;
  }
  mergeChanges(result);
  // Returns only mark their cleared band: no other distances changed.
  if (!distances_.empty()) result.distances.emplace_back(distances_);
}

void ProjectiveIntegrator::mergeChanges(IntegrationResult& result) {
  if (!result.changes.empty()) {
    std::vector<LeafChange> first, merged;
    for (const auto& part : result.changes) first.insert(first.end(), part.begin(), part.end());
    std::sort(first.begin(), first.end(), before);
    std::sort(changes_.begin(), changes_.end(), before);
    auto a = first.begin();
    auto b = changes_.begin();
    while (a != first.end() || b != changes_.end()) {
      const bool take_a = b == changes_.end() || (a != first.end() && !before(*b, *a));
      const bool take_b = a == first.end() || (b != changes_.end() && !before(*a, *b));
      const LeafChange change = take_a && take_b ? joined(*a, *b) : take_a ? *a : *b;
      a += take_a ? 1 : 0;
      b += take_b ? 1 : 0;
      if (!empty(change)) merged.push_back(change);
    }
    changes_ = std::move(merged);
  }
  result.changes.clear();
  if (!changes_.empty()) result.changes.emplace_back(changes_);
}

}  // namespace accessvdb::internal
