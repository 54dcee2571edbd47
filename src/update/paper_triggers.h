// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's three reasons to score a point again ("Incremental Updates and Confidence"; docs/PAPER_MAP.md, "Update
/// policy").
#pragma once

#include <Eigen/Core>
#include <optional>
#include <random>
#include <span>
#include <vector>

#include "accessvdb/distance_change.h"
#include "update/id_list.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// What scans requested, including points that are not confident.
struct PaperRequests {
  std::vector<std::uint32_t> jumped;   ///< (i) ascending, each once
  std::vector<std::uint32_t> sampled;  ///< (ii) likewise
  bool blocked = false;                ///< (iii) every point that is not accessible
};

class PaperTriggers {
 public:
  explicit PaperTriggers(const PointScorer& scorer);

  /// Call when one scan has been integrated and its points are in the store.
  /// @param q_L  [n] or [1] sensor positions  @param distances  leaves whose distances changed, each once
  void note(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
            std::span<const std::span<const DistanceChange>> distances);
  /// Covers all scans since the last call.
  PaperRequests take();

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  void noteDistances(std::span<const std::span<const DistanceChange>> distances);
  void noteSample(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);
  void noteMotion(const Eigen::Vector3f& q_L);

  /// Centre of a voxel that the return wrote to, all equally likely.
  Eigen::Vector3d drawWrittenVoxel(const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L);
  [[nodiscard]] bool writes(const Eigen::Vector3d& p_L, const Eigen::Vector3d& q_L, const Eigen::Vector3d& x_L) const;
  /// Uniform in 0 .. count - 1.
  std::size_t draw(std::size_t count);

  const PointScorer& scorer_;
  std::mt19937_64 random_;
  IdList jumped_, sampled_;
  bool blocked_ = false;
  ChunkedArray<float> last_distance_m_;           ///< by id; NaN until the end of the point's first scan
  std::uint32_t known_points_ = 0;                ///< those with an entry
  std::optional<Eigen::Vector3f> last_sensor_L_;  ///< where trigger (iii) fired last
};

}  // namespace accessvdb::internal
