// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// tile plan --append: what another flight did not touch is not run again, and the bytes are those of one piece over
/// all flights.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>

#include "large/tiled_test.h"
#include "large/walk_scans.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;

class SecondFlight : public TiledTest {
 protected:
  void SetUp() override {
    TiledTest::SetUp();
    addFlight({}, 0);
  }

  /// Writes a walk that begins at x into a folder of its own, and adds it to the folder "all". @return its flags
  Flags addFlight(const Walk& walk, double x_m) {
    const fs::path flight = folder_ / ("flight" + std::to_string(flights_++));
    writeWalk(flight, walk);
    std::ifstream poses(flight / "poses.txt");
    std::ofstream moved(flight / "moved.txt"), all(path("all_poses.txt"), std::ios::app);
    fs::create_directories(path("all"));
    int scan = 0;
    for (double stamp, x, y, z; poses >> stamp >> x >> y >> z; ++scan) {
      poses.ignore(100, '\n');
      moved << stamp << " " << x + x_m << " " << y << " " << z << " 0 0 0 1\n";
      all << 1000 + scans_in_all_ << " " << x + x_m << " " << y << " " << z << " 0 0 0 1\n";
      char from[32], to[32];
      std::snprintf(from, sizeof from, "%06d.pcd", scan);
      std::snprintf(to, sizeof to, "%06d.pcd", scans_in_all_++);
      fs::copy_file(flight / "scans" / from, folder_ / "all" / to);
    }
    EXPECT_EQ(scan, walk.scans);
    return {"--scans", (flight / "scans").string(), "--poses", (flight / "moved.txt").string()};
  }
  void append(const Flags& flight) const { succeed(plus({"tile", "plan", path("out"), "--append"}, flight)); }

  /// Compares with one piece over all flights.
  void expectOnePieceOfAll() {
    const Flags first = scans_;
    scans_ = {"--scans", path("all"), "--poses", path("all_poses.txt")};
    succeed(map({"--tiles", "off"}, "one"));
    scans_ = first;
    succeed(step("merge", {"--points", path("all.ply"), "--vdb", path("all.vdb"), "--keep-rays"}));
    expectSameFiles("all.ply", "one/points.ply");
    expectSameFiles("all.vdb", "one/field.vdb");
  }

  /// Which file each tile's manifest is: another one after it was run again.
  [[nodiscard]] std::map<std::string, fs::file_time_type> manifests() const {
    std::map<std::string, fs::file_time_type> times;
    for (const auto& tile : fs::directory_iterator(path("out/tiles"))) {
      const fs::path manifest = tile.path() / "tile.json";
      if (fs::exists(manifest)) times[tile.path().filename()] = fs::last_write_time(manifest);
    }
    return times;
  }

 private:
  int flights_ = 0, scans_in_all_ = 0;
};

TEST_F(SecondFlight, RunsOnlyTheTilesThatItTouches) {
  succeed(plan({"--tiles", "6.4"}));
  succeed(step("bin"));
  succeed(step("run"));
  expectOnePieceOfAll();
  const auto first = manifests();
  ASSERT_GE(first.size(), 6u);

  // At the end of the first, and beyond: some tiles are new, some are touched again, some are not.
  append(addFlight({.scans = 2, .seed = 2}, 11));
  succeed(step("bin"));
  std::vector<std::string> todo;
  std::istringstream names(runProgram(step("list", {"--todo"})).out);
  for (std::string name; std::getline(names, name);) todo.push_back(name);
  succeed(step("run"));
  int again = 0, kept = 0, fresh = 0;
  for (const auto& [name, time] : manifests()) {
    const bool was_todo = std::find(todo.begin(), todo.end(), name) != todo.end();
    const auto before = first.find(name);
    EXPECT_EQ(was_todo, before == first.end() || before->second != time) << name;
    ++(before == first.end() ? fresh : was_todo ? again : kept);
  }
  EXPECT_GE(again, 1);
  EXPECT_GE(kept, 2);
  EXPECT_GE(fresh, 1);
  expectOnePieceOfAll();

  // A third one, over all that there is, without the rays of the others.
  succeed(step("merge"));
  ASSERT_FALSE(fs::exists(path("out/rays")));
  append(addFlight({.scans = 5, .step_m = 3, .rays = 3000, .seed = 3}, 0.7));
  succeed(step("bin"));
  succeed(step("run"));
  expectOnePieceOfAll();
}

TEST_F(SecondFlight, SaysMoreThanItsScans) {
  succeed(plan({"--tiles", "6.4"}));
  const std::string before = readText("out/plan.json");
  const Flags flight = addFlight({.scans = 2, .seed = 2}, 11);
  const Flags append_flight = plus({"tile", "plan", path("out"), "--append"}, flight);
  for (const Flags& more : {Flags{"--voxel", "0.1"}, Flags{"--tool", "builtin:pruner"}, Flags{"--corridor", "0.4"}}) {
    refuse(plus(append_flight, more), 2, "usage.append");
  }
  refuse({"tile", "plan", path("empty"), "--append", "--scans", path("scans")}, 3, "plan.missing");
  EXPECT_EQ(readText("out/plan.json"), before);
}

}  // namespace
}  // namespace accessvdb::large_test
