// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PCD files written and read by PCL itself.
#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>

#include <fstream>
#include <iterator>

#include "unit/io/cloud_parts.h"

namespace accessvdb::io {
namespace {

using test::readPcd;
using test::TempFolder;

pcl::PointCloud<pcl::PointXYZI> pclCloud(int n) {
  pcl::PointCloud<pcl::PointXYZI> cloud;
  for (int i = 0; i < n; ++i) {
    pcl::PointXYZI p;
    p.x = 0.1F * static_cast<float>(i), p.y = -3.7F / static_cast<float>(i + 1), p.z = 1e4F + static_cast<float>(i),
    p.intensity = 7;
    cloud.push_back(p);
  }
  return cloud;
}

TEST(PcdAgainstPcl, ReadsWhatPclWritesInAllThreeEncodings) {
  const TempFolder folder;
  const auto truth = pclCloud(500);
  pcl::PCDWriter writer;
  const std::string ascii = folder.path() / "a.pcd", binary = folder.path() / "b.pcd", packed = folder.path() / "c.pcd";
  ASSERT_EQ(writer.writeASCII(ascii, truth, 9), 0);  // 9 digits preserve every float
  ASSERT_EQ(writer.writeBinary(binary, truth), 0);
  ASSERT_EQ(writer.writeBinaryCompressed(packed, truth), 0);
  for (const std::string& path : {ascii, binary, packed}) {
    const PointCloud cloud = readPcd(path, {});
    ASSERT_EQ(cloud.points.size(), truth.size()) << path;
    EXPECT_EQ(cloud.truncated_points, 0U);
    for (std::size_t i = 0; i < truth.size(); ++i)
      ASSERT_EQ(cloud.points[i].cast<float>(), truth[i].getVector3fMap()) << path << " " << i;
  }
}

TEST(PcdAgainstPcl, RefusesCompressedDataCutAtEveryByte) {
  const TempFolder folder;
  const std::string path = folder.path() / "c.pcd";
  ASSERT_EQ(pcl::PCDWriter().writeBinaryCompressed(path, pclCloud(20)), 0);
  std::ifstream in(path, std::ios::binary);
  const std::string file((std::istreambuf_iterator<char>(in)), {});
  // PCL pads nothing after the compressed bytes, so each cut takes some of them.
  for (std::size_t size = 0; size < file.size(); ++size)
    for (const bool allow : {false, true})
      EXPECT_THROW((void)readPcd(folder.write("d.pcd", file.substr(0, size)), {allow, false}), InputError) << size;
}

struct PclFile {
  const char* name;
  std::size_t points;
};
std::ostream& operator<<(std::ostream& out, const PclFile& file) { return out << file.name; }
class PcdAgainstPclReal : public ::testing::TestWithParam<PclFile> {};

TEST_P(PcdAgainstPclReal, AgreesWithPclAndWithTheCountOfItsReadme) {
  ACCESSVDB_NEED_DATA(path, GetParam().name);
  const PointCloud cloud = readPcd(path, {});
  EXPECT_EQ(cloud.points.size(), GetParam().points);
  pcl::PointCloud<pcl::PointXYZ> truth;
  ASSERT_EQ(pcl::io::loadPCDFile(path.string(), truth), 0);
  ASSERT_EQ(truth.size(), cloud.points.size());
  for (std::size_t i = 0; i < truth.size(); ++i)
    ASSERT_EQ(cloud.points[i].cast<float>(), truth[i].getVector3fMap()) << i;
}
INSTANTIATE_TEST_SUITE_P(Files, PcdAgainstPclReal,
                         ::testing::Values(PclFile{"pcd_misc/bunny.pcd", 397}, PclFile{"pcd_misc/car6.pcd", 10031},
                                           PclFile{"pcd_misc/colored_cloud.pcd", 1000},
                                           PclFile{"pcd_misc/fraslab_scans_compressed_viewpoint.pcd", 5779},
                                           PclFile{"pcd_misc/lamppost.pcd", 1771},
                                           PclFile{"pcd_misc/milk_color.pcd", 13704},
                                           PclFile{"pcd_misc/rops_cloud.pcd", 32087},
                                           PclFile{"livox_mid360/frame_20240509061326.pcd", 19965},
                                           PclFile{"livox_mid360/fastlio_scans.pcd", 57075},
                                           PclFile{"scans_poses_balm/full107.pcd", 68513}));

}  // namespace
}  // namespace accessvdb::io
