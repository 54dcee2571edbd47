// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "support/brute_force_field.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace accessvdb::test {
namespace {

bool collides(const BruteForceInput& input, const MapVoxel& voxel) {
  return voxel.observed && !(voxel.distance_m >= input.collision_distance_m);
}

double neighbourRadius(const BruteForceInput& input) { return std::max(10.0 * input.voxel_size_m, 0.1); }

/// The largest power of two that makes at most 2^20 steps of a radius.
double stepsPerMetre(double radius) {
  double steps = 1;
  while (steps * radius <= 0x1p20) steps *= 2;
  return steps / 2;
}

/// Offset rounded to whole steps.
Eigen::Vector3d offsetInSteps(const BruteForceInput& input, const Eigen::Vector3f& from, const Eigen::Vector3f& to) {
  const Eigen::Vector3d metres = to.cast<double>() - from.cast<double>();
  return (metres * stepsPerMetre(neighbourRadius(input)) + Eigen::Vector3d::Constant(0.5)).array().floor();
}

/// Neighbours within R_k by (squared distance in steps, id), the first k.
std::vector<std::uint32_t> nearest(const BruteForceInput& input, std::size_t self) {
  const double most = std::floor(neighbourRadius(input) * stepsPerMetre(neighbourRadius(input)));
  struct Candidate {
    double squared_distance;
    std::uint32_t id, index;
  };
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < input.points.size(); ++i) {
    const double squared_distance =
        offsetInSteps(input, input.points[self].mean_position_L, input.points[i].mean_position_L)
            .squaredNorm();  // below 2^53: exact
    if (squared_distance <= most * most) {
      candidates.push_back({squared_distance, input.points[i].id, static_cast<std::uint32_t>(i)});
    }
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    return a.squared_distance != b.squared_distance ? a.squared_distance < b.squared_distance : a.id < b.id;
  });
  if (candidates.size() > static_cast<std::size_t>(input.neighbours)) {
    candidates.resize(static_cast<std::size_t>(input.neighbours));
  }
  std::vector<std::uint32_t> indices;
  for (const Candidate& c : candidates) indices.push_back(c.index);
  return indices;
}

void findNormal(const BruteForceInput& input, const BruteForcePoint& point, BruteForceResult& result) {
  Eigen::MatrixXd positions(result.neighbours.size(), 3);
  for (std::size_t i = 0; i < result.neighbours.size(); ++i) {
    positions.row(static_cast<Eigen::Index>(i)) =
        offsetInSteps(input, point.mean_position_L, input.points[result.neighbours[i]].mean_position_L).transpose();
  }
  const Eigen::RowVector3d mean = positions.colwise().mean();
  const Eigen::MatrixXd centred = positions.rowwise() - mean;
  const Eigen::Matrix3d covariance = centred.transpose() * centred / static_cast<double>(positions.rows());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);  // eigenvalues ascend
  const Eigen::Vector3d values = solver.eigenvalues();
  const Eigen::Vector3d to_sensor = point.mean_sensor_L - point.first_position_L.cast<double>();
  Eigen::Vector3d normal = solver.eigenvectors().col(0).normalized();
  if (normal.dot(to_sensor) < 0.0) normal = -normal;
  result.pca_normal = normal;
  result.pca_gap = values[2] > 0.0 ? (values[1] - values[0]) / values[2] : 0.0;
  result.pca_side = to_sensor.norm() > 0.0 ? normal.dot(to_sensor) / to_sensor.norm() : 0.0;
}

std::uint32_t observationWeight(const BruteForceInput& input, const VoxelCoord& voxel) {
  if (!input.neighbourhood_weight) return input.map(voxel).weight;
  std::uint32_t weight = 0;
  for (int di = -1; di <= 1; ++di)
    for (int dj = -1; dj <= 1; ++dj)
      for (int dk = -1; dk <= 1; ++dk) {
        weight = std::max(weight, input.map({voxel[0] + di, voxel[1] + dj, voxel[2] + dk}).weight);
      }
  return weight;
}

std::array<double, 3> axisOf(const BruteForceInput& input, int d) {
  if (!input.axes.empty()) return input.axes.at(static_cast<std::size_t>(d));
  const double yaw = 2.0 * std::numbers::pi * d / input.num_directions;
  return {std::cos(yaw), std::sin(yaw), 0.0};
}

void testArm(const BruteForceInput& input, const BruteForcePoint& point, BruteForceDirection& direction) {
  const std::array<double, 3> axis = axisOf(input, direction.index);
  const float inverse_voxel_size = static_cast<float>(1.0 / input.voxel_size_m);
  for (const double distance : input.arm_distances_m) {
    const float offset[3] = {static_cast<float>(distance * axis[0]), static_cast<float>(distance * axis[1]),
                             static_cast<float>(distance * axis[2])};
    VoxelCoord voxel;
    for (int a = 0; a < 3; ++a) {
      const float x = point.first_position_L[a] + offset[a];
      const float scaled = x * inverse_voxel_size;
      voxel[static_cast<std::size_t>(a)] = static_cast<std::int32_t>(std::floor(scaled + 0.5f));
    }
    const MapVoxel sample = input.map(voxel);
    direction.arm_unknown = !sample.observed && !sample.cleared;
    direction.arm_blocked = direction.arm_unknown || collides(input, sample);
    if (direction.arm_blocked) return;
    ++direction.arm_passed;
  }
}

enum Stage { kUnseen, kArm, kTool };

Stage stageOf(const BruteForceDirection& d) { return !d.seen ? kUnseen : d.arm_blocked ? kArm : kTool; }

/// The rank rule, one line per criterion.
bool ranksBefore(const BruteForceDirection& a, const BruteForceDirection& b) {
  if (stageOf(a) != stageOf(b)) return stageOf(a) > stageOf(b);
  if (a.arm_passed != b.arm_passed) return a.arm_passed > b.arm_passed;
  if (a.collisions != b.collisions) return a.collisions < b.collisions;
  if (a.dot != b.dot) return a.dot > b.dot;
  return a.index < b.index;
}

void decide(const BruteForceInput& input, const std::vector<BruteForceDirection>& directions,
            BruteForceResult& result) {
  std::vector<BruteForceDirection> candidates;
  for (const BruteForceDirection& d : directions) {
    if (d.in_cone) candidates.push_back(d);
  }
  result.label = PointLabel::Blocked;
  if (candidates.empty()) {
    result.reason = PointReason::Normal;
    return;
  }
  std::sort(candidates.begin(), candidates.end(), ranksBefore);
  const BruteForceDirection& best = candidates.front();
  if (stageOf(best) == kUnseen) {
    result.reason = PointReason::Unseen;
    return;
  }
  result.direction = static_cast<std::uint16_t>(best.index);
  if (stageOf(best) == kArm) {
    result.reason = best.arm_unknown ? PointReason::Unknown : PointReason::Arm;
    return;
  }
  result.score = static_cast<std::uint16_t>(std::min(best.collisions, kNoScore - 1));
  if (best.collisions < input.collision_limit) {
    result.label = PointLabel::Accessible;
    result.reason = PointReason::None;
  } else {
    result.reason = PointReason::Tool;
  }
}

}  // namespace

std::vector<BruteForceDirection> bruteForceDirections(const BruteForceInput& input, const BruteForcePoint& point,
                                                      const Eigen::Vector3f& normal,
                                                      const std::vector<bool>& effective_seen) {
  const float cone_cos = static_cast<float>(std::cos(input.normal_cone_rad));
  std::vector<BruteForceDirection> directions;
  for (int d = 0; d < input.num_directions; ++d) {
    const std::array<double, 3> axis = axisOf(input, d);
    const float ax = static_cast<float>(axis[0]), ay = static_cast<float>(axis[1]), az = static_cast<float>(axis[2]);
    BruteForceDirection direction;
    direction.index = d;
    const float x_part = ax * normal.x();
    const float y_part = ay * normal.y();
    const float z_part = az * normal.z();
    const float level_part = x_part + y_part;
    direction.dot = level_part + z_part;
    direction.in_cone = direction.dot >= cone_cos;
    direction.seen = effective_seen.at(static_cast<std::size_t>(d));
    if (direction.in_cone && direction.seen) {
      testArm(input, point, direction);
      if (!direction.arm_blocked) {
        direction.collisions = 0;
        for (const VoxelCoord& offset : input.tool_voxels.at(static_cast<std::size_t>(d))) {
          const VoxelCoord voxel = {point.voxel[0] + offset[0], point.voxel[1] + offset[1], point.voxel[2] + offset[2]};
          if (collides(input, input.map(voxel))) ++direction.collisions;
        }
      }
    }
    directions.push_back(direction);
  }
  return directions;
}

std::vector<BruteForceResult> bruteForceScore(const BruteForceInput& input) {
  std::vector<BruteForceResult> results(input.points.size());
  for (std::size_t i = 0; i < input.points.size(); ++i) {
    const BruteForcePoint& point = input.points[i];
    BruteForceResult& result = results[i];
    result.neighbours = nearest(input, i);
    const bool has_normal = result.neighbours.size() >= 3;
    if (has_normal) {
      findNormal(input, point, result);
      result.normal = point.given_normal ? *point.given_normal : Eigen::Vector3f(result.pca_normal.cast<float>());
    }
    result.effective_seen = point.seen;
    if (input.join_neighbour_views) {
      for (std::size_t n = 0; n < std::min<std::size_t>(result.neighbours.size(), 10); ++n) {
        const std::vector<bool>& other = input.points[result.neighbours[n]].seen;
        for (std::size_t d = 0; d < other.size(); ++d) {
          if (other[d]) result.effective_seen[d] = true;
        }
      }
    }
    result.weight = observationWeight(input, point.voxel);
    const double w = result.weight;
    result.confidence = w / (w + input.confidence_half_weight);

    if (!(result.confidence >= input.confidence_min)) {
      result.label = PointLabel::Unscored;
      result.reason = PointReason::Confidence;
    } else if (!has_normal) {
      result.label = PointLabel::Unscored;
      result.reason = PointReason::Normal;
    } else {
      decide(input, bruteForceDirections(input, point, result.normal, result.effective_seen), result);
    }
  }
  return results;
}

}  // namespace accessvdb::test
