// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a view of the sensor brings to points: the side that they have not been seen from, the space in front of them,
/// observations. Positions are in voxels, as KnownSpace has them.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "accessvdb/next_views.h"
#include "accessvdb/params.h"
#include "accessvdb/point_label.h"
#include "field/query/known_space.h"

namespace accessvdb::internal {

/// A direction in which the tool may yet reach a point, and what is missing there.
struct OpenWay {
  Eigen::Vector3f along = {0, 0, 0};  ///< unit, outwards
  std::uint32_t unknown = 0;          ///< bit k: of sample k of the corridor nothing is known
  bool seen = false;
};

/// An unresolved point.
struct OpenPoint {
  static constexpr std::size_t kMostWays = 24, kMostSamples = 32;

  Eigen::Vector3d place = {0, 0, 0};
  Eigen::Vector3f normal = {0, 0, 0};
  PointReason reason = PointReason::Confidence;
  double missing_weight = 0;  ///< observations until it is scored
  double left = 1;            ///< probability that it is still unresolved
  double may_turn = 1;        ///< probability that no return has turned its normal yet
  std::vector<OpenWay> ways;
};

/// The same of all points and views.
struct ViewRules {
  double voxel_size_m = 0;
  double observation_cos_min = 0;
  std::vector<double> corridor;  ///< distances of its samples from the point
  // A ray clears what is within cleared_radius of it, from its return back by cleared_end; beyond that single voxels,
  // back by line_end.
  double cleared_radius = 0, cleared_end = 0, line_end = 0;
  double same_surface = 0;  ///< a ray that ends so near to a point hits its surface
  ViewSensor sensor;
  double max_range = 0;
  double passing = 0;
  int most_passed = 1;  ///< beyond so many voxels that collide, next to nothing passes

  ViewRules(const FieldParams& resolved, const ViewSensor& sensor);
  /// @param share  of the rays that pass a voxel which collides: none at solid things, most in a crown of needles
  void setPassing(double share);
  /// Share of the rays that pass so many voxels which collide.
  [[nodiscard]] double passingAll(int voxels) const { return voxels == 0 ? 1 : std::pow(passing, voxels); }
  /// Rays per steradian at an elevation of the sensor.
  [[nodiscard]] double density(double sin_elevation) const;
  /// Whether a direction of the sensor's frame is in its field of view. @param unit_S  unit
  [[nodiscard]] bool covers(const Eigen::Vector3d& unit_S) const;
};

struct SensorPose {
  Eigen::Vector3d place = {0, 0, 0};
  Eigen::Matrix3d R_WS = Eigen::Matrix3d::Identity();
};

class ViewGain {
 public:
  ViewGain(const KnownSpace& space, const ViewRules& rules) : reader_(space), rules_(rules) {}

  /// How probable it is that a view resolves a point.
  [[nodiscard]] double of(const SensorPose& pose, const OpenPoint& point) const;
  /// The point as it is after the view.
  void take(const SensorPose& pose, OpenPoint& point) const;

 private:
  /// What a pose has to do with a place: distance, direction.
  struct Sight {
    double range = 0;
    Eigen::Vector3d out = {0, 0, 0};  ///< unit, from the place to the sensor
    double density = 0;               ///< rays per steradian; 0: out of view
  };
  [[nodiscard]] Sight sightOf(const SensorPose& pose, const Eigen::Vector3d& place) const;
  /// Returns to expect in the point's voxel.
  [[nodiscard]] double returnsAt(const SensorPose& pose, const OpenPoint& point) const;
  /// Probability that a sample of a corridor becomes known to be free.
  /// @param beside  also by rays that pass beside it
  [[nodiscard]] double clears(const SensorPose& pose, const Eigen::Vector3d& sample, bool beside) const;
  /// Of a way, that nothing is missing.
  [[nodiscard]] double completes(const SensorPose& pose, const OpenPoint& point, const OpenWay& way,
                                 double seen_anew) const;

  KnownSpace::Reader reader_;
  const ViewRules& rules_;
};

}  // namespace accessvdb::internal
