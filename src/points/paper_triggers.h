// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's three reasons to score a point again ("Incremental Updates and Confidence"; SPEC a.8, step 4).
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <random>
#include <span>
#include <vector>

#include "points/point_scorer.h"

namespace accessvdb::internal {

class PaperTriggers {
 public:
  using Enqueue = std::function<void(std::uint32_t id)>;

  explicit PaperTriggers(const PointScorer& scorer);

  /// One scan has been integrated and its points are in the store. Calls enqueue in a repeatable order; an id may come
  /// more than once. @param q_L  [n] or [1] sensor positions
  void fire(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L, const Enqueue& enqueue);

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  void fireOnDistance(std::span<const Eigen::Vector3f> p_L, const Enqueue& enqueue);
  void fireOnSample(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L, const Enqueue& enqueue);
  void fireOnMotion(const Eigen::Vector3f& q_L, const Enqueue& enqueue);

  /// Points in blocks that a return may have written to, ascending.
  [[nodiscard]] std::vector<std::uint32_t> pointsInWrittenBlocks(std::span<const Eigen::Vector3f> p_L);
  /// Centre of a voxel that the return wrote to, each equally likely.
  Eigen::Vector3d drawWrittenVoxel(const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L);
  [[nodiscard]] bool writes(const Eigen::Vector3d& p_L, const Eigen::Vector3d& q_L, const Eigen::Vector3d& x_L) const;
  /// Uniform in 0 .. count - 1.
  std::size_t draw(std::size_t count);

  const PointScorer& scorer_;
  std::mt19937_64 random_;
  ChunkedArray<float> last_distance_m_;      ///< by id; NaN before the first frame
  ChunkedArray<std::uint32_t> block_stamp_;  ///< by block: the last scan that reached it
  std::uint32_t scan_ = 0;
  std::optional<Eigen::Vector3f> last_sensor_L_;  ///< where trigger (iii) fired last
};

}  // namespace accessvdb::internal
