// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/truth_orientations.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "accessvdb/error.h"

namespace accessvdb::eval {
namespace {

using Rotations = std::vector<Eigen::Matrix3d>;

void addRing(double pitch_deg, int yaws, Rotations& out) {
  for (int n = 0; n < yaws; ++n) out.push_back(heldAt(360.0 * n / yaws, pitch_deg, 0));
}

/// Quotients that should be whole are off by rounding.
constexpr double kSlack = 1e-6;

Rotations pitchSet(double min_deg, double max_deg, double step_deg, int yaws) {
  Rotations out;
  for (int n = 0; min_deg + n * step_deg <= max_deg + kSlack; ++n) {
    const double pitch_deg = min_deg + n * step_deg;
    addRing(pitch_deg, std::abs(std::abs(pitch_deg) - 90) < kSlack ? 1 : yaws, out);
  }
  return out;
}

/// Rings at whole fractions of half a turn, as near to STEP apart as can be, the equator among them; on each a multiple
/// of four yaws, as near to STEP apart as can be.
Rotations sphereSet(double step_deg) {
  const int to_pole = std::max(1, static_cast<int>(std::floor(90 / step_deg + 0.5 + kSlack)));
  Rotations out;
  for (int ring = -to_pole; ring <= to_pole; ++ring) {
    const double pitch_deg = 90.0 * ring / to_pole;
    const double quarter_deg = 90 * std::cos(pitch_deg * std::numbers::pi / 180);
    const int in_quarter = std::max(1, static_cast<int>(std::floor(quarter_deg / step_deg + 0.5 + kSlack)));
    addRing(pitch_deg, std::abs(ring) == to_pole ? 1 : 4 * in_quarter, out);
  }
  return out;
}

}  // namespace

Eigen::Matrix3d heldAt(double yaw_deg, double pitch_deg, double roll_deg) {
  constexpr double kDegree = std::numbers::pi / 180;
  // Straight up or down, where the doubles of the angles would leave the axis a little off.
  const bool upright = std::abs(pitch_deg) == 90;
  const double pitch_rad = pitch_deg * kDegree;
  Eigen::Matrix3d tilt;
  tilt << (upright ? 0 : std::cos(pitch_rad)), 0, -std::sin(pitch_rad),  //
      0, 1, 0,                                                           //
      std::sin(pitch_rad), 0, (upright ? 0 : std::cos(pitch_rad));
  const auto turn = [](double angle_deg, const Eigen::Vector3d& axis) {
    return Eigen::AngleAxisd(angle_deg * kDegree, axis).toRotationMatrix();
  };
  return turn(yaw_deg, Eigen::Vector3d::UnitZ()) * tilt * turn(roll_deg, Eigen::Vector3d::UnitX());
}

Rotations yawOrientations(int num_directions) {
  Rotations out;
  for (int d = 0; d < num_directions; ++d) {
    const double yaw_rad = 2 * std::numbers::pi * d / num_directions;
    Eigen::Matrix3d R_WT = Eigen::Matrix3d::Identity();
    R_WT(0, 0) = R_WT(1, 1) = std::cos(yaw_rad);
    R_WT(1, 0) = std::sin(yaw_rad);
    R_WT(0, 1) = -R_WT(1, 0);
    out.push_back(R_WT);
  }
  return out;
}

Rotations rolled(const Rotations& orientations, int rolls, int fold) {
  Rotations out;
  for (const Eigen::Matrix3d& R_WT : orientations) {
    for (int roll = 0; roll < rolls; ++roll) out.push_back(R_WT * heldAt(0, 0, 360.0 * roll / (rolls * fold)));
  }
  return out;
}

Rotations truthOrientations(const std::string& text, int num_directions) {
  double min_deg = 0, max_deg = 0, step_deg = 0;
  int read = 0;
  const auto whole = [&] { return static_cast<std::size_t>(read) == text.size(); };
  if (text == "yaw") return yawOrientations(num_directions);
  if (std::sscanf(text.c_str(), "pitch:%lf:%lf:%lf%n", &min_deg, &max_deg, &step_deg, &read) == 3 && whole() &&
      step_deg > 0 && min_deg >= -90 && max_deg <= 90) {
    return pitchSet(min_deg, max_deg, step_deg, num_directions);
  }
  if (std::sscanf(text.c_str(), "sphere:%lf%n", &step_deg, &read) == 1 && step_deg > 0 && step_deg <= 90) {
    const bool with_yaw = text.substr(static_cast<std::size_t>(read)) == "+yaw";
    if (with_yaw || whole()) {
      Rotations out = with_yaw ? yawOrientations(num_directions) : Rotations();
      const Rotations sphere = sphereSet(step_deg);
      for (const Eigen::Matrix3d& R_WT : sphere) {
        const bool known = std::any_of(out.begin(), out.end(), [&](const Eigen::Matrix3d& other) {
          return (other.col(0) - R_WT.col(0)).norm() < kSlack;
        });
        if (!known) out.push_back(R_WT);
      }
      return out;
    }
  }
  throw InvalidArgument("truth.orientations", text, "is not a set of orientations", "See docs/orientations.md");
}

}  // namespace accessvdb::eval
