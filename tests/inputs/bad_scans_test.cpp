// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One bad scan costs that scan: it is left out, counted and named, and the others give the map that they give without
/// it. Most of them bad are refused.
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "inputs/field_world.h"

namespace accessvdb::inputs_test {
namespace {

class BadScans : public InputTest {
 protected:
  void SetUp() override {
    InputTest::SetUp();
    writeNumberedScans(scans_);
  }
  [[nodiscard]] MapOutcome mapScans(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"--scans", path("scans"), "--poses", path("poses.txt")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return map(arguments);
  }
  [[nodiscard]] std::string bytes(const std::string& name) const {
    std::ifstream file(path(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  /// What the scans give without the fourth.
  [[nodiscard]] MapOutcome withoutFourth() const {
    const std::string fourth = bytes("scans/000003.pcd");
    std::filesystem::remove(path("scans/000003.pcd"));
    const MapOutcome outcome = mapScans();
    expectRight(outcome);
    writeBytes("scans/000003.pcd", fourth);
    return outcome;
  }
  void expectSkipped(const MapOutcome& outcome, const MapOutcome& without, const std::string& id,
                     const std::string& name) const {
    expectRight(outcome);
    EXPECT_TRUE(outcome.warns(id)) << outcome.program.err;
    EXPECT_NE(outcome.program.err.find(name), std::string::npos) << outcome.program.err;
    EXPECT_EQ(outcome.points, without.points);
    // A scan whose points are left out still takes its turn in rules that count scans.
    constexpr double kTurn = 2;
    EXPECT_NEAR(static_cast<double>(outcome.accessible), static_cast<double>(without.accessible), kTurn);
    EXPECT_NEAR(static_cast<double>(outcome.blocked), static_cast<double>(without.blocked), kTurn);
  }

  const std::vector<WorldScan> scans_ = worldScans();
};

TEST_F(BadScans, EmptyFilesAndCutHeadersAreLeftOut) {
  const MapOutcome without = withoutFourth();
  const std::string good = bytes("scans/000003.pcd");
  for (const std::size_t kept : {0, 1, 60, 150}) {
    writeBytes("scans/000003.pcd", good.substr(0, kept));
    expectSkipped(mapScans(), without, "scans.skipped", "000003.pcd");
    expectSkipped(mapScans({"--allow-truncated"}), without, "scans.skipped", "1 of 8");
  }
  // A cut body is another matter: what is there may be used, if that is asked for.
  writeBytes("scans/000003.pcd", good.substr(0, 9000));
  EXPECT_TRUE(mapScans().fails("input.truncated"));
  expectRight(mapScans({"--allow-truncated"}));
}

TEST_F(BadScans, HeadersWithoutDataAndLinksToLfsAreLeftOut) {
  const MapOutcome without = withoutFourth();
  const std::string pcd =
      "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 9\nHEIGHT 1\nPOINTS 9\n";
  const std::string pointer =
      "version https://git-lfs.github.com/spec/v1\noid sha256:" + std::string(64, 'a') + "\nsize 9\n";
  for (const std::string& bad : {pcd + "DATA binary\n", pcd + "DATA ascii\n", pcd + "DATA binary_compressed\n",
                                 pcd + "DATA binary\n" + std::string(11, 'x'), pointer}) {
    writeBytes("scans/000003.pcd", bad);
    expectSkipped(mapScans(), without, "scans.skipped", "000003.pcd");
  }
  // Of the first one, too.
  writeNumberedScans(scans_);
  writeBytes("scans/000000.pcd", pointer);
  const MapOutcome first = mapScans();
  expectRight(first);
  EXPECT_TRUE(first.warns("scans.skipped")) << first.program.err;
  EXPECT_NE(first.program.err.find("Git LFS pointer"), std::string::npos) << first.program.err;
  // A scan that says that it has no points is right.
  std::string none = pcd + "DATA binary\n";
  for (const char* count : {"WIDTH 9", "POINTS 9"}) none[none.find(count) + std::strlen(count) - 1] = '0';
  writeNumberedScans(scans_);
  writeBytes("scans/000003.pcd", none);
  EXPECT_FALSE(mapScans().warns("scans.skipped"));
  for (int i = 0; i < 5; ++i) writeBytes("scans/00000" + std::to_string(i) + ".pcd", pointer);
  EXPECT_TRUE(mapScans().fails("input.lfs_pointer"));
}

TEST_F(BadScans, MostOfThemAreRefused) {
  for (int i = 0; i < 5; ++i) writeBytes("scans/00000" + std::to_string(i) + ".pcd", "");
  EXPECT_TRUE(mapScans().fails("input.empty"));
}

TEST_F(BadScans, APoseThatIsNoneCostsItsScan) {
  const MapOutcome without = withoutFourth();
  const std::string poses = bytes("poses.txt");
  for (const std::string& bad :
       {std::string("0 0 0 0 0 0 0 0 0 0 0 0"), std::string("nan nan nan nan nan nan nan nan nan nan nan nan"),
        std::string("1 0 0 inf 0 1 0 0 0 0 1 0")}) {
    std::string lines;
    std::size_t begin = 0;
    for (int i = 0; i < 8; ++i) {
      const std::size_t end = poses.find('\n', begin) + 1;
      lines += i == 3 ? bad + "\n" : poses.substr(begin, end - begin);
      begin = end;
    }
    writeBytes("poses.txt", lines);
    expectSkipped(mapScans(), without, "poses.skipped", "line 4");
    expectSkipped(mapScans({"--match", "order"}), without, "poses.skipped", "1 of 8");
  }
}

TEST_F(BadScans, ScansThatAreThereTwiceCountOnce) {
  const MapOutcome once = mapScans();
  expectRight(once);
  for (const char* name : {"scans/000003 (1).pcd", "scans/000003_copy.pcd", "scans/000008.pcd"}) {
    writeBytes(name, bytes("scans/000003.pcd"));
    expectSkipped(mapScans(), once, "scans.repeated", "000003.pcd");
    std::filesystem::remove(path(name));
  }
  // With a pose of its own, it is a scan of its own.
  writeBytes("scans/000008.pcd", bytes("scans/000003.pcd"));
  const std::string poses = bytes("poses.txt");
  writeBytes("poses.txt", poses + poses.substr(0, poses.find('\n') + 1));
  EXPECT_FALSE(mapScans().warns("scans.repeated"));
  // With the same pose, it is not.
  std::size_t third = 0;
  for (int line = 0; line < 3; ++line) third = poses.find('\n', third) + 1;
  writeBytes("poses.txt", poses + poses.substr(third, poses.find('\n', third) + 1 - third));
  expectSkipped(mapScans(), once, "scans.repeated", "000008.pcd is 000003.pcd");
}

/// The fields x y z and t, seconds since the stamp; the platform goes straight from pose to pose.
class TimedScans : public BadScans {
 protected:
  void SetUp() override {
    InputTest::SetUp();
    std::string poses;
    for (std::size_t i = 0; i <= scans_.size(); ++i) {
      const WorldScan& scan = scans_[std::min(i, scans_.size() - 1)];
      const Eigen::Quaterniond q(scan.T_W_S.linear());
      const Eigen::Vector3d p = scan.T_W_S.translation();
      poses += decimals(stamp(i));
      for (const double value : {p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w()}) poses += " " + decimals(value);
      poses += "\n";
    }
    writeBytes("poses.txt", poses);
    for (std::size_t i = 0; i < scans_.size(); ++i) writeTimed(i, 1, 0);
  }
  static double stamp(std::size_t i) { return 1700000000 + 0.1 * static_cast<double>(i); }
  [[nodiscard]] Eigen::Isometry3d poseAt(std::size_t i, double share) const {
    const Eigen::Isometry3d& a = scans_[i].T_W_S;
    const Eigen::Isometry3d& b = scans_[std::min(i + 1, scans_.size() - 1)].T_W_S;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() =
        Eigen::Quaterniond(a.linear()).slerp(share, Eigen::Quaterniond(b.linear())).normalized().toRotationMatrix();
    T.translation() = (1 - share) * a.translation() + share * b.translation();
    return T;
  }
  /// @param factor, offset_s  what is wrong with the times
  void writeTimed(std::size_t i, double factor, double offset_s) const {
    const std::vector<Eigen::Vector3d>& points_W = scans_[i].points_W;
    const std::string n = std::to_string(points_W.size());
    std::string bytes = "VERSION 0.7\nFIELDS x y z t\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH " + n +
                        "\nHEIGHT 1\nPOINTS " + n + "\nDATA binary\n";
    for (std::size_t k = 0; k < points_W.size(); ++k) {
      const double share = 0.9 * static_cast<double>(k) / static_cast<double>(points_W.size());
      const Eigen::Vector3f p_S = (poseAt(i, share).inverse() * points_W[k]).cast<float>();
      const double t = 0.1 * share * factor + offset_s;
      bytes.append(reinterpret_cast<const char*>(p_S.data()), 3 * sizeof(float));
      bytes.append(reinterpret_cast<const char*>(&t), sizeof t);
    }
    writeBytes(name(i), bytes);
  }
  static std::string name(std::size_t i) { return "scans/1700000000." + std::to_string(i) + "00000.pcd"; }
};

TEST_F(TimedScans, TimesAreJudgedScanByScan) {
  const MapOutcome all = mapScans();
  expectRight(all);
  EXPECT_NE(all.program.err.find("placed by the pose at its own time"), std::string::npos) << all.program.err;
  EXPECT_FALSE(all.warns("scans.skipped")) << all.program.err;
  for (const std::size_t bad : {std::size_t{0}, std::size_t{3}}) {
    std::filesystem::rename(path(name(bad)), path("kept"));
    const MapOutcome without = mapScans();
    expectRight(without);
    for (const auto& [factor, offset_s] : {std::pair(40.0, 0.0), std::pair(12.0, 0.0), std::pair(1.0, 5000.0),
                                           std::pair(1.0, -1.0), std::pair(1e3, 0.0), std::pair(1e9, 0.0)}) {
      writeTimed(bad, factor, offset_s);
      const MapOutcome outcome = mapScans();
      expectSkipped(outcome, without, "scans.skipped", name(bad).substr(6));
      EXPECT_NE(outcome.program.err.find("placed by the pose at its own time"), std::string::npos)
          << outcome.program.err;
    }
    writeTimed(bad, 1, 0);
  }
}

TEST_F(TimedScans, AScanOfAnotherClockIsNamed) {
  std::filesystem::rename(path(name(3)), path("kept"));
  const MapOutcome without = mapScans();
  std::filesystem::rename(path("kept"), path("scans/12.5.pcd"));
  expectSkipped(mapScans(), without, "scans.skipped", "12.5");
}

TEST_F(TimedScans, TilesAndResumedRunsLeaveOutTheSame) {
  writeTimed(3, 40, 0);
  writeBytes(name(5), "");
  const MapOutcome whole = mapScans({"--checkpoint", path("state")});
  expectRight(whole);
  const std::string points = bytes("out/points.ply");
  const MapOutcome resumed = mapScans({"--resume", path("state")});
  EXPECT_EQ(resumed.program.exit_code, 0) << resumed.program.err;
  EXPECT_TRUE(resumed.warns("scans.skipped"));
  EXPECT_EQ(bytes("out/points.ply"), points);
  const MapOutcome tiled = mapScans({"--tiles", "6.4"});
  EXPECT_EQ(tiled.program.exit_code, 0) << tiled.program.err;
  EXPECT_TRUE(tiled.warns("scans.skipped")) << tiled.program.err;
}

}  // namespace
}  // namespace accessvdb::inputs_test
