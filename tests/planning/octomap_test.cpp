// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `export --octomap`, read by OctoMap itself, against the voxels of the field that it was made from.
#include <gtest/gtest.h>
#include <octomap/OcTree.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/device_view.h"
#include "accessvdb/saved_state.h"
#include "cli/program_run.h"
#include "sample_scans/walk_generator.h"

namespace accessvdb::cli_test {
namespace {

AccessibilityField walkField(const std::array<double, 3>& origin_W, double voxel_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.tsdf.clear_rays_m = 5;
  params.tsdf.platform_radius_m = 0.4;
  params.origin_W = origin_W;
  params.backend = BackendKind::Cpu;
  params.threads = 2;
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
  const samples::WalkGenerator walk({.frames = 4, .max_range_m = 8});
  const Eigen::Vector3d away_W(origin_W[0], origin_W[1], origin_W[2]);
  for (int frame = 0; frame < walk.frames(); ++frame) {
    const samples::WalkFrame scan = walk.frame(frame);
    Eigen::Isometry3d T_W_S = scan.T_W_S;
    T_W_S.translation() += away_W;
    field.integrateScan(scan.points_S, T_W_S);
  }
  field.update();
  return field;
}

class OctomapExport : public ProgramTest {
 protected:
  ProgramResult run(const AccessibilityField& field, const std::string& name = "map.bt") {
    field.saveState(path("field.avst"));
    return runProgram({"export", "--map", path("field.avst"), "--tool", "builtin:pencil", "--octomap", path(name)});
  }
};

TEST_F(OctomapExport, HasTheCellsThatTheVoxelsSay) {
  constexpr double kVoxel_m = 0.08;
  const AccessibilityField field = walkField({-3.2, 1.6, 0.8}, kVoxel_m);
  const ProgramResult result = run(field);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.err.find("accessvdb: wrote "), 0U) << result.err;  // OctoMap itself says nothing
  EXPECT_EQ(run(field).exit_code, 0);                                 // its own file is written again
  const octomap::OcTree tree(path("map.bt"));
  EXPECT_EQ(tree.getResolution(), kVoxel_m);
  const DeviceView view = field.hostView();
  std::mt19937 engine(6);
  std::uniform_real_distribution<double> uniform(-8, 8);
  std::map<std::string, std::size_t> seen;
  const Eigen::Vector3d middle_W = field.origin_W();
  for (int n = 0; n < 60000; ++n) {
    // Half of them where the points are.
    Eigen::Vector3d p_W = middle_W + Eigen::Vector3d(uniform(engine), uniform(engine), 0.4 * uniform(engine));
    Eigen::Vector3d cell;
    for (int axis = 0; axis < 3; ++axis) cell[axis] = (std::floor(p_W[axis] / kVoxel_m) + 0.5) * kVoxel_m;
    // The voxels that the cell overlaps, by a place well inside of each.
    bool collides = false, all_free = true;
    for (int corner = 0; corner < 8; ++corner) {
      const double at_W[3] = {cell.x() + ((corner & 1) != 0 ? 0.4 : -0.4) * kVoxel_m,
                              cell.y() + ((corner & 2) != 0 ? 0.4 : -0.4) * kVoxel_m,
                              cell.z() + ((corner & 4) != 0 ? 0.4 : -0.4) * kVoxel_m};
      collides = collides || view.collides(at_W);
      all_free = all_free && view.armFree(at_W);
    }
    const std::string expected = collides ? "occupied" : all_free ? "free" : "unknown";
    const octomap::OcTreeNode* node = tree.search(cell.x(), cell.y(), cell.z());
    const std::string found = node == nullptr ? "unknown" : tree.isNodeOccupied(node) ? "occupied" : "free";
    ASSERT_EQ(found, expected) << cell.transpose();
    ++seen[found];
  }
  EXPECT_GT(seen["occupied"], 100U);
  EXPECT_GT(seen["free"], 1000U);
  EXPECT_GT(seen["unknown"], 1000U);
}

TEST_F(OctomapExport, SaysWhatCannotBeWritten) {
  ProgramResult result = run(walkField({431000, 5420000, 0}, 0.1));
  EXPECT_EQ(result.exit_code, 5);
  EXPECT_NE(result.err.find("octomap.range"), std::string::npos) << result.err;
  const AccessibilityField field = walkField({0, 0, 0}, 0.1);
  result = run(field, "map.ot");
  EXPECT_EQ(result.exit_code, 2) << result.err;
  result = runProgram({"export", "--map", path("field.avst"), "--octomap", path("map.bt")});
  EXPECT_EQ(result.exit_code, 2) << result.err;  // the tool is missing
  EXPECT_NE(result.err.find("--tool"), std::string::npos) << result.err;
  result = runProgram({"export", "--map", path("field.avst"), "--tool", "builtin:pencil", "--octomap", path("map.bt"),
                       "--mcap", path("map.mcap")});
  EXPECT_EQ(result.exit_code, 2) << result.err;
  result = runProgram({"export", "--map", path("field.avst"), "--tool", "builtin:pencil", "--octomap", path("map.bt"),
                       "--crs", "EPSG:32632"});
  EXPECT_EQ(result.exit_code, 2) << result.err;
  // A state says itself how it is turned, and how much room was asked for.
  for (const std::vector<std::string>& flags : std::vector<std::vector<std::string>>{{"--margins", "0.1"},
                                                                                     {"--directions", "90"},
                                                                                     {"--orientations", "sphere:30"},
                                                                                     {"--rolls", "3"},
                                                                                     {"--max-collisions", "7"}}) {
    result = runProgram({"export", "--map", path("field.avst"), "--tool", "builtin:pencil", "--octomap", path("map.bt"),
                         flags[0], flags[1]});
    EXPECT_EQ(result.exit_code, 2) << flags[0] << result.err;
    EXPECT_NE(result.err.find("usage.state"), std::string::npos) << result.err;
  }
  EXPECT_EQ(listing(""), std::vector<std::string>{"field.avst"});
}

TEST_F(OctomapExport, OverwritesNoInput) {
  const AccessibilityField field = walkField({0, 0, 0}, 0.1);
  field.saveState(path("field.bt"));
  const ProgramResult result =
      runProgram({"export", "--map", path("field.bt"), "--tool", "builtin:pencil", "--octomap", path("field.bt")});
  EXPECT_EQ(result.exit_code, 2) << result.err;
  EXPECT_EQ(inspectState(path("field.bt")).scans, 4U);
}

}  // namespace
}  // namespace accessvdb::cli_test
