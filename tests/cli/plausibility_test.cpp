// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Each warning is given for its cause, and an ordinary run gets none.
#include "runs/plausibility.h"

#include <gtest/gtest.h>

#include <cmath>

namespace accessvdb::tools {
namespace {

/// Scans of a 4 m wide floor from a sensor that moves `step_m` per scan; lengths in the scans are times `unit`.
SceneStatistics scenery(double step_m = 0.2, double unit = 1) {
  SceneStatistics scene;
  for (int scan = 0; scan < 5; ++scan) {
    io::ScanRecord record;
    record.T_W_S.translation() = Eigen::Vector3d(step_m * scan, 0, 1);
    for (int i = 0; i < 1000; ++i) {
      record.points_S.emplace_back(static_cast<float>(unit * (i % 40 - 20) * 0.1),
                                   static_cast<float>(unit * (i / 40 - 12) * 0.1), static_cast<float>(-unit));
    }
    scene.add(record);
  }
  return scene;
}

class Plausibility : public ::testing::Test {
 protected:
  Plausibility() {
    report_.points_in = report_.points_used = 5000;
    report_.surface_points = 900;
    report_.labels[static_cast<int>(PointLabel::Accessible)] = 500;
    report_.labels[static_cast<int>(PointLabel::Blocked)] = 300;
    report_.labels[static_cast<int>(PointLabel::Unscored)] = 100;
    report_.reasons[static_cast<int>(PointReason::Arm)] = 300;
    surface_W_ = {Eigen::Vector3d(-2, -1, 0), Eigen::Vector3d(3, 1, 0.1)};
  }
  std::vector<std::string> found() const {
    RunFacts facts{report_, scene_, surface_W_, origin_W_, 0.01, {tool_m_, 0.1 * tool_m_, 0.1 * tool_m_},
                   tool_m_, level_};
    std::vector<std::string> ids;
    for (const Warning& warning : findImplausible(facts)) {
      ids.push_back(warning.id);
      EXPECT_GT(warning.text.size(), 40u);
    }
    return ids;
  }
  static std::vector<std::string> only(const char* id) { return {id}; }

  RunReport report_;
  SceneStatistics scene_ = scenery();
  Eigen::AlignedBox3d surface_W_;
  Eigen::Vector3d origin_W_ = {0, 0, 1};
  double tool_m_ = 0.6;
  bool level_ = true;
};

TEST_F(Plausibility, OrdinaryRunIsNotWarnedAbout) { EXPECT_TRUE(found().empty()); }

TEST_F(Plausibility, AllBlocked) {
  report_.labels[static_cast<int>(PointLabel::Accessible)] = 0;
  EXPECT_EQ(found(), only("result.all_blocked"));
}

TEST_F(Plausibility, AdviceWhereAllIsBlockedFitsTheReason) {
  report_.labels[static_cast<int>(PointLabel::Accessible)] = 0;
  const auto adviceFor = [&](PointReason reason, bool level) {
    report_.reasons = {};
    report_.reasons[static_cast<int>(reason)] = 300;
    const RunFacts facts{report_, scene_, surface_W_, origin_W_, 0.01, {0.6, 0.1, 0.1}, 0.6, level};
    return findImplausible(facts).at(0).text;
  };
  const auto has = [](const std::string& text, const std::string& part) { return text.find(part) != text.npos; };
  EXPECT_TRUE(has(adviceFor(PointReason::Unseen, true), "--orientations"));
  EXPECT_FALSE(has(adviceFor(PointReason::Unseen, false), "--orientations"));
  EXPECT_TRUE(has(adviceFor(PointReason::Confidence, true), "more scans"));
  EXPECT_TRUE(has(adviceFor(PointReason::Tool, true), "tip, axis and unit"));
}

TEST_F(Plausibility, TheOpenSkyIsNoMistake) {
  report_.dropped[static_cast<int>(DropReason::NoReturn)] = 4750;
  EXPECT_TRUE(found().empty());
  ASSERT_TRUE(openSkyNotice(report_));
  EXPECT_EQ(openSkyNotice(report_)->substr(0, 4), "95 %");
  // Of what did come back, most is out of range.
  report_.dropped[static_cast<int>(DropReason::BeyondMaxRange)] = 200;
  EXPECT_EQ(found(), only("input.most_dropped"));
}

TEST_F(Plausibility, NothingScored) {
  report_.labels = {900, 0, 0};
  EXPECT_EQ(found(), only("result.nothing_scored"));
}

TEST_F(Plausibility, MostReturnsDropped) {
  report_.dropped[static_cast<int>(DropReason::BeyondMaxRange)] = 2501;
  EXPECT_EQ(found(), only("input.most_dropped"));
  report_.dropped[static_cast<int>(DropReason::BeyondMaxRange)] = 2499;
  EXPECT_TRUE(found().empty());
}

TEST_F(Plausibility, ScansInMillimetres) {
  scene_ = scenery(0.2, 1000);
  EXPECT_EQ(found(), only("input.scan_unit"));
}

TEST_F(Plausibility, PosesInMillimetres) {
  // Scans so far apart cannot overlap either.
  scene_ = scenery(2000);
  EXPECT_EQ(found(), (std::vector<std::string>{"input.pose_unit", "input.no_overlap"}));
}

TEST_F(Plausibility, ScansThatHardlyOverlap) {
  scene_ = scenery(50);
  EXPECT_EQ(found(), only("input.no_overlap"));
  EXPECT_LT(scene_.medianOverlap(), 0.01);
  EXPECT_GT(scenery().medianOverlap(), 0.8);
}

TEST_F(Plausibility, ToolLargerThanTheScene) {
  surface_W_ = {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0.3, 0.3, 0.3)};
  EXPECT_EQ(found(), only("tool.larger_than_scene"));
}

TEST_F(Plausibility, ToolInTheWrongUnit) {
  tool_m_ = 4;
  EXPECT_EQ(found(), only("tool.unit"));
  tool_m_ = 0.004;
  EXPECT_EQ(found(), only("tool.unit"));
}

TEST(HiddenTool, IsWarnedOfFromThreeTenthsOn) {
  EXPECT_FALSE(hiddenToolWarning(0.29));
  ASSERT_TRUE(hiddenToolWarning(0.31));
  EXPECT_EQ(hiddenToolWarning(0.31)->id, "tool.hidden");
}

TEST_F(Plausibility, HugeCoordinates) {
  const Eigen::Vector3d utm(5e5, 5e6, 100);
  surface_W_.translate(utm);
  origin_W_ += utm;
  EXPECT_EQ(found(), only("scene.huge_coordinates"));
  origin_W_ -= utm;  // far from the local origin, precision suffers too
  EXPECT_EQ(found(), (std::vector<std::string>{"scene.too_wide", "scene.huge_coordinates"}));
}

TEST(StageTimes, PercentilesAreNearestRanks) {
  StageTimes times;
  EXPECT_EQ(times.percentile(0.99), 0);
  for (int i = 100; i >= 1; --i) times.add(i);
  EXPECT_EQ(times.mean(), 50.5);
  EXPECT_EQ(times.percentile(0.5), 50);
  EXPECT_EQ(times.percentile(0.95), 95);
  EXPECT_EQ(times.percentile(0.99), 99);
  EXPECT_EQ(times.percentile(1.0), 100);
}

TEST(ReportedScans, ThoseThatAGpuFusedAreCounted) {
  RunReport report;
  FrameStats stats;
  for (const bool fused : {false, true, true}) {
    stats.fused_on_device = fused;
    report.addScan(stats, false);
  }
  EXPECT_EQ(report.scans_fused_on_device, 2u);
}

TEST(Failures, ForeignExceptionsAreOursToReport) {
  EXPECT_EQ(describeFailure(std::runtime_error("oops")).exit_code, 70);
  EXPECT_EQ(describeFailure(std::bad_alloc()).exit_code, 5);
  const Failure ours = describeFailure(OutputError("output.full", "file", "problem", "advice"));
  EXPECT_EQ(ours.exit_code, 7);
  EXPECT_EQ(ours.id + ours.subject + ours.problem + ours.advice, "output.fullfileproblemadvice");
}

}  // namespace
}  // namespace accessvdb::tools
