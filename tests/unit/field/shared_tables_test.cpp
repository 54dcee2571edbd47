// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fields that share their tools' tables: made once, counted once, and the labels of fields with tables of their own.
#include "field/tools/shared_tables.h"

#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "field/field_access.h"
#include "field/tools/tools_of_field.h"
#include "support/determinism_support.h"

namespace accessvdb::internal {
namespace {

FieldParams params() {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.backend = BackendKind::Cpu;
  return params;
}

std::vector<ToolSpec> tools() {
  return namedTools({{test::armTool(), OrientationSet::yaw(), 0, "arm", 0},
                     {ToolGeometry::builtin("builtin:pencil"), OrientationSet::sphere(30), 0, "pencil", 0}});
}

FieldSnapshot labelsOf(AccessibilityField& field) {
  for (const test::Scan& scan : test::wallScans(3, 6, 1500)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  return field.snapshot();
}

/// Oracle: a field that makes its own tables.
TEST(SharedTables, ServeManyFieldsAndAreMadeOnce) {
  const std::vector<ToolSpec> list = tools();
  AccessibilityField alone(list, params());
  const std::uint64_t bytes_alone = alone.memoryUse().point_host_bytes + alone.memoryUse().point_device_bytes;
  const FieldSnapshot expected = labelsOf(alone);

  std::size_t progress_calls = 0;
  SharedTables tables;
  const WindowMargins margins = tables.makeAll(list, params(), [&](std::size_t, std::size_t) { ++progress_calls; });
  EXPECT_GT(margins.returns, 0);
  EXPECT_GE(margins.map, 18) << "an arm of 0.9 m";
  EXPECT_GT(progress_calls, 0u);
  const std::uint64_t bytes = tables.hostBytes() + tables.deviceBytes();
  EXPECT_GT(bytes, 0u);

  auto first = std::make_unique<AccessibilityField>(FieldAccess::make(list, params(), tables));
  AccessibilityField second = FieldAccess::make(list, params(), tables);
  EXPECT_EQ(tables.hostBytes() + tables.deviceBytes(), bytes) << "made again";
  EXPECT_EQ(first->memoryUse().point_host_bytes + first->memoryUse().point_device_bytes + bytes, bytes_alone);
  static_cast<void>(labelsOf(*first));
  first.reset();  // whose tables stay
  const FieldSnapshot found = labelsOf(second);
  ASSERT_EQ(found.points.size(), expected.points.size());
  std::size_t accessible = 0;
  for (std::size_t n = 0; n < found.points.size(); ++n) {
    EXPECT_TRUE(test::sameVerdict(found.points[n], expected.points[n])) << n;
    if (found.points[n].label == PointLabel::Accessible) ++accessible;
  }
  EXPECT_GT(accessible, 0u);
}

TEST(SharedTables, AreTheSameObjectForEachFieldOfABackend) {
  const std::vector<ToolSpec> list = tools();
  const FieldParams resolved = resolvedFor(list.front(), params());
  const auto cpu = kernels::makeCpuBackend(), another = kernels::makeCpuBackend();
  SharedTables tables;
  const auto a = tables.tablesOf(0, list[0].tool, resolved, *cpu, {});
  const auto b = tables.tablesOf(0, list[0].tool, resolved, *another, {});
  EXPECT_EQ(a.get(), b.get());
  EXPECT_NE(a.get(), tables.tablesOf(1, list[1].tool, resolvedFor(list[1], resolved), *cpu, {}).get());
}

/// What fails is not kept: a later call may succeed.
TEST(SharedTables, ThatCannotBeMadeAreTriedAgain) {
  const ToolGeometry pole = test::boxTool({0.1f, 0, 0}, {19, 0.01f, 0.01f});
  FieldParams fine = params();
  fine.tsdf.voxel_size_m = 0.0006;
  fine.tsdf.range_noise_m = 0;
  const auto cpu = kernels::makeCpuBackend();
  SharedTables tables;
  const auto from = [&](const FieldParams& of_field) {
    return tables.tablesOf(0, pole, resolvedFor(onlyTool(pole, of_field).front(), of_field), *cpu, {});
  };
  EXPECT_THROW(static_cast<void>(from(fine)), ResourceLimit);
  EXPECT_EQ(tables.hostBytes(), 0u);
  EXPECT_NE(from(params()), nullptr);
}

}  // namespace
}  // namespace accessvdb::internal
