// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb export --mcap, read by programs of others (npm: @mcap/core, protobufjs), against points.ply.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "survey/las_plot.h"

namespace accessvdb::survey_test {
namespace {

using Words = std::vector<std::string>;

class Mcap : public LasPlotTest {
 protected:
  void SetUp() override {
    LasPlotTest::SetUp();
    if (!std::filesystem::exists(npm_ + "/node_modules/protobufjs") ||
        std::system("node --version > /dev/null 2>&1") != 0) {
      GTEST_SKIP() << "node or the npm package protobufjs is missing: tools/setup_debian.sh --tests";
    }
    use({});
  }
  /// What others read, word by word.
  [[nodiscard]] std::vector<Words> linesOf(const std::string& file) const {
    const std::string command = "node " ACCESSVDB_SOURCE_DIR "/tests/survey/mcap_to_text.mjs '" + npm_ + "' '" +
                                path(file) + "' > '" + path("mcap.txt") + "'";
    EXPECT_EQ(std::system(command.c_str()), 0);
    std::vector<Words> lines;
    std::istringstream text(readText("mcap.txt"));
    for (std::string line; std::getline(text, line);) {
      std::istringstream words(line);
      Words& of_line = lines.emplace_back();
      for (std::string word; words >> word;) of_line.push_back(word);
    }
    return lines;
  }
  static std::vector<Words> beginningWith(const std::string& word, const std::vector<Words>& lines) {
    std::vector<Words> found;
    for (const Words& line : lines) {
      if (line.front() == word) found.push_back(line);
    }
    return found;
  }
  [[nodiscard]] Flags exported(const Flags& more, const std::string& out = "out") const {
    return plus({"export", "--map", path(out), "--quiet", "--mcap", path("field.mcap")}, more);
  }
  const std::string npm_ = ACCESSVDB_SOURCE_DIR "/build/npm";
};

TEST_F(Mcap, HasThePointsAndTheWaysIn) {
  succeed(map({"--tiles", "off", "--carry", "tree_id"}));
  succeed(exported({"--arrows", "100"}));
  const Ply points(readText("out/points.ply"));
  const std::vector<Words> lines = linesOf("field.mcap");
  for (const char* how : {"indexed", "streamed"}) {
    EXPECT_EQ(beginningWith(how, lines), (std::vector<Words>{{how, "/accessvdb/frame", "foxglove.FrameTransform"},
                                                             {how, "/accessvdb/points", "foxglove.PointCloud"},
                                                             {how, "/accessvdb/approaches", "foxglove.SceneUpdate"}}));
  }
  const std::vector<Words> frames = beginningWith("frame", lines);
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_EQ(frames[0][1], "world");
  EXPECT_EQ(frames[0][2], "map");
  double origin_W[3];
  for (std::size_t axis = 0; axis < 3; ++axis) origin_W[axis] = std::stod(frames[0][3 + axis]);
  EXPECT_NEAR(origin_W[0], Cloud::kEast, 0.05);  // the scanner's place, rounded to whole voxels

  std::vector<std::string> names;
  for (const Words& field : beginningWith("field", lines)) names.push_back(field[1]);
  const std::vector<Words> rows = beginningWith("point", lines);
  ASSERT_EQ(rows.size(), points.rows);
  for (std::size_t n = 0; n < rows.size(); ++n) {
    ASSERT_EQ(rows[n].size(), names.size() + 1);
    for (std::size_t c = 0; c < names.size(); ++c) {
      if (names[c] == "alpha") continue;
      const double value = std::stod(rows[n][c + 1]);
      const std::size_t axis = std::string("xyz").find(names[c]);
      if (axis < 3) {
        EXPECT_NEAR(value + origin_W[axis], points.column.at(names[c])[n], 1e-6);  // float32 within 10 m
      } else {
        EXPECT_EQ(value, points.column.at(names[c])[n]) << names[c];
      }
    }
    if (HasFailure()) return;
  }
  // Each arrow ends at an accessible point, and comes from where the tool does.
  const std::vector<Words> arrows = beginningWith("arrow", lines);
  EXPECT_GT(arrows.size(), 50U);
  EXPECT_LE(arrows.size(), 100U);
  std::size_t n = 0;
  for (const Words& arrow : arrows) {
    double from[3], to[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      from[axis] = std::stod(arrow[1 + axis]);
      to[axis] = std::stod(arrow[4 + axis]);
    }
    const auto isThere = [&] {
      const char* const axes[] = {"x", "y", "z"};
      for (int axis = 0; axis < 3; ++axis) {
        if (std::abs(to[axis] + origin_W[axis] - points.column.at(axes[axis])[n]) > 1e-6) return false;
      }
      return points.column.at("label")[n] == 1;
    };
    while (n < points.rows && !isThere()) ++n;  // in their order
    ASSERT_LT(n, points.rows);
    const char* const back[] = {"dx", "dy", "dz"};
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(from[axis] - to[axis], 6 * 0.05 * points.column.at(back[axis])[n], 1e-6);  // six voxels long
    }
  }
}

TEST_F(Mcap, OfTilesAndThinned) {
  succeed(map({"--tiles", "6.4"}));
  succeed(exported({"--arrows", "0"}));
  std::vector<Words> lines = linesOf("field.mcap");
  std::size_t points = 0;
  for (const std::string& tile : tilesOf()) points += Ply(readText("out/tiles/" + tile + "/points.ply")).rows;
  EXPECT_EQ(beginningWith("point", lines).size(), points);
  EXPECT_TRUE(beginningWith("arrow", lines).empty());
  succeed(exported({"--max-points", "100"}));
  lines = linesOf("field.mcap");
  EXPECT_LE(beginningWith("point", lines).size(), 100U);
  EXPECT_GT(beginningWith("point", lines).size(), 50U);
}

TEST_F(Mcap, RefusesInOneLine) {
  succeed(map({"--tiles", "off"}));
  refuse(exported({"--max-points", "0"}), 2, "usage.max_points");
  refuse({"export", "--map", path("out"), "--mcap", path("field.bag")}, 2, "usage.ending");
  writeText("field.mcap", "\x89MCAP0\r\n and what the user recorded");
  refuse(exported({}), 7, "output.foreign");
}

}  // namespace
}  // namespace accessvdb::survey_test
