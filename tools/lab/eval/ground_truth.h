// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is really accessible: the tool against the exact distance of a scene (docs/PAPER.md, "Ground truth"). Shares no
/// function with the method: its own samples of the tool, self-exclusion and orientations, double throughout, no map,
/// no observations.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/tool_geometry.h"
#include "sim/signed_distance.h"

namespace accessvdb::eval {

class CollisionField;

struct TruthOptions {
  int num_directions = 180;  ///< [D] yaw directions, unless there are orientations
  /// World from tool: what is tried in place of the yaw directions; several may share an axis. Empty = yaw.
  std::vector<Eigen::Matrix3d> orientations = {};
  double normal_cone_rad = 1.2217304763960306;  ///< 70 degrees
  std::vector<double> arm_m;                    ///< distances along the direction that must be outside the object
  double collision_distance_m = 0.0005;         ///< [r_c] a sample closer than this collides
  double self_exclusion_m = 0.003;              ///< [r_s] samples within this of the tip are ignored
  double margin_m = 0;                          ///< room around the tool: see SampleThreshold
  int surface_samples = 1000;                   ///< [M]
  int collision_limit = 5;                      ///< [n_c] fewest collisions that block an orientation
  std::uint64_t seed = 7;                       ///< for the samples
};

/// The truth for a parameter set: the same lengths (r_c, r_s, arm), samples and limit as printed in the paper (M =
/// 1000, n_c = 5) for any tool form of the method. @param resolved  FieldParams::resolved()
[[nodiscard]] TruthOptions truthOptions(const FieldParams& resolved);

class GroundTruth {
 public:
  /// @throws InvalidArgument for invalid options
  GroundTruth(std::shared_ptr<const sim::SignedDistance> distance, const ToolGeometry& tool,
              const TruthOptions& options);
  /// For distances that are slow to evaluate; the same answers.
  GroundTruth(std::shared_ptr<const CollisionField> field, const ToolGeometry& tool, const TruthOptions& options);
  ~GroundTruth();
  GroundTruth(GroundTruth&&) noexcept;

  /// @param positions_W  [n] metres  @param normals_W  [n] unit; zero = none, then no direction is in the cone
  /// @return [n] 1 = at least one orientation is free
  [[nodiscard]] std::vector<std::uint8_t> accessible(std::span<const Eigen::Vector3d> positions_W,
                                                     std::span<const Eigen::Vector3d> normals_W) const;
  /// One point. Thread-safe.
  [[nodiscard]] bool accessible(const Eigen::Vector3d& position_W, const Eigen::Vector3d& normal_W) const;
  /// One orientation of one point: corridor and tool, without the cone around the normal.
  [[nodiscard]] bool free(const Eigen::Vector3d& position_W, int orientation) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::eval
