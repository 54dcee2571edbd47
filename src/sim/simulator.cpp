// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/simulator.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "accessvdb/error.h"
#include "sim/counter_random.h"
#include "sim/ray_caster.h"

namespace accessvdb::sim {
namespace {

constexpr int kRaysPerTask = 2048;
/// Closer than this to a surface the first range says more about rounding than about the scene.
constexpr double kSurface_m = 1e-6;

std::string place(const Eigen::Vector3d& p) {
  char text[96];
  std::snprintf(text, sizeof text, "(%.4g, %.4g, %.4g)", p.x(), p.y(), p.z());
  return text;
}

/// @throws UnusableInput naming the first frame whose sensor is not outside
void requireOutside(const Scene& scene, const Trajectory& trajectory) {
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    if (!trajectory[i].matrix().allFinite()) {
      throw UnusableInput("sim.pose", "frame " + std::to_string(i), "its pose is not finite", "Check the trajectory");
    }
    if (!scene.distance) continue;
    const Eigen::Vector3d sensor_W = trajectory[i].translation();
    const double distance_m = scene.distance->at(sensor_W);
    if (distance_m > kSurface_m) continue;
    throw UnusableInput("sim.inside", "frame " + std::to_string(i),
                        "the sensor at " + place(sensor_W) + " is " +
                            (distance_m < -kSurface_m ? "inside" : "on the surface of") + " the " + scene.name,
                        "Move the trajectory away from the object, for example with a larger --radius");
  }
}

}  // namespace

struct Simulator::Impl {
  std::string scene_name;
  LidarModel model;
  Trajectory trajectory;
  std::uint64_t seed;
  RayCaster caster;

  /// What the sensor reports for a true range (infinity: nothing there); 0 = no return.
  [[nodiscard]] float measured_m(float range_m, std::uint64_t frame, int ray) const {
    if (!std::isfinite(range_m)) return 0;
    double measured = static_cast<double>(range_m);
    if (model.dropout > 0 || model.range_noise_m > 0) {
      // Both numbers are always drawn, so that changing one of the two settings leaves the other's outcome alone.
      CounterRandom random({seed, frame, static_cast<std::uint64_t>(ray)});
      const bool lost = random.uniform() < model.dropout;
      measured += model.range_noise_m * random.gaussian();
      if (lost) return 0;
    }
    // The sensor judges what it measured: it knows no other range.
    return measured >= model.min_range_m && measured <= model.max_range_m && measured > 0 ? static_cast<float>(measured)
                                                                                          : 0;
  }
};

Simulator::Simulator(const Scene& scene, const LidarModel& model, Trajectory trajectory, std::uint64_t seed) {
  model.validate();
  if (trajectory.empty()) {
    throw UnusableInput("sim.frames", "trajectory", "there are no frames to simulate", "Give at least one pose");
  }
  requireOutside(scene, trajectory);
  impl_ = std::make_unique<Impl>(Impl{scene.name, model, std::move(trajectory), seed, RayCaster(scene.mesh)});
}

Simulator::~Simulator() = default;
Simulator::Simulator(Simulator&&) noexcept = default;
Simulator& Simulator::operator=(Simulator&&) noexcept = default;

void Simulator::requireClearPath(const Trajectory& stations) const {
  for (std::size_t i = 1; i < stations.size(); ++i) {
    const Eigen::Vector3d begin_W = stations[i - 1].translation(), way = stations[i].translation() - begin_W;
    if (!(way.norm() > 0)) continue;
    const Eigen::Vector3f direction_W = way.normalized().cast<float>();
    float range_m = 0;
    impl_->caster.cast(begin_W, {&direction_W, 1}, {&range_m, 1});
    if (static_cast<double>(range_m) > way.norm()) continue;
    throw UnusableInput("sim.through", "trajectory",
                        "it leads through the " + impl_->scene_name + " at " +
                            place(begin_W + static_cast<double>(range_m) * way.normalized()),
                        "Move the trajectory away from the object, for example with a larger --radius");
  }
}

int Simulator::frames() const { return static_cast<int>(impl_->trajectory.size()); }

SimulatedFrame Simulator::frame(int index) const {
  if (index < 0 || index >= frames()) {
    throw InvalidArgument("sim.frame", "frame " + std::to_string(index),
                          "there are only " + std::to_string(frames()) + " frames");
  }
  const auto frame_number = static_cast<std::uint64_t>(index);
  SimulatedFrame out;
  out.T_W_S = impl_->trajectory[static_cast<std::size_t>(index)];
  out.stamp_s = index * impl_->model.frame_period_s;
  out.points_S.resize(static_cast<std::size_t>(impl_->model.rays_per_frame));
  const Eigen::Matrix3d R_W_S = out.T_W_S.linear();
  const Eigen::Vector3d origin_W = out.T_W_S.translation();

  tbb::parallel_for(tbb::blocked_range<int>(0, impl_->model.rays_per_frame, kRaysPerTask),
                    [&](const tbb::blocked_range<int>& rays) {
                      std::vector<Eigen::Vector3f> directions_S(rays.size()), directions_W(rays.size());
                      std::vector<float> ranges_m(rays.size());
                      for (int ray = rays.begin(); ray < rays.end(); ++ray) {
                        const auto i = static_cast<std::size_t>(ray - rays.begin());
                        directions_S[i] = rayDirection_S(impl_->model, frame_number, ray);
                        directions_W[i] = (R_W_S * directions_S[i].cast<double>()).cast<float>();
                      }
                      impl_->caster.cast(origin_W, directions_W, ranges_m);
                      for (int ray = rays.begin(); ray < rays.end(); ++ray) {
                        const auto i = static_cast<std::size_t>(ray - rays.begin());
                        const float range_m = impl_->measured_m(ranges_m[i], frame_number, ray);
                        Eigen::Vector3f& point_S = out.points_S[static_cast<std::size_t>(ray)];
                        point_S.setZero();  // not 0 * direction, which may be -0
                        if (range_m > 0) point_S = range_m * directions_S[i];
                      }
                    });
  return out;
}

}  // namespace accessvdb::sim
