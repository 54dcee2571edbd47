// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/pose_matching.h"

#include <limits>
#include <numbers>

#include "io/poses/pose_gap.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::anyContains;
using test::expectError;

/// Pose i is at (i, 0, 0), turned by 0.1 i about z.
PoseFile posesOf(PoseFormat format, std::size_t n, double first_s = 0, double step_s = 0) {
  PoseFile file;
  file.subject = "poses.txt";
  file.format = format;
  file.stamped = step_s != 0;
  for (std::size_t i = 0; i < n; ++i) {
    PoseEntry pose;
    const auto k = static_cast<double>(i);
    pose.T_W_S = Eigen::Translation3d(k, 0, 0) * Eigen::AngleAxisd(0.1 * k, Eigen::Vector3d::UnitZ());
    pose.stamp_s = first_s + k * step_s;
    pose.index = i;
    pose.line = i + 1;
    file.poses.push_back(pose);
  }
  return file;
}

std::vector<double> placesOf(const MatchResult& match) {
  std::vector<double> places;
  for (const auto& scan : match.scans) places.push_back(scan.T_W_S.translation()[0]);
  return places;
}

TEST(PoseGap, NanosecondsHoldAnyTime) {
  EXPECT_EQ(nanoseconds(0.2), 200'000'000);
  EXPECT_EQ(nanoseconds(-1.5e-9), -2);
  // Files may hold any number; the sum with a stamp of a message must hold, too.
  constexpr std::int64_t kMost_ns = 4'000'000'000'000'000'000, kLatestMessage_ns = 4'294'967'295'999'999'999;
  EXPECT_EQ(nanoseconds(1e30), kMost_ns);
  EXPECT_EQ(nanoseconds(-1e30), -kMost_ns);
  EXPECT_LT(nanoseconds(1e30), std::numeric_limits<std::int64_t>::max() - kLatestMessage_ns);
}

TEST(PoseMatching, FileNamesGiveNumbersOrTimes) {
  EXPECT_EQ(fileNumber("full96"), 96U);
  EXPECT_EQ(fileNumber("lidar2_12"), 12U);
  EXPECT_EQ(fileNumber("000007"), 7U);
  EXPECT_EQ(fileNumber("12a"), 12U);
  EXPECT_FALSE(fileNumber("scan"));
  EXPECT_FALSE(fileNumber("99999999999999999999999"));
  EXPECT_EQ(fileStamp_s("12.5"), 12.5);
  EXPECT_EQ(fileStamp_s("scan_1630577806.571210"), 1630577806.571210);
  EXPECT_EQ(fileStamp_s("1630577806"), 1630577806);
  EXPECT_NEAR(fileStamp_s("1630577806571210000").value(), 1630577806.571210, 1e-6);
  EXPECT_NEAR(fileStamp_s("1630577806571210").value(), 1630577806.571210, 1e-6);
  EXPECT_NEAR(fileStamp_s("1630577806571").value(), 1630577806.571, 1e-6);
  EXPECT_FALSE(fileStamp_s("000012"));
  EXPECT_FALSE(fileStamp_s("0000000012"));  // KITTI raw: ten digits, but an index
  EXPECT_FALSE(fileStamp_s("full96"));
  EXPECT_FALSE(fileStamp_s("scan"));
  EXPECT_FALSE(fileStamp_s(""));
}

TEST(PoseMatching, NumberIsIndexForBalmHbaAndKitti) {
  for (const PoseFormat format : {PoseFormat::Balm, PoseFormat::Hba, PoseFormat::Kitti}) {
    const MatchResult match = matchPoses({"full96", "full97", "full100"}, posesOf(format, 177), {}, "");
    EXPECT_EQ(placesOf(match), (std::vector<double>{96, 97, 100}));
    EXPECT_NE(match.rule.find("file number = pose index"), std::string::npos) << match.rule;
  }
}

TEST(PoseMatching, TumNumbersAreNoIndices) {
  // Twelve poses of the files 96 to 107: only matching by order is possible.
  std::vector<std::string> stems;
  for (int i = 96; i < 108; ++i) stems.push_back("full" + std::to_string(i));
  const MatchResult match = matchPoses(stems, posesOf(PoseFormat::Tum, 12, 1e9, 0.5), {}, "");
  EXPECT_EQ(placesOf(match).front(), 0);
  EXPECT_EQ(placesOf(match).back(), 11);
  EXPECT_NE(match.rule.find("in order"), std::string::npos);
  EXPECT_EQ(match.scans[2].stamp_s, 1e9 + 1);
  // The same for KITTI poses of some of the files: 96 is past the end of the poses.
  EXPECT_EQ(placesOf(matchPoses(stems, posesOf(PoseFormat::Kitti, 12), {}, "")).front(), 0);
  // With different counts, the numbers must not be taken as indices or seconds.
  expectError(
      [] {
        (void)matchPoses({"000001", "000002"}, posesOf(PoseFormat::Tum, 30, 0, 0.1), {}, "");
      },
      ErrorCode::Unusable, "poses.no_match", {"2 scans numbered 1 to 2", "30 poses from 0.000000 s to 2.900000 s"});
}

TEST(PoseMatching, TimeStampsInterpolateOverSmallGapsOnly) {
  PoseFile poses = posesOf(PoseFormat::Tum, 11, 1000.0, 0.1);
  const MatchResult match = matchPoses({"999.95", "1000.00", "1000.25", "1000.999995", "1001.2"}, poses, {}, "");
  ASSERT_EQ(match.scans.size(), 3U);
  EXPECT_EQ(match.scans[0].scan, 1U);
  // 1e-9: seconds near 1000 are exact to 1e-13, times 10 m/s, with margin.
  EXPECT_NEAR(match.scans[1].T_W_S.translation()[0], 2.5, 1e-9);
  const Eigen::AngleAxisd turn(match.scans[1].T_W_S.linear());
  EXPECT_NEAR(turn.angle(), 0.25, 1e-9);
  EXPECT_EQ(match.scans[1].stamp_s, 1000.25);
  EXPECT_EQ(match.scans[2].T_W_S.translation()[0], 10);
  EXPECT_TRUE(test::anyContains(match.notices, "2 of 5 scans are skipped"));

  poses.poses.erase(poses.poses.begin() + 3, poses.poses.begin() + 5);  // a gap of 0.3 s from 1000.2 to 1000.5
  EXPECT_FALSE(interpolatePose(poses.poses, 1000.3).has_value());
  EXPECT_EQ(interpolatePose(poses.poses, 1000.5).value().translation()[0], 5);
  EXPECT_TRUE(interpolatePose(poses.poses, 1000.55).has_value());
}

TEST(PoseMatching, OtherTimeSpansAreRefusedEvenWithEqualCounts) {
  expectError(
      [] {
        (void)matchPoses({"10.00", "10.10"}, posesOf(PoseFormat::Tum, 2, 1000, 0.1), {}, "");
      },
      ErrorCode::Unusable, "poses.no_overlap",
      {"2 scans from 10.000000 s to 10.100000 s", "2 poses from 1000.000000 s to 1000.100000 s"});
}

TEST(PoseMatching, TimesFileGivesTheStampsOfNumberedScans) {
  const PoseFile poses = posesOf(PoseFormat::Tum, 21, 50, 0.1);
  const MatchResult match = matchPoses({"000001", "000003"}, poses, {50.0, 50.15, 50.2, 50.35}, "times.txt");
  ASSERT_EQ(match.scans.size(), 2U);
  EXPECT_NEAR(placesOf(match)[0], 1.5, 1e-9);
  EXPECT_NEAR(placesOf(match)[1], 3.5, 1e-9);
  EXPECT_NE(match.rule.find("times.txt"), std::string::npos);
  const MatchResult named = matchPoses({"a", "b"}, poses, {50.1, 50.2}, "times.txt");
  EXPECT_NEAR(placesOf(named)[1], 2, 1e-9);
}

TEST(PoseMatching, InsistsWhenAsked) {
  const std::vector<std::string> stems = {"1000.0", "1000.1", "1000.2"};
  const PoseFile poses = posesOf(PoseFormat::Tum, 3, 1000, 0.1);
  EXPECT_NE(matchPoses(stems, poses, {}, "", {.match = Match::Order}).rule.find("in order"), std::string::npos);
  EXPECT_NE(matchPoses(stems, poses, {}, "", {.match = Match::Name}).rule.find("file number"), std::string::npos);
  EXPECT_NE(matchPoses(stems, poses, {}, "", {.match = Match::Time}).rule.find("time stamp"), std::string::npos);
  expectError(
      [&] {
        (void)matchPoses({"a", "b", "c"}, poses, {}, "", {.match = Match::Time});
      },
      ErrorCode::Unusable, "poses.no_match", {"Match::Time"});
  expectError(
      [&] {
        (void)matchPoses({"a", "b", "c"}, poses, {}, "", {.match = Match::Name});
      },
      ErrorCode::Unusable, "poses.no_match", {"Match::Name"});
  expectError(
      [&] {
        (void)matchPoses({"a", "b"}, poses, {}, "", {.match = Match::Order});
      },
      ErrorCode::Unusable, "poses.no_match", {"Match::Order"});
}

TEST(PoseMatching, WholeNumbersAreTimesInTheUnitThatFits) {
  const PoseFile poses = posesOf(PoseFormat::Tum, 30, 0, 0.1);
  const MatchResult match = matchPoses({"100000000", "250000000"}, poses, {}, "");
  EXPECT_NEAR(placesOf(match).at(1), 2.5, 1e-9);
  EXPECT_NE(match.rule.find("in ns"), std::string::npos) << match.rule;
  EXPECT_EQ(placesOf(matchPoses({"1", "2"}, poses, {}, "", {.match = Match::Time})), (std::vector<double>{10, 20}));
}

TEST(PoseMatching, TakesTheNamesOfThePoseFile) {
  PoseFile poses = posesOf(PoseFormat::Hba, 3);
  poses.scan_names = {"scans/c.pcd", "scans/b.pcd", "scans/a.pcd"};
  const MatchResult match = matchPoses({"a", "b", "d"}, poses, {}, "");
  EXPECT_EQ(placesOf(match), (std::vector<double>{2, 1}));
  EXPECT_TRUE(anyContains(match.notices, "1 of 3 scans are skipped"));
  expectError(
      [&] {
        (void)matchPoses({"x", "y", "z"}, poses, {}, "");
      },
      ErrorCode::Unusable, "poses.no_match", {"scans/c.pcd"});
  poses.scan_names = {"12", "11", "10"};
  EXPECT_EQ(placesOf(matchPoses({"000010", "000011", "000012"}, poses, {}, "")), (std::vector<double>{2, 1, 0}));
}

TEST(PoseMatching, NumbersFromAnotherBaseAreTakenInOrder) {
  PoseFile poses = posesOf(PoseFormat::Hba, 3);
  poses.numbered = true;
  poses.numbers = {1, 2, 3};
  for (PoseEntry& pose : poses.poses) pose.index = poses.numbers[pose.index];
  const MatchResult match = matchPoses({"000000", "000001", "000002"}, poses, {}, "");
  EXPECT_EQ(placesOf(match), (std::vector<double>{0, 1, 2}));
  EXPECT_TRUE(anyContains(match.notices, "taken in order"));
  EXPECT_EQ(placesOf(matchPoses({"000000", "000001", "000002"}, poses, {}, "", {.match = Match::Name})),
            (std::vector<double>{0, 1}));
  expectError(
      [&] {
        (void)matchPoses({"000002", "000003", "000004"}, poses, {}, "");
      },
      ErrorCode::Unusable, "poses.no_match", {"Match::Order"});
  EXPECT_EQ(placesOf(matchPoses({"000002", "000003"}, poses, {}, "")), (std::vector<double>{1, 2})) << "fewer scans";
}

TEST(PoseMatching, NamesTheGapThatWouldDo) {
  PoseFile poses = posesOf(PoseFormat::Tum, 11, 1000.0, 0.1);
  poses.poses.erase(poses.poses.begin() + 3, poses.poses.begin() + 5);  // 0.3 s
  const std::vector<std::string> stems = {"1000.0", "1000.3", "1000.4", "1000.5"};
  const MatchResult match = matchPoses(stems, poses, {}, "");
  EXPECT_TRUE(anyContains(match.notices, "max_gap_s 0.32 for 2 of them")) << match.notices.at(0);
  EXPECT_EQ(matchPoses(stems, poses, {}, "", {.max_gap_s = 0.32}).scans.size(), 4U);
  EXPECT_TRUE(interpolatePose(posesOf(PoseFormat::Tum, 3, 1.7e9, 0.2).poses, 1.7e9 + 0.3)) << "5 Hz";
}

TEST(PoseMatching, FewerPosesThanScansAreRefusedWithBothCounts) {
  expectError(
      [] {
        (void)matchPoses({"0", "1", "2"}, posesOf(PoseFormat::Kitti, 2), {}, "");
      },
      ErrorCode::Unusable, "poses.too_few", {"3 scans numbered 0 to 2", "2 poses without time stamps"});
}

}  // namespace
}  // namespace accessvdb::io
