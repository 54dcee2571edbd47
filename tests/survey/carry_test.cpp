// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// --carry: what the program writes, against counting here; the same in tiles, after a stop, and on one thread.
#include <gtest/gtest.h>

#include <signal.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <tuple>

#include "large/tiled_test.h"
#include "survey/survey_world.h"

namespace accessvdb::survey_test {
namespace {

using large_test::Flags;

constexpr double kVoxel_m = 0.05;

class Carry : public large_test::TiledTest {
 protected:
  void SetUp() override {
    TiledTest::SetUp();
    writeLabelledWalk(folder_ / "walk.ply");
    scans_ = {"--scans", path("walk.ply")};
    carry_ = {"--carry", "tree_id", "--carry", "class=species"};
  }
  [[nodiscard]] Ply ply(const std::string& name) const { return Ply(readText(name)); }
  Flags carry_;
};

/// Each voxel's returns are counted here, by the rule for voxels of the documentation.
TEST_F(Carry, PointsHaveWhatMostOfTheirReturnsHave) {
  succeed(map(plus(carry_, {"--tiles", "off"})));
  const Ply points = ply("out/points.ply"), returns = ply("walk.ply");
  ASSERT_EQ(points.names.back(), "species");
  ASSERT_EQ(points.names[points.names.size() - 2], "tree_id");
  double origin_W[3] = {};
  const std::size_t comment = points.header.find("comment origin_W ");
  ASSERT_EQ(std::sscanf(points.header.c_str() + comment, "comment origin_W %lf %lf %lf", origin_W, origin_W + 1,
                        origin_W + 2),
            3);
  using Voxel = std::tuple<long, long, long>;
  const auto voxelOf = [&](const Ply& ply, std::size_t row) {
    long ijk[3];
    const char* const axes[] = {"x", "y", "z"};
    for (int axis = 0; axis < 3; ++axis) {
      const double p_L = ply.column.at(axes[axis])[row] - origin_W[axis];
      ijk[axis] = static_cast<long>(std::floor(static_cast<float>(p_L) * static_cast<float>(1 / kVoxel_m) + 0.5f));
    }
    return Voxel{ijk[0], ijk[1], ijk[2]};
  };
  std::map<Voxel, std::map<double, int>> trees, classes;
  for (std::size_t n = 0; n < returns.rows; ++n) {
    ++trees[voxelOf(returns, n)][returns.column.at("tree_id")[n]];
    ++classes[voxelOf(returns, n)][returns.column.at("class")[n]];
  }
  const auto winner = [](const std::map<double, int>& votes) {
    std::pair<double, int> best = {0, 0};
    for (const auto& vote : votes) {
      if (vote.second > best.second) best = vote;
    }
    return best.first;
  };
  std::size_t split = 0, found = 0;
  for (std::size_t n = 0; n < points.rows; ++n) {
    const auto at = trees.find(voxelOf(points, n));
    if (at == trees.end()) continue;  // its first return was rounded into the neighbour
    ++found;
    split += at->second.size() > 1 ? 1 : 0;
    EXPECT_EQ(points.column.at("tree_id")[n], winner(at->second)) << "point " << n;
    EXPECT_EQ(points.column.at("species")[n], winner(classes.at(at->first))) << "point " << n;
    if (HasFailure()) return;
  }
  EXPECT_GT(found, points.rows * 999 / 1000);
  EXPECT_GT(split, points.rows / 20);  // so that votes are counted
}

TEST_F(Carry, NothingElseChanges) {
  succeed(map({"--tiles", "off"}, "without"));
  succeed(map(plus(carry_, {"--tiles", "off"})));
  const Ply with = ply("out/points.ply"), without = ply("without/points.ply");
  ASSERT_EQ(with.names.size(), without.names.size() + 2);
  for (const std::string& name : without.names) EXPECT_EQ(with.column.at(name), without.column.at(name)) << name;
}

TEST_F(Carry, TilesMergeIntoTheBytesOfOnePiece) {
  const Flags las = plus(carry_, {"--points-format", "las"});
  succeed(map(plus(las, {"--tiles", "off", "--threads", "1"}), "one_piece"));
  succeed(map(plus(las, {"--tiles", "6.4"})));
  ASSERT_GT(tilesOf().size(), 2u);
  succeed(step("merge", {"--points", path("all.ply")}));
  succeed(step("merge", {"--points", path("all.las")}));
  expectSameFiles("all.ply", "one_piece/points.ply");
  expectSameFiles("all.las", "one_piece/points.las");
}

TEST_F(Carry, AStopAndAnotherNumberOfThreadsChangeNothing) {
  const Flags run = plus(carry_, {"--tiles", "off"});
  succeed(map(plus(run, {"--threads", "1"}), "straight"));
  // Stopped after it has fused some: the checkpoint is of those.
  cli_test::ProgramSetup setup;
  setup.arguments = map(plus(run, {"--checkpoint", path("state"), "--checkpoint-every", "0"}));
  setup.signal_after = "fusing scans";
  setup.act = [](pid_t pid) { ::kill(pid, SIGTERM); };
  const auto stopped = cli_test::runProgram(setup);
  EXPECT_TRUE(stopped.exit_code == 0 || stopped.exit_code == 143) << stopped.err;  // a fast machine was done
  succeed(map(plus(run, {"--resume", path("state"), "--threads", "2"})));
  expectSameFiles("out/points.ply", "straight/points.ply");
  expectSameFiles("out/field_points.vdb", "straight/field_points.vdb");
  // With other names, or none, it would be another field.
  refuse(map({"--tiles", "off", "--carry", "tree_id", "--resume", path("state")}, "other"), 4, "state.params");
}

TEST_F(Carry, QueriesSayThem) {
  succeed(map(plus(carry_, {"--tiles", "off"})));
  const Ply points = ply("out/points.ply");
  std::size_t n = 0;
  while (points.column.at("tree_id")[n] < 0) ++n;
  char at[100];
  std::snprintf(at, sizeof at, "%.9f,%.9f,%.9f", points.column.at("x")[n], points.column.at("y")[n],
                points.column.at("z")[n]);
  const auto answer =
      nlohmann::json::parse(cli_test::runProgram({"query", "--map", path("out"), "--at", at, "--json", "--quiet"}).out);
  EXPECT_EQ(answer[0]["point"]["attributes"]["tree_id"], points.column.at("tree_id")[n]);
  EXPECT_EQ(answer[0]["point"]["attributes"]["species"], points.column.at("species")[n]);
}

TEST_F(Carry, BadNamesAndValuesAreRefusedInOneLine) {
  const auto with = [&](const std::string& name) { return map({"--tiles", "off", "--carry", name}); };
  EXPECT_NE(refuse(with("no_such"), 4, "carry.missing").find("tree_id class loudness"), std::string::npos);
  EXPECT_NE(refuse(with("loudness"), 3, "carry.value").find("loudness 0.25"), std::string::npos);
  EXPECT_NE(refuse(with("label"), 2, "carry.name").find("label=OTHER"), std::string::npos);
  refuse(with("tree id"), 2, "carry.name");
  refuse(with("@time_low"), 2, "carry.name");
  // What OpenVDB has no attributes of, and what readers or the table's first row have taken.
  for (const char* name : {"tree.id", "tree-id", "1st", "fid", "Geom", "all", "Position", "tile"}) {
    refuse(with(name), 2, "carry.name");
    refuse(with(std::string("class=") + name), 2, "carry.name");
  }
  refuse(with("class=@class"), 2, "carry.name");
  refuse(map({"--carry", "tree_id", "--carry", "class=tree_id"}), 2, "carry.name");
}

TEST_F(Carry, FourAndTwentyAreCarriedAndNoMore) {
  Flags many;
  for (int n = 0; n < 24; ++n) many = plus(many, {"--carry", "tree_id=t" + std::to_string(n)});
  succeed(map(plus(many, {"--tiles", "off", "--index"})));
  EXPECT_EQ(ply("out/points.ply").column.at("t23"), ply("out/points.ply").column.at("t0"));
  for (int n = 24; n < 27; ++n) many = plus(many, {"--carry", "tree_id=t" + std::to_string(n)});
  refuse(map(plus(many, {"--tiles", "off"})), 2, "carry.count");
}

}  // namespace
}  // namespace accessvdb::survey_test
