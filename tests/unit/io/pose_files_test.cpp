// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/pose_files.h"

#include <cmath>
#include <numbers>
#include <random>

#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::anyContains;
using test::expectError;
using test::TempFolder;

PoseFile read(const std::filesystem::path& path, PoseFormat format = PoseFormat::Auto, bool sort = false) {
  return readPoseFile(path, format, {}, sort);
}

/// A turn by 90 degrees about z, then a step: (1,0,0) in the sensor frame is (0,1,0) + (1,2,3) in the world.
void expectQuarterTurn(const Eigen::Isometry3d& T_W_S) {
  // 1e-8: the text of the quaternions has 9 digits.
  EXPECT_LT((T_W_S * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(), 1e-8);
  EXPECT_LT((T_W_S * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(1, 2, 4)).norm(), 1e-8);
}

TEST(PoseFiles, RecognisesEachFormatAndItsOrder) {
  const TempFolder folder;
  const PoseFile tum = read(folder.write("a.txt", "# comment\n10.5 1 2 3 0 0 0.707106781 0.707106781\n"));
  EXPECT_EQ(tum.format, PoseFormat::Tum);
  EXPECT_TRUE(tum.stamped);
  EXPECT_EQ(tum.poses.at(0).stamp_s, 10.5);
  EXPECT_EQ(tum.poses.at(0).line, 2U);
  EXPECT_TRUE(anyContains(tum.notices, "x y z w"));
  expectQuarterTurn(tum.poses.at(0).T_W_S);

  const PoseFile hba = read(folder.write("pose.json", "1 2 3 0.707106781 0 0 0.707106781\n"));
  EXPECT_EQ(hba.format, PoseFormat::Hba);
  EXPECT_FALSE(hba.stamped);
  EXPECT_TRUE(anyContains(hba.notices, "w x y z"));
  expectQuarterTurn(hba.poses.at(0).T_W_S);

  const PoseFile kitti = read(folder.write("poses.txt", "0 -1 0 1 1 0 0 2 0 0 1 3\n"));
  EXPECT_EQ(kitti.format, PoseFormat::Kitti);
  expectQuarterTurn(kitti.poses.at(0).T_W_S);
  EXPECT_TRUE(anyContains(kitti.notices, "poses of the scanner itself"));

  const PoseFile balm = read(folder.write("alidarPose.csv", "0,-1,0,1,\n1,0,0,2,\n0,0,1,3,\n0,0,0,77.5,\n"));
  EXPECT_EQ(balm.format, PoseFormat::Balm);
  EXPECT_TRUE(balm.stamped);
  EXPECT_EQ(balm.poses.at(0).stamp_s, 77.5);
  expectQuarterTurn(balm.poses.at(0).T_W_S);
  EXPECT_FALSE(read(folder.write("m.txt", "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n")).stamped);
}

TEST(PoseFiles, TurnsCameraPosesIntoScannerPoses) {
  const TempFolder folder;
  // Camera: x right, y down, z ahead; scanner: x ahead, y left, z up; the camera is 0.5 m ahead of the scanner.
  const auto calib = folder.write("calib.txt", "P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: 0 -1 0 0 0 0 -1 0 1 0 0 -0.5\n");
  // The camera turns left by 90 degrees (about its -y) on the spot.
  const auto poses = folder.write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n0 0 -1 0 0 1 0 0 1 0 0 0\n");
  const PoseFile file = readPoseFile(poses, PoseFormat::Auto, calib, false);
  EXPECT_TRUE(file.poses.at(0).T_W_S.isApprox(Eigen::Isometry3d::Identity(), 1e-12));
  // The scanner is then 0.5 m to the right (-y) of the camera, and looks left (+y).
  EXPECT_LT((file.poses.at(1).T_W_S.translation() - Eigen::Vector3d(0.5, -0.5, 0)).norm(), 1e-12);
  EXPECT_LT((file.poses.at(1).T_W_S.linear() * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  expectError([&] { (void)readPoseFile(poses, PoseFormat::Auto, folder.write("c.txt", "P0: 1\n"), false); },
              ErrorCode::Input, "input.malformed", {"Tr"});
  expectError([&] { (void)readPoseFile(poses, PoseFormat::Auto, folder.write("c.txt", "Tr: 1 2\n"), false); },
              ErrorCode::Input, "input.malformed", {"line 1"});
  expectError(
      [&] {
        (void)readPoseFile(poses, PoseFormat::Auto, folder.write("c.txt", "Tr: 1 0 0 0 0 1 0 0 0 0 2 0\n"), false);
      },
      ErrorCode::Unusable, "poses.bad_rotation");
  expectError([&] { (void)readPoseFile(folder.write("t.txt", "1 0 0 0 0 0 0 1\n"), PoseFormat::Auto, calib, false); },
              ErrorCode::Usage, "usage.calib");
}

std::string tum(const std::vector<std::string>& rows) {
  std::string text;
  for (const auto& row : rows) text += row + "\n";
  return text;
}

TEST(PoseFiles, RefusesBadPosesNamingTheLine) {
  const TempFolder folder;
  const auto refuse = [&](const std::string& text, ErrorCode code, const std::string& id,
                          const std::vector<std::string>& words = {}) {
    expectError([&] { (void)read(folder.write("a.txt", text)); }, code, id, words);
  };
  const std::string good = "1 0 0 0 0 0 0 1";
  refuse("", ErrorCode::Input, "input.empty");
  refuse("# nothing\n\n", ErrorCode::Unusable, "poses.none");
  refuse("{\"poses\": []}\n", ErrorCode::Input, "input.malformed", {"line 1"});
  refuse("1 2 3 4 5\n", ErrorCode::Input, "input.malformed", {"5 numbers"});
  refuse("1 2 3 4\n1 2 3 4\n", ErrorCode::Input, "input.malformed");
  refuse(tum({good, "2 0 0 0 0 0 0"}), ErrorCode::Input, "input.malformed", {"line 2", "7 numbers"});
  refuse(tum({good, "2 nan 0 0 0 0 0 1"}), ErrorCode::Unusable, "poses.non_finite", {"line 2"});
  refuse(tum({good, "2 0 0 0 0 0 0 inf"}), ErrorCode::Unusable, "poses.non_finite", {"line 2"});
  refuse(tum({good, "nan 0 0 0 0 0 0 1"}), ErrorCode::Unusable, "poses.non_finite", {"line 2"});
  refuse(tum({good, "2 0 0 0 0 0 0 0"}), ErrorCode::Unusable, "poses.bad_quaternion", {"line 2"});
  refuse(tum({good, "2 0 0 0 0 0 0 1.011"}), ErrorCode::Unusable, "poses.bad_quaternion", {"line 2"});
  refuse(tum({good, "1 0.1 0 0 0 0 0 1"}), ErrorCode::Unusable, "poses.duplicate", {"lines 1 and 2"});
  refuse(tum({"2 0 0 0 0 0 0 1", good}), ErrorCode::Unusable, "poses.reversed", {"line 2", "sort_poses"});
  refuse("1 0 0 0 0 1 0 0 0 0 -1 0\n", ErrorCode::Unusable, "poses.bad_rotation", {"line 1", "determinant -1"});
  refuse("1 0 0 0 0 1 0 0 0 0 1.006 0\n", ErrorCode::Unusable, "poses.bad_rotation");
  refuse("1,0,0,0\n0,1,0,0\n0,0,1,0\n0,0.1,0,5\n", ErrorCode::Input, "input.malformed", {"line 4"});
  expectError([&] { (void)read(folder.path() / "none.txt"); }, ErrorCode::Input, "input.missing");
  expectError([&] { (void)read(folder.write("a.txt", good), PoseFormat::Kitti); }, ErrorCode::Input, "input.malformed",
              {"12"});
}

TEST(PoseFiles, RepairsSmallErrorsAndSaysSo) {
  const TempFolder folder;
  const PoseFile silent = read(folder.write("a.txt", "1 0 0 0 0 0 0 1.0000005\n"));
  EXPECT_FALSE(anyContains(silent.notices, "normalised"));
  const PoseFile repaired = read(folder.write("b.txt", "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1.009\n"));
  EXPECT_TRUE(anyContains(repaired.notices, "1 rotations"));
  EXPECT_TRUE(anyContains(repaired.notices, "line 2"));
  EXPECT_TRUE(repaired.poses.at(1).T_W_S.linear().isIdentity(1e-12));
  const PoseFile matrix = read(folder.write("c.txt", "1 0 0 0 0 1 0 0 0 0 1.004 0\n"));
  EXPECT_TRUE(anyContains(matrix.notices, "1 rotations"));
  EXPECT_TRUE(matrix.poses.at(0).T_W_S.linear().isIdentity(1e-12));
}

/// The nearest rotation of one that is exact but for rounding may be another one in its last bits.
TEST(PoseFiles, MatricesWithAllDigitsKeepTheirBits) {
  const TempFolder folder;
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::string text;
  std::vector<Eigen::Matrix4d> written;
  for (int n = 0; n < 200; ++n) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    const Eigen::Quaterniond q(normal(random), normal(random), normal(random), normal(random));
    pose.linear() = q.normalized().toRotationMatrix();
    pose.translation() = Eigen::Vector3d(normal(random), 1e5 * normal(random), normal(random));
    written.push_back(pose.matrix());
    for (int k = 0; k < 12; ++k) {
      char number[40];
      std::snprintf(number, sizeof number, "%.17g%c", pose(k / 4, k % 4), k < 11 ? ' ' : '\n');
      text += number;
    }
  }
  const PoseFile file = read(folder.write("poses.txt", text));
  ASSERT_EQ(file.poses.size(), written.size());
  for (std::size_t n = 0; n < written.size(); ++n) EXPECT_EQ(file.poses[n].T_W_S.matrix(), written[n]) << n;
}

TEST(PoseFiles, KeepsOneOfTwoEqualPosesAndSortsWhenAsked) {
  const TempFolder folder;
  const PoseFile repeated = read(folder.write("a.txt", "1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n"));
  EXPECT_EQ(repeated.poses.size(), 2U);
  EXPECT_TRUE(anyContains(repeated.notices, "1 repeated poses"));
  const PoseFile sorted = read(folder.write("b.txt", "2 9 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"), PoseFormat::Auto, true);
  EXPECT_EQ(sorted.poses.at(0).stamp_s, 1);
  EXPECT_EQ(sorted.poses.at(1).T_W_S.translation()[0], 9);
  EXPECT_TRUE(anyContains(sorted.notices, "sorted"));
}

/// A fault planted in a random trajectory is reported with its line, and none otherwise. A pose that
/// is none costs that pose.
TEST(PoseFiles, FindsOnePlantedFaultInRandomTrajectories) {
  const TempFolder folder;
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  std::uniform_int_distribution<int> pick(1, 19);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<std::string> rows;
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector4d q =
          Eigen::Vector4d(normal(random), normal(random), normal(random), normal(random)).normalized();
      char row[256];
      std::snprintf(row, sizeof(row), "%.3f %.9f %.9f %.9f %.9f %.9f %.9f %.9f", 100 + 0.1 * i, normal(random),
                    normal(random), normal(random), q[0], q[1], q[2], q[3]);
      rows.emplace_back(row);
    }
    ASSERT_EQ(read(folder.write("a.txt", tum(rows))).poses.size(), 20U);
    const int bad = pick(random);
    const char* const ids[] = {"poses.bad_quaternion", "poses.non_finite", "poses.reversed", "poses.duplicate"};
    const int fault = trial % 4;
    if (fault == 0) rows[bad] = "1000 0 0 0 0.5 0.5 0.5 0.6";
    if (fault == 1) rows[bad] = rows[bad].substr(0, rows[bad].find(' ')) + " nan 0 0 0 0 0 1";
    if (fault == 2) rows[bad] = "1 0 0 0 0 0 0 1";
    if (fault == 3) rows[bad] = rows[bad - 1].substr(0, rows[bad - 1].find(' ')) + " 1000 0 0 0 0 0 1";
    if (fault == 1) {
      const PoseFile file = read(folder.write("a.txt", tum(rows)));
      EXPECT_EQ(file.poses.size(), 19U);
      EXPECT_EQ(file.written, 20U);
      ASSERT_EQ(file.warnings.size(), 1U);
      EXPECT_EQ(file.warnings[0].id, "poses.skipped");
      EXPECT_NE(file.warnings[0].text.find("line " + std::to_string(bad + 1) + " "), std::string::npos)
          << file.warnings[0].text;
      continue;
    }
    expectError([&] { (void)read(folder.write("a.txt", tum(rows))); }, ErrorCode::Unusable, ids[fault],
                {(fault == 3 ? "and " : "line ") + std::to_string(bad + 1) + " "});
  }
}

TEST(PoseFiles, LeaveOutWhatIsNoPoseInEachFormat) {
  const TempFolder folder;
  const std::string kitti = "1 0 0 0 0 1 0 0 0 0 1 0", square = kitti + " 0 0 0 1",
                    balm = "1 0 0 0\n0 1 0 0\n0 0 1 0\n";
  const std::string zero12 = "0 0 0 0 0 0 0 0 0 0 0 0", nan4 = "nan nan nan nan",
                    nan12 = nan4 + " " + nan4 + " " + nan4;
  for (const auto& [good, bad] : {std::pair(std::string("0 0 0 1 0 0 0"), std::string("0 0 0 0 0 0 0")),
                                  {kitti, zero12},
                                  {kitti, nan12},
                                  {square, zero12 + " 0 0 0 0"},
                                  {square, zero12 + " 0 0 0 1"},
                                  {square, nan12 + " " + nan4},
                                  {balm + "0 0 0 1", "0 0 0 0\n0 0 0 0\n0 0 0 0\n0 0 0 0"},
                                  {balm + "0 0 0 1", nan4 + "\n" + nan4 + "\n" + nan4 + "\n" + nan4}}) {
    const PoseFile file = read(folder.write("a.txt", tum({good, bad, good})));
    ASSERT_EQ(file.poses.size(), 2U) << bad;
    EXPECT_EQ(file.poses[1].index, 2U) << bad;
    EXPECT_EQ(file.written, 3U);
    ASSERT_EQ(file.warnings.size(), 1U);
    EXPECT_EQ(file.warnings[0].id, "poses.skipped");
  }
  // What is not a rotation was meant as something else.
  expectError(
      [&] {
        (void)read(folder.write("a.txt", tum({square, kitti + " 0 0 1 0", square})));
      },
      ErrorCode::Unusable, "poses.bad_rotation", {"line 2"});
  expectError(
      [&] {
        (void)read(folder.write("a.txt", tum({kitti, "2 0 0 0 0 2 0 0 0 0 2 0", kitti})));
      },
      ErrorCode::Unusable, "poses.bad_rotation", {"line 2"});
}

TEST(PoseFiles, ReadsARealTumTrajectory) {
  ACCESSVDB_NEED_DATA(path, "trajectories/freiburg1_xyz-groundtruth.txt");
  const PoseFile file = read(path);
  EXPECT_EQ(file.format, PoseFormat::Tum);
  // Independent count: lines that do not begin with '#'.
  std::ifstream in(path);
  std::size_t lines = 0;
  for (std::string line; std::getline(in, line);) lines += !line.empty() && line[0] != '#' ? 1 : 0;
  EXPECT_EQ(file.poses.size(), lines);
  EXPECT_NEAR(file.poses.front().T_W_S.translation()[0], 1.3563, 1e-12);
  // Four decimals: lengths off by up to 1e-4, so there is a notice and no refusal.
  EXPECT_TRUE(anyContains(file.notices, "normalised"));
}

TEST(PoseFiles, ThreeSpellingsOfTheSameRealPosesAgree) {
  ACCESSVDB_NEED_DATA(folder, "scans_poses_balm");
  const PoseFile balm = read(folder / "alidarPose.csv"), tum_file = read(folder / "poses_tum.txt"),
                 kitti = read(folder / "poses_kitti.txt");
  ASSERT_EQ(balm.poses.size(), 177U);
  ASSERT_EQ(tum_file.poses.size(), 12U);
  ASSERT_EQ(kitti.poses.size(), 12U);
  for (std::size_t i = 0; i < 12; ++i) {
    const auto& truth = balm.poses[96 + i];
    EXPECT_EQ(tum_file.poses[i].stamp_s, truth.stamp_s);
    for (const auto* other : {&tum_file.poses[i], &kitti.poses[i]}) {
      EXPECT_LT((other->T_W_S.translation() - truth.T_W_S.translation()).norm(), 1e-9);  // same 6 decimals
      // The csv rounds rotations to 6 decimals; two ways to the nearest rotation differ by no more than that rounding.
      EXPECT_LT((other->T_W_S.linear() - truth.T_W_S.linear()).cwiseAbs().maxCoeff(), 2e-6);
    }
  }
}

TEST(PoseFiles, ReadsRealHbaAndKittiPoses) {
  ACCESSVDB_NEED_DATA(hba, "livox_mlcc/pose.json");
  const PoseFile file = read(hba);
  EXPECT_EQ(file.format, PoseFormat::Hba);
  EXPECT_EQ(file.poses.size(), 22U);
  ACCESSVDB_NEED_DATA(kitti, "kitti_00/poses.txt");
  const PoseFile scanner = readPoseFile(kitti, PoseFormat::Auto, kitti.parent_path() / "calib.txt", false);
  ASSERT_EQ(scanner.poses.size(), 6U);
  // The README: 0.86 m per frame along +x of the scanner, to two digits. Sideways: the camera itself moves 0.055 m
  // across its axis per frame, and Tr tilts that by less than 1 degree (0.015 m).
  for (std::size_t i = 1; i < 6; ++i) {
    const Eigen::Vector3d step = scanner.poses[i - 1].T_W_S.inverse() * scanner.poses[i].T_W_S.translation();
    EXPECT_NEAR(step[0], 0.86, 0.02);
    EXPECT_LT(step.tail<2>().norm(), 0.07);
  }
}

}  // namespace
}  // namespace accessvdb::io
