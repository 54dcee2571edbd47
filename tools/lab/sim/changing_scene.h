// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scenes that change at known times: parts that come, go and move, with the exact distance at every moment.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "sim/scene.h"
#include "sim/trajectory.h"

namespace accessvdb::sim {

/// Something that is there for a time, half open: from_s <= t < until_s.
struct ScenePart {
  Scene scene;  ///< with a distance
  double from_s = -std::numeric_limits<double>::infinity(), until_s = std::numeric_limits<double>::infinity();
  /// Where it is at a time, relative to where its mesh is; not set: it stays there.
  std::function<Eigen::Vector3d(double stamp_s)> offset_W;

  [[nodiscard]] bool isThere(double stamp_s) const { return stamp_s >= from_s && stamp_s < until_s; }
  [[nodiscard]] Eigen::Vector3d offsetAt_W(double stamp_s) const {
    return offset_W ? offset_W(stamp_s) : Eigen::Vector3d::Zero();
  }
};

struct ChangingScene {
  std::string name;         ///< "bar", "person" ...
  std::string description;  ///< one line
  std::vector<ScenePart> parts;
  double change_s = 0;        ///< when something new appears
  std::size_t first_new = 0;  ///< parts from here on appear then; parts.size(): none does
  double gone_s = 0;          ///< when it has gone again, or what was there before has; 0: never
  Trajectory trajectory;

  /// The exact distance to all that is there at a time: the least of the parts'. @throws InvalidArgument: none is there
  [[nodiscard]] std::shared_ptr<const SignedDistance> distanceAt(double stamp_s) const;
};

/// A board 3 x 2 m at x = 2 m is watched from the origin for 30 s; then, until 36 s:
///   "bar"      a level bar 2 voxels thick and 1 m long, 6 cm before it: in the way of every approach at its height
///   "cable"    the same, 1 voxel thick, 4 voxels before it
///   "person"   a box 0.4 x 0.5 x 1.7 m crosses 0.8 m before it, at 1 m/s, from 30 s to 33 s
///   "branch"   nothing new: a branch 0.3 m before it, there from the beginning, is cut at 30 s
///   "sway"     a branch 0.3 m before it, there from the beginning, sways up and down by 15 cm at 0.5 Hz
///   "car"      a box 0.5 x 1.6 x 0.9 m, 0.5 m before it from the beginning, leaves at 1 m/s, from 30 s to 33 s
///   "sky"      a branch above a lower board, nothing behind it, is cut at 30 s
/// @throws InvalidArgument naming the known ones
[[nodiscard]] ChangingScene changingScene(const std::string& name, double voxel_size_m);
[[nodiscard]] std::vector<std::string> changingSceneNames();

}  // namespace accessvdb::sim
