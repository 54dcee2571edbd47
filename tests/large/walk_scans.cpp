// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "large/walk_scans.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <random>
#include <vector>

namespace accessvdb::large_test {
namespace {

using Vector = std::array<double, 3>;

constexpr double kHalfWidth_m = 2.5, kHeight_m = 2.6, kPoleRadius_m = 0.12, kPoleDistance_m = 1.7;
constexpr double kSensorHeight_m = 1.2;

/// Uniform in [low, high), the same with every standard library.
double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

Vector sensorOf(int scan, const Walk& walk) { return {scan * walk.step_m, 0.4 * std::sin(0.7 * scan), 0}; }

/// Distance to the ground, a wall or a pole; infinite if there is none.
double rangeOf(const Vector& o, const Vector& d) {
  double range = std::numeric_limits<double>::infinity();
  const auto hit = [&](double t) {
    if (t > 0 && t < range && o[2] + t * d[2] < kHeight_m - kSensorHeight_m) range = t;
  };
  if (d[2] < 0) hit(-kSensorHeight_m / d[2]);
  for (const double wall : {-kHalfWidth_m, kHalfWidth_m}) {
    if (d[1] != 0) hit((wall - o[1]) / d[1]);
  }
  const int first = static_cast<int>(std::floor(o[0] / kPoleDistance_m)) - 5;
  for (int pole = first; pole < first + 11; ++pole) {
    const double x = (pole + 0.5) * kPoleDistance_m - o[0], y = (pole % 2 == 0 ? 1.4 : -1.5) - o[1];
    const double a = d[0] * d[0] + d[1] * d[1], b = d[0] * x + d[1] * y,
                 c = x * x + y * y - kPoleRadius_m * kPoleRadius_m;
    if (b * b > a * c) hit((b - std::sqrt(b * b - a * c)) / a);
  }
  return range;
}

/// In the sensor's frame, whose axes are those of the world.
std::vector<Vector> returnsOf(int scan, const Walk& walk) {
  std::mt19937_64 random(walk.seed * 1000 + static_cast<std::uint64_t>(scan));
  std::vector<Vector> returns;
  const Vector o = sensorOf(scan, walk);
  for (int ray = 0; ray < walk.rays; ++ray) {
    const double heading = uniform(random, 0, 6.283185307), z = uniform(random, -0.85, 0.45);
    const double flat = std::sqrt(1 - z * z);
    const Vector d = {flat * std::cos(heading), flat * std::sin(heading), z};
    const double range = rangeOf(o, d) + uniform(random, -0.01, 0.01);
    if (range < walk.max_range_m) returns.push_back({range * d[0], range * d[1], range * d[2]});
  }
  return returns;
}

void putFloats(std::ostream& stream, const Vector& values) {
  for (const double value : values) {
    const auto text = static_cast<float>(value);
    stream.write(reinterpret_cast<const char*>(&text), sizeof text);
  }
}

std::ofstream binaryFile(const std::filesystem::path& file) {
  std::filesystem::create_directories(file.parent_path());
  return std::ofstream(file, std::ios::binary);
}

Vector sum(const Vector& a, const Vector& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }

}  // namespace

const char* const kFirstSensor = "0,0,0";

void writeWalk(const std::filesystem::path& folder, const Walk& walk) {
  std::filesystem::create_directories(folder);
  std::ofstream poses(folder / "poses.txt");
  for (int scan = 0; scan < walk.scans; ++scan) {
    const Vector o = sensorOf(scan, walk);
    poses << 100 + scan << " " << o[0] << " " << o[1] << " " << o[2] << " 0 0 0 1\n";
    const std::vector<Vector> returns = returnsOf(scan, walk);
    char name[32];
    std::snprintf(name, sizeof name, "%06d.pcd", scan);
    std::ofstream file = binaryFile(folder / "scans" / name);
    file << "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << returns.size()
         << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << returns.size() << "\nDATA binary\n";
    for (const Vector& p : returns) putFloats(file, p);
  }
}

void writeRayCloud(const std::filesystem::path& path, const Walk& walk) {
  std::ofstream file = binaryFile(path);
  std::vector<std::vector<Vector>> scans;
  std::size_t count = 0;
  for (int scan = 0; scan < walk.scans; ++scan) count += scans.emplace_back(returnsOf(scan, walk)).size();
  file << "ply\nformat binary_little_endian 1.0\nelement vertex " << count
       << "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n"
          "property float nz\nend_header\n";
  for (int scan = 0; scan < walk.scans; ++scan) {
    for (const Vector& p : scans[static_cast<std::size_t>(scan)]) {
      putFloats(file, sum(sensorOf(scan, walk), p));
      putFloats(file, {-p[0], -p[1], -p[2]});
    }
  }
}

void writeCloud(const std::filesystem::path& path, const Walk& walk) {
  std::ofstream file = binaryFile(path);
  const std::vector<Vector> returns = returnsOf(0, walk);
  file << "ply\nformat binary_little_endian 1.0\nelement vertex " << returns.size()
       << "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
  for (const Vector& p : returns) putFloats(file, sum(sensorOf(0, walk), p));
}

}  // namespace accessvdb::large_test
