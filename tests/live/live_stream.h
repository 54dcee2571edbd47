// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans and poses as they would arrive, and the field that is fed with the same scans directly.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "accessvdb/live_session.h"
#include "support/determinism_support.h"
#include "support/same_map.h"

namespace accessvdb::live_test {

using test::Scan;

constexpr std::int64_t kFirst_ns = 1'700'000'000'000'000'000, kStep_ns = 100'000'000;

inline FieldParams coarseParams() {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.backend = BackendKind::Cpu;
  return params;
}

inline std::int64_t stampOf(std::size_t n) { return kFirst_ns + static_cast<std::int64_t>(n) * kStep_ns; }

inline LivePose poseOf(const Scan& scan, std::size_t n) {
  return {stampOf(n), scan.T_W_S.translation(), Eigen::Quaterniond(scan.T_W_S.linear())};
}
/// The pose as a quaternion gives it, which differs from the scan's in the last digits.
inline Eigen::Isometry3d sentPose(const LivePose& pose) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = pose.q_W_B.normalized().toRotationMatrix();
  T.translation() = pose.p_W;
  return T;
}
inline LiveScan scanOf(const Scan& scan, std::size_t n) { return {stampOf(n), scan.points_S}; }

/// Labels by the plain field: what `map --update-every 1` does with the scans of these numbers.
inline AccessibilityField fedDirectly(const std::vector<Scan>& scans, const std::vector<std::size_t>& numbers) {
  AccessibilityField field(test::armTool(), coarseParams());
  for (const std::size_t n : numbers) {
    field.integrateScan(scans[n].points_S, sentPose(poseOf(scans[n], n)));
    field.update();
  }
  return field;
}

inline std::vector<std::size_t> upTo(std::size_t count) {
  std::vector<std::size_t> numbers(count);
  for (std::size_t n = 0; n < count; ++n) numbers[n] = n;
  return numbers;
}

inline void expectSameField(const AccessibilityField& a, const AccessibilityField& b) {
  test::expectSame(a.snapshot(), b.snapshot());
  test::expectSameMap(a.volume(), b.volume());
}

inline std::size_t stepAll(LiveSession& session) {
  std::size_t steps = 0;
  while (session.step()) ++steps;
  return steps;
}

inline void expectAllAccountedFor(const LiveStatus& status) {
  EXPECT_EQ(status.published, status.taken + status.allDropped() + status.waiting);
}

inline std::uint64_t droppedFor(const LiveSession& session, ScanDrop reason) {
  return session.status().dropped[static_cast<std::size_t>(reason)];
}

}  // namespace accessvdb::live_test
