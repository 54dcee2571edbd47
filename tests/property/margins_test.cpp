// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How much room a tool has: a field with margins against one field for each margin, and its files.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/tool_spec.h"
#include "property/several_tools.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

FieldParams marginParams() {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.04;
  params.tsdf.range_noise_m = 0.01;
  params.approach.num_directions = 36;
  return params;
}

/// The largest margin with a bit, of the tool that stands for the point, from the bits alone.
float marginByHand(const SurfacePoint& point, const std::vector<ToolSpec>& tools) {
  float most_m = -1;
  for (std::size_t k = 0; k < tools.size(); ++k) {
    const bool same = tools[k].tool.vertices_T().size() == tools[point.tool].tool.vertices_T().size();
    if (same && (point.tools >> k & 1) != 0) most_m = std::max(most_m, static_cast<float>(tools[k].tool.margin_m()));
  }
  return most_m;
}

TEST(Margins, AreThoseOfAFieldForEach) {
  const FieldParams params = marginParams();
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner"), pencil = ToolGeometry::builtin("builtin:pencil");
  const std::vector<ToolSpec> tools = withMargins({{pruner}, {pencil}}, {0.08, 0, 0.04, 0.12, 0.08});
  ASSERT_EQ(tools.size(), 8U);
  EXPECT_EQ(tools[1].name, "pruner_40mm");
  EXPECT_EQ(tools[7].name, "pencil_120mm");
  AccessibilityField field(tools, params);
  std::vector<AccessibilityField> alone;
  for (const ToolSpec& tool : tools) alone.emplace_back(tool.tool, params);
  const std::vector<Scan> scans = wallScans(5, 9, 1500);
  for (const Scan& scan : scans) {
    field.integrateScan(scan.points_S, scan.T_W_S);
    field.update();
    for (AccessibilityField& other : alone) {
      other.integrateScan(scan.points_S, scan.T_W_S);
      other.update();
    }
  }
  const FieldSnapshot found = field.snapshot();
  std::vector<FieldSnapshot> each;
  for (const AccessibilityField& other : alone) each.push_back(other.snapshot());
  std::map<float, int> margins;
  for (std::size_t n = 0; n < found.points.size(); ++n) {
    const SurfacePoint& point = found.points[n];
    for (std::size_t k = 0; k < tools.size(); ++k)
      ASSERT_EQ((point.tools >> k & 1) != 0, each[k].points[n].label == PointLabel::Accessible) << n << " " << k;
    for (std::size_t k = 1; k < tools.size(); ++k) {  // what a larger tool reaches, a smaller one does
      if (k != 4 && (point.tools >> k & 1) != 0) {
        ASSERT_NE(point.tools >> (k - 1) & 1, 0U) << n << " " << k;
      }
    }
    ASSERT_TRUE(point.tool == 0 || point.tool == 4) << "a grown tool stands for point " << n;
    ASSERT_EQ(point.margin_m, marginByHand(point, tools)) << n;
    ++margins[point.margin_m];
  }
  EXPECT_GE(margins.size(), 4U) << "of -1, 0, 0.04, 0.08, 0.12";
  for (const auto& [margin_m, points] : margins) EXPECT_GT(points, 5) << margin_m;
}

/// The mesh is the same, and so is what a margin of 0 says.
TEST(Margins, OfZeroAreNoTool) {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  const std::vector<ToolSpec> tools = withMargins({{pruner}}, {0});
  ASSERT_EQ(tools.size(), 1U);
  EXPECT_EQ(toolListSha256(tools), toolListSha256(onlyTool(pruner, {})));
  EXPECT_EQ(describeTools(tools, {}), FieldParams().describe());
}

TEST(Margins, ComeBackFromFiles) {
  const ScratchFolder scratch;
  AccessibilityField field(withMargins({{ToolGeometry::builtin("builtin:pruner")}}, {0.04, 0.1}), marginParams());
  for (const Scan& scan : wallScans(4, 9, 1500)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  field.write(scratch / "out");
  const FieldSnapshot written = field.snapshot(), read = io::readPointsPly(scratch / "out" / "points.ply");
  ASSERT_EQ(read.points.size(), written.points.size());
  std::size_t with = 0;
  for (std::size_t n = 0; n < read.points.size(); ++n) {
    ASSERT_EQ(read.points[n].margin_m, written.points[n].margin_m);
    with += read.points[n].margin_m > 0 ? 1 : 0;
    ASSERT_EQ(read.points[n].free_arc_deg > 0, read.points[n].label == PointLabel::Accessible) << n;
  }
  ASSERT_GT(with, 20U);
  // A margin that no tool reaches the point with is not taken for one: the last column but two of the last point.
  std::fstream file(scratch / "out" / "points.ply", std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(-12, std::ios::end);
  const float wrong_m = written.points.back().margin_m == 0.04f ? 0.1f : 0.04f;
  file.write(reinterpret_cast<const char*>(&wrong_m), sizeof wrong_m);
  file.close();
  try {
    (void)io::readPointsPly(scratch / "out" / "points.ply");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_EQ(error.id(), "input.contradictory");
  }
}

TEST(Margins, AreRefusedInWords) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  const auto refused = [&](std::vector<double> margins_m) -> std::string {
    try {
      (void)withMargins({{pencil}}, std::move(margins_m));
      return "taken";
    } catch (const Error& error) {
      return error.id();
    }
  };
  EXPECT_EQ(refused({0.02, -0.01}), "tool.margin");
  EXPECT_EQ(refused({std::nan("")}), "tool.margin");
  EXPECT_EQ(refused({0.02, 0.0200001}), "tool.margin") << "no two names";
  EXPECT_EQ(refused({0.3}), "tool.margin") << "larger than the tool";
  std::vector<double> many;
  for (int n = 1; n <= 64; ++n) many.push_back(0.001 * n);
  EXPECT_EQ(refused(many), "tool.count");
}

}  // namespace
}  // namespace accessvdb::test
