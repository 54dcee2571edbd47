// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PCL before and after: pcl_filter FOLDER OUT.pcd reads PCD scans with their poses (VIEWPOINT, or FOLDER/poses.txt in
/// TUM format), removes stray returns with pcl::StatisticalOutlierRemoval, labels what a pruner can reach, and writes a
/// PCD file with one label per surface point.
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/io/pcd_io.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/pcl.h"
#include "accessvdb/scan_io.h"

namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

/// Removes returns far from their neighbours, measured in standard deviations of all such distances.
Cloud withoutStrays(const Cloud::ConstPtr& cloud) {
  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> filter;
  filter.setInputCloud(cloud);
  filter.setMeanK(8);
  filter.setStddevMulThresh(3.0);
  Cloud kept;
  filter.filter(kept);
  return kept;
}

int run(const std::filesystem::path& folder, const std::filesystem::path& out) {
  const accessvdb::ToolGeometry tool = accessvdb::ToolGeometry::builtin("builtin:pruner");
  accessvdb::AccessibilityField field(tool, {.tsdf = {.voxel_size_m = 0.05}});

  accessvdb::io::ScanInputOptions input = {.scans = folder};
  if (std::filesystem::exists(folder / "poses.txt")) input.poses = folder / "poses.txt";
  auto scans = accessvdb::io::ScanSequence::open(input);
  std::size_t removed = 0;
  for (std::size_t step = 0; step < scans.size(); ++step) {
    const accessvdb::io::ScanRecord scan = scans.read(step);
    auto cloud = std::make_shared<Cloud>();
    for (const Eigen::Vector3f& p_S : scan.points_S) {
      if (!p_S.isZero()) cloud->push_back({p_S.x(), p_S.y(), p_S.z()});  // exactly zero: no return
    }
    const Cloud kept = withoutStrays(cloud);
    removed += cloud->size() - kept.size();
    field.integrateScan(accessvdb::PclScan(kept).points_S(), scan.T_W_S);
  }
  field.update();

  const auto labelled = accessvdb::labelledCloud(field.snapshot());
  if (pcl::io::savePCDFileBinary(out.string(), labelled) != 0) return 7;
  std::printf("%zu strays removed, %zu surface points, %zu accessible -> %s\n", removed, labelled.size(),
              field.snapshot().accessible().size(), out.c_str());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: pcl_filter FOLDER OUT.pcd\n");
    return 2;
  }
  try {
    return run(argv[1], argv[2]);
  } catch (const accessvdb::Error& error) {
    std::fprintf(stderr, "pcl_filter: %s\n", error.what());
    return error.exitCode();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "pcl_filter: %s\n", error.what());
    return static_cast<int>(accessvdb::ErrorCode::Internal);
  }
}
