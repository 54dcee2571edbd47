// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/lidar_model.h"

#include <cmath>
#include <numbers>

#include "accessvdb/error.h"
#include "sim/angles.h"
#include "sim/halton.h"

namespace accessvdb::sim {
namespace {

constexpr double kMid360Lowest_rad = -7 * kDegree, kMid360Highest_rad = 52 * kDegree;
/// 64 rings over 45 degrees around the horizon, as in Ouster's OS1-64.
constexpr double kSpinningHighest_rad = 22.5 * kDegree;
constexpr int kRings = 64, kColumns = 1024;

Eigen::Vector3f unitVector(double azimuth_rad, double elevation_rad) {
  const double level = std::cos(elevation_rad);
  return Eigen::Vector3d(level * std::cos(azimuth_rad), level * std::sin(azimuth_rad), std::sin(elevation_rad))
      .cast<float>();
}

}  // namespace

LidarModel LidarModel::named(const std::string& name) {
  LidarModel model;
  if (name == "mid360") return model;
  if (name == "spinning") {
    model.pattern = Pattern::Spinning;
    model.rays_per_frame = kRings * kColumns;
    return model;
  }
  throw InvalidArgument("sim.sensor", name, "is not a sensor", "Use mid360 or spinning");
}

double LidarModel::middleElevation_rad() const {
  return pattern == Pattern::Mid360 ? 0.5 * (kMid360Lowest_rad + kMid360Highest_rad) : 0.0;
}

void LidarModel::validate() const {
  const auto refuse = [](const char* field, const char* problem, const char* advice) {
    throw InvalidArgument("sim.sensor", field, problem, advice);
  };
  if (rays_per_frame < 1 || rays_per_frame > 10'000'000) {
    refuse("rays per frame", "is outside 1 .. 10 000 000", "Choose a number of rays in between");
  }
  if (pattern == Pattern::Spinning && rays_per_frame != kRings * kColumns) {
    refuse("rays per frame", "the spinning sensor has 64 x 1024 rays", "Do not change them");
  }
  if (!(frame_period_s > 0) || !std::isfinite(frame_period_s)) {
    refuse("frame period", "is not a positive time", "Use seconds");
  }
  if (!(range_noise_m >= 0) || !(range_noise_m <= 10)) {
    refuse("--range-noise", "is outside 0 .. 10 m", "Use a standard deviation in metres");
  }
  if (!(dropout >= 0) || !(dropout <= 1)) refuse("--dropout", "is outside 0 .. 1", "Use a share such as 0.1");
  if (!(min_range_m >= 0) || !(max_range_m > min_range_m)) {
    refuse("--max-range", "is not above the shortest range", "Use a range in metres");
  }
}

double rayTime_s(const LidarModel& model, int ray) { return model.frame_period_s * ray / model.rays_per_frame; }

Eigen::Vector3f rayDirection_S(const LidarModel& model, std::uint64_t frame, int ray) {
  if (model.pattern == LidarModel::Pattern::Spinning) {
    // Column by column as the head turns; ring 0 is the lowest. The encoder repeats the same grid in every turn.
    const int column = ray / kRings, ring = ray % kRings;
    const double elevation = -kSpinningHighest_rad + 2 * kSpinningHighest_rad * ring / (kRings - 1);
    return unitVector(2 * std::numbers::pi * column / kColumns, elevation);
  }
  // Starts at 1: element 0 of the sequence is a corner in every base.
  const std::uint64_t index =
      frame * static_cast<std::uint64_t>(model.rays_per_frame) + static_cast<std::uint64_t>(ray) + 1;
  const double azimuth = 2 * std::numbers::pi * radicalInverse<2>(index);
  const double elevation = kMid360Lowest_rad + (kMid360Highest_rad - kMid360Lowest_rad) * radicalInverse<3>(index);
  return unitVector(azimuth, elevation);
}

}  // namespace accessvdb::sim
