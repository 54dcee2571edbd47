// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lists of tools: what they may hold, what their tools are called, and how far their tables are.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/tool_tables.h"
#include "property/several_tools.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

/// One tool after the other, each to its end; of sets other than yaw also the yaw directions that set the limit.
TEST(SeveralTools, TellHowFarTheirTablesAre) {
  const ScratchFolder folder;
  const FieldParams params = paramsAt(0.05);
  std::vector<std::size_t> expected;
  for (const ToolSpec& tool : threeTools()) {
    const ApproachParams approach = toolParams(tool, params).approach;
    const bool by_rule = tool.max_collisions == 0 && !approach.orientations.isYaw();
    expected.push_back(static_cast<std::size_t>(approach.directionCount() * rollsOf(tool.tool, approach) +
                                                (by_rule ? approach.num_directions : 0)));
  }
  std::vector<std::size_t> ended;
  const TableProgress progress = [&](std::size_t done, std::size_t total) {
    EXPECT_LE(done, total);
    if (done == total) ended.push_back(total);
  };
  AccessibilityField field(threeTools(), params, progress);
  EXPECT_EQ(ended, expected);
  ended.clear();
  field.saveState(folder.path() / "state");
  static_cast<void>(AccessibilityField::loadState(folder.path() / "state", threeTools(), testedBackend(), 0, progress));
  EXPECT_EQ(ended, expected);
}

std::string idOfList(std::vector<ToolSpec> tools, FieldParams params = paramsAt(0.05)) {
  try {
    const AccessibilityField field(std::move(tools), params);
  } catch (const Error& error) {
    return error.id();
  }
  return "";
}

TEST(SeveralTools, BadListsAreRefused) {
  const auto pencil = [](const std::string& name) {
    return spec(ToolGeometry::builtin("builtin:pencil"), OrientationSet::yaw(), 0, name);
  };
  EXPECT_EQ(idOfList({}), "tool.count");
  EXPECT_EQ(idOfList(std::vector<ToolSpec>(33, pencil(""))), "tool.count");
  EXPECT_EQ(idOfList({pencil("a"), pencil("a")}), "tool.name");
  const std::string too_long(33, 'a');
  for (const std::string& odd : std::vector<std::string>{" ", "a b", "a/b", "\xc3\xa4", "a.b", too_long}) {
    EXPECT_EQ(idOfList({pencil("a"), pencil(odd)}), "tool.name") << odd;
  }
  EXPECT_EQ(idOfList({pencil("Aa0_-"), pencil(std::string(32, 'a'))}), "");
  FieldParams paper = FieldParams::paper(0.05);
  paper.backend = BackendKind::Cpu;
  EXPECT_EQ(idOfList({pencil("a"), pencil("b")}, paper), "tool.policy");
  ToolSpec bad = pencil("b");
  bad.max_collisions = -2;
  EXPECT_EQ(idOfList({pencil("a"), bad}), "config.range");
  bad.max_collisions = 0;
  bad.orientations = OrientationSet::sphere(3);
  EXPECT_EQ(idOfList({pencil("a"), bad}), "orientations.count");
}

TEST(SeveralTools, GetNamesOfTheirOwn) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  const auto named =
      namedTools({spec(pencil, {}, 0), spec(pencil, {}, 0), spec(pencil, {}, 0, "pencil_2"),
                  spec(ToolGeometry::fromTriangles(pencil.vertices_T(), pencil.triangles(), "my tool.stl"), {}, 0)});
  EXPECT_EQ(named[0].name, "pencil");
  EXPECT_EQ(named[1].name, "pencil_3");
  EXPECT_EQ(named[2].name, "pencil_2");
  EXPECT_EQ(named[3].name, "my_tool");
}

}  // namespace
}  // namespace accessvdb::test
