// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans of a scene along a trajectory. The same inputs give the same bytes, in any order of frames, from any thread.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/changing_scene.h"
#include "sim/lidar_model.h"
#include "sim/ray_caster.h"
#include "sim/scene.h"
#include "sim/trajectory.h"

namespace accessvdb::sim {

struct SimulatedFrame {
  std::vector<Eigen::Vector3f> points_S;                    ///< [rays_per_frame] metres; exactly (0,0,0) = no return
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();  ///< when it begins
  Eigen::Isometry3d T_W_S_end = Eigen::Isometry3d::Identity();  ///< LidarModel::moves: when it ends; else as it begins
  double stamp_s = 0;
  std::vector<std::uint32_t> times_ns = {};  ///< [points_S] since the stamp; only with LidarModel::moves
};

class Simulator {
 public:
  /// @throws InvalidArgument (model), UnusableInput: no frames, or a sensor inside the object or on its surface
  Simulator(const Scene& scene, const LidarModel& model, Trajectory trajectory, std::uint64_t seed);
  /// A scene without a known distance: only requireClearPath() can tell whether the path is free.
  Simulator(RayCaster scene, const std::string& scene_name, const LidarModel& model, Trajectory trajectory,
            std::uint64_t seed);
  /// A scene that changes along its own trajectory: each frame sees it as it is at the frame's stamp.
  /// @throws UnusableInput: a sensor inside a part, or on its surface
  Simulator(const ChangingScene& scene, const LidarModel& model, std::uint64_t seed);
  ~Simulator();
  Simulator(Simulator&&) noexcept;
  Simulator& operator=(Simulator&&) noexcept;

  /// Refuses a path that passes through a surface, even if no frame is inside.
  /// @param stations  places along the path, close enough together that straight lines between them represent it
  /// @throws UnusableInput naming the position
  void requireClearPath(const Trajectory& stations) const;
  /// One per pose; with LidarModel::moves one fewer, since the last pose ends the last frame.
  [[nodiscard]] int frames() const;
  [[nodiscard]] const LidarModel& model() const;
  /// May be called from several threads at once; parallel internally. @throws InvalidArgument (index)
  [[nodiscard]] SimulatedFrame frame(int index) const;
  /// The first `returns` rays of a frame that hit something: a frame of fixed size, however much sky there is.
  /// LidarModel::rays_per_frame limits the rays tried. Without times. @throws UnusableInput if fewer return
  [[nodiscard]] SimulatedFrame frameOfReturns(int index, int returns) const;
  /// The same for frames begin .. end, all at once. @throws like each of them
  [[nodiscard]] std::vector<SimulatedFrame> framesOfReturns(int begin, int end, int returns) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb::sim
