// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The predicted size of a tool's tables against the memory of a field without scans.
#include <gtest/gtest.h>

#include <string>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/tool_tables.h"
#include "support/box_tool.h"

namespace accessvdb {
namespace {

FieldParams paramsOf(double voxel_size_m, int directions = 180) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.approach.num_directions = directions;
  params.backend = BackendKind::Cpu;
  return params;
}

/// Bytes of a field without scans.
double heldBytes(const ToolGeometry& tool, const FieldParams& params) {
  const MemoryUse use = AccessibilityField(tool, params).memoryUse();
  return static_cast<double>(use.point_host_bytes + use.point_device_bytes);
}

void expectHeld(const ToolGeometry& tool, const FieldParams& params) {
  const ToolTableBytes said = toolTableBytes(onlyTool(tool, params), params);
  // Corridor and directions are tables too, of a hundred kilobytes.
  EXPECT_NEAR(static_cast<double>(said.held), heldBytes(tool, params), 0.1 * static_cast<double>(said.held) + 1e5);
  EXPECT_GE(said.making, said.held);
}

TEST(ToolTableBytes, AreWhatAFieldHolds) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  const ToolGeometry tall = test::boxTool({0.1f, -0.2f, -0.4f}, {0.5f, 0.3f, 0.6f});
  expectHeld(pruner, paramsOf(0.02));
  expectHeld(pruner, paramsOf(0.01));
  expectHeld(pruner, paramsOf(0.01, 4));    // fewer than are sampled
  expectHeld(pruner, paramsOf(0.004, 48));  // the table of directions by offset fits
  expectHeld(pruner, paramsOf(0.003, 24));  // and here it does not
  // Neither here: kept, it would take 4 bytes per entry, but 32 while it is made.
  expectHeld(test::boxTool({2.9f, -0.01f, -1.5f}, {3.0f, 0.01f, 1.5f}), paramsOf(0.005, 24));
  expectHeld(tall, paramsOf(0.01, 90));  // columns of more than 64 voxels
  expectHeld(ToolGeometry::builtin("builtin:pencil"), paramsOf(0.002));
  FieldParams oriented = paramsOf(0.01);
  oriented.approach.orientations = OrientationSet::sphere(12.5);
  expectHeld(pruner, oriented);  // six rolls by rule
  oriented.approach.rolls = 3;
  expectHeld(tall, oriented);
  oriented.approach.rolls = 1;
  expectHeld(pruner, oriented);
  oriented.approach.rolls = 0;
  oriented.approach.num_directions = 36;
  oriented.approach.orientations = OrientationSet::pitch(-30, 30, 10);
  expectHeld(pruner, oriented);
  FieldParams paper = paramsOf(0.01);
  paper.update.policy = UpdatePolicy::Paper;
  expectHeld(pruner, paper);
  FieldParams samples = paramsOf(0.02);
  samples.scoring.form = ToolForm::SurfaceSamples;
  samples.scoring.surface_samples = 2000;
  expectHeld(pruner, samples);
}

/// They grow with the square of the voxels per edge, like the ground below the tool.
TEST(ToolTableBytes, GrowWithTheVoxelsOfTheTool) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  FieldParams coarse = paramsOf(0.006), fine = paramsOf(0.003);
  coarse.update.policy = fine.update.policy = UpdatePolicy::Paper;
  coarse.scoring.max_collisions = fine.scoring.max_collisions = 5;
  const double ratio = static_cast<double>(toolTableBytes(onlyTool(pruner, fine), fine).held) /
                       static_cast<double>(toolTableBytes(onlyTool(pruner, coarse), coarse).held);
  EXPECT_GT(ratio, 4);  // twice that if a column needs two words
  EXPECT_LT(ratio, 8.5);
  // On a GPU the second copy is not the host's.
  fine.backend = BackendKind::Cuda;
  EXPECT_NEAR(static_cast<double>(toolTableBytes(onlyTool(pruner, fine), fine).held) * 2,
              ratio * static_cast<double>(toolTableBytes(onlyTool(pruner, coarse), coarse).held), 16);
}

TEST(ToolTableBytes, RefuseWhatAFieldRefuses) {
  const ToolGeometry table = test::boxTool({0.1f, -4, -0.1f}, {19, 4, 0.1f});
  const auto idOf = [&](double voxel_size_m) -> std::string {
    FieldParams params = paramsOf(voxel_size_m);
    params.tsdf.range_noise_m = 0;  // otherwise the band alone would have too many voxels
    try {
      static_cast<void>(toolTableBytes(onlyTool(table, params), params));
    } catch (const Error& error) {
      return error.id();
    }
    return "none";
  };
  EXPECT_EQ(idOf(0.0006), "tool.span");
  EXPECT_EQ(idOf(0.002), "tool.columns");
  EXPECT_EQ(idOf(0.05), "none");
}

}  // namespace
}  // namespace accessvdb
