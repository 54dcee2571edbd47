// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Streams whose returns all fall together must not make updates quadratic: each update tests a direction of a point at
/// most twice, once if its best direction is tested again and once in a full search.
#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <vector>

#include "accessvdb/accessibility_field.h"

namespace accessvdb {
namespace {

AccessibilityField makeField() {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.backend = BackendKind::Cpu;
  return AccessibilityField(ToolGeometry::builtin("builtin:pruner"), params);
}

/// CPU time of the process, which other programs on the machine do not lengthen.
double cpuSeconds() {
  std::timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Updates after each scan. @return all direction tests
std::uint64_t testsOf(AccessibilityField& field, const std::vector<Eigen::Vector3f>& scan, int frames) {
  const auto directions = static_cast<std::uint64_t>(field.params().approach.num_directions);
  std::uint64_t tests = 0;
  for (int frame = 0; frame < frames; ++frame) {
    Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.translation().x() = 0.001 * frame;
    field.integrateScan(scan, T_W_S);
    const UpdateStats stats = field.update();
    EXPECT_LE(stats.direction_tests, stats.scored_points * (directions + 1)) << "frame " << frame;
    EXPECT_LE(stats.scored_points, field.snapshot().points.size()) << "frame " << frame;
    tests += stats.direction_tests;
  }
  const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
  for (std::size_t n = 0; n < now.points.size(); ++n) {
    EXPECT_EQ(now.points[n].label, scratch.points[n].label) << n;
  }
  return tests;
}

/// Returns in the voxel at (3, 0, 0) m.
std::vector<Eigen::Vector3f> inOneVoxel(int count) {
  std::vector<Eigen::Vector3f> scan;
  for (int n = 0; n < count; ++n) {
    const float along = 0.02f * static_cast<float>(n) / static_cast<float>(count);
    scan.emplace_back(3.0f + along, along, -along);
  }
  return scan;
}

TEST(DegenerateStream, AllReturnsInOneVoxel) {
  AccessibilityField field = makeField();
  testsOf(field, inOneVoxel(2000), 12);
  EXPECT_LE(field.snapshot().points.size(), 4u);  // the sensor moves 1 mm a scan
}

TEST(DegenerateStream, AMillionReturnsInOneVoxelTakeTimeInProportion) {
  const auto secondsFor = [](int count) {
    AccessibilityField field = makeField();
    const std::vector<Eigen::Vector3f> scan = inOneVoxel(count);
    const double begin = cpuSeconds();
    field.integrateScan(scan, Eigen::Isometry3d::Identity());
    field.update();
    field.integrateScan(scan, Eigen::Isometry3d::Identity());
    const UpdateStats stats = field.update();
    EXPECT_LE(stats.direction_tests, 181u);
    return cpuSeconds() - begin;
  };
  const double some = secondsFor(125'000), many = secondsFor(500'000);
  EXPECT_LT(many, 10 * some + 0.05) << "4 times as many returns; 16 times as long would be quadratic";
}

/// Evenly spread over a sphere of 3 m.
std::vector<Eigen::Vector3f> atOneRange(int count) {
  std::vector<Eigen::Vector3f> scan;
  for (int n = 0; n < count; ++n) {
    const double z = 1 - (2 * n + 1.0) / count, r = std::sqrt(1 - z * z), yaw = 2.399963229728653 * n;
    scan.emplace_back((3 * Eigen::Vector3d(r * std::cos(yaw), r * std::sin(yaw), z)).cast<float>());
  }
  return scan;
}

TEST(DegenerateStream, AllReturnsAtOneRange) {
  const std::vector<Eigen::Vector3f> scan = atOneRange(4000);
  AccessibilityField field = makeField();
  const std::uint64_t first = testsOf(field, scan, 4);
  const std::uint64_t later = testsOf(field, scan, 4);
  EXPECT_GT(first, 1000u);
  EXPECT_LE(later, 2 * first) << "the same places again";
}

TEST(DegenerateStream, MoreReturnsAtOneRangeTakeTimeInProportion) {
  const auto secondsFor = [](int count) {
    AccessibilityField field = makeField();
    const std::vector<Eigen::Vector3f> scan = atOneRange(count);
    const double begin = cpuSeconds();
    for (int frame = 0; frame < 3; ++frame) {
      field.integrateScan(scan, Eigen::Isometry3d::Identity());
      field.update();
    }
    return cpuSeconds() - begin;
  };
  // Up to 45 000 voxels: the larger scan makes at most four times as many points, each with more neighbours in reach.
  const double some = secondsFor(4'000), many = secondsFor(16'000);
  EXPECT_LT(many, 10 * some + 0.05) << "4 times as many returns; 16 times as long would be quadratic";
}

}  // namespace
}  // namespace accessvdb
