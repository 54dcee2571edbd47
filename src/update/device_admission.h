// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tells a backend that keeps the points itself (launch/point_delta.h) about them, for any policy: which points are
/// new, touched, or now confident.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/types.h"
#include "launch/point_delta.h"
#include "update/device_blocks.h"
#include "update/fresh_points.h"
#include "update/point_scorer.h"
#include "update/scheduled_tool.h"

namespace accessvdb::internal {

/// Tables for an updater of any policy. @param group_log2  of its blocks
kernels::NeighbourTables neighbourTables(const FieldParams& resolved, int num_directions, int group_log2);
/// What an update of any policy reads.
class ScoringInputs {
 public:
  /// @param tools  the same for all updates
  explicit ScoringInputs(std::vector<ScheduledTool> tools) : tools_(std::move(tools)) {}

  /// @param mirror  in the backend's memory  @param budget_points  of the update; 0: no limit
  /// @return valid until the next call
  [[nodiscard]] kernels::ScoringInput of(const kernels::OccupancyGrid* mirror, int budget_points);

 private:
  std::vector<ScheduledTool> tools_;
  std::vector<kernels::ToolInput> inputs_;
};
UpdateStats statsOf(const kernels::UpdateOutcome& outcome);

class DeviceAdmission {
 public:
  /// @param scorers  at least one, which share the device; they and the updater must outlive this
  /// @param group_log2  same as the updater's
  DeviceAdmission(std::vector<PointScorer*> scorers, kernels::PointAdmission& updater, int group_log2);

  /// Whether noteReturns() needs the next scan described (PointStore::describeTouched).
  [[nodiscard]] bool takesDeltas() const { return isNextFirst(); }
  /// Prepares handOver(). @param changed  TouchedPoints::changed_blocks of the next scan
  void describeBlocks(std::span<const std::uint32_t> changed);
  /// Call when a scan's returns are in the store. Hands over those of the first scan since the last update, so that the
  /// backend can begin. If another scan comes before the update, that work is wasted: everything is handed over again.
  /// @return whether they were handed over
  bool handOver(const TouchedPoints& touched);
  /// Call for every scan, also concurrently with handOver(): notes which points it touched and which leaves it reached.
  /// @param is_in_map  whether the map has the scan already; then the weights of the points that it touched are read at
  /// once, before the backend is busy, and again if another scan comes before the update
  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L, bool is_in_map);
  /// Call when the map changed without a scan.
  void forgetWeights() { has_weights_ = false; }
  /// Call when all points came at once, without a scan: they are handed over with the next update.
  void noteRestored() {
    scans_ = 2;
    has_weights_ = false;
  }
  /// Whether the next scan is the first one since the last update.
  [[nodiscard]] bool isNextFirst() const { return scans_ == 0; }
  /// Whether the backend already has the points in their current state.
  [[nodiscard]] bool isAhead() const { return scans_ == 1; }
  /// Call before an update: makes room for the state of all points.
  void growState();
  /// Call next: hands over what has not been handed over yet.
  void complete();
  /// Call next: reads the map's weights of points, concurrently with backend work that does not need them.
  void readWeights();
  /// What was read, for the backend's update; valid until the next readWeights().
  [[nodiscard]] kernels::ConfidenceDelta confidence() const { return {weights_, crossed_}; }
  /// Call after readWeights(), also concurrently with the backend's update: from then on the new points count as known,
  /// and the update reads neither points nor map on the host.
  void know();
  /// Call after an update. @param outcome  its waiting_ids are taken
  void noteWaiting(kernels::UpdateOutcome& outcome);

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct Touched {
    std::uint32_t id;
    Eigen::Vector3f before_L;  ///< at the last update
  };

  [[nodiscard]] kernels::AdmitInput input();
  template <typename HandOver>
  void admit(const HandOver& hand_over);
  void admitBlocks(std::span<const std::uint32_t> changed);
  void admitPoints(std::span<const kernels::PointDelta> deltas);
  [[nodiscard]] std::span<const std::uint32_t> returnsOf(std::span<const kernels::PointDelta> deltas);
  void admitAll();
  void readWeightsOf(std::span<const std::uint32_t> ids, std::vector<kernels::PointWeight>& points);
  void findCrossed();
  void takeConfident();

  std::vector<PointScorer*> scorers_;
  PointScorer& scorer_;  ///< the first, for what all of them share
  kernels::PointAdmission& updater_;
  DeviceBlocks blocks_;
  std::uint32_t known_points_ = 0;             ///< admitted; higher ids are new
  std::vector<Touched> touched_;               ///< known points that scans touched since the last update
  ChunkedArray<std::uint8_t> is_touched_;      ///< [known_points_]
  FreshPoints fresh_;                          ///< below the confidence bound
  FreshPlaces reached_;                        ///< of the current update
  std::uint16_t least_weight_ = 0;             ///< lowest weight that is confident
  int scans_ = 0;                              ///< since the last update
  std::vector<std::uint32_t> ids_;             ///< new or touched since the last update
  std::vector<kernels::PointWeight> weights_;  ///< per entry of ids_
  bool has_weights_ = false;                   ///< they are those of the map
  std::vector<kernels::PointWeight> crossed_;  ///< points that became confident since the last update
  std::vector<std::uint16_t> read_weights_;    ///< used by readWeightsOf()
  std::vector<kernels::PointDelta> deltas_;
  std::vector<std::uint32_t> returns_;  ///< of the points that are handed over, if they compete
  std::vector<kernels::BlockDelta> block_deltas_;
  std::vector<std::uint32_t> block_ids_;
  bool blocks_described_ = false;                ///< both are those of the next scan
  std::vector<kernels::PointStateView> states_;  ///< of scorers_
};

}  // namespace accessvdb::internal
