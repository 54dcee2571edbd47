// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Inputs as other software writes them, all of one scene: a wall at x = 3 m, a post and a floor, seen by eight scans.
/// Tests write the scans in the form under test, run the program, and ask whether an accessible point lies where
/// nothing is.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "cli/program_run.h"

namespace accessvdb::inputs_test {

struct WorldScan {
  double stamp_s = 0;
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  std::vector<Eigen::Vector3d> points_W;
  [[nodiscard]] std::vector<Eigen::Vector3d> points_S() const;
};

/// The scans of a platform that turns and climbs while it goes by, 0.1 s apart from `first_stamp_s`.
[[nodiscard]] std::vector<WorldScan> worldScans(int returns_per_scan = 1500, double first_stamp_s = 1700000000);
/// Distance from the nearest surface of the scene.
[[nodiscard]] double distanceFromScene_m(const Eigen::Vector3d& p_W);

/// What a run said and wrote.
struct MapOutcome {
  cli_test::ProgramResult program;
  std::uint64_t points = 0, accessible = 0, blocked = 0;  ///< of points.ply
  std::uint64_t phantoms = 0;  ///< accessible points more than 10 cm from every surface of the scene
  [[nodiscard]] bool warns(const std::string& id) const;
  [[nodiscard]] bool fails(const std::string& id) const;
};

class InputTest : public cli_test::ProgramTest {
 protected:
  /// Ascii or binary PCD of float32 x y z. @param name  relative to the test's folder; its folders are made
  void writePcd(const std::string& name, const std::vector<Eigen::Vector3d>& points, bool binary = true) const;
  void writeBytes(const std::string& name, const std::string& bytes) const;
  /// "scans/000000.pcd" and so on, and "poses.txt" (KITTI).
  void writeNumberedScans(const std::vector<WorldScan>& scans) const;
  /// `map --device cpu --voxel 0.05 --range-noise 0.01 --tool builtin:pruner --out out` with the rest given.
  [[nodiscard]] MapOutcome map(std::vector<std::string> arguments) const;
  /// Exit code 0, points there, and none of the accessible ones where nothing is.
  static void expectRight(const MapOutcome& outcome);
};

/// A number with nine decimals.
[[nodiscard]] std::string decimals(double value);

}  // namespace accessvdb::inputs_test
