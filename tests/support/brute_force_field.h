// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The product profile's scoring, implemented a second time: plain, slow, following the method's text. The library's
/// results must equal these, value for value. Shares no code with the library beyond the names of labels and reasons.
///
/// Frame L: the map's local frame, metres, float32 positions.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <numbers>
#include <optional>
#include <vector>

#include "accessvdb/point_label.h"
#include "support/dense_map.h"

namespace accessvdb::test {

struct BruteForcePoint {
  std::uint32_t id = 0;
  VoxelCoord voxel = {};                         ///< voxel of first_position_L
  Eigen::Vector3f first_position_L = {0, 0, 0};  ///< first return: where it is scored
  Eigen::Vector3f mean_position_L = {0, 0, 0};   ///< input of the PCA
  Eigen::Vector3d mean_sensor_L = {0, 0, 0};     ///< mean of the sensor positions that saw it
  std::vector<bool> seen;                        ///< [D] its own mask, neighbours not joined
  std::optional<Eigen::Vector3f> given_normal;   ///< used instead of the PCA's, for exact comparison of the later steps
};

struct BruteForceInput {
  double voxel_size_m = 0.01;
  float collision_distance_m = 0.005f;      ///< [r_c] compared in float32, as distances are stored
  int num_directions = 180;                 ///< [D]
  std::vector<std::array<double, 3>> axes;  ///< [D] unit, of the directions; empty: yaws
  double normal_cone_rad = 70.0 * std::numbers::pi / 180.0;
  std::vector<double> arm_distances_m;               ///< in the order in which they are tested
  std::vector<std::vector<VoxelCoord>> tool_voxels;  ///< [D] offsets from the point's voxel, self-exclusion applied
  int collision_limit = 1;                           ///< [n_c] a direction is free when its count is below
  int neighbours = 10;                               ///< [k] of the PCA, the point itself included
  bool join_neighbour_views = true;                  ///< masks of the first min(k, 10) neighbours are joined
  bool neighbourhood_weight = true;                  ///< largest weight of 3x3x3 voxels instead of the own voxel's
  double confidence_half_weight = 5.0;               ///< c = w / (w + this)
  double confidence_min = 0.2;
  MapLookup map;
  std::vector<BruteForcePoint> points;
};

/// Result of one direction, earlier stages first.
struct BruteForceDirection {
  int index = 0;  ///< d
  bool in_cone = false;
  float dot = 0;  ///< a_d . n
  bool seen = false;
  int arm_passed = 0;  ///< samples before the first block
  bool arm_blocked = false;
  bool arm_unknown = false;  ///< the block is unobserved space
  int collisions = -1;       ///< tool voxels that collide; -1 if the arm is blocked or the direction is out
};

struct BruteForceResult {
  PointLabel label = PointLabel::Unscored;
  PointReason reason = PointReason::Confidence;
  std::uint16_t score = kNoScore;          ///< fewest collisions of the directions whose arm is free
  std::uint16_t direction = kNoDirection;  ///< best direction
  std::uint32_t weight = 0;
  double confidence = 0;
  Eigen::Vector3f normal = {0, 0, 0};      ///< normal used for scoring: given or PCA; zero if there is none
  Eigen::Vector3d pca_normal = {0, 0, 0};  ///< zero with fewer than 3 neighbours
  double pca_gap = 0;                      ///< (l1 - l0) / l2 of the covariance; near 0 the normal is arbitrary
  double pca_side = 0;                     ///< cos between normal and sensor; near 0 the sign is arbitrary
  std::vector<std::uint32_t> neighbours;   ///< indices into points, nearest first
  std::vector<bool> effective_seen;        ///< [D]
};

/// All points against all points and all directions: meant for a few thousand points.
/// @pre every `seen` has D entries, `tool_voxels` has D entries, ids are distinct
[[nodiscard]] std::vector<BruteForceResult> bruteForceScore(const BruteForceInput& input);

/// Every direction of one point with the given normal and effective mask: what the result above was chosen from.
[[nodiscard]] std::vector<BruteForceDirection> bruteForceDirections(const BruteForceInput& input,
                                                                    const BruteForcePoint& point,
                                                                    const Eigen::Vector3f& normal,
                                                                    const std::vector<bool>& effective_seen);

}  // namespace accessvdb::test
