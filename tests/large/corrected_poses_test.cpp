// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// tile plan --poses: tiles whose rays moved are made again, the others stay, and the bytes are those of one piece with
/// the poses in effect, which this test works out by itself. A folder with tiles of both is never merged.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iostream>
#include <limits>
#include <map>
#include <numbers>
#include <random>
#include <sstream>

#include "large/tiled_test.h"
#include "large/walk_scans.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;

constexpr double kHalfVoxel_m = 0.025, kDegree = std::numbers::pi / 180;

/// Upright: the rotation is one about z.
struct FlatPose {
  double stamp_s = 0, x = 0, y = 0, z = 0, yaw_rad = 0;
};
using Track = std::vector<FlatPose>;

class CorrectedPoses : public TiledTest {
 protected:
  static constexpr int kScans = 12;

  void SetUp() override {
    TiledTest::SetUp();
    fs::remove_all(path("scans"));
    writeWalk(folder_, {.scans = kScans, .rays = 5000});
    std::ifstream poses(path("poses.txt"));
    FlatPose pose;
    while (poses >> pose.stamp_s >> pose.x >> pose.y >> pose.z) {
      old_.push_back(pose);
      poses.ignore(100, '\n');
    }
    ASSERT_EQ(old_.size(), static_cast<std::size_t>(kScans));
    writeTrack("poses.txt", old_);
  }

  void writeTrack(const std::string& name, const Track& track) const {
    std::ofstream file(path(name));
    file.precision(17);
    for (const FlatPose& p : track) {
      file << p.stamp_s << " " << p.x << " " << p.y << " " << p.z << " 0 0 " << std::sin(p.yaw_rad / 2) << " "
           << std::cos(p.yaw_rad / 2) << "\n";
    }
  }

  /// A loop that closes: from a scan on, the poses drift away; those before move by less than a tenth of a millimetre.
  [[nodiscard]] Track drifted(int from) const {
    Track track = old_;
    for (int n = 0; n < kScans; ++n) {
      FlatPose& pose = track[static_cast<std::size_t>(n)];
      pose.x += n < from ? 5e-5 : 0.03 + 0.01 * (n - from);
      pose.y += n < from ? -5e-5 : 0.02 * (n - from);
      pose.yaw_rad += n < from ? 1e-6 : 0.3 * kDegree * (n - from + 1);
    }
    return track;
  }

  /// Positions of a scan as writeWalk() wrote them.
  [[nodiscard]] std::vector<std::array<float, 3>> returnsOf(std::size_t scan) const {
    char name[32];
    std::snprintf(name, sizeof name, "scans/%06zu.pcd", scan);
    const std::string file = readText(name), mark = "DATA binary\n";
    const std::size_t begin = file.find(mark) + mark.size();
    std::vector<std::array<float, 3>> returns((file.size() - begin) / 12);
    std::memcpy(returns.data(), file.data() + begin, returns.size() * 12);
    return returns;
  }

  /// How far the sensor or any return moved.
  [[nodiscard]] double farthest_m(std::size_t scan, const FlatPose& a, const FlatPose& b) const {
    const auto at = [](const FlatPose& pose, double x, double y) {
      const double s = std::sin(pose.yaw_rad), c = std::cos(pose.yaw_rad);
      return std::array{c * x - s * y + pose.x, s * x + c * y + pose.y};
    };
    double most = std::hypot(a.x - b.x, a.y - b.y, a.z - b.z);
    for (const auto& p : returnsOf(scan)) {
      const auto from = at(a, p[0], p[1]), to = at(b, p[0], p[1]);
      most = std::max(most, std::hypot(from[0] - to[0], from[1] - to[1], a.z - b.z));
    }
    return most;
  }

  /// A scan keeps its pose where nothing moved by more than half a voxel.
  [[nodiscard]] Track inEffect(const Track& before, const Track& now) const {
    Track track = before;
    for (std::size_t n = 0; n < track.size(); ++n) {
      if (farthest_m(n, before[n], now[n]) > kHalfVoxel_m) track[n] = now[n];
    }
    return track;
  }

  void makeMap(const Flags& tiles = {"--tiles", "6.4"}) const {
    succeed(plan(tiles));
    succeed(step("bin"));
    succeed(step("run"));
    succeed(step("merge"));
  }
  [[nodiscard]] Flags correct(const std::string& poses, const Flags& more = {}) const {
    return plus({"tile", "plan", path("out"), "--poses", path(poses)}, more);
  }
  void remake() const {
    succeed(step("bin"));
    succeed(step("run"));
  }

  /// One piece from the start with these poses, which its origin does not follow.
  void expectFromTheStart(const std::string& poses, const Flags& more = {}) {
    const Flags first = scans_;
    scans_ = {"--scans", path("scans"), "--poses", path(poses)};
    fs::remove_all(path("one"));
    succeed(map(plus({"--tiles", "off", "--origin", "0,0,0"}, more), "one"));
    scans_ = first;
    succeed(step("merge", {"--points", path("all.ply"), "--vdb", path("all.vdb")}));
    expectSameFiles("all.ply", "one/points.ply");
    expectSameFiles("all.vdb", "one/field.vdb");
  }
  void expectFromTheStart(const Track& track) {
    writeTrack("expected.txt", track);
    expectFromTheStart("expected.txt");
  }

  [[nodiscard]] std::vector<std::string> todo() const {
    std::vector<std::string> names;
    std::istringstream lines(runProgram(step("list", {"--todo", "--quiet"})).out);
    for (std::string name; std::getline(lines, name);) names.push_back(name);
    std::sort(names.begin(), names.end());
    return names;
  }
  /// What each tile's files are, by their names.
  [[nodiscard]] std::map<std::string, std::map<std::string, std::string>> tileBytes(const std::string& out) const {
    std::map<std::string, std::map<std::string, std::string>> bytes;
    for (const auto& tile : fs::directory_iterator(folder_ / out / "tiles")) {
      if (!fs::is_directory(tile)) continue;
      const std::string name = tile.path().filename().string();
      for (const char* file : {"points.ply", "field.vdb", "order.bin"}) {
        bytes[name][file] = readText(out + "/tiles/" + name + "/" + file);
      }
    }
    return bytes;
  }
  void copy(const std::string& from, const std::string& to) const {
    fs::remove_all(folder_ / to);
    fs::copy(folder_ / from, folder_ / to, fs::copy_options::recursive);
  }
  static bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

  Track old_;
};

TEST_F(CorrectedPoses, RemakeTheTilesWhoseRaysMoved) {
  makeMap();
  const auto before = tileBytes("out");
  const Track now = drifted(9), effective = inEffect(old_, now);
  writeTrack("new.txt", now);
  EXPECT_TRUE(has(succeed(correct("new.txt")), "3 of 12 scans move"));
  refuse(step("run"), 3, "rays.missing");
  refuse(step("merge", {"--points", path("mixed.ply")}), 3, "rays.missing");
  succeed(step("bin"));
  const std::vector<std::string> again = todo();
  ASSERT_FALSE(again.empty());
  refuse(step("merge", {"--points", path("mixed.ply")}), 4, "tile.unfinished");
  EXPECT_FALSE(fs::exists(path("mixed.ply")));
  succeed(step("run", {"--tile", again.front()}));
  refuse(step("merge", {"--points", path("mixed.ply")}), 4, "tile.unfinished");
  succeed(step("run"));
  expectFromTheStart(effective);

  // Each tile by itself: what was made again is what has other bytes, and all have those of a run from the start.
  scans_ = {"--scans", path("scans"), "--poses", path("expected.txt")};
  succeed(map({"--tiles", "6.4", "--origin", "0,0,0"}, "fresh"));
  const auto after = tileBytes("out"), fresh = tileBytes("fresh");
  EXPECT_TRUE(after == fresh);
  std::size_t kept = 0;
  for (const auto& [name, bytes] : after) {
    const bool was_todo = std::find(again.begin(), again.end(), name) != again.end();
    const auto earlier = before.find(name);
    EXPECT_EQ(was_todo, earlier == before.end() || earlier->second != bytes) << name;
    kept += was_todo ? 0 : 1;
  }
  EXPECT_GE(kept, 4u);
  EXPECT_GE(again.size(), 4u);
}

TEST_F(CorrectedPoses, AScanThatOnlyTurnsMovesByItsFarReturns) {
  makeMap();
  Track now = old_;
  // Returns are up to 6 m away, so these move by 18 and by 36 mm, the sensors by nothing.
  now[2].yaw_rad = 0.003;
  now[10].yaw_rad = 0.006;
  now[11].x += 1.02 * kHalfVoxel_m;
  now[0].x += 0.98 * kHalfVoxel_m;
  const Track effective = inEffect(old_, now);
  EXPECT_EQ(effective[2].yaw_rad, 0);
  EXPECT_NE(effective[10].yaw_rad, 0);
  EXPECT_EQ(effective[0].x, old_[0].x);
  EXPECT_EQ(effective[11].x, now[11].x);
  writeTrack("new.txt", now);
  EXPECT_TRUE(has(succeed(correct("new.txt")), "2 of 12 scans move"));
  remake();
  expectFromTheStart(effective);
}

TEST_F(CorrectedPoses, BelowHalfAVoxelTheMapStays) {
  makeMap();
  Track now = old_;
  for (FlatPose& pose : now) pose.y += 0.01;
  writeTrack("new.txt", now);
  const std::string before = readText("out/plan.json");
  EXPECT_TRUE(has(succeed(correct("new.txt")), "the map stays"));
  EXPECT_EQ(readText("out/plan.json"), before);
  EXPECT_FALSE(fs::exists(path("out/poses-1.txt")));
  expectFromTheStart(old_);
}

/// The second correction is compared with the poses in effect, not with the first ones or the last that were given.
TEST_F(CorrectedPoses, AgainAndBack) {
  makeMap();
  const Track first = inEffect(old_, drifted(6));
  writeTrack("new.txt", drifted(6));
  succeed(correct("new.txt"));
  remake();
  expectFromTheStart(first);

  Track second = drifted(6);
  for (FlatPose& pose : second) pose.y += 0.018;  // twice this is more than half a voxel
  succeed(step("run"));
  writeTrack("second.txt", second);
  EXPECT_TRUE(has(succeed(correct("second.txt")), "the map stays"));
  for (FlatPose& pose : second) pose.y += 0.018;
  writeTrack("second.txt", second);
  succeed(correct("second.txt"));
  remake();
  expectFromTheStart(inEffect(first, second));

  succeed(correct("poses.txt"));
  remake();
  expectFromTheStart(inEffect(inEffect(first, second), old_));
}

/// Who writes the new poses over the old ones has nothing to compare with: all scans take them.
TEST_F(CorrectedPoses, PosesThatWereOverwritten) {
  makeMap();
  Track now = old_;
  for (std::size_t n = 9; n < now.size(); ++n) now[n].x += 0.1;
  writeTrack("poses.txt", now);
  EXPECT_TRUE(has(succeed(correct("poses.txt")), "all scans take the new poses"));
  succeed(step("bin"));
  const auto names = tilesOf();
  EXPECT_LT(todo().size(), names.size());  // the same numbers give the same rays
  succeed(step("run"));
  expectFromTheStart("poses.txt");
}

/// Between plan and bin, they would be mixed with those of before.
TEST_F(CorrectedPoses, PosesThatChangedBehindThePlanAreNamed) {
  succeed(plan({"--tiles", "6.4"}));
  const std::string before = readText("poses.txt");
  writeTrack("poses.txt", drifted(3));
  EXPECT_TRUE(has(refuse(step("bin"), 4, "plan.changed"), "poses.txt"));
  writeText("poses.txt", before);
  remake();
  writeTrack("new.txt", drifted(3));
  succeed(correct("new.txt"));
  const std::string effective = readText("out/poses-1.txt");
  writeText("out/poses-1.txt", effective + "\n");
  EXPECT_TRUE(has(refuse(step("bin"), 4, "plan.changed"), "poses-1.txt"));
  writeText("out/poses-1.txt", effective);
  fs::remove(path("new.txt"));
  remake();
  expectFromTheStart(inEffect(old_, drifted(3)));
}

TEST_F(CorrectedPoses, PosesThatCannotBeMeant) {
  makeMap();
  const std::string before = readText("out/plan.json");
  const auto refused = [&](const Track& track, int code, const std::string& id, const Flags& more = {}) {
    SCOPED_TRACE(id);
    writeTrack("bad.txt", track);
    refuse(correct("bad.txt", more), code, id);
    EXPECT_EQ(readText("out/plan.json"), before);
    EXPECT_FALSE(fs::exists(path("out/poses-1.txt")));
  };
  Track track = drifted(6);
  track.pop_back();
  refused(track, 4, "poses.too_few");  // another recording: shorter,
  track = drifted(6);
  for (FlatPose& pose : track) pose.stamp_s += 3;
  refused(track, 4, "poses.other_scans");  // at other times,
  track = drifted(6);
  track[5].stamp_s += 0.01;
  refused(track, 4, "poses.other_scans");
  track = drifted(6);
  track[4].stamp_s = track[3].stamp_s;
  refused(track, 4, "poses.duplicate");
  track = drifted(6);
  track[4].x = std::numeric_limits<double>::quiet_NaN();
  refused(track, 4, "poses.other_scans");
  track = drifted(6);
  track[7].x += 10000;
  refused(track, 4, "poses.far", {"--allow-disagreement"});
  for (FlatPose& pose : track) pose.x += 10000;
  refused(track, 4, "poses.far");
  writeTrack("bad.txt", drifted(6));
  std::string text = readText("bad.txt");
  text.replace(text.rfind(' '), std::string::npos, " 3\n");
  writeText("bad.txt", text);
  refuse(correct("bad.txt"), 4, "poses.bad_quaternion");
  writeText("bad.txt", "");
  refuse(correct("bad.txt"), 3, "input.empty");
  refuse(correct("none.txt"), 3, "input.missing");

  writeTrack("new.txt", drifted(6));
  for (const Flags& more : {Flags{"--voxel", "0.1"}, Flags{"--corridor", "0.4"}, Flags{"--every", "2"},
                            Flags{"--fresh"}, Flags{"--tiles", "12.8"}}) {
    refuse(correct("new.txt", more), 2, "usage.poses");
  }
  refuse(correct("new.txt", {"--scans", path("elsewhere")}), 2, "usage.poses");
  refuse({"tile", "plan", path("empty"), "--poses", path("new.txt")}, 3, "plan.missing");
  fs::create_directories(path("flight"));
  writeText("flight/rolling.json", "{}");
  refuse({"tile", "plan", path("flight"), "--poses", path("new.txt")}, 2, "usage.poses");
  // The same command as before, with the corrected poses, says what is meant.
  scans_ = {"--scans", path("scans"), "--poses", path("new.txt")};
  EXPECT_TRUE(has(refuse(map({"--tiles", "6.4"}), 4, "plan.changed"), "tile plan OUT --poses"));
  EXPECT_EQ(readText("out/plan.json"), before);
  scans_ = {"--scans", path("scans"), "--poses", path("poses.txt")};
  expectFromTheStart(old_);
}

/// A tile of before, put back among the new ones by hand: its files are whole, and are not merged.
TEST_F(CorrectedPoses, ATileOfBeforeIsNotMerged) {
  makeMap();
  copy("out", "earlier");
  writeTrack("new.txt", drifted(9));
  succeed(correct("new.txt"));
  succeed(step("bin"));
  ASSERT_FALSE(todo().empty());
  const std::string name = todo().front();
  succeed(step("run"));
  copy("earlier/tiles/" + name, "out/tiles/" + name);
  EXPECT_TRUE(has(refuse(step("merge", {"--points", path("mixed.ply")}), 4, "tile.unfinished"), name));
  // Nor read as part of what field.json lists: it still lists the map of before, and others of its tiles are new.
  refuse({"query", "--map", path("out"), "--at", "17,0,-1"}, 3, "output.changed");
  succeed(step("run"));
  expectFromTheStart(inEffect(old_, drifted(9)));
}

/// Tiles that have no return any more go when the others are merged, and none of them stays beside the new ones.
TEST_F(CorrectedPoses, TilesThatAreLeftBehindGo) {
  makeMap();
  const std::vector<std::string> before = tilesOf();
  Track now = old_;
  for (std::size_t n = 8; n < now.size(); ++n) now[n].x = old_[7].x + 0.01 * static_cast<double>(n);
  writeTrack("new.txt", now);
  writeText("out/tiles/3_0/notes.txt", "of somebody");
  fs::create_directories(path("out/tiles/9_9"));
  ASSERT_TRUE(std::find(before.begin(), before.end(), "3_-1") != before.end());
  succeed(correct("new.txt", {"--allow-disagreement"}));
  remake();
  ASSERT_TRUE(fs::exists(path("out/tiles/3_-1")));
  expectFromTheStart(now);
  EXPECT_FALSE(fs::exists(path("out/tiles/3_-1")));
  EXPECT_TRUE(fs::exists(path("out/tiles/3_0/notes.txt")));
  EXPECT_TRUE(fs::exists(path("out/tiles/9_9")));
  for (const std::string& name : tilesOf()) EXPECT_TRUE(fs::exists(path("out/tiles/" + name))) << name;
}

TEST_F(CorrectedPoses, QuartersStayToo) {
  const Flags near = {"--max-range", "3"};
  succeed(plan(plus({"--tiles", "12.8"}, near)));
  succeed(step("bin"));
  for (const char* quarter : {"0_0.0", "0_0.1", "0_0.2", "0_0.3", "1_0.0"}) succeed(step("run", {"--tile", quarter}));
  succeed(step("run"));
  writeTrack("new.txt", drifted(11));
  succeed(correct("new.txt"));
  succeed(step("bin"));
  const std::vector<std::string> again = todo();
  EXPECT_EQ(std::count_if(again.begin(), again.end(), [](const auto& name) { return name.starts_with("0_0"); }), 0);
  EXPECT_EQ(std::count(again.begin(), again.end(), "1_0"), 1) << "may fit now";
  succeed(step("run"));
  writeTrack("expected.txt", inEffect(old_, drifted(11)));
  expectFromTheStart("expected.txt", near);
  EXPECT_FALSE(fs::exists(path("out/tiles/1_0.0")));
}

/// What else says where a scan is: the file in effect has it in the end, and is read without it.
TEST_F(CorrectedPoses, WithWhateverPosesTheScans) {
  const auto kitti = [&](const std::string& name, const Track& track) {
    std::ofstream file(path(name));
    file.precision(17);
    for (const FlatPose& p : track) {
      const double s = std::sin(p.yaw_rad), c = std::cos(p.yaw_rad);
      file << c << " " << -s << " 0 " << p.x << " " << s << " " << c << " 0 " << p.y << " 0 0 1 " << p.z << "\n";
    }
  };
  kitti("kitti.txt", old_);
  kitti("kitti_new.txt", drifted(8));
  writeTrack("new.txt", drifted(8));
  const std::string poses = path("poses.txt");
  struct Case {
    std::string name, poses, corrected;
    Flags more, from_start;
    std::string moved;
  };
  for (const Case& each :
       {Case{"extrinsic", "poses.txt", "new.txt", {"--extrinsic", "0.1,0,0.2,1,2,30", "--level", "1,2"}, {}, "4 of 12"},
        Case{"every second", "poses.txt", "new.txt", {"--every", "2"}, {}, "2 of 6"},
        Case{"no times", "kitti.txt", "kitti_new.txt", {}, {}, "4 of 12"},
        Case{"another format", "kitti.txt", "new.txt", {"--pose-format", "kitti"}, {}, "4 of 12"}}) {
    SCOPED_TRACE(each.name);
    fs::remove_all(path("out"));
    scans_ = {"--scans", path("scans"), "--poses", path(each.poses)};
    makeMap(plus({"--tiles", "6.4", "--allow-disagreement", "--origin", "0,0,0"}, each.more));
    EXPECT_TRUE(has(succeed(correct(each.corrected, {"--allow-disagreement"})), each.moved + " scans move"));
    succeed(step("bin"));
    EXPECT_LT(todo().size(), tilesOf().size());
    succeed(step("run"));
    expectFromTheStart("out/poses-1.txt", {"--allow-disagreement"});
  }
}

/// Of two flights one was corrected. The other's are compared with nothing.
TEST_F(CorrectedPoses, OfOneFlightAmongOthers) {
  const fs::path second = folder_ / "second";
  writeWalk(second, {.scans = 2, .seed = 2});
  succeed(plan({"--tiles", "6.4"}));
  succeed({"tile", "plan", path("out"), "--append", "--scans", (second / "scans").string(), "--poses",
           (second / "poses.txt").string()});
  remake();
  std::ofstream(second / "new.txt") << "100 0.1 0 0 0 0 0 1\n101 1.7 0.2576871 0 0 0 0 1\n";
  const Flags corrected = {"tile", "plan", path("out"), "--poses", (second / "new.txt").string()};
  refuse(corrected, 2, "usage.poses");
  succeed(plus(corrected, {"--scans", (second / "scans/").string()}));
  succeed(step("bin"));
  EXPECT_LT(todo().size(), tilesOf().size());
  succeed(step("run"));
  fs::create_directories(path("all"));
  std::ofstream poses(path("all.txt"));
  poses << readText("poses.txt") << "200 0.1 0 0 0 0 0 1\n201 1.7 0.2576871 0 0 0 0 1\n";
  poses.close();
  int count = 0;
  for (const auto& [folder, scans] : {std::pair(folder_, kScans), {second, 2}}) {
    for (int n = 0; n < scans; ++n) {
      char from[32], to[32];
      std::snprintf(from, sizeof from, "%06d.pcd", n);
      std::snprintf(to, sizeof to, "%06d.pcd", count++);
      fs::copy_file(folder / "scans" / from, folder_ / "all" / to);
    }
  }
  const Flags first = scans_;
  scans_ = {"--scans", path("all"), "--poses", path("all.txt")};
  succeed(map({"--tiles", "off", "--origin", "0,0,0"}, "one"));
  succeed(step("merge", {"--points", path("all.ply")}));
  expectSameFiles("all.ply", "one/points.ply");
}

/// A cloud in the world frame, of which only the sensor's positions are corrected: all are taken as they are given.
TEST_F(CorrectedPoses, ATrajectoryIsTakenAsItIs) {
  std::string cloud, track, corrected;
  std::size_t count = 0;
  for (std::size_t n = 0; n < old_.size(); ++n) {
    const FlatPose& pose = old_[n];
    for (const auto& p : returnsOf(n)) {
      const std::array<double, 4> row = {pose.x + p[0], pose.y + p[1], pose.z + p[2], pose.stamp_s};
      cloud.append(reinterpret_cast<const char*>(row.data()), sizeof row);
      ++count;
    }
    char line[100];
    std::snprintf(line, sizeof line, "%g %.17g %.17g %.17g\n", pose.stamp_s, pose.x, pose.y, pose.z);
    track += line;
    std::snprintf(line, sizeof line, "%g %.17g %.17g %.17g\n", pose.stamp_s, pose.x, pose.y + (n < 9 ? 0 : 0.01),
                  pose.z);
    corrected += line;
  }
  writeText("cloud.ply", "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(count) +
                             "\nproperty double x\nproperty double y\nproperty double z\nproperty double time\n"
                             "end_header\n" +
                             cloud);
  writeText("track.txt", track);
  writeText("corrected.txt", corrected);
  scans_ = {"--scans", path("cloud.ply"), "--trajectory", path("track.txt")};
  makeMap();
  EXPECT_TRUE(has(succeed({"tile", "plan", path("out"), "--trajectory", path("corrected.txt")}),
                  "all scans take the new poses: their returns have more than one pose each"));
  succeed(step("bin"));
  EXPECT_GE(todo().size(), 2u);
  EXPECT_LE(todo().size(), tilesOf().size() - 2);
  succeed(step("run"));
  scans_ = {"--scans", path("cloud.ply"), "--trajectory", path("corrected.txt")};
  succeed(map({"--tiles", "off", "--origin", "0,0,0"}, "one"));
  succeed(step("merge", {"--points", path("all.ply"), "--vdb", path("all.vdb")}));
  expectSameFiles("all.ply", "one/points.ply");
  expectSameFiles("all.vdb", "one/field.vdb");
}

/// A map whose rays were never on disk knows what they were.
TEST_F(CorrectedPoses, OfAMapThatRolled) {
  succeed(map({"--rolling", path("flight"), "--max-memory", "1G"}));
  writeTrack("new.txt", drifted(9));
  succeed(correct("new.txt"));
  refuse(step("merge"), 3, "rays.missing");
  succeed(step("bin"));
  EXPECT_LT(todo().size(), tilesOf().size());
  EXPECT_FALSE(todo().empty());
  succeed(step("run"));
  const Track first = inEffect(old_, drifted(9));
  expectFromTheStart(first);
  Track second = first;
  second.back().x += 0.1;
  writeTrack("second.txt", second);
  succeed(correct("second.txt"));
  succeed(step("bin"));
  EXPECT_LT(todo().size(), tilesOf().size());
  succeed(step("run"));
  expectFromTheStart(second);

  // Files of a tile that was scored along the way need not be those of one update at the end.
  fs::remove_all(path("out"));
  succeed(map({"--rolling", path("flight_scored"), "--max-memory", "1G", "--update-every", "2"}));
  succeed(correct("new.txt"));
  succeed(step("bin"));
  EXPECT_EQ(todo().size(), tilesOf().size());
  succeed(step("run"));
  expectFromTheStart(first);

  succeed(map({"--rolling", path("flight_full"), "--max-memory", "1G", "--change", "full"}, "full"));
  refuse({"tile", "plan", path("full"), "--poses", path("new.txt")}, 2, "usage.poses");
}

/// SIGKILL at any moment of a correction: what is merged then is the map of before, as a whole, or nothing; and the
/// same commands go on.
TEST_F(CorrectedPoses, KilledAtAnyMoment) {
  const int kills = countFrom("ACCESSVDB_KILLS", 12), seed = countFrom("ACCESSVDB_SEED", 1);
  std::mt19937_64 random(static_cast<std::uint64_t>(seed));
  makeMap();
  succeed(step("merge", {"--points", path("before.ply")}));
  writeTrack("new.txt", drifted(9));
  struct Step {
    Flags arguments;
    std::string before;
    double seconds = 0;
  };
  copy("out", "state0");
  std::vector<Step> steps = {{correct("new.txt"), "state0", 0}, {step("bin"), "state1", 0}, {step("run"), "state2", 0}};
  for (std::size_t n = 0; n < steps.size(); ++n) {
    steps[n].seconds = runToItsEnd(steps[n].arguments).seconds;
    if (n + 1 < steps.size()) copy("out", "state" + std::to_string(n + 1));
  }
  expectFromTheStart(inEffect(old_, drifted(9)));
  const std::string after = readText("all.ply"), earlier = readText("before.ply");
  ASSERT_TRUE(after != earlier);  // megabytes, which a failure would print
  int hits = 0, refused = 0;
  for (int n = 0; n < kills && !HasFailure(); ++n) {
    const std::size_t at = static_cast<std::size_t>(n) % steps.size();
    SCOPED_TRACE("step " + std::to_string(at) + ", kill " + std::to_string(n) + " of seed " + std::to_string(seed));
    copy(steps[at].before, "out");
    const double share = std::uniform_real_distribution<double>(0.05, 0.95)(random);
    hits += runToItsEnd(steps[at].arguments, share * steps[at].seconds).killed ? 1 : 0;
    fs::remove(path("merged.ply"));
    const ProgramResult merge = runProgram(step("merge", {"--points", path("merged.ply"), "--keep-rays"}));
    if (merge.exit_code == 0) {
      const std::string merged = readText("merged.ply");
      EXPECT_TRUE(merged == after || (at == 0 && merged == earlier));
    } else {
      EXPECT_TRUE(has(merge.err, "error[rays.missing]") || has(merge.err, "error[tile.unfinished]")) << merge.err;
      EXPECT_FALSE(fs::exists(path("merged.ply")));
      ++refused;
    }
    for (std::size_t next = at; next < steps.size(); ++next) succeed(steps[next].arguments);
    succeed(step("merge", {"--points", path("merged.ply")}));
    EXPECT_TRUE(readText("merged.ply") == after);
    expectNoLeftovers();
  }
  std::cout << hits << " of " << kills << " killed a running process, " << refused << " merges were refused\n";
  EXPECT_GE(hits, 0.6 * kills);
  EXPECT_GE(refused, 1);
}

}  // namespace
}  // namespace accessvdb::large_test
