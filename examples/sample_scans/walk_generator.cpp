// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sample_scans/walk_generator.h"

#include <cmath>
#include <numbers>
#include <string>

#include "accessvdb/error.h"
#include "sample_scans/forest_scene.h"
#include "sample_scans/random_stream.h"

namespace accessvdb::samples {
namespace {

constexpr double kStepPerFrame_m = 0.1;
constexpr double kElevationMin_rad = -7.0 * std::numbers::pi / 180.0;
constexpr double kElevationMax_rad = 52.0 * std::numbers::pi / 180.0;
constexpr std::uint64_t kNoiseStream = 0x4E4F495345000000ull;  // separate from the streams of the scene

void check(bool valid, const char* option, const char* range) {
  if (!valid)
    throw InvalidArgument("sample.option", option, std::string("is outside ") + range, "Choose a value inside");
}

WalkOptions checked(WalkOptions o) {
  check(o.frames >= 1 && o.frames <= 1000000, "frames", "1 .. 1000000");
  check(o.rays_per_frame >= 1 && o.rays_per_frame <= 10000000, "rays", "1 .. 10000000");
  check(o.range_noise_m >= 0.0 && o.range_noise_m <= 10.0, "range-noise", "0 .. 10 m");
  check(o.length_m >= 0.0 && o.length_m <= 1e5, "length", "0 .. 100000 m");
  check(o.max_range_m > 0.0 && o.max_range_m <= 1000.0, "max-range", "(0, 1000] m");
  check(o.trees >= -1 && o.trees <= 100000, "trees", "0 .. 100000");
  check(o.height_m >= 0.5 && o.height_m <= 5.0, "height", "0.5 .. 5 m");
  check(std::abs(o.mount_pitch_rad) <= 1.5, "mount-pitch", "-1.5 .. 1.5 rad");
  check(o.frame_period_s > 0.0 && o.frame_period_s <= 1000.0, "frame-period", "(0, 1000] s");
  check(o.offset_W.allFinite(), "offset", "the finite numbers");
  if (o.length_m == 0.0) o.length_m = kStepPerFrame_m * (o.frames - 1);
  return o;
}

/// Halton sequence: the digits of index in that base, mirrored at the point. [0, 1)
double radicalInverse(std::uint64_t index, std::uint64_t base) {
  double result = 0.0, place = 1.0 / static_cast<double>(base);
  for (; index > 0; index /= base, place /= static_cast<double>(base)) {
    result += static_cast<double>(index % base) * place;
  }
  return result;
}

}  // namespace

WalkGenerator::WalkGenerator(const WalkOptions& options)
    : options_(checked(options)),
      scene_(makeForest({options_.length_m, options_.trees, options_.flat_ground, options_.seed})) {}

Eigen::Isometry3d WalkGenerator::pose(int index) const {
  const double s = options_.frames > 1 ? options_.length_m * index / (options_.frames - 1) : 0.0;
  const Eigen::Vector2d track = pathPoint(s);
  // A step is about 0.7 m: bobs with each, sways with every other one, looks around slowly.
  const double step = 2.0 * std::numbers::pi * s / 0.7;
  const double yaw = pathYaw(s) + 0.08 * std::sin(0.9 * s);
  const double pitch = options_.mount_pitch_rad + 0.03 * std::sin(step);
  const double roll = 0.03 * std::sin(0.5 * step);
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  T_W_S.linear() =
      (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  T_W_S.translation() =
      Eigen::Vector3d(track.x(), track.y(), options_.height_m + 0.02 * std::sin(step)) + options_.offset_W;
  return T_W_S;
}

Eigen::Vector3d WalkGenerator::rayDirection_S(int frame_index, int ray) const {
  const std::uint64_t index =
      static_cast<std::uint64_t>(frame_index) * static_cast<std::uint64_t>(options_.rays_per_frame) +
      static_cast<std::uint64_t>(ray) + 1;
  const double azimuth = 2.0 * std::numbers::pi * radicalInverse(index, 2);
  const double elevation = kElevationMin_rad + (kElevationMax_rad - kElevationMin_rad) * radicalInverse(index, 3);
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
}

WalkFrame WalkGenerator::frame(int index) const {
  WalkFrame result;
  result.T_W_S = pose(index);
  result.stamp_s = options_.frame_period_s * index;
  result.points_S.reserve(static_cast<std::size_t>(options_.rays_per_frame));
  RandomStream noise(options_.seed, kNoiseStream + static_cast<std::uint64_t>(index));
  const Eigen::Vector3d origin = result.T_W_S.translation() - options_.offset_W;
  for (int ray = 0; ray < options_.rays_per_frame; ++ray) {
    const Eigen::Vector3d direction_S = rayDirection_S(index, ray);
    // Drawn for misses too, so that one ray's noise does not depend on the others.
    const double error = options_.range_noise_m > 0.0 ? options_.range_noise_m * noise.gaussian() : 0.0;
    const double range = scene_.castRay({origin, result.T_W_S.linear() * direction_S}) + error;
    const bool hit = range > 0.0 && range <= options_.max_range_m;
    result.points_S.push_back(hit ? Eigen::Vector3f((range * direction_S).cast<float>()) : Eigen::Vector3f(0, 0, 0));
  }
  return result;
}

}  // namespace accessvdb::samples
