// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <Eigen/Geometry>
#include <cmath>

#include "accessvdb/scan_io.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::anyContains;
using test::expectError;
using test::TempFolder;

std::string pcd(const std::string& point, const std::string& viewpoint = "") {
  return "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\n" +
         (viewpoint.empty() ? "" : "VIEWPOINT " + viewpoint + "\n") + "POINTS 1\nDATA ascii\n" + point + "\n";
}

/// Scans 8 to 11, whose one point is (number, 0, 0), and twelve HBA poses at (0, index, 0).
void writeNumbered(const TempFolder& folder) {
  for (int i = 8; i <= 11; ++i)
    (void)folder.write("scans/full" + std::to_string(i) + ".pcd", pcd(std::to_string(i) + " 0 0"));
  std::string poses;
  for (int i = 0; i < 12; ++i) poses += "0 " + std::to_string(i) + " 0 1 0 0 0\n";
  (void)folder.write("pose.json", poses);
}

TEST(ScanSequence, PairsScansAndPosesInNaturalOrder) {
  const TempFolder folder;
  writeNumbered(folder);
  (void)folder.write("scans/range_noise.txt", "0.015\n");
  ScanSequence scans = ScanSequence::open({.scans = folder.path() / "scans", .poses = folder.path() / "pose.json"});
  ASSERT_EQ(scans.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    const ScanRecord record = scans.read(i);
    ASSERT_EQ(record.points_S.size(), 1U);
    EXPECT_EQ(record.points_S[0][0], static_cast<float>(8 + i));
    EXPECT_EQ(record.T_W_S.translation()[1], static_cast<double>(8 + i));
    EXPECT_TRUE(record.points_W.empty());
  }
  EXPECT_TRUE(anyContains(scans.notices(), "w x y z"));
  EXPECT_TRUE(anyContains(scans.notices(), scans.matchingRule()));
  EXPECT_EQ(scans.recordedRangeNoise_m(), 0.015);
  EXPECT_EQ(scans.paths().size(), 6U);  // 4 scans, poses, range noise
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < 4; ++i) bytes += std::filesystem::file_size(scans.paths()[i]);
  EXPECT_EQ(scans.inputBytes(), bytes);
  EXPECT_LT(scans.heldBytes(), 1000U);
  EXPECT_THROW((void)scans.read(4), InvalidArgument);

  ScanSequence thinned =
      ScanSequence::open({.scans = folder.path() / "scans", .poses = folder.path() / "pose.json", .every = 3});
  ASSERT_EQ(thinned.size(), 2U);
  EXPECT_EQ(thinned.read(1).points_S.at(0)[0], 11.0F);
  EXPECT_EQ(thinned.read(1).T_W_S.translation()[1], 11.0);
  EXPECT_EQ(thinned.path(1), thinned.read(1).path);
  EXPECT_FALSE(thinned.stamp_s(1)) << "HBA poses have no stamps";
  EXPECT_THROW((void)thinned.path(2), InvalidArgument);
  EXPECT_THROW((void)thinned.stamp_s(2), InvalidArgument);
}

TEST(ScanSequence, FindsASubfolderAndPrefersVelodyne) {
  const TempFolder folder;
  writeNumbered(folder);
  ScanSequence scans = ScanSequence::open({.scans = folder.path(), .poses = folder.path() / "pose.json"});
  EXPECT_EQ(scans.size(), 4U);
  EXPECT_TRUE(anyContains(scans.notices(), "sub-folder scans"));
  (void)folder.write("other/0.pcd", pcd("1 1 1"));
  expectError([&] { (void)ScanSequence::open({.scans = folder.path(), .poses = folder.path() / "pose.json"}); },
              ErrorCode::Input, "input.no_scans", {"other", "scans"});
  std::string bin;
  for (int i = 0; i < 4; ++i) test::put(bin, 2.0F);
  (void)folder.write("velodyne/0.bin", bin);
  EXPECT_EQ(ScanSequence::open({.scans = folder.path(), .poses = folder.path() / "pose.json"}).size(), 1U);
}

TEST(ScanSequence, UsesTheKindWithTheMostFilesAndSaysSo) {
  const TempFolder folder;
  writeNumbered(folder);
  (void)folder.write("scans/mesh.ply", "ply\n");
  const ScanSequence scans =
      ScanSequence::open({.scans = folder.path() / "scans", .poses = folder.path() / "pose.json"});
  EXPECT_EQ(scans.size(), 4U);
  EXPECT_TRUE(anyContains(scans.notices(), "1 .ply files in the folder are not used"));
}

TEST(ScanSequence, TakesPosesFromViewpoints) {
  const TempFolder folder;
  (void)folder.write("v/a.pcd", pcd("1 0 0", "1 2 3 0.70710678 0 0 0.70710678"));
  (void)folder.write("v/b.pcd", pcd("1 0 0"));
  ScanSequence scans = ScanSequence::open({.scans = folder.path() / "v"});
  ASSERT_EQ(scans.size(), 2U);
  const ScanRecord record = scans.read(0);
  // 1e-7: 8 digits of the quaternion.
  EXPECT_LT((record.T_W_S * record.points_S[0].cast<double>() - Eigen::Vector3d(1, 3, 3)).norm(), 1e-7);
  EXPECT_TRUE(scans.read(1).T_W_S.matrix().isIdentity(0));
  EXPECT_TRUE(anyContains(scans.notices(), "1 of 2 scans have no VIEWPOINT"));

  (void)folder.write("i/a.pcd", pcd("1 0 0"));
  (void)folder.write("i/b.pcd", pcd("1 0 0", "0 0 0 1 0 0 0"));
  expectError([&] { (void)ScanSequence::open({.scans = folder.path() / "i"}); }, ErrorCode::Unusable, "poses.none",
              {"ScanInputOptions::poses"});
  EXPECT_EQ(ScanSequence::open({.scans = folder.path() / "i", .pose_format = PoseFormat::Viewpoint}).size(), 2U);
  EXPECT_EQ(ScanSequence::open({.scans = folder.path() / "i/a.pcd"}).size(), 1U);
  (void)folder.write("z/a.pcd", pcd("1 0 0", "0 0 0 0 0 0 0"));
  expectError([&] { (void)ScanSequence::open({.scans = folder.path() / "z"}); }, ErrorCode::Unusable,
              "poses.bad_quaternion", {"a.pcd"});
}

TEST(ScanSequence, HandsOutARayCloudInSteps) {
  const TempFolder folder;
  std::string file =
      "ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty double x\nproperty double y\n"
      "property double z\nproperty double time\nproperty float nx\nproperty float ny\nproperty float nz\nend_header\n";
  for (int i = 0; i < 5; ++i) {
    test::put(file, 500000.0 + i);
    test::put(file, 5600000.125);
    test::put(file, 300.0);
    test::put(file, 10.0 + i);
    for (const float n : {-2.0F, 0.0F, static_cast<float>(i)}) test::put(file, n);
  }
  const auto path = folder.write("rays.ply", file);
  ScanSequence rays = ScanSequence::open({.scans = path, .rays_per_step = 2});
  ASSERT_EQ(rays.size(), 3U);
  EXPECT_NE(rays.matchingRule().find("ray cloud"), std::string::npos);
  int at = 0;
  for (std::size_t step = 0; step < 3; ++step) {
    const ScanRecord record = rays.read(step);
    EXPECT_TRUE(record.points_S.empty());
    ASSERT_EQ(record.points_W.size(), record.origins_W.size());
    EXPECT_EQ(record.stamp_s, 10.0 + at);
    for (std::size_t i = 0; i < record.points_W.size(); ++i, ++at) {
      EXPECT_EQ(record.points_W[i], Eigen::Vector3d(500000.0 + at, 5600000.125, 300));
      EXPECT_EQ(record.origins_W[i], Eigen::Vector3d(499998.0 + at, 5600000.125, 300.0 + at));
    }
  }
  EXPECT_EQ(at, 5);
  ScanSequence thinned = ScanSequence::open({.scans = path, .every = 2, .rays_per_step = 2});
  ASSERT_EQ(thinned.size(), 2U);
  EXPECT_EQ(thinned.read(1).points_W.size(), 1U);
  EXPECT_EQ(thinned.stamp_s(1), 14.0);
  EXPECT_EQ(thinned.path(1), path.string());
  // Backwards, and again: the same rays.
  const std::vector<Eigen::Vector3d> last = rays.read(2).points_W, first = rays.read(0).points_W;
  EXPECT_EQ(last.at(0), Eigen::Vector3d(500004, 5600000.125, 300));
  EXPECT_EQ(first.at(0), Eigen::Vector3d(500000, 5600000.125, 300));

  const auto normals =
      folder.write("n.ply",
                   "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty "
                   "float z\nproperty float nx\nproperty float ny\nproperty float nz\nend_header\n1 2 3 0 0.6 0.8\n");
  expectError([&] { (void)ScanSequence::open({.scans = normals}); }, ErrorCode::Unusable, "input.no_rays",
              {"surface normals"});
  EXPECT_EQ(ScanSequence::open({.scans = normals, .sensor_at_W = Eigen::Vector3d(0, 0, 0)}).size(), 1U);
}

TEST(ScanSequence, GivesOneCloudOneSensorPosition) {
  const TempFolder folder;
  const auto path = folder.write("a.xyz", "470000.0001 3810222.123 1\n470001.5 3810223 2 7 8\n# end\n3 4 5\n");
  ScanSequence cloud =
      ScanSequence::open({.scans = path, .sensor_at_W = Eigen::Vector3d(470000, 3810000, 10), .rays_per_step = 2});
  ASSERT_EQ(cloud.size(), 2U);
  const ScanRecord record = cloud.read(0);
  EXPECT_EQ(record.points_W.at(0), Eigen::Vector3d(470000.0001, 3810222.123, 1));
  ASSERT_EQ(record.origins_W.size(), 1U);
  EXPECT_EQ(record.origins_W[0], Eigen::Vector3d(470000, 3810000, 10));
  EXPECT_EQ(cloud.read(1).points_W.size(), 1U);
  EXPECT_FALSE(cloud.stamp_s(1));
  (void)folder.write("a.xyz", "1 2 3\n");
  expectError([&] { (void)cloud.read(0); }, ErrorCode::Input, "input.changed", {"a.xyz"});
  for (const char* bad : {"1 2\n3 4 5\n", "a b c\n", "x\n"})
    expectError(
        [&] {
          (void)ScanSequence::open({.scans = folder.write("b.xyz", bad), .sensor_at_W = Eigen::Vector3d::Zero()});
        },
        ErrorCode::Input, "input.malformed", {"line 1"});
  const auto cut = folder.write("c.xyz", "1 2 3\n4 5");
  expectError([&] { (void)ScanSequence::open({.scans = cut, .sensor_at_W = Eigen::Vector3d::Zero()}); },
              ErrorCode::Input, "input.truncated");
  ScanSequence kept =
      ScanSequence::open({.scans = cut, .sensor_at_W = Eigen::Vector3d::Zero(), .allow_truncated = true});
  EXPECT_EQ(kept.read(0).points_W.size(), 1U);
  EXPECT_EQ(kept.read(0).truncated_points, 1U);
}

TEST(ScanSequence, RefusesOptionsThatContradictEachOther) {
  const TempFolder folder;
  writeNumbered(folder);
  const auto scans = folder.path() / "scans";
  const auto poses = folder.path() / "pose.json";
  const auto refuse = [](const ScanInputOptions& options, ErrorCode code, const std::string& id,
                         const std::vector<std::string>& words = {}) {
    expectError([&] { (void)ScanSequence::open(options); }, code, id, words);
  };
  refuse({.scans = scans, .poses = poses, .every = 0}, ErrorCode::Usage, "usage.every");
  refuse({.scans = scans, .poses = poses, .rays_per_step = 0}, ErrorCode::Usage, "usage.rays_per_step");
  refuse({.scans = scans, .poses = poses, .sensor_at_W = Eigen::Vector3d::Zero()}, ErrorCode::Usage, "usage.sensor_at");
  refuse({.scans = scans, .sensor_at_W = Eigen::Vector3d::Zero()}, ErrorCode::Usage, "usage.sensor_at", {"4 scans"});
  refuse({.scans = scans / "full8.pcd", .sensor_at_W = Eigen::Vector3d(0, NAN, 0)}, ErrorCode::Usage,
         "usage.sensor_at");
  refuse({.scans = scans, .calib = poses}, ErrorCode::Usage, "usage.calib");
  refuse({.scans = scans, .poses = poses, .pose_format = PoseFormat::Viewpoint}, ErrorCode::Usage, "usage.pose_format");
}

TEST(ScanSequence, RefusesInputsWithoutScansOrPoses) {
  const TempFolder folder;
  const auto refuse = [](const std::filesystem::path& scans, ErrorCode code, const std::string& id,
                         const std::vector<std::string>& words = {}) {
    expectError([&] { (void)ScanSequence::open({.scans = scans}); }, code, id, words);
  };
  refuse(folder.path() / "none", ErrorCode::Input, "input.missing");
  refuse(folder.path(), ErrorCode::Input, "input.no_scans");
  refuse(folder.write("a.txt", "1 2 3"), ErrorCode::Input, "input.unsupported", {".pcd"});
  refuse(folder.write("b.xyz", "1 2 3\n"), ErrorCode::Unusable, "poses.none", {"sensor_at_W"});
  refuse(folder.write("p/0.ply", "x"), ErrorCode::Input, "input.malformed");
  (void)folder.write("p/1.ply", "x");
  refuse(folder.path() / "p", ErrorCode::Unusable, "poses.none");
  (void)folder.write("f/0.pcd", pcd("1 2 3"));
  (void)folder.write("f/range_noise.txt", "-1\n");
  refuse(folder.path() / "f", ErrorCode::Input, "input.malformed", {"range noise"});
}

TEST(ScanSequence, CountsTruncatedPointsAndPassesBadValuesOn) {
  const TempFolder folder;
  std::string bin;
  for (const float value : {NAN, 0.0F, 1e30F, 1.0F, 5.0F}) test::put(bin, value);
  const auto path = folder.write("0.bin", bin);
  ScanSequence strict = ScanSequence::open({.scans = path});
  expectError([&] { (void)strict.read(0); }, ErrorCode::Input, "input.truncated", {"0.bin", "20 bytes"});
  ScanSequence scans = ScanSequence::open({.scans = path, .allow_truncated = true});
  const ScanRecord record = scans.read(0);
  ASSERT_EQ(record.points_S.size(), 1U);
  EXPECT_EQ(record.truncated_points, 1U);
  EXPECT_TRUE(std::isnan(record.points_S[0][0]));
  EXPECT_EQ(record.points_S[0][2], 1e30F);
  const auto huge = folder.write("h/0.pcd", pcd("1e300 -1e300 1"));
  EXPECT_TRUE(std::isinf(ScanSequence::open({.scans = huge}).read(0).points_S.at(0)[1]));
}

TEST(ScanSequence, TimesBesideKittiScansStampThePoses) {
  const TempFolder folder;
  std::string bin, poses;
  for (int i = 0; i < 4; ++i) test::put(bin, 2.0F);
  for (int i = 0; i < 3; ++i) {
    (void)folder.write("velodyne/00000" + std::to_string(i) + ".bin", bin);
    poses += "1 0 0 " + std::to_string(i) + " 0 1 0 0 0 0 1 0\n";
  }
  (void)folder.write("times.txt", "0.0\n0.1\n0.2\n");
  ScanSequence scans =
      ScanSequence::open({.scans = folder.path() / "velodyne", .poses = folder.write("poses.txt", poses)});
  EXPECT_EQ(scans.read(2).stamp_s, 0.2);
  EXPECT_EQ(scans.stamp_s(0), 0.0) << "known, and 0";
  EXPECT_EQ(scans.read(2).T_W_S.translation()[0], 2);
  EXPECT_TRUE(anyContains(scans.paths(), "times.txt"));
  // Without those poses' times: a TUM file on the same clock.
  ScanSequence tum = ScanSequence::open({.scans = folder.path() / "velodyne",
                                         .poses = folder.write("tum.txt", "0.05 1 0 0 0 0 0 1\n0.15 3 0 0 0 0 0 1\n")});
  ASSERT_EQ(tum.size(), 1U);
  EXPECT_NEAR(tum.read(0).T_W_S.translation()[0], 2, 1e-12);
}

TEST(ScanSequence, RealBalmScansWithEachOfTheirPoseFiles) {
  ACCESSVDB_NEED_DATA(folder, "scans_poses_balm");
  std::vector<Eigen::Isometry3d> truth;
  for (const char* name : {"alidarPose.csv", "poses_tum.txt", "poses_kitti.txt"}) {
    ScanSequence scans = ScanSequence::open({.scans = folder, .poses = folder / name});
    ASSERT_EQ(scans.size(), 12U) << name;
    for (const std::size_t i : {std::size_t{0}, std::size_t{11}}) {
      const ScanRecord record = scans.read(i);
      EXPECT_EQ(std::filesystem::path(record.path).filename(), i == 0 ? "full96.pcd" : "full107.pcd");
      EXPECT_EQ(record.points_S.size(), i == 0 ? 76802U : 68513U);
      if (truth.size() < 2) {
        truth.push_back(record.T_W_S);
        continue;
      }
      // 6 decimals of the csv: see PoseFiles.ThreeSpellingsOfTheSameRealPosesAgree.
      EXPECT_LT((record.T_W_S.matrix() - truth[i == 0 ? 0 : 1].matrix()).cwiseAbs().maxCoeff(), 2e-6) << name;
    }
  }
}

TEST(ScanSequence, RealKittiScansWithCalibration) {
  ACCESSVDB_NEED_DATA(folder, "kitti_00");
  ScanSequence scans =
      ScanSequence::open({.scans = folder, .poses = folder / "poses.txt", .calib = folder / "calib.txt"});
  ASSERT_EQ(scans.size(), 6U);
  EXPECT_TRUE(anyContains(scans.notices(), "sub-folder velodyne"));
  constexpr std::size_t kPoints[] = {124668, 124605, 124478, 124167, 123969, 123924};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(scans.read(i).points_S.size(), kPoints[i]);
  EXPECT_NEAR(scans.read(5).T_W_S.translation()[0], 5 * 0.86, 0.1);  // README: 0.86 m per frame along +x
  const ScanSequence without = ScanSequence::open({.scans = folder, .poses = folder / "poses.txt"});
  EXPECT_TRUE(anyContains(without.notices(), "ScanInputOptions::calib"));
}

TEST(ScanSequence, RealCloudsWithOneSensor) {
  ACCESSVDB_NEED_DATA(folder, "trees");
  const Eigen::Vector3d sensor(470640, 3810230, 2300);
  ScanSequence utm = ScanSequence::open({.scans = folder / "MLS_Clip.las", .sensor_at_W = sensor});
  EXPECT_EQ(utm.size(), 16U);  // 301477 points in steps of 20000
  EXPECT_EQ(utm.read(15).points_W.size(), 1477U);
  EXPECT_NEAR(utm.read(0).points_W[0][1], 3810235.2, 13.0);  // inside the box of the README
  EXPECT_EQ(ScanSequence::open({.scans = folder / "tree33.xyz", .sensor_at_W = Eigen::Vector3d::Zero()}).size(), 1U);
}

}  // namespace
}  // namespace accessvdb::io
