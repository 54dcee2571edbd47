// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a backend that keeps the points by itself (launch/point_news.h) is told about them, whatever its policy: which
/// are new, touched, or confident by now.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "accessvdb/types.h"
#include "launch/point_news.h"
#include "update/device_blocks.h"
#include "update/fresh_points.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// What an updater of any policy is made with. @param group_log2  of its blocks
kernels::NeighbourTables neighbourTables(const FieldParams& resolved, int group_log2);
/// What an update of any policy reads.
kernels::ScoringInput scoringInput(const PointScorer& scorer, const ScoringTables& tables);
UpdateStats statsOf(const kernels::UpdateOutcome& outcome);

class DeviceAdmission {
 public:
  /// @param scorer, updater  alive as long as this  @param group_log2  the updater's
  DeviceAdmission(PointScorer& scorer, kernels::PointAdmission& updater, int group_log2);

  /// Whether noteReturns() needs the next scan described (PointStore::describeTouched).
  [[nodiscard]] bool takesNews() const { return scans_ == 0; }
  /// One scan's returns are in the store. Those of the first scan since the last update are handed over, so that the
  /// backend can begin. Should another scan come before the update, that was for nothing: all are handed over again.
  /// @return whether they were handed over
  bool handOver(const TouchedPoints& touched);
  /// Then, of every scan: which points it touched, and which leaves it reached.
  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L);
  /// Has the backend got the points as they are?
  [[nodiscard]] bool isAhead() const { return scans_ == 1; }
  /// Before an update: room for the state of all points.
  void growState() { scorer_.growDevice(); }
  /// Then makes up for what was not handed over.
  void complete();
  /// Then reads what the map says about them, beside what the backend does without it.
  void readWeights();
  /// Last: the backend's update with what was read. The new points are known from then on.
  using RunUpdate = std::function<kernels::UpdateOutcome(const kernels::ConfidenceNews&)>;
  kernels::UpdateOutcome update(const RunUpdate& run);

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct Touched {
    std::uint32_t id;
    Eigen::Vector3f before_L;  ///< at the last update
  };

  void know();
  [[nodiscard]] kernels::AdmitInput input() const;
  template <typename HandOver>
  void admit(const HandOver& hand_over);
  void admitBlocks(std::span<const std::uint32_t> changed);
  void admitPoints(std::span<const kernels::PointNews> news);
  void admitAll();
  void readWeightsOf(std::span<const std::uint32_t> ids, std::vector<kernels::PointWeight>& points);
  void findCrossed();
  void takeConfident();

  PointScorer& scorer_;
  kernels::PointAdmission& updater_;
  DeviceBlocks blocks_;
  std::uint32_t known_points_ = 0;             ///< admitted; those behind are new
  std::vector<Touched> touched_;               ///< known points that scans touched since the last update
  ChunkedArray<std::uint8_t> is_touched_;      ///< [known_points_]
  FreshPoints fresh_;                          ///< below the confidence bound
  FreshPlaces reached_;                        ///< of one update
  std::uint16_t least_weight_ = 0;             ///< that is confident
  int scans_ = 0;                              ///< since the last update
  std::vector<std::uint32_t> ids_;             ///< points that came since the last update
  std::vector<kernels::PointWeight> weights_;  ///< of ids_
  std::vector<kernels::PointWeight> crossed_;  ///< points that became confident since the last update
  std::vector<std::uint16_t> read_weights_;    ///< readWeightsOf()
  std::vector<kernels::PointNews> news_;
  std::vector<kernels::BlockNews> block_news_;
  std::vector<std::uint32_t> block_ids_;
};

}  // namespace accessvdb::internal
