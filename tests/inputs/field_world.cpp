// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "inputs/field_world.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <optional>
#include <random>

namespace accessvdb::inputs_test {
namespace {

constexpr double kWallX = 3, kHalfWidth = 1.5, kHeight = 2, kPostX = 2.2, kPostY = 0.3, kPostRadius = 0.1,
                 kPostHeight = 1.8;

/// Where a ray from o along d first meets the scene.
std::optional<double> rayLength(const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
  std::optional<double> nearest;
  const auto offer = [&](double t) {
    if (t > 0 && (!nearest || t < *nearest)) nearest = t;
  };
  if (d.x() != 0) {
    const double t = (kWallX - o.x()) / d.x();
    const Eigen::Vector3d p = o + t * d;
    if (std::abs(p.y()) <= kHalfWidth && p.z() >= 0 && p.z() <= kHeight) offer(t);
  }
  if (d.z() != 0) {
    const double t = -o.z() / d.z();
    const Eigen::Vector3d p = o + t * d;
    if (std::abs(p.y()) <= kHalfWidth && p.x() >= 0 && p.x() <= kWallX) offer(t);
  }
  const Eigen::Vector2d from = o.head<2>() - Eigen::Vector2d(kPostX, kPostY), along = d.head<2>();
  const double a = along.squaredNorm(), b = from.dot(along), c = from.squaredNorm() - kPostRadius * kPostRadius;
  if (const double root = b * b - a * c; a > 0 && root >= 0) {
    const double t = (-b - std::sqrt(root)) / a;
    const double z = o.z() + t * d.z();
    if (z >= 0 && z <= kPostHeight) offer(t);
  }
  return nearest;
}

}  // namespace

std::vector<Eigen::Vector3d> WorldScan::points_S() const {
  const Eigen::Isometry3d T_S_W = T_W_S.inverse();
  std::vector<Eigen::Vector3d> points;
  points.reserve(points_W.size());
  for (const Eigen::Vector3d& p_W : points_W) points.push_back(T_S_W * p_W);
  return points;
}

std::vector<WorldScan> worldScans(int returns_per_scan, double first_stamp_s) {
  std::vector<WorldScan> scans;
  std::mt19937 random(7);
  const auto uniform = [&](double low, double high) { return low + (high - low) * (random() / 4294967296.0); };
  for (int i = 0; i < 8; ++i) {
    WorldScan scan;
    scan.stamp_s = first_stamp_s + 0.1 * i;
    const double yaw = 0.3 - 0.1 * i, roll = 0.4;
    scan.T_W_S = Eigen::Translation3d(0.2 + 0.05 * i, -1 + 0.28 * i, 1 + 0.03 * i) *
                 Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitY()) *
                 Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
    const Eigen::Vector3d o = scan.T_W_S.translation();
    while (static_cast<int>(scan.points_W.size()) < returns_per_scan) {
      const double azimuth = uniform(-1.2, 1.2), height = uniform(-1, 0.6);
      const Eigen::Vector3d d(std::cos(azimuth) * std::cos(height), std::sin(azimuth) * std::cos(height),
                              std::sin(height));
      if (const auto t = rayLength(o, d)) scan.points_W.push_back(o + *t * d);
    }
    scans.push_back(std::move(scan));
  }
  return scans;
}

double distanceFromScene_m(const Eigen::Vector3d& p) {
  const double far = std::numeric_limits<double>::infinity();
  const bool beside = std::abs(p.y()) < kHalfWidth + 0.1;
  const double wall = beside && p.z() > -0.1 && p.z() < kHeight + 0.1 ? std::abs(p.x() - kWallX) : far;
  const double floor = beside && p.x() > -0.1 && p.x() < kWallX + 0.1 ? std::abs(p.z()) : far;
  const double post = p.z() > -0.1 && p.z() < kPostHeight + 0.1
                          ? std::abs(std::hypot(p.x() - kPostX, p.y() - kPostY) - kPostRadius)
                          : far;
  return std::min({wall, floor, post});
}

bool MapOutcome::warns(const std::string& id) const {
  return program.err.find("warning[" + id + "]") != std::string::npos;
}
bool MapOutcome::fails(const std::string& id) const {
  return program.err.find("error[" + id + "]") != std::string::npos;
}

void InputTest::writeBytes(const std::string& name, const std::string& bytes) const {
  std::filesystem::create_directories(std::filesystem::path(path(name)).parent_path());
  std::ofstream(path(name), std::ios::binary) << bytes;
}

void InputTest::writePcd(const std::string& name, const std::vector<Eigen::Vector3d>& points, bool binary) const {
  const std::string n = std::to_string(points.size());
  std::string bytes =
      "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"
      "COUNT 1 1 1\nWIDTH " +
      n + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + n + "\nDATA " + (binary ? "binary" : "ascii") + "\n";
  for (const Eigen::Vector3d& p : points) {
    if (binary) {
      const Eigen::Vector3f single = p.cast<float>();
      bytes.append(reinterpret_cast<const char*>(single.data()), 3 * sizeof(float));
    } else {
      bytes += decimals(p.x()) + " " + decimals(p.y()) + " " + decimals(p.z()) + "\n";
    }
  }
  writeBytes(name, bytes);
}

void InputTest::writeNumberedScans(const std::vector<WorldScan>& scans) const {
  std::string poses;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    char name[32];
    std::snprintf(name, sizeof name, "scans/%06zu.pcd", i);
    writePcd(name, scans[i].points_S());
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column)
        poses += decimals(scans[i].T_W_S(row, column)) + (row == 2 && column == 3 ? "\n" : " ");
    }
  }
  writeBytes("poses.txt", poses);
}

MapOutcome InputTest::map(std::vector<std::string> arguments) const {
  std::vector<std::string> all = {"map",    "--device",       "cpu",   "--voxel",  "0.05", "--range-noise", "0.01",
                                  "--tool", "builtin:pruner", "--out", path("out")};
  all.insert(all.end(), arguments.begin(), arguments.end());
  std::filesystem::remove_all(path("out"));
  MapOutcome outcome;
  outcome.program = cli_test::runProgram(std::move(all));
  std::ifstream file(path("out/points.ply"), std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), {});
  const std::size_t end = bytes.find("end_header\n"), count = bytes.find("element vertex ");
  if (end == std::string::npos || count == std::string::npos) return outcome;
  outcome.points = std::stoull(bytes.substr(count + 15));
  const std::size_t begin = end + 11;
  const std::size_t stride = outcome.points == 0 ? 0 : (bytes.size() - begin) / outcome.points;
  constexpr std::size_t kLabel = 39;  // after x y z (double), normal and colour, docs/file_formats.md
  for (std::uint64_t i = 0; i < outcome.points; ++i) {
    const char* const point = bytes.data() + begin + i * stride;
    Eigen::Vector3d p_W;
    std::memcpy(p_W.data(), point, 3 * sizeof(double));
    outcome.accessible += point[kLabel] == 1 ? 1 : 0;
    outcome.blocked += point[kLabel] == 2 ? 1 : 0;
    outcome.phantoms += point[kLabel] == 1 && distanceFromScene_m(p_W) > 0.1 ? 1 : 0;
  }
  return outcome;
}

void InputTest::expectRight(const MapOutcome& outcome) {
  EXPECT_EQ(outcome.program.exit_code, 0) << outcome.program.err;
  EXPECT_GT(outcome.accessible, 0u) << outcome.program.err;
  EXPECT_EQ(outcome.phantoms, 0u) << outcome.program.err;
}

std::string decimals(double value) {
  char text[64];
  std::snprintf(text, sizeof text, "%.9f", value);
  return text;
}

}  // namespace accessvdb::inputs_test
