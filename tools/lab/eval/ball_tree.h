// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts the tool samples too near to an object, exactly, without examining each.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "sim/signed_distance.h"

namespace accessvdb::eval {

class CollisionField;

/// Where the tool is and how it is held.
struct ToolPlacement {
  Eigen::Vector3d tip_W;
  Eigen::Matrix3d R_WT;  ///< the body is along its first column

  /// Summed in this order, so that zeros change nothing: a level tool is where it was before others could be held.
  [[nodiscard]] Eigen::Vector3d at(const Eigen::Vector3d& p_T) const {
    Eigen::Vector3d p_W;
    for (int row = 0; row < 3; ++row) {
      p_W[row] = tip_W[row] + R_WT(row, 0) * p_T.x() + R_WT(row, 1) * p_T.y() + R_WT(row, 2) * p_T.z();
    }
    return p_W;
  }
};

/// How near a sample may come. With a margin, the farther it is from the tip, up to the margin: at the surface that the
/// tip touches there is no room, and a tool that is held 20 degrees above it has a third of the distance from the tip.
struct SampleThreshold {
  double collision_distance_m = 0;
  double margin_m = 0;
  double self_exclusion_m = 0;  ///< from here on the margin begins

  /// Grows with the distance, and no faster.
  [[nodiscard]] double at(double from_tip_m) const {
    return collision_distance_m + std::clamp((from_tip_m - self_exclusion_m) / 3, 0.0, margin_m);
  }
};

/// A tree of balls around the samples. A signed distance changes by no more than the distance moved, so its value at a
/// ball's centre decides the whole ball if it is far enough from the threshold; other balls are split, down to single
/// samples, which are compared exactly.
class BallTree {
 public:
  explicit BallTree(const std::vector<Eigen::Vector3d>& samples_T);

  /// Samples with a distance below the threshold. Stops at `enough`: the result is exact below it, else at least it.
  [[nodiscard]] int countBelow(const sim::SignedDistance& distance, const ToolPlacement& tool,
                               const SampleThreshold& threshold, int enough) const;
  /// The same answer, for distances that are slow to evaluate.
  [[nodiscard]] int countBelow(const CollisionField& distance, const ToolPlacement& tool,
                               const SampleThreshold& threshold, int enough) const;
  [[nodiscard]] int size() const { return nodes_.empty() ? 0 : nodes_.front().samples; }

 private:
  struct Node {
    Eigen::Vector3d centre_T;
    double radius_m;
    int samples;
    std::int32_t second;  ///< index of the second child; the first follows its parent; -1 for a single position
  };
  template <typename Settle>
  [[nodiscard]] int count(int enough, const Settle& settle) const;
  void build(std::vector<Eigen::Vector3d>& samples_T, std::size_t begin, std::size_t end);

  std::vector<Node> nodes_;
};

}  // namespace accessvdb::eval
