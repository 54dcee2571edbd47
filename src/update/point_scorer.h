// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The state of points on the device and their scoring: shared by both update policies.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "accessvdb/distance_change.h"
#include "accessvdb/params.h"
#include "launch/backend.h"
#include "launch/due_update.h"
#include "points/neighbourhood.h"
#include "points/point_store.h"
#include "points/raw_vector.h"
#include "update/device_points.h"
#include "update/waiting_points.h"

namespace accessvdb::internal {

using TakeLeaves = std::function<void(std::span<const Index3> leaves)>;

/// What point state reads from the map; filled by the field.
struct MapReads {
  /// Observations behind the confidence of each id: largest weight of 3x3x3 voxels, or that of its own voxel (paper).
  std::function<void(std::span<const std::uint32_t> ids, std::span<std::uint16_t> weights)> weights;
  /// The same for voxels already known.
  std::function<void(std::span<const Index3> voxels, std::span<std::uint16_t> weights)> weights_at;
  /// Needs only the returns, not the map. Calls take(leaves), from several threads at once, for all leaves (voxel index
  /// >> 3) in which a scan may have raised a point's weight: a superset, and a leaf may come several times.
  /// @return false if no leaf was named: any leaf may be affected
  std::function<bool(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                     const TakeLeaves& take)>
      reached;
  DistanceCode distance_code;  ///< for DistanceChange (paper trigger i)
};

/// Tables and grid that scoring reads; views in the backend's memory.
struct ScoringTables {
  kernels::OccupancyView map;
  kernels::ToolKernelView tool;
  kernels::ToolSlabsView slabs;
  kernels::ApproachView approach;
  kernels::UpdateRule rule;
  const kernels::PreparedTool* prepared = nullptr;  ///< ScoreRequest::prepared
};

/// What the host stores of each point's state: a cache line, because points are read at random.
struct alignas(64) PointRecord {
  Eigen::Vector3f normal_L = {0, 0, 0};
  float reach_m = 0;        ///< Neighbourhood::reach_m
  DirectionMask seen = {};  ///< joined; of a wide set empty, and PointsOnDevice has them
  std::uint16_t weight = 0;
  std::uint16_t score = kNoScore, direction = kNoDirection;
  PointLabel label = PointLabel::Unscored;
  std::uint8_t roll = 0;
  bool has_neighbourhood = false;
};

/// What scoring found out about a point, but for its seen directions.
struct ScoredPoint {
  Eigen::Vector3f normal_L = {0, 0, 0};
  float reach_m = 0, stability = 1;
  std::uint16_t weight = 0, score = kNoScore, direction = kNoDirection;
  PointLabel label = PointLabel::Unscored;
  PointReason reason = PointReason::Confidence;
  std::uint8_t roll = 0;
  bool has_neighbourhood = false;
};

class PointScorer {
 public:
  PointScorer(const PointStore& points, const FieldParams& resolved, kernels::Backend& backend, MapReads reads);

  /// Makes room for all points of the store.
  void grow();
  /// Like grow(), but only on the device and not initialised: for an updater that keeps state without the host.
  void growDevice() { device_.growRaw(points_.size()); }
  /// From now on what a device keeps of the points for any tool is that of another tool's scorer (PointsOnDevice).
  void shareDevice(const PointScorer& owner) { device_.shareWith(owner.device_); }
  /// Only makes room, so that the updater can begin: readers of the device do not see the new points until
  /// growDevice().
  void reserveDevice() { device_.reserve(points_.size()); }

  /// Reads the weights again. @return ids that crossed the confidence bound
  std::vector<std::uint32_t> refreshWeights(std::span<const std::uint32_t> ids);
  /// Reads the weights of points that were not confident. @param fresh  in: those; out: the ones that still are not
  /// @return those that now are
  std::vector<std::uint32_t> takeConfident(std::vector<std::uint32_t>& fresh);
  /// Points whose normal or seen directions changed, and what these were; zero if there were none.
  struct Changed {
    std::vector<std::uint32_t> ids;
    RawVector<kernels::PointDirections> before;
  };
  /// Whether to keep the memory that changes of this many points took. After a first update, or one after many scans,
  /// it is given back.
  [[nodiscard]] bool keepsMemoryFor(std::size_t changed) const {
    constexpr std::size_t kMost = 1 << 18;
    return changed <= kMost && changed <= points_.size() / 2;
  }
  /// Recomputes the neighbourhoods.
  /// @param ids  each once, in any order; fastest if points of a block follow each other
  /// @param memory  an earlier result whose memory may be used again; its content is lost
  Changed refreshNeighbourhoods(std::span<const std::uint32_t> ids, Changed memory = {});
  /// Reads the weights of touched points that have a neighbourhood, and sends them to the device, because views of the
  /// points show them.
  void refreshTouched(std::vector<std::uint32_t> touched);
  /// Takes over what the refresh functions of a scorer of the same points found for these ids, and sends it to the
  /// device. Those without a neighbourhood are left out.
  void adopt(const PointScorer& from, std::span<const std::uint32_t> ids);
  /// Sends to the device what the refresh functions found for these ids.
  void upload(std::span<const std::uint32_t> ids);

  /// Whether the host has all of what scoring found out.
  [[nodiscard]] bool keepsAllOnHost() const { return backend_.hasHostMemory(); }
  /// Only then. @param seen  receives the joined seen directions, [directionWords()]
  [[nodiscard]] ScoredPoint scored(std::uint32_t id, std::span<std::uint64_t> seen) const;
  /// Only then, after grow(). From any thread, also at the same time for other points.
  void restore(std::uint32_t id, const ScoredPoint& point, std::span<const std::uint64_t> seen);

  /// Scores the items on the device and stores the results.
  std::vector<kernels::ScoreResult> score(std::span<const kernels::ScoreItem> items, const ScoringTables& tables);

  /// What a backend needs to evaluate what is due.
  [[nodiscard]] kernels::DueUpdate dueUpdate(const kernels::KnownScale& scale, const ScoringTables& tables) const;
  /// Stores what an evaluation left behind. From any thread, also at the same time for other points.
  void store(std::uint32_t id, const kernels::DueOutcome& outcome);

  /// At the end of each update: which points it left waiting.
  void setWaiting(std::vector<std::uint32_t> ids) { waiting_.set(std::move(ids)); }
  /// WaitingPoints::marks(): whatever is stored of these points, they are told as unscored.
  [[nodiscard]] std::span<const std::uint8_t> waiting() const { return waiting_.marks(); }

  [[nodiscard]] const PointRecord& record(std::uint32_t id) const { return records_[id]; }
  [[nodiscard]] bool confidentEnough(std::uint32_t id) const { return isConfident(records_[id].weight); }
  [[nodiscard]] const kernels::SurfaceChoice& choice() const { return search_.choice(); }
  /// Whether this many observations are enough for a point to be scored.
  [[nodiscard]] bool isConfident(std::uint16_t weight) const;
  [[nodiscard]] const PointsOnDevice& device() const { return device_; }
  [[nodiscard]] kernels::Backend& backend() const { return backend_; }
  [[nodiscard]] const PointStore& points() const { return points_; }
  [[nodiscard]] const MapReads& reads() const { return reads_; }
  [[nodiscard]] const FieldParams& params() const { return params_; }
  [[nodiscard]] std::uint64_t hostBytes() const {
    return records_.bytes() + wide_seen_.capacity() * sizeof(std::uint64_t) +
           found_.capacity() * sizeof(Neighbourhood) + inputs_.capacity() * sizeof(kernels::PointInput) +
           waiting_.bytes();
  }

 private:
  /// Of a wide set, the host joins the seen directions, in the backend's memory if it can.
  [[nodiscard]] bool keepsWideSeen() const { return points_.isWide() && !backend_.hasHostMemory(); }
  [[nodiscard]] std::uint64_t* wideSeen() { return keepsWideSeen() ? wide_seen_.data() : device_.view().seen; }
  [[nodiscard]] const std::uint64_t* wideSeen() const {
    return keepsWideSeen() ? wide_seen_.data() : device_.view().seen;
  }
  void uploadInputs(std::span<const std::uint32_t> ids);
  void uploadWideSeen(std::span<const std::uint32_t> ids);

  const PointStore& points_;
  FieldParams params_;
  kernels::Backend& backend_;
  MapReads reads_;
  NeighbourhoodSearch search_;
  PointsOnDevice device_;
  ChunkedArray<PointRecord> records_;
  WaitingPoints waiting_;
  std::vector<std::uint64_t> wide_seen_;  ///< [points x words of a set] if keepsWideSeen()
  // For one refresh; kept, because freshly allocated memory has to be cleared by the system first.
  std::vector<Neighbourhood> found_;
  std::vector<kernels::PointInput> inputs_;
};

}  // namespace accessvdb::internal
