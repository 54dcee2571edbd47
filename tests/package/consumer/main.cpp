// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A third-party program: maps a wall, asks for labels and for the OpenVDB grid, catches an error.
#include <accessvdb/accessibility_field.h>
#include <accessvdb/config.h>
#include <accessvdb/error.h>
#include <accessvdb/field_io.h>
#include <accessvdb/tsdf_volume.h>

#include <cstdio>
#include <filesystem>
#include <vector>

int main(int argc, char** argv) {
  const auto tool = accessvdb::ToolGeometry::builtin("builtin:pencil");
  accessvdb::AccessibilityField field(tool, {.tsdf = {.voxel_size_m = 0.05}});
  for (int scan = 0; scan < 4; ++scan) {  // a wall at x = 2, seen while the sensor moves sideways
    Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.translation() = Eigen::Vector3d(0, 0.05 * scan, 0);
    std::vector<Eigen::Vector3f> points_S;
    for (float y = -1; y <= 1; y += 0.02f) {
      for (float z = -1; z <= 1; z += 0.02f) points_S.emplace_back(2.0f, y, z);
    }
    field.integrateScan(points_S, T_W_S);
  }
  field.update();
  const auto accessible = field.snapshot().accessible();
  const openvdb::FloatGrid::ConstPtr distance = field.volume().distance();
  if (accessible.empty() || distance->activeVoxelCount() == 0) return 1;

  bool caught = false;  // by its type, across the library's boundary
  try {
    accessvdb::AccessibilityField bad(tool, {.tsdf = {.voxel_size_m = 0}});
  } catch (const accessvdb::InvalidArgument& error) {
    caught = error.code() == accessvdb::ErrorCode::Usage;
  }
  if (!caught) return 1;

  if (argc > 1) {
    field.write(argv[1]);
    const auto summary = accessvdb::io::summarizeVdb(std::filesystem::path(argv[1]) / "field.vdb");
    if (summary.grids.size() < 9) return 1;
  }
  std::printf("AccessVDB %s: %zu points accessible, %llu voxels observed\n", ACCESSVDB_VERSION, accessible.size(),
              static_cast<unsigned long long>(distance->activeVoxelCount()));
}
