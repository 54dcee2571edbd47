// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts the tool samples too near to an object, exactly, without examining each.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "sim/signed_distance.h"

namespace accessvdb::eval {

class CollisionField;

/// The tool's position: tip at p_W, body along (cos, sin, 0).
struct ToolPlacement {
  Eigen::Vector3d tip_W;
  double cos_yaw, sin_yaw;

  [[nodiscard]] Eigen::Vector3d at(const Eigen::Vector3d& p_T) const {
    return {tip_W.x() + cos_yaw * p_T.x() - sin_yaw * p_T.y(), tip_W.y() + sin_yaw * p_T.x() + cos_yaw * p_T.y(),
            tip_W.z() + p_T.z()};
  }
};

/// A tree of balls around the samples. A signed distance changes by no more than the distance moved, so its value at a
/// ball's centre decides the whole ball if it is far enough from the threshold; other balls are split, down to single
/// samples, which are compared exactly.
class BallTree {
 public:
  explicit BallTree(const std::vector<Eigen::Vector3d>& samples_T);

  /// Samples with distance below `threshold_m`. Stops at `enough`: the result is exact below it, else at least it.
  [[nodiscard]] int countBelow(const sim::SignedDistance& distance, const ToolPlacement& tool, double threshold_m,
                               int enough) const;
  /// The same answer, for distances that are slow to evaluate.
  [[nodiscard]] int countBelow(const CollisionField& distance, const ToolPlacement& tool, double threshold_m,
                               int enough) const;
  [[nodiscard]] int size() const { return nodes_.empty() ? 0 : nodes_.front().samples; }

 private:
  struct Node {
    Eigen::Vector3d centre_T;
    double radius_m;
    int samples;
    std::int32_t second;  ///< index of the second child; the first follows its parent; -1 for a single position
  };
  template <typename Settle>
  [[nodiscard]] int count(const ToolPlacement& tool, int enough, const Settle& settle) const;
  void build(std::vector<Eigen::Vector3d>& samples_T, std::size_t begin, std::size_t end);

  std::vector<Node> nodes_;
};

}  // namespace accessvdb::eval
