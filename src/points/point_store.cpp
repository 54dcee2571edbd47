// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/point_store.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <tuple>

#include "hostdev/position_voxel.h"
#include "hostdev/voxel_scale.h"
#include "points/radix_sort.h"
#include "points/short_places.h"
#include "processor/prefetch.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kPointsPerTask = 256;
/// Returns of a scan; more, or some that are too far apart for short places, are sorted by all threads.
constexpr std::size_t kMostSortedByOne = std::size_t{1} << 17;
/// Points are scattered in memory: each is prefetched this many points ahead of its use.
constexpr std::size_t kPointsAhead = 6;
constexpr double kOffsetSteps = 1 << 20;  // per voxel
constexpr double kSensorSteps = 1 << 16;  // per metre

}  // namespace

PointStore::PointStore(const FieldParams& resolved, kernels::DirectionTable directions)
    : params_(resolved),
      inverse_voxel_size_(kernels::VoxelScale(resolved.tsdf.voxel_size_m).inverse_float32),
      seen_(resolved.approach, std::move(directions)) {}

Index3 PointStore::voxelOf(const Eigen::Vector3f& p_L) const {
  const auto ijk = kernels::voxelOf(p_L.x(), p_L.y(), p_L.z(), inverse_voxel_size_);
  return {ijk[0], ijk[1], ijk[2]};
}

Index3 PointStore::voxelOf(const Eigen::Vector3d& p_L) const {
  const auto ijk = kernels::voxelOfPosition(p_L.data(), inverse_voxel_size_);
  return {ijk[0], ijk[1], ijk[2]};
}

/// The returns of a scan by place of their voxels; those of one voxel in the order of the scan.
void PointStore::sortReturns(std::span<const Eigen::Vector3f> p_L) {
  const tbb::blocked_range<std::size_t> all(0, p_L.size(), kPointsPerTask);
  std::vector<KeyedReturn>&returns = groups_.returns, &sorted = groups_.sorted;
  returns.resize(p_L.size());
  if (returns.empty()) return;
  const ShortPlaces::Box leaves = tbb::parallel_reduce(
      all, ShortPlaces::Box(),
      [&](const auto& range, ShortPlaces::Box box) {
        for (std::size_t n = range.begin(); n != range.end(); ++n) {
          const Index3 voxel = voxelOf(p_L[n]);
          returns[n] = {placeOf(voxel), static_cast<std::uint32_t>(n)};
          box.add(parentOf(voxel));
        }
        return box;
      },
      [](ShortPlaces::Box box, const ShortPlaces::Box& other) {
        box.add(other);
        return box;
      });
  const ShortPlaces places(leaves);
  const int bits_of_index = std::bit_width(returns.size());
  if (returns.size() > kMostSortedByOne || places.bits() + bits_of_index > 64) {
    tbb::parallel_sort(returns, [](const KeyedReturn& a, const KeyedReturn& b) {
      return std::tie(a.place, a.index) < std::tie(b.place, b.index);
    });
    return;
  }
  std::vector<std::uint64_t>& order = groups_.order;
  order.resize(returns.size());
  for (std::size_t n = 0; n < order.size(); ++n) order[n] = places(returns[n].place) << bits_of_index | n;
  radixSort(order, groups_.spare, [bits_of_index](std::uint64_t item) { return item >> bits_of_index; });
  sorted.resize(returns.size());
  tbb::parallel_for(all, [&](const auto& range) {
    const std::uint64_t index = (std::uint64_t{1} << bits_of_index) - 1;
    for (std::size_t n = range.begin(); n != range.end(); ++n) sorted[n] = returns[order[n] & index];
  });
  std::swap(returns, sorted);
}

/// Groups returns by place of the voxel, sorted by value, so that the order within the scan does not matter.
void PointStore::group(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L) {
  sortReturns(p_L);
  const auto values = [&](std::uint32_t n) {
    const Eigen::Vector3f &p = p_L[n], &q = q_L[q_L.size() == 1 ? 0 : n];
    return std::make_tuple(p.x(), p.y(), p.z(), q.x(), q.y(), q.z());
  };
  std::vector<KeyedReturn>& returns = groups_.returns;
  groups_.begin.clear();
  for (std::size_t n = 0; n < returns.size(); ++n) {
    if (n == 0 || returns[n].place != returns[n - 1].place) groups_.begin.push_back(static_cast<std::uint32_t>(n));
  }
  groups_.begin.push_back(static_cast<std::uint32_t>(returns.size()));
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, groups_.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      const auto begin = returns.begin() + groups_.begin[g], end = returns.begin() + groups_.begin[g + 1];
      if (end - begin == 1) continue;
      std::sort(begin, end,
                [&](const KeyedReturn& a, const KeyedReturn& b) { return values(a.index) < values(b.index); });
    }
  });
}

void PointStore::locateGroups() {
  voxels_.resize(groups_.size());
  places_.resize(groups_.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, groups_.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) voxels_[g] = voxelAt(groups_.first(g).place);
    index_.locate(std::span(voxels_).subspan(range.begin(), range.size()),
                  std::span(places_).subspan(range.begin(), range.size()));
  });
}

/// Gives each group an id, in the order of their places; a new one if its voxel has none. So new points in one leaf
/// have consecutive ids, and most of their readers do, too.
void PointStore::numberGroups() {
  TouchedPoints& touched = touched_;
  locateGroups();
  const std::uint32_t before = size();
  added_.clear();
  touched.all.resize(places_.size());
  for (std::size_t g = 0; g < places_.size(); ++g) {
    touched.all[g] = places_[g].id;
    if (places_[g].id != kNone) continue;
    touched.all[g] = before + static_cast<std::uint32_t>(added_.size());
    added_.push_back({voxels_[g], touched.all[g], places_[g].block});
  }
  touched.new_points = added_.size();
}

void PointStore::indexNew() {
  index_.insertAll(added_);
  touched_.changed_blocks.clear();
  if (describe_touched_) index_.blocksOfLastInsert(touched_.changed_blocks);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, added_.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) block_[added_[n].id] = added_[n].block;
  });
}

void PointStore::endReturns() {
  std::vector<kernels::PointDelta>& deltas = touched_.deltas;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, deltas.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      if (deltas[n].block == kNone) deltas[n].block = block_[deltas[n].id];
    }
  });
}

/// For all points, with the new ones.
void PointStore::makeRoom() {
  const std::size_t size = this->size() + added_.size();
  block_.growRaw(size);
  first_L_.growRaw(size);
  pca_L_.growRaw(size);
  sums_.growRaw(size);
  seen_.inItsForm([size](auto& seen) { seen.grow(size); });
}

/// Initialises a new point, except its seen directions, before its first return is added.
void PointStore::start(std::uint32_t id, const Eigen::Vector3f& first_L) {
  first_L_[id] = first_L;
  pca_L_[id] = Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN());
  sums_[id] = {};
}

void PointStore::prefetch(std::uint32_t id) const {
  prefetchRead(&first_L_[id]);
  prefetchRead(&pca_L_[id]);
  prefetchRead(&sums_[id], sizeof(ReturnSums));
  seen_.prefetch(id);
}

const TouchedPoints& PointStore::addReturns(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                            std::span<const std::int32_t> attributes) {
  const TouchedPoints& touched = placeReturns(p_L, q_L);
  indexNew();
  sumReturns(p_L, q_L, attributes);
  endReturns();
  return touched;
}

/// After the sums of the same scan.
void PointStore::addAttributes(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                               std::span<const std::int32_t> attributes, std::uint32_t first_new) {
  const ReturnGroups& groups = groups_;
  order_.resize(groups.returns.size());
  ties_.resize(groups.size());
  const auto same = [&](std::uint32_t a, std::uint32_t b) {
    return p_L[a] == p_L[b] && (q_L.size() == 1 || q_L[a] == q_L[b]);
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, groups.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t g = range.begin(); g != range.end(); ++g) {
      const std::uint32_t begin = groups.begin[g], end = groups.begin[g + 1];
      std::uint32_t ties = 0;
      for (std::uint32_t m = begin; m < end; ++m) {
        order_[m] = groups.returns[m].index;
        if (ties == m - begin && same(order_[m], order_[begin])) ++ties;
      }
      ties_[g] = ties;
    }
  });
  attributes_.add({touched_.all, groups.begin, order_, ties_, first_new}, attributes, size(),
                  [this](std::uint32_t id) { return sums_[id].returns; });
}

const TouchedPoints& PointStore::placeReturns(std::span<const Eigen::Vector3f> p_L,
                                              std::span<const Eigen::Vector3f> q_L) {
  group(p_L, q_L);
  numberGroups();
  makeRoom();
  return touched_;
}

void PointStore::sumReturns(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                            std::span<const std::int32_t> attributes) {
  TouchedPoints& touched = touched_;
  const ReturnGroups& groups = groups_;
  const std::uint32_t before = size() - static_cast<std::uint32_t>(touched.new_points);
  touched.before_L.resize(groups.size());
  touched.views_changed.assign(groups.size(), 0);
  touched.deltas.resize(describe_touched_ ? groups.size() : 0);
  seen_.inItsForm([&](auto& seen) {
    const std::uint32_t first_pose = seen.addPoses(q_L);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, groups.size(), kPointsPerTask), [&](const auto& range) {
      for (std::size_t g = range.begin(); g != range.end(); ++g) {
        const std::uint32_t id = touched.all[g];
        if (g + kPointsAhead < range.end()) prefetch(touched.all[g + kPointsAhead]);
        if (id >= before) {
          start(id, p_L[groups.first(g).index]);
          seen.clear(id);
        }
        touched.before_L[g] = pca_L_[id];
        for (std::uint32_t m = groups.begin[g]; m < groups.begin[g + 1]; ++m) {
          const std::uint32_t i = groups.returns[m].index, sensor = q_L.size() == 1 ? 0 : i;
          addToSums(id, p_L[i], q_L[sensor]);
          if (seen.add(id, p_L[i], q_L[sensor], first_pose + sensor)) touched.views_changed[g] = 1;
        }
        refreshMean(id);
        if (describe_touched_) touched.deltas[g] = deltaIn(id < before ? block_[id] : kNone, id, touched.before_L[g]);
      }
    });
  });
  if (attributes_.columns() > 0) addAttributes(p_L, q_L, attributes, before);
}

void PointStore::addToSums(std::uint32_t id, const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L) {
  const Index3 voxel = voxelOf(p_L);
  ReturnSums& sums = sums_[id];
  if (sums.returns == std::numeric_limits<std::uint32_t>::max()) return;  // one more does not move the mean
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double centre = voxel[axis] * params_.tsdf.voxel_size_m;
    const auto a = static_cast<Eigen::Index>(axis);
    sums.offset[axis] +=
        std::llround((static_cast<double>(p_L[a]) - centre) / params_.tsdf.voxel_size_m * kOffsetSteps);
    sums.sensor[axis] += std::llround(static_cast<double>(q_L[a]) * kSensorSteps);
  }
  ++sums.returns;
}

void PointStore::refreshMean(std::uint32_t id) {
  if (!params_.scoring.mean_positions) {
    pca_L_[id] = first_L_[id];
    return;
  }
  const Index3 voxel = voxelOf(first_L_[id]);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double offset =
        static_cast<double>(sums_[id].offset[axis]) / static_cast<double>(sums_[id].returns) / kOffsetSteps;
    pca_L_[id][static_cast<Eigen::Index>(axis)] =
        static_cast<float>((static_cast<double>(voxel[axis]) + offset) * params_.tsdf.voxel_size_m);
  }
}

Eigen::Vector3d PointStore::meanSensor_L(std::uint32_t id) const {
  Eigen::Vector3d mean;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    mean[static_cast<Eigen::Index>(axis)] =
        static_cast<double>(sums_[id].sensor[axis]) / static_cast<double>(sums_[id].returns) / kSensorSteps;
  }
  return mean;
}

kernels::PointDelta PointStore::deltaOf(std::uint32_t id, const Eigen::Vector3f& before_L) const {
  return deltaIn(block_[id], id, before_L);
}

kernels::PointDelta PointStore::deltaIn(std::uint32_t block, std::uint32_t id, const Eigen::Vector3f& before_L) const {
  const auto copy3 = [](const Eigen::Vector3f& from, float* to) {
    for (Eigen::Index axis = 0; axis < 3; ++axis) to[axis] = from[axis];
  };
  kernels::PointDelta delta;
  delta.id = id;
  delta.block = block;
  copy3(first_L_[id], delta.position_L);
  copy3(pca_L_[id], delta.mean_L);
  copy3(toSensor_L(id), delta.to_sensor_L);
  copy3(before_L, delta.before_L);
  delta.seen = seen(id);
  return delta;
}

StoredPoint PointStore::stored(std::uint32_t id) const { return {first_L_[id], sums_[id], seen_.stored(id)}; }

void PointStore::restorePoses(std::span<const Eigen::Vector3f> poses_L) {
  seen_.inItsForm([poses_L](auto& seen) { seen.addPoses(poses_L); });
}

/// Whether addReturns() could have made this point.
bool PointStore::canBe(const StoredPoint& point) const {
  const auto farthest_m = static_cast<float>(kFarthestVoxel * params_.tsdf.voxel_size_m);
  if (!point.first_L.allFinite() || !(point.first_L.lpNorm<Eigen::Infinity>() <= farthest_m)) return false;
  const double bound_m = (kFarthestVoxel + 1) * params_.tsdf.voxel_size_m;  // sensor positions, rounded to steps
  const double returns = point.sums.returns;
  if (returns == 0) return false;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (!(std::abs(static_cast<double>(point.sums.offset[axis])) <= returns * kOffsetSteps)) return false;
    if (!(std::abs(static_cast<double>(point.sums.sensor[axis])) <= returns * bound_m * kSensorSteps)) return false;
  }
  return seen_.canBe(point.seen);
}

bool PointStore::restore(std::span<const StoredPoint> points) {
  const std::uint32_t before = size();
  std::vector<KeyedReturn>& order = groups_.returns;
  order.resize(points.size());
  std::atomic<bool> good = true;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), kPointsPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      if (!canBe(points[n])) {
        good = false;
        return;
      }
      order[n] = {placeOf(voxelOf(points[n].first_L)), static_cast<std::uint32_t>(n)};
    }
  });
  if (!good) return false;
  tbb::parallel_sort(order, [](const KeyedReturn& a, const KeyedReturn& b) { return a.place < b.place; });
  voxels_.resize(points.size());
  places_.resize(points.size());
  added_.resize(points.size());
  for (std::size_t n = 0; n < order.size(); ++n) {
    if (n > 0 && order[n].place == order[n - 1].place) return false;  // two points in one voxel
    voxels_[n] = voxelAt(order[n].place);
  }
  index_.locate(voxels_, places_);
  for (std::size_t n = 0; n < order.size(); ++n) {
    if (places_[n].id != kNone) return false;
    added_[n] = {voxels_[n], before + order[n].index, places_[n].block};
  }
  index_.insertAll(added_);
  makeRoom();
  seen_.inItsForm([&](auto& seen) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), kPointsPerTask), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        block_[added_[n].id] = added_[n].block;
        const auto id = static_cast<std::uint32_t>(before + n);
        start(id, points[n].first_L);
        sums_[id] = points[n].sums;
        seen.restore(id, points[n].seen);
        refreshMean(id);
      }
    });
  });
  return true;
}

std::uint64_t PointStore::bytes() const {
  const auto bytesOf = [](const auto& list) { return list.capacity() * sizeof(list[0]); };
  return index_.bytes() + block_.bytes() + first_L_.bytes() + pca_L_.bytes() + sums_.bytes() + seen_.bytes() +
         bytesOf(touched_.all) + bytesOf(touched_.before_L) + bytesOf(touched_.views_changed) +
         bytesOf(touched_.deltas) + bytesOf(touched_.changed_blocks) + bytesOf(groups_.returns) +
         bytesOf(groups_.sorted) + bytesOf(groups_.order) + bytesOf(groups_.spare) + bytesOf(groups_.begin) +
         bytesOf(voxels_) + bytesOf(places_) + bytesOf(added_) + bytesOf(order_) + bytesOf(ties_) + attributes_.bytes();
}

}  // namespace accessvdb::internal
