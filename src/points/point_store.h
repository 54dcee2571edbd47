// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The authoritative store of surface points: one stable id per voxel that ever contained a return (docs/PAPER_MAP.md,
/// "Surface points").
///
/// Everything here depends on the set of returns of each scan, not on their order: sums are integers, and the first
/// return of a voxel is the lexicographically smallest (x, y, z) of the first scan that reached it.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "accessvdb/params.h"
#include "launch/point_delta.h"
#include "points/point_attributes.h"
#include "points/seen_directions.h"
#include "points/surface_index.h"

namespace accessvdb::internal {

/// Points that a scan touched, in the order of their voxels (placeOf).
struct TouchedPoints {
  std::vector<std::uint32_t> all;           ///< including new ones
  std::vector<Eigen::Vector3f> before_L;    ///< pca_L() of each before the scan; NaN for new points
  std::vector<std::uint8_t> views_changed;  ///< of each: whether the scan changed its seen directions
  std::size_t new_points = 0;
  // Only after describeTouched(true).
  std::vector<kernels::PointDelta> deltas;    ///< each as it is after the scan; before_L as above
  std::vector<std::uint32_t> changed_blocks;  ///< those with new points, in no order
};

/// Sums over the returns of a point; integers, so that the order does not matter.
struct ReturnSums {
  std::array<std::int64_t, 3> offset;  ///< return minus voxel centre, in 2^-20 voxels
  std::array<std::int64_t, 3> sensor;  ///< in 2^-16 m
  std::uint32_t returns;               ///< their number
};

/// A point as it is saved. All else that the store knows of it follows from this.
struct StoredPoint {
  Eigen::Vector3f first_L;
  ReturnSums sums;
  StoredSeen seen;  ///< its own
};

class PointStore {
 public:
  PointStore(const FieldParams& resolved, kernels::DirectionTable directions);

  [[nodiscard]] int numDirections() const { return seen_.numDirections(); }
  /// Words of seen directions, per point.
  [[nodiscard]] int directionWords() const { return seen_.directionWords(); }
  /// Whether there are more directions than a DirectionMask holds. All masks of points are then empty, and joinSeen()
  /// has what they were seen from.
  [[nodiscard]] bool isWide() const { return seen_.isWide(); }

  /// Whether addReturns() describes touched points for a backend that keeps them itself. This is cheaper while all
  /// threads are already working on the points than later.
  void describeTouched(bool wanted) { describe_touched_ = wanted; }
  /// Adds the returns of one scan. @param q_L  [n] or [1] sensor positions
  /// @param attributes  what they carry: [n x attributes().columns()], row by row
  /// @return valid until the next call
  const TouchedPoints& addReturns(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                  std::span<const std::int32_t> attributes = {});
  /// The same in four parts, of which the second and third may run at the same time. After the first one,
  /// TouchedPoints::all is as it will be.
  const TouchedPoints& placeReturns(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);
  /// Then index(), blockOf() and TouchedPoints::changed_blocks are as they will be.
  void indexNew();
  void sumReturns(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                  std::span<const std::int32_t> attributes = {});
  /// Gives the deltas of new points their blocks, which are kNone before.
  void endReturns();
  /// What the returns of points carry; nothing unless it was asked for.
  void carry(std::vector<CarriedAttribute> carried) { attributes_ = PointAttributes(std::move(carried)); }
  [[nodiscard]] const PointAttributes& attributes() const { return attributes_; }
  [[nodiscard]] PointAttributes& attributes() { return attributes_; }

  [[nodiscard]] std::uint32_t size() const { return static_cast<std::uint32_t>(first_L_.size()); }
  [[nodiscard]] const SurfaceIndex& index() const { return index_; }
  /// Voxel of a stored position.
  [[nodiscard]] Index3 voxelOf(const Eigen::Vector3f& p_L) const;
  /// Voxel of any position within kFarthestVoxel.
  [[nodiscard]] Index3 voxelOf(const Eigen::Vector3d& p_L) const;

  /// Prefetches what is known of a point: it is scattered in memory.
  void prefetch(std::uint32_t id) const;
  /// Index into index().blocks().
  [[nodiscard]] std::uint32_t blockOf(std::uint32_t id) const { return block_[id]; }
  [[nodiscard]] const Eigen::Vector3f& first_L(std::uint32_t id) const { return first_L_[id]; }
  /// Position that neighbourhoods are based on: mean return (product) or first return (paper).
  [[nodiscard]] const Eigen::Vector3f& pca_L(std::uint32_t id) const { return pca_L_[id]; }
  [[nodiscard]] std::uint32_t returns(std::uint32_t id) const { return sums_[id].returns; }
  [[nodiscard]] Eigen::Vector3d meanSensor_L(std::uint32_t id) const;
  /// From the first return to the mean sensor position, metres: the side that normals point to.
  [[nodiscard]] Eigen::Vector3f toSensor_L(std::uint32_t id) const {
    return (meanSensor_L(id) - first_L_[id].cast<double>()).cast<float>();
  }
  /// Directions that the point itself was seen from: the stored mask, or computed from its viewpoints.
  [[nodiscard]] DirectionMask seen(std::uint32_t id) const { return seen_.mask(id, first_L_[id]); }
  /// Adds the directions of a point, of a set of any size. @param words  [directionWords()]
  void joinSeen(std::uint32_t id, std::span<std::uint64_t> words) const { seen_.join(id, first_L_[id], words); }
  /// A point in its current state. @param before_L  see kernels::PointDelta
  [[nodiscard]] kernels::PointDelta deltaOf(std::uint32_t id, const Eigen::Vector3f& before_L) const;
  /// Distinct sensor positions, with viewpoints only.
  [[nodiscard]] const ChunkedArray<Eigen::Vector3f>& poses() const { return seen_.poses(); }

  [[nodiscard]] StoredPoint stored(std::uint32_t id) const;
  /// Appends sensor positions and points of a saved store, in the order of their ids; any number at a time.
  void restorePoses(std::span<const Eigen::Vector3f> poses_L);
  /// @return false if a point is not one that this store can have; then it is of no use any more
  [[nodiscard]] bool restore(std::span<const StoredPoint> points);

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  /// A return with its voxel.
  struct KeyedReturn {
    std::uint64_t place;  ///< of its voxel
    std::uint32_t index;
  };
  /// The returns of a scan, grouped by voxel.
  struct ReturnGroups {
    std::vector<KeyedReturn> returns, sorted;  ///< sorted, spare: for sorting
    std::vector<std::uint64_t> order, spare;
    std::vector<std::uint32_t> begin;  ///< [groups + 1] first of each group in returns

    [[nodiscard]] std::size_t size() const { return begin.size() - 1; }
    [[nodiscard]] const KeyedReturn& first(std::size_t group) const { return returns[begin[group]]; }
  };
  [[nodiscard]] kernels::PointDelta deltaIn(std::uint32_t block, std::uint32_t id,
                                            const Eigen::Vector3f& before_L) const;
  [[nodiscard]] bool canBe(const StoredPoint& point) const;
  void sortReturns(std::span<const Eigen::Vector3f> p_L);
  void group(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);
  void locateGroups();
  void numberGroups();
  void makeRoom();
  void start(std::uint32_t id, const Eigen::Vector3f& first_L);
  void addToSums(std::uint32_t id, const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L);
  void refreshMean(std::uint32_t id);
  void addAttributes(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                     std::span<const std::int32_t> attributes, std::uint32_t first_new);

  FieldParams params_;
  float inverse_voxel_size_;
  bool describe_touched_ = false;
  SurfaceIndex index_;
  ChunkedArray<std::uint32_t> block_;
  ChunkedArray<Eigen::Vector3f> first_L_, pca_L_;
  ChunkedArray<ReturnSums> sums_;  ///< zeroed by start()
  SeenDirections seen_;
  PointAttributes attributes_{{}};
  // For one scan; kept, because freshly allocated memory has to be cleared by the system first.
  ReturnGroups groups_;
  TouchedPoints touched_;
  std::vector<Index3> voxels_;   ///< of the groups
  std::vector<Located> places_;  ///< of the groups
  std::vector<NewVoxel> added_;
  std::vector<std::uint32_t> order_, ties_;  ///< only where returns carry something
};

}  // namespace accessvdb::internal
