// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// table.csv: against sums over points.ply made here, against the page, in tiles, after a stop; and of a plot whose
/// trees were scanned one by one.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <vector>

#include "large/tiled_test.h"
#include "support/bytes.h"
#include "survey/survey_world.h"

namespace accessvdb::survey_test {
namespace {

using large_test::Flags;
using Row = std::map<std::string, std::string>;

class Table : public large_test::TiledTest {
 protected:
  void SetUp() override {
    TiledTest::SetUp();
    writeLabelledWalk(folder_ / "walk.ply");
    scans_ = {"--scans", path("walk.ply"), "--carry", "tree_id", "--carry", "class"};
  }
  [[nodiscard]] std::vector<Row> rowsOf(const std::string& out) const {
    return parsedCsv(readText(out + "/table.csv"));
  }
};

const char* const kReasons[] = {"confidence", "normal", "unseen", "unknown", "arm", "tool", "changed"};

TEST_F(Table, RowsAreSumsOverThePoints) {
  succeed(map({"--tiles", "off", "--html"}));
  const Ply points(readText("out/points.ply"));
  struct Sum {
    int points = 0, scored = 0;
    double area_m2 = 0, score = 0, by_reason[8] = {}, low[3] = {1e9, 1e9, 1e9}, high[3] = {-1e9, -1e9, -1e9};
    double unscored_m2 = 0;
  };
  std::map<std::string, std::map<double, Sum>> sums;
  const Vector origin_W = originOf(points);
  const auto at = [&](const char* name, std::size_t n) { return points.column.at(name)[n]; };
  for (std::size_t n = 0; n < points.rows; ++n) {
    const double area_m2 =
        sectionOf({at("x", n), at("y", n), at("z", n)}, {at("nx", n), at("ny", n), at("nz", n)}, origin_W, 0.05);
    for (const auto& [name, value] :
         {std::pair<std::string, double>{"all", 0}, {"tree_id", at("tree_id", n)}, {"class", at("class", n)}}) {
      Sum& sum = sums[name][value];
      ++sum.points;
      sum.area_m2 += area_m2;
      sum.by_reason[static_cast<int>(at("reason", n))] += area_m2;
      if (at("label", n) == 0) sum.unscored_m2 += area_m2;
      if (at("score", n) != 65535) ++sum.scored, sum.score += at("score", n);
      const char* const axes[] = {"x", "y", "z"};
      for (int axis = 0; axis < 3; ++axis) {
        sum.low[axis] = std::min(sum.low[axis], at(axes[axis], n));
        sum.high[axis] = std::max(sum.high[axis], at(axes[axis], n));
      }
    }
  }
  const std::vector<Row> rows = rowsOf("out");
  ASSERT_EQ(rows.size(), 1 + sums["tree_id"].size() + sums["class"].size());
  ASSERT_GT(rows.size(), 12u);
  EXPECT_EQ(rows[0].at("attribute"), "all");
  std::map<std::string, Exact> whole;
  double last = -1e9;
  std::string attribute;
  for (const Row& row : rows) {
    const bool all = row.at("attribute") == "all";
    const double id = all ? 0 : std::stod(row.at("id"));
    if (row.at("attribute") == attribute) {
      EXPECT_GT(id, last);
    }
    attribute = row.at("attribute"), last = id;
    const Sum& sum = sums.at(attribute).at(id);
    EXPECT_EQ(std::stoi(row.at("points")), sum.points);
    // The sum of some thousand areas that were each rounded to 1e-9.
    const double tolerance_m2 = 1e-9 * sum.points;
    EXPECT_NEAR(std::stod(row.at("area_m2")), sum.area_m2, tolerance_m2);
    EXPECT_NEAR(std::stod(row.at("accessible_m2")), sum.by_reason[0], tolerance_m2);
    EXPECT_NEAR(std::stod(row.at("unscored_m2")), sum.unscored_m2, tolerance_m2);
    EXPECT_NEAR(std::stod(row.at("accessible_share")), sum.by_reason[0] / sum.area_m2, 1e-6);  // six decimals
    for (int reason = 1; reason < 8; ++reason) {
      EXPECT_NEAR(std::stod(row.at(std::string(kReasons[reason - 1]) + "_m2")), sum.by_reason[reason], tolerance_m2);
    }
    if (sum.scored > 0) {
      EXPECT_NEAR(std::stod(row.at("mean_score")), sum.score / sum.scored, 1e-3);  // three decimals
    }
    EXPECT_EQ(std::stod(row.at("min_x")), sum.low[0]);
    EXPECT_EQ(std::stod(row.at("max_z")), sum.high[2]);
    EXPECT_NEAR(std::stod(row.at("height_m")), sum.high[2] - sum.low[2], 1e-3);
    for (const auto& [name, text] : row) {
      if (name.ends_with("_m2")) whole[attribute + " " + name] += exactly(text, 9);
    }
  }
  // To the last digit.
  for (const auto& [key, sum] : whole) {
    EXPECT_EQ(sum, whole.at("all " + key.substr(key.find(' ') + 1))) << key;
  }
  // And the page says the same.
  const std::string page = readText("out/report.html");
  const std::string mark = "<script type=\"application/json\" id=\"facts\">";
  const std::size_t begin = page.find(mark) + mark.size();
  const auto facts = nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
  Exact of_page = 0;
  for (const auto& each : facts.at("classes")) {
    of_page += static_cast<Exact>(std::llround(each.at("area_m2").get<double>() * 1e9));
  }
  EXPECT_EQ(of_page, exactly(rows[0].at("area_m2"), 9));
  ASSERT_EQ(facts.at("tables").size(), 2u);
  EXPECT_EQ(facts.at("tables")[0].at("rows_total"), sums["tree_id"].size());
}

TEST_F(Table, WhereAReturnIsHasNoRows) {
  succeed(map({"--tiles", "off", "--html"}));
  succeed(map({"--tiles", "off", "--html", "--index"}, "indexed"));
  const std::string expected = readText("out/table.csv");
  EXPECT_EQ(readText("indexed/table.csv"), expected);
  EXPECT_EQ(cli_test::runProgram({"query", "--map", path("indexed"), "--table", "--quiet"}).out, expected);
  const std::string page = readText("indexed/report.html");
  EXPECT_NE(page.find("\"attribute\":\"tree_id\""), std::string::npos);
  EXPECT_EQ(page.find("\"attribute\":\"index\""), std::string::npos);
  EXPECT_EQ(page.find("\"attribute\":\"scan\""), std::string::npos);
}

TEST_F(Table, TilesAndAStopGiveTheSameBytes) {
  succeed(map({"--tiles", "off", "--threads", "1"}, "straight"));
  succeed(map({"--tiles", "6.4"}));
  ASSERT_GT(tilesOf().size(), 2u);
  const std::string expected = readText("straight/table.csv");
  ASSERT_GT(expected.size(), 1000u);
  EXPECT_EQ(readText("out/table.csv"), expected);
  EXPECT_EQ(cli_test::runProgram({"query", "--map", path("out"), "--table", "--quiet"}).out, expected);
  succeed(map({"--tiles", "off", "--checkpoint", path("state")}, "once"));
  succeed(map({"--tiles", "off", "--resume", path("state")}, "again"));
  EXPECT_EQ(readText("again/table.csv"), expected);
  // It is an output as others are: known by its hash, replaced, and nothing of the user's.
  EXPECT_NE(readText("out/report.json").find("\"table.csv\""), std::string::npos);
  succeed(map({"--tiles", "off"}, "again"));
  writeText("mine/table.csv", "my own table\n");
  refuse(map({"--tiles", "off"}, "mine"), 7, "output.foreign");
  EXPECT_EQ(readText("mine/table.csv"), "my own table\n");
}

TEST_F(Table, OfAMapWithoutAttributesIsTheWholeAlone) {
  scans_ = {"--scans", path("walk.ply")};
  succeed(map({"--tiles", "off"}));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out/table.csv"));
  const auto rows = parsedCsv(cli_test::runProgram({"query", "--map", path("out"), "--table", "--quiet"}).out);
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].at("points"), std::to_string(Ply(readText("out/points.ply")).rows));
  refuse({"query", "--map", path("out"), "--table", "--json"}, 2, "usage.table");
}

/// Each point is a tree of its own: all are in the table, the page says how many it leaves out.
TEST_F(Table, AMillionTreesHaveARowEach) {
  constexpr std::size_t kSide = 1000, kTrees = kSide * kSide;
  // Odd, so that numbers below 2^22 are all different; some are negative.
  const auto idOf = [](std::size_t n) { return static_cast<std::int32_t>(n * 2147483u % (1u << 22)) - 1'000'000; };
  std::string bytes = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(kTrees) + "\n";
  for (const char* name : {"float x", "float y", "float z", "float nx", "float ny", "float nz", "int tree_id"})
    bytes += std::string("property ") + name + "\n";
  bytes += "end_header\n";
  for (std::size_t n = 0; n < kTrees; ++n) {
    // Ten to a metre, each in the middle of a voxel of 50 mm.
    for (const float value :
         {0.1f * static_cast<float>(n % kSide), 0.1f * static_cast<float>(n / kSide), 0.1f, 0.05f, 0.0f, 0.5f}) {
      test::put(bytes, value);
    }
    test::put(bytes, idOf(n));
  }
  writeText("million.ply", bytes);
  scans_ = {"--scans", path("million.ply"), "--carry", "tree_id", "--static", "--origin", "0,0,0"};
  succeed(map({"--tiles", "off", "--html"}));
  std::istringstream lines(readText("out/table.csv"));
  std::string line;
  std::getline(lines, line);
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_TRUE(line.starts_with("all,," + std::to_string(kTrees) + ",")) << line;
  std::vector<bool> seen(std::size_t{1} << 22);
  std::size_t rows = 0;
  std::int64_t last = -1'000'001;
  while (std::getline(lines, line)) {
    ASSERT_TRUE(line.starts_with("tree_id,")) << line;
    char* end = nullptr;
    const std::int64_t id = std::strtol(line.c_str() + 8, &end, 10);
    ASSERT_TRUE(std::string(end).starts_with(",1,")) << line;
    ASSERT_GT(id, last);
    last = id;
    seen[static_cast<std::size_t>(id + 1'000'000)] = true;
    ++rows;
  }
  EXPECT_EQ(rows, kTrees);
  for (std::size_t n = 0; n < kTrees; ++n) ASSERT_TRUE(seen[static_cast<std::size_t>(idOf(n) + 1'000'000)]) << n;
  const std::string page = readText("out/report.html");
  EXPECT_LT(page.size(), 20'000'000u);
  EXPECT_NE(page.find("\"rows_total\":1000000"), std::string::npos);
  std::size_t shown = 0;
  for (std::size_t at = page.find("\"reasons_m2\""); at != std::string::npos; at = page.find("\"reasons_m2\"", at + 1))
    ++shown;
  EXPECT_EQ(shown, 1000u);
}

/// Of several tools each has a column; against the bits of points.ply, whole and in tiles.
TEST_F(Table, EachOfSeveralToolsHasAColumn) {
  const Flags two = {"--tool", "builtin:pruner", "--tool-name", "arm", "--tool-name", "thin"};
  Flags whole = two, tiled = two;
  whole.insert(whole.end(), {"--tiles", "off"});
  tiled.insert(tiled.end(), {"--tiles", "6.4"});
  succeed(map(whole));
  succeed(map(tiled, "tiled"));
  EXPECT_EQ(readText("out/table.csv"), readText("tiled/table.csv"));
  const Ply points(readText("out/points.ply"));
  const Vector origin_W = originOf(points);
  const auto at = [&](const char* name, std::size_t n) { return points.column.at(name)[n]; };
  std::map<std::string, double> area_m2[2];
  for (std::size_t n = 0; n < points.rows; ++n) {
    const double own_m2 =
        sectionOf({at("x", n), at("y", n), at("z", n)}, {at("nx", n), at("ny", n), at("nz", n)}, origin_W, 0.05);
    for (int k = 0; k < 2; ++k) {
      if ((static_cast<unsigned>(at("tools", n)) >> k & 1) != 0)
        area_m2[k][std::to_string(static_cast<int>(at("tree_id", n)))] += own_m2;
    }
  }
  const std::vector<Row> rows = rowsOf("out");
  Exact sum[3];
  for (const Row& row : rows) {
    if (row.at("attribute") != "tree_id") continue;
    const std::string id = row.at("id").empty() ? "-2147483648" : row.at("id");
    EXPECT_NEAR(std::stod(row.at("accessible_arm_m2")), area_m2[0][id], 1e-9 * static_cast<double>(points.rows)) << id;
    EXPECT_NEAR(std::stod(row.at("accessible_thin_m2")), area_m2[1][id], 1e-9 * static_cast<double>(points.rows)) << id;
    sum[0] += exactly(row.at("accessible_arm_m2"), 9);
    sum[1] += exactly(row.at("accessible_thin_m2"), 9);
    sum[2] += exactly(row.at("accessible_m2"), 9);
  }
  EXPECT_EQ(sum[0], exactly(rows[0].at("accessible_arm_m2"), 9));
  EXPECT_EQ(sum[1], exactly(rows[0].at("accessible_thin_m2"), 9));
  EXPECT_NE(sum[0], sum[1]);
  EXPECT_LE(std::max(sum[0], sum[1]), sum[2]);  // what any of them reaches
}

/// Pines that stand 32 m apart were seen by a sensor of their own each, so each is mapped as if it were alone. Its row
/// has to be what a map of it alone says.
class PlotOfPines : public large_test::TiledTest, public testing::WithParamInterface<const char*> {};

TEST_P(PlotOfPines, EachRowIsThatOfTheTreeAlone) {
  const std::string noise = GetParam();
  constexpr int kTrees = 3, kScans = 12;
  std::filesystem::create_directories(folder_ / "plot/scans");
  std::ofstream poses(folder_ / "plot/poses.txt");
  std::vector<Row> alone;
  for (int tree = 0; tree < kTrees; ++tree) {
    const std::string name = "tree" + std::to_string(tree);
    const auto made = cli_test::runLab({"simulate", "--scene", "pine", "--frames", std::to_string(kScans), "--seed",
                                        std::to_string(tree + 1), "--range-noise", noise, "--out", path(name)});
    ASSERT_EQ(made.exit_code, 0) << made.err;
    std::ofstream own_poses(folder_ / name / "moved.txt");
    std::ifstream lines(folder_ / name / "poses.txt");
    int scan = 0;
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      double t = 0, x = 0;
      if (line.empty() || line[0] == '#' || !(words >> t >> x)) continue;
      std::string rest;
      std::getline(words, rest);
      char pose[64];
      std::snprintf(pose, sizeof pose, "%.9f %.17g", 1000.0 * tree + t, x + 32 * tree);
      poses << pose << rest << "\n";
      own_poses << pose << rest << "\n";
      ++scan;
    }
    ASSERT_EQ(scan, kScans);
    own_poses.close();
    scans_ = {"--scans", path(name + "/scans"), "--poses", path(name + "/moved.txt"), "--match", "order", "--origin",
              "0,0,0"};
    succeed(map({"--tiles", "off", "--range-noise", noise}, name + "/out"));
    alone.push_back(
        parsedCsv(cli_test::runProgram({"query", "--map", path(name + "/out"), "--table", "--quiet"}).out).at(0));
    std::vector<std::filesystem::path> files;
    for (const auto& file : std::filesystem::directory_iterator(folder_ / name / "scans")) {
      if (file.path().extension() == ".pcd") files.push_back(file.path());
    }
    std::sort(files.begin(), files.end());
    ASSERT_EQ(files.size(), static_cast<std::size_t>(kScans));
    for (std::size_t n = 0; n < files.size(); ++n) {
      std::ifstream in(files[n], std::ios::binary);
      const std::string bytes{std::istreambuf_iterator<char>(in), {}};
      const std::size_t data = bytes.find("DATA binary\n");
      ASSERT_NE(data, std::string::npos);
      ASSERT_NE(bytes.find("FIELDS x y z\n"), std::string::npos) << bytes.substr(0, 200);
      const std::string points = bytes.substr(data + 12);
      const std::size_t count = points.size() / 12;
      char to[32];
      std::snprintf(to, sizeof to, "plot/scans/%06d.pcd", tree * kScans + static_cast<int>(n));
      std::ofstream out(folder_ / to, std::ios::binary);
      out << "VERSION 0.7\nFIELDS x y z tree_id\nSIZE 4 4 4 2\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH " << count
          << "\nHEIGHT 1\nPOINTS " << count << "\nDATA binary\n";
      const std::uint16_t id = static_cast<std::uint16_t>(10 * (tree + 1));
      for (std::size_t p = 0; p < count; ++p) {
        out.write(points.data() + 12 * p, 12);
        out.write(reinterpret_cast<const char*>(&id), sizeof id);
      }
    }
  }
  poses.close();
  scans_ = {"--scans", path("plot/scans"), "--poses", path("plot/poses.txt"), "--match", "order", "--origin",
            "0,0,0",   "--carry",          "tree_id"};
  succeed(map({"--tiles", "off", "--range-noise", noise}, "plot/out"));
  const std::vector<Row> rows = parsedCsv(readText("plot/out/table.csv"));
  ASSERT_EQ(rows.size(), 1u + kTrees);
  for (int tree = 0; tree < kTrees; ++tree) {
    const Row &row = rows[static_cast<std::size_t>(tree) + 1], &expected = alone[static_cast<std::size_t>(tree)];
    EXPECT_EQ(row.at("id"), std::to_string(10 * (tree + 1)));
    EXPECT_GT(std::stoi(row.at("points")), 1000);
    for (const auto& [name, text] : expected) {
      if (name != "points" && !name.ends_with("_m2") && name != "mean_score") continue;
      EXPECT_EQ(row.at(name), text) << name;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Noise, PlotOfPines, testing::Values("0", "0.02"));

}  // namespace
}  // namespace accessvdb::survey_test
