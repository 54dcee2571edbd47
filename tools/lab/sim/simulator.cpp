// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/simulator.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <span>
#include <string>
#include <utility>

#include "accessvdb/error.h"
#include "io/poses/pose_matching.h"
#include "sim/counter_random.h"

namespace accessvdb::sim {
namespace {

constexpr int kRaysPerTask = 2048;
/// Closer than this to a surface, rounding dominates the first range.
constexpr double kSurface_m = 1e-6;

std::string place(const Eigen::Vector3d& p) {
  char text[96];
  std::snprintf(text, sizeof text, "(%.4g, %.4g, %.4g)", p.x(), p.y(), p.z());
  return text;
}

void requirePoses(const LidarModel& model, const Trajectory& trajectory) {
  model.validate();
  if (trajectory.size() < (model.moves ? 2 : 1)) {
    throw UnusableInput("sim.frames", "trajectory", "there are no frames to simulate", "Use at least one pose");
  }
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    if (trajectory[i].matrix().allFinite()) continue;
    throw UnusableInput("sim.pose", "frame " + std::to_string(i), "its pose is not finite", "Check the trajectory");
  }
}

/// @throws UnusableInput naming the frame
void requireOutside(const SignedDistance& distance, const std::string& scene_name, const Trajectory& trajectory,
                    std::size_t frame) {
  const Eigen::Vector3d sensor_W = trajectory[frame].translation();
  const double distance_m = distance.at(sensor_W);
  if (distance_m > kSurface_m) return;
  throw UnusableInput("sim.inside", "frame " + std::to_string(frame),
                      "the sensor at " + place(sensor_W) + " is " +
                          (distance_m < -kSurface_m ? "inside" : "on the surface of") + " the " + scene_name,
                      "Move the trajectory away from the object, for example with a larger --radius");
}

}  // namespace

namespace {

/// What rays hit, for a time and somewhere.
struct Target {
  RayCaster caster;
  ScenePart when;  ///< without its scene
};

std::vector<Target> standing(RayCaster caster) {
  std::vector<Target> targets;
  targets.push_back({std::move(caster), {}});
  return targets;
}

}  // namespace

struct Simulator::Impl {
  std::string scene_name;
  LidarModel model;
  Trajectory trajectory;
  std::uint64_t seed;
  std::vector<Target> targets;

  [[nodiscard]] double stampOf(int index) const { return index * model.frame_period_s; }

  /// The nearest of what is there. @param ranges_m  [n] out
  void cast(double stamp_s, const Eigen::Vector3d& origin_W, std::span<const Eigen::Vector3f> directions_W,
            std::span<float> ranges_m) const {
    if (targets.size() == 1) {
      targets.front().caster.cast(origin_W, directions_W, ranges_m);
      return;
    }
    std::vector<float> of_one(ranges_m.size());
    std::fill(ranges_m.begin(), ranges_m.end(), std::numeric_limits<float>::infinity());
    for (const Target& target : targets) {
      if (!target.when.isThere(stamp_s)) continue;
      target.caster.cast(origin_W - target.when.offsetAt_W(stamp_s), directions_W, of_one);
      for (std::size_t n = 0; n < of_one.size(); ++n) ranges_m[n] = std::min(ranges_m[n], of_one[n]);
    }
  }

  /// What the sensor reports for a true range (infinity: nothing there); 0 = no return.
  [[nodiscard]] float measured_m(float range_m, std::uint64_t frame, int ray) const {
    if (!std::isfinite(range_m)) return 0;
    double measured = static_cast<double>(range_m);
    if (model.dropout > 0 || model.range_noise_m > 0) {
      // Both numbers are always drawn, so that changing one setting does not affect the other's outcome.
      CounterRandom random({seed, frame, static_cast<std::uint64_t>(ray)});
      const bool lost = random.uniform() < model.dropout;
      measured += model.range_noise_m * random.gaussian();
      if (lost) return 0;
    }
    // The sensor can only judge the measured range.
    return measured >= model.min_range_m && measured <= model.max_range_m && measured > 0 ? static_cast<float>(measured)
                                                                                          : 0;
  }

  [[nodiscard]] SimulatedFrame emptyFrame(int index) const {
    if (index < 0 || index >= frames()) {
      throw InvalidArgument("sim.frame", "frame " + std::to_string(index),
                            "there are only " + std::to_string(frames()) + " frames");
    }
    const auto begin = static_cast<std::size_t>(index);
    return {{}, trajectory[begin], trajectory[model.moves ? begin + 1 : begin], index * model.frame_period_s};
  }

  [[nodiscard]] int frames() const { return static_cast<int>(trajectory.size()) - (model.moves ? 1 : 0); }

  /// Ranges of rays begin .. end, each from where the sensor is at its time.
  void castMoving(const SimulatedFrame& frame, int begin, const std::vector<Eigen::Vector3f>& directions_S,
                  std::vector<float>& ranges_m) const {
    for (std::size_t i = 0; i < directions_S.size(); ++i) {
      const double share = rayTime_s(model, begin + static_cast<int>(i)) / model.frame_period_s;
      const Eigen::Isometry3d T_W_S = io::interpolateBetween(frame.T_W_S, frame.T_W_S_end, share);
      const Eigen::Vector3f direction_W = (T_W_S.linear() * directions_S[i].cast<double>()).cast<float>();
      cast(frame.stamp_s + rayTime_s(model, begin + static_cast<int>(i)), T_W_S.translation(), {&direction_W, 1},
           {&ranges_m[i], 1});
    }
  }

  /// Rays begin .. end of a frame. @return [end - begin] returns in the sensor frame; zero = no return
  [[nodiscard]] std::vector<Eigen::Vector3f> measure(int index, const SimulatedFrame& frame, int begin, int end) const {
    const auto frame_number = static_cast<std::uint64_t>(index);
    std::vector<Eigen::Vector3f> points_S(static_cast<std::size_t>(end - begin));
    const Eigen::Matrix3d R_W_S = frame.T_W_S.linear();
    const Eigen::Vector3d origin_W = frame.T_W_S.translation();
    tbb::parallel_for(tbb::blocked_range<int>(begin, end, kRaysPerTask), [&](const tbb::blocked_range<int>& rays) {
      std::vector<Eigen::Vector3f> directions_S(rays.size()), directions_W(rays.size());
      std::vector<float> ranges_m(rays.size());
      for (int ray = rays.begin(); ray < rays.end(); ++ray) {
        const auto i = static_cast<std::size_t>(ray - rays.begin());
        directions_S[i] = rayDirection_S(model, frame_number, ray);
        directions_W[i] = (R_W_S * directions_S[i].cast<double>()).cast<float>();
      }
      if (model.moves) {
        castMoving(frame, rays.begin(), directions_S, ranges_m);
      } else {
        cast(stampOf(index), origin_W, directions_W, ranges_m);
      }
      for (int ray = rays.begin(); ray < rays.end(); ++ray) {
        const auto i = static_cast<std::size_t>(ray - rays.begin());
        const float range_m = measured_m(ranges_m[i], frame_number, ray);
        Eigen::Vector3f& point_S = points_S[static_cast<std::size_t>(ray - begin)];
        point_S.setZero();  // not 0 * direction, which may be -0
        if (range_m > 0) point_S = range_m * directions_S[i];
      }
    });
    return points_S;
  }
};

Simulator::Simulator(const Scene& scene, const LidarModel& model, Trajectory trajectory, std::uint64_t seed) {
  requirePoses(model, trajectory);
  for (std::size_t n = 0; scene.distance && n < trajectory.size(); ++n) {
    requireOutside(*scene.distance, scene.name, trajectory, n);
  }
  impl_ = std::make_unique<Impl>(Impl{scene.name, model, std::move(trajectory), seed, standing(RayCaster(scene.mesh))});
}

Simulator::Simulator(RayCaster scene, const std::string& scene_name, const LidarModel& model, Trajectory trajectory,
                     std::uint64_t seed) {
  requirePoses(model, trajectory);
  impl_ = std::make_unique<Impl>(Impl{scene_name, model, std::move(trajectory), seed, standing(std::move(scene))});
}

Simulator::Simulator(const ChangingScene& scene, const LidarModel& model, std::uint64_t seed) {
  requirePoses(model, scene.trajectory);
  std::vector<Target> targets;
  for (const ScenePart& part : scene.parts) {
    targets.push_back({RayCaster(part.scene.mesh), {{}, part.from_s, part.until_s, part.offset_W}});
  }
  for (std::size_t n = 0; n < scene.trajectory.size(); ++n) {
    const auto distance = scene.distanceAt(static_cast<double>(n) * model.frame_period_s);
    requireOutside(*distance, scene.name, scene.trajectory, n);
  }
  impl_ = std::make_unique<Impl>(Impl{scene.name, model, scene.trajectory, seed, std::move(targets)});
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
    impl_->cast(0, begin_W, {&direction_W, 1}, {&range_m, 1});
    if (static_cast<double>(range_m) > way.norm()) continue;
    throw UnusableInput("sim.through", "trajectory",
                        "it passes through the " + impl_->scene_name + " at " +
                            place(begin_W + static_cast<double>(range_m) * way.normalized()),
                        "Move the trajectory away from the object, for example with a larger --radius");
  }
}

int Simulator::frames() const { return impl_->frames(); }
const LidarModel& Simulator::model() const { return impl_->model; }

SimulatedFrame Simulator::frame(int index) const {
  SimulatedFrame out = impl_->emptyFrame(index);
  const LidarModel& model = impl_->model;
  out.points_S = impl_->measure(index, out, 0, model.rays_per_frame);
  for (int ray = 0; model.moves && ray < model.rays_per_frame; ++ray)
    out.times_ns.push_back(static_cast<std::uint32_t>(std::llround(1e9 * rayTime_s(model, ray))));
  return out;
}

SimulatedFrame Simulator::frameOfReturns(int index, int returns) const {
  SimulatedFrame out = impl_->emptyFrame(index);
  if (returns < 1) throw InvalidArgument("sim.returns", "returns", "a frame has at least one");
  const auto wanted = static_cast<std::size_t>(returns);
  for (int begin = 0; out.points_S.size() < wanted; begin += returns) {
    if (begin >= impl_->model.rays_per_frame) {
      throw UnusableInput("sim.returns", "frame " + std::to_string(index),
                          "of " + std::to_string(impl_->model.rays_per_frame) + " rays only " +
                              std::to_string(out.points_S.size()) + " return, not " + std::to_string(returns),
                          "Use fewer points per frame, or a longer range");
    }
    // Batches of a fixed size: the rays in a frame do not depend on the threads.
    const int end = std::min(impl_->model.rays_per_frame, begin + returns);
    for (const Eigen::Vector3f& point_S : impl_->measure(index, out, begin, end)) {
      if (out.points_S.size() < wanted && !point_S.isZero(0)) out.points_S.push_back(point_S);
    }
  }
  return out;
}

std::vector<SimulatedFrame> Simulator::framesOfReturns(int begin, int end, int returns) const {
  std::vector<SimulatedFrame> frames(static_cast<std::size_t>(std::max(0, end - begin)));
  tbb::parallel_for(std::size_t{0}, frames.size(),
                    [&](std::size_t n) { frames[n] = frameOfReturns(begin + static_cast<int>(n), returns); });
  return frames;
}

}  // namespace accessvdb::sim
