// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans that do not agree, as other software's poses make them: refused or warned about, with the cure.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "inputs/field_world.h"

namespace accessvdb::inputs_test {
namespace {

using Json = nlohmann::json;

class Agreement : public InputTest {
 protected:
  void SetUp() override {
    InputTest::SetUp();
    scans_ = worldScans();
    for (std::size_t i = 0; i < scans_.size(); ++i)
      writePcd("scans/" + std::to_string(i) + ".pcd", scans_[i].points_S());
  }

  /// TUM, with each pose as `change` makes it.
  template <typename Change>
  void writePosesAs(const Change& change, double later_s = 0) const {
    std::string text;
    for (const WorldScan& scan : scans_) {
      const Eigen::Isometry3d T = change(scan.T_W_S);
      const Eigen::Quaterniond q(T.linear());
      text += decimals(scan.stamp_s + later_s);
      for (const double value :
           {T.translation().x(), T.translation().y(), T.translation().z(), q.x(), q.y(), q.z(), q.w()})
        text += " " + decimals(value);
      text += "\n";
    }
    writeBytes("poses.txt", text);
  }

  [[nodiscard]] MapOutcome mapped(std::vector<std::string> more = {}) const {
    std::vector<std::string> arguments = {"--scans", path("scans"), "--poses", path("poses.txt")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return map(arguments);
  }

  [[nodiscard]] Json report() const { return Json::parse(std::ifstream(path("out/report.json"))); }

  void expectDisagree(const MapOutcome& outcome, const std::string& cure) const {
    EXPECT_EQ(outcome.program.exit_code, 4) << outcome.program.err;
    EXPECT_TRUE(outcome.fails("poses.disagree")) << outcome.program.err;
    EXPECT_NE(outcome.program.err.find(cure), std::string::npos) << outcome.program.err;
    EXPECT_EQ(outcome.points, 0u);
  }

  std::vector<WorldScan> scans_;
};

TEST_F(Agreement, IsSaidAndKept) {
  writePosesAs([](const auto& T) { return T; });
  const MapOutcome outcome = mapped();
  expectRight(outcome);
  EXPECT_NE(outcome.program.err.find("agreement of the scans: 100 %"), std::string::npos) << outcome.program.err;
  EXPECT_EQ(outcome.program.err.find("warning["), std::string::npos) << outcome.program.err;
  const Json agreement = report()["agreement"];
  EXPECT_EQ(agreement["verdict"], "usual");
  EXPECT_EQ(agreement["scans"], 8);
  EXPECT_GT(agreement["agreeing"], 1000);
  EXPECT_EQ(agreement["contradicting"], 0);
}

TEST_F(Agreement, QuaternionsWithWFirst) {
  std::string text;
  for (const WorldScan& scan : scans_) {
    const Eigen::Quaterniond q(scan.T_W_S.linear());
    const Eigen::Vector3d t = scan.T_W_S.translation();
    text += decimals(scan.stamp_s);
    for (const double value : {t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z()}) text += " " + decimals(value);
    text += "\n";
  }
  writeBytes("poses.txt", text);
  expectDisagree(mapped(), "the quaternions are w x y z");
  EXPECT_EQ(report()["error"]["id"], "poses.disagree");
}

TEST_F(Agreement, InversePoses) {
  writePosesAs([](const auto& T) { return T.inverse(); });
  expectDisagree(mapped(), "the poses are inverse");
}

TEST_F(Agreement, ASensorThatIsTurned) {
  const auto turned = [](double degrees, int axis) {
    return [=](const Eigen::Isometry3d& T) {
      return Eigen::Isometry3d(T * Eigen::AngleAxisd(degrees * std::numbers::pi / 180, Eigen::Vector3d::Unit(axis)));
    };
  };
  writePosesAs(turned(90, 2));
  expectDisagree(mapped(), "turned by -90 degrees about its z axis: --extrinsic 0,0,0,0,0,-90");
  writePosesAs(turned(180, 0));
  expectDisagree(mapped(), "turned by 180 degrees about its x axis: --extrinsic 0,0,0,180,0,0");
  writePosesAs(turned(60, 1));
  expectDisagree(mapped(), "turned by -60 degrees about its y axis: --extrinsic 0,0,0,0,-60,0");
  // The cure that is named is one.
  const MapOutcome cured = mapped({"--extrinsic=0,0,0,0,-60,0"});
  expectRight(cured);
  EXPECT_FALSE(cured.warns("poses.disagree")) << cured.program.err;
}

TEST_F(Agreement, AnInverseExtrinsic) {
  const Eigen::Isometry3d mount =
      Eigen::Translation3d(0.1, 0, 0.2) * Eigen::AngleAxisd(std::numbers::pi / 3, Eigen::Vector3d::UnitY());
  writePosesAs([&](const auto& T) { return T * mount.inverse(); });
  expectRight(mapped({"--extrinsic=0.1,0,0.2,0,60,0"}));
  const Eigen::Vector3d back = mount.inverse().translation();
  expectDisagree(mapped({"--extrinsic=" + decimals(back.x()) + ",0," + decimals(back.z()) + ",0,-60,0"}),
                 "--extrinsic is inverse");
}

TEST_F(Agreement, ScansInTheWorldAlready) {
  for (std::size_t i = 0; i < scans_.size(); ++i) writePcd("scans/" + std::to_string(i) + ".pcd", scans_[i].points_W);
  writePosesAs([](const auto& T) { return T; });
  expectDisagree(mapped(), "in the world frame already");
}

TEST_F(Agreement, PosesInMillimetres) {
  writePosesAs([](Eigen::Isometry3d T) {
    T.translation() *= 1000;
    return T;
  });
  expectDisagree(mapped(), "multiply the positions of the poses by 0.001");
}

TEST_F(Agreement, CanBeOverruled) {
  writePosesAs([](const auto& T) { return T.inverse(); });
  const MapOutcome outcome = mapped({"--allow-disagreement"});
  EXPECT_EQ(outcome.program.exit_code, 0) << outcome.program.err;
  EXPECT_TRUE(outcome.warns("poses.disagree")) << outcome.program.err;
  EXPECT_EQ(report()["agreement"]["verdict"], "disagree");
}

TEST_F(Agreement, IsMeasuredByAllThatMap) {
  writePosesAs([](const auto& T) { return T.inverse(); });
  for (const std::vector<std::string>& verb :
       {std::vector<std::string>{"advise", "--out", path("a.toml")},
        {"tile", "plan", path("tiles"), "--voxel", "0.05", "--tool", "builtin:pruner"},
        {"map", "--tiles", "2", "--out", path("out2"), "--tool", "builtin:pruner"}}) {
    SCOPED_TRACE(verb[0]);
    std::vector<std::string> arguments = verb;
    for (const std::string& more : {std::string("--scans"), path("scans"), std::string("--poses"), path("poses.txt")})
      arguments.push_back(more);
    const cli_test::ProgramResult result = cli_test::runProgram(arguments);
    EXPECT_EQ(result.exit_code, 4) << result.err;
    EXPECT_NE(result.err.find("error[poses.disagree]"), std::string::npos) << result.err;
    EXPECT_FALSE(std::filesystem::exists(path("tiles/plan.json")));
  }
}

TEST_F(Agreement, IsNotMeasuredOfASingleCloud) {
  std::string text;
  for (const Eigen::Vector3d& p : scans_[0].points_W)
    text += decimals(p.x()) + " " + decimals(p.y()) + " " + decimals(p.z()) + "\n";
  writeBytes("cloud.xyz", text);
  const Eigen::Vector3d at = scans_[0].T_W_S.translation();
  const MapOutcome outcome = map({"--scans", path("cloud.xyz"), "--sensor-at",
                                  decimals(at.x()) + "," + decimals(at.y()) + "," + decimals(at.z())});
  expectRight(outcome);
  EXPECT_NE(outcome.program.err.find("agreement of the scans: not measured (a single scan)"), std::string::npos)
      << outcome.program.err;
  EXPECT_EQ(report()["agreement"]["verdict"], "not_measured");
}

TEST_F(Agreement, PosesAroundTheMiddleOfTheEarth) {
  // East, north and up at 48 degrees north, 11 degrees east.
  const double lat = 48 * std::numbers::pi / 180, lon = 11 * std::numbers::pi / 180;
  Eigen::Isometry3d T_E_W = Eigen::Isometry3d::Identity();
  T_E_W.linear().col(0) << -std::sin(lon), std::cos(lon), 0;
  T_E_W.linear().col(1) << -std::sin(lat) * std::cos(lon), -std::sin(lat) * std::sin(lon), std::cos(lat);
  T_E_W.linear().col(2) << std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat);
  T_E_W.translation() = 6.366e6 * T_E_W.linear().col(2);
  writePosesAs([&](const auto& T) { return T_E_W * T; });
  const MapOutcome outcome = mapped();
  EXPECT_EQ(outcome.program.exit_code, 0) << outcome.program.err;
  ASSERT_TRUE(outcome.warns("poses.up")) << outcome.program.err;
  const std::size_t flag = outcome.program.err.find("--level=");
  ASSERT_NE(flag, std::string::npos) << outcome.program.err;
  const std::string level = outcome.program.err.substr(flag, outcome.program.err.find(' ', flag) - flag);
  EXPECT_FALSE(mapped({level}).warns("poses.up")) << level;
}

TEST_F(Agreement, OneBadPoseIsNamed) {
  std::size_t scan = 0;
  writePosesAs([&](Eigen::Isometry3d T) {
    if (scan++ == 3) T.translation().z() += 1;
    return T;
  });
  const MapOutcome outcome = mapped();
  EXPECT_EQ(outcome.program.exit_code, 0) << outcome.program.err;
  EXPECT_TRUE(outcome.warns("poses.disagree")) << outcome.program.err;
  EXPECT_NE(outcome.program.err.find("1 of 8 scans compared does not agree with the others (3.pcd)"), std::string::npos)
      << outcome.program.err;
  EXPECT_EQ(report()["agreement"]["outliers"], Json::array({"3.pcd"}));
}

TEST_F(Agreement, AWorldThatIsTilted) {
  // Walls count as much as floors: dense enough for patches of both.
  scans_ = worldScans(12000);
  for (std::size_t i = 0; i < scans_.size(); ++i) writePcd("scans/" + std::to_string(i) + ".pcd", scans_[i].points_S());
  const Eigen::Isometry3d T(Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitX()) *
                            Eigen::AngleAxisd(-0.3, Eigen::Vector3d::UnitY()));
  writePosesAs([&](const auto& T_W_S) { return T * T_W_S; });
  const MapOutcome outcome = mapped();
  ASSERT_TRUE(outcome.warns("poses.up")) << outcome.program.err;
  const std::size_t flag = outcome.program.err.find("--level=");
  ASSERT_NE(flag, std::string::npos) << outcome.program.err;
  const std::string level = outcome.program.err.substr(flag, outcome.program.err.find(' ', flag) - flag);
  const MapOutcome levelled = mapped({level});
  EXPECT_FALSE(levelled.warns("poses.up")) << level << levelled.program.err;
}

}  // namespace
}  // namespace accessvdb::inputs_test
