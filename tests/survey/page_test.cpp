// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// diff.html and whatif.html: what they say against diff.json and whatif.json, where their cells are against the
/// points, and texts that would like to be code.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>

#include "accessvdb/program/result_page.h"
#include "large/tiled_test.h"
#include "survey/survey_world.h"

namespace accessvdb::survey_test {
namespace {

using large_test::Flags;
using Json = nlohmann::json;

/// Cells of a path "M x y h1v1h-1z ...".
std::set<std::pair<int, int>> cellsOf(const std::string& html, const std::string& colour, std::size_t figure) {
  std::set<std::pair<int, int>> cells;
  std::size_t begin = 0;
  for (std::size_t n = 0; n <= figure; ++n) begin = html.find("<figure>", begin + 1);
  const std::size_t end = html.find("</figure>", begin);
  const std::size_t path = html.find("<path fill=\"" + colour + "\"", begin);
  if (path == std::string::npos || path > end) return cells;
  const std::string text = html.substr(path, html.find("/>", path) - path);
  const std::regex cell("M(\\d+) (\\d+)h1v1h-1z");
  for (std::sregex_iterator at(text.begin(), text.end(), cell), last; at != last; ++at)
    cells.emplace(std::stoi((*at)[1]), std::stoi((*at)[2]));
  return cells;
}

TEST(ResultPage, CellsAreWhereThePointsAre) {
  io::ResultPage page;
  page.kind = "Test";
  page.voxel_size_m = 1;
  page.marks = {{"one", "#111111"}, {"two", "#222222"}};
  // 10 x 4 x 2 m: cells are voxels. Of the kinds in a cell the most frequent is shown, and a mark before none.
  page.visit = [](const io::ResultPage::TakeMarked& take) {
    for (int x = 0; x < 10; ++x) {
      for (int y = 0; y < 4; ++y) take({x + 0.5, y + 0.5, 0.5}, std::nullopt);
    }
    take({2.5, 0.5, 1.5}, 0);
    take({7.5, 3.5, 0.5}, 1);
    take({7.5, 3.5, 0.5}, 1);
    take({7.5, 3.5, 1.5}, 1);
    take({7.5, 3.5, 0.5}, 0);
  };
  const std::string html = io::htmlOf(page);
  EXPECT_EQ(cellsOf(html, "#111111", 0), (std::set<std::pair<int, int>>{{2, 3}}));
  EXPECT_EQ(cellsOf(html, "#222222", 0), (std::set<std::pair<int, int>>{{7, 0}}));
  EXPECT_EQ(cellsOf(html, "#d0d4d9", 0).size(), 38U);
  // From the side: x to the right, z up.
  EXPECT_EQ(cellsOf(html, "#111111", 1), (std::set<std::pair<int, int>>{{2, 0}}));
  EXPECT_EQ(cellsOf(html, "#222222", 1), (std::set<std::pair<int, int>>{{7, 0}, {7, 1}}));
  EXPECT_NE(html.find("the bar is 1 m"), std::string::npos);
  page.visit = [](const io::ResultPage::TakeMarked&) {};
  EXPECT_EQ(io::htmlOf(page).find("<figure>"), std::string::npos);  // of nothing
}

TEST(ResultPage, TextsStayTexts) {
  io::ResultPage page;
  const std::string bad = "<script>alert(\"x\")</script> & 'y'";
  page.kind = page.title = page.client = page.site = bad;
  page.sentences = page.warnings = {bad};
  page.tables = {{bad, {bad}, {{bad}}}};
  const std::string html = io::htmlOf(page);
  EXPECT_EQ(html.find("<script"), std::string::npos);
  std::size_t found = 0;
  for (std::size_t at = html.find("&lt;script&gt;alert(&quot;x"); at != std::string::npos;
       at = html.find("&lt;script&gt;alert(&quot;x", at + 1)) {
    ++found;
  }
  EXPECT_EQ(found, 10U);  // kind, title twice, client, site, sentence, warning, heading, column, cell
  EXPECT_NE(html.find("default-src 'none'; style-src 'sha256-"), std::string::npos);
}

class Pages : public large_test::TiledTest {
 protected:
  void SetUp() override {
    TiledTest::SetUp();
    writeLabelledWalk(folder_ / "walk.ply");
    scans_ = {"--scans", path("walk.ply"), "--origin", "0,0,0"};
  }
  /// The rows of a page's table as texts without tags.
  static bool hasRow(const std::string& html, const std::vector<std::string>& cells) {
    std::string row = "<tr>";
    for (const std::string& cell : cells) {
      const bool number = cell.find_first_not_of("0123456789") == std::string::npos;
      row += (number ? "<td class=\"number\">" : "<td>") + cell + "</td>";
    }
    return html.find(row) != std::string::npos;
  }
};

TEST_F(Pages, OfADiffSayWhatItsJsonSays) {
  succeed(map({"--tiles", "off"}, "spring"));
  succeed(map({"--tiles", "off", "--corridor", "0.6"}, "autumn"));
  const Flags diff = {"diff", path("spring"), path("autumn"), "--out", path("changes"), "--quiet"};
  succeed(plus(diff, {"--html", "--title", "A <b> plan", "--client", "City", "--site", "Oak Lane"}));
  const std::string html = readText("changes/diff.html");
  const Json json = Json::parse(readText("changes/diff.json"));
  int changed = 0;
  for (const char* kind : {"opened", "closed", "relabelled", "appeared", "gone"}) {
    EXPECT_TRUE(hasRow(html, {kind, std::to_string(json.at(kind).get<int>())})) << kind;
    changed += json.at(kind).get<int>();
  }
  ASSERT_GT(changed, 10);
  EXPECT_NE(html.find("A &lt;b&gt; plan</h1>"), std::string::npos);
  EXPECT_NE(html.find("City · Oak Lane"), std::string::npos);
  EXPECT_FALSE(cellsOf(html, "#c62828", 0).empty());  // a corridor closes
  // Ours is replaced, another's is not; without --out there is nowhere to write.
  succeed(plus(diff, {"--html"}));
  EXPECT_NE(readText("changes/diff.html").find("<h1>What changed</h1>"), std::string::npos);
  writeText("changes/diff.html", "<html>mine</html>");
  refuse(plus(diff, {"--html"}), 7, "output.foreign");
  refuse({"diff", path("spring"), path("autumn"), "--html"}, 2, "usage.missing");
}

/// Each of several tools by itself, also where another one still reaches the point: against the bits of both maps.
TEST_F(Pages, OfADiffHaveARowForEachTool) {
  const Flags two = {"--tiles", "off", "--tool", "builtin:pruner", "--tool-name", "thin", "--tool-name", "arm"};
  succeed(map(two, "spring"));
  succeed(map(plus(two, {"--corridor", "0.6"}), "autumn"));
  const Ply before(readText("spring/points.ply")), after(readText("autumn/points.ply"));
  ASSERT_EQ(before.column.at("x"), after.column.at("x"));  // a corridor moves no point
  int opened[2] = {}, closed[2] = {};
  for (std::size_t n = 0; n < before.rows; ++n) {
    for (int k = 0; k < 2; ++k) {
      const bool was = (static_cast<unsigned>(before.column.at("tools")[n]) >> k & 1) != 0;
      const bool is = (static_cast<unsigned>(after.column.at("tools")[n]) >> k & 1) != 0;
      opened[k] += is && !was;
      closed[k] += was && !is;
    }
  }
  ASSERT_GT(closed[0], 0);
  ASSERT_GT(closed[1], 0);
  ASSERT_NE(closed[0], closed[1]);
  succeed({"diff", path("spring"), path("autumn"), "--out", path("changes"), "--quiet", "--html"});
  const Json tools = Json::parse(readText("changes/diff.json")).at("tools");
  const std::string html = readText("changes/diff.html");
  for (int k = 0; k < 2; ++k) {
    const std::string name = k == 0 ? "thin" : "arm";
    EXPECT_EQ(tools.at(static_cast<std::size_t>(k)),
              Json({{"name", name}, {"opened", opened[k]}, {"closed", closed[k]}}));
    EXPECT_TRUE(hasRow(html, {name, std::to_string(opened[k]), std::to_string(closed[k])}));
  }
  EXPECT_NE(html.find("one of the tools reaches"), std::string::npos);
  // With one tool there is nothing of the kind.
  succeed(map({"--tiles", "off"}, "one"));
  succeed({"diff", path("one"), path("one"), "--out", path("none"), "--quiet", "--html"});
  EXPECT_FALSE(Json::parse(readText("none/diff.json")).contains("tools"));
  EXPECT_EQ(readText("none/diff.html").find("By tool"), std::string::npos);
}

TEST_F(Pages, OfAWhatIfSayWhatItsJsonSays) {
  succeed(map({"--tiles", "off", "--checkpoint", path("state")}));
  const Flags what_if = {"whatif", path("state"), "--tool",  "builtin:pencil", "--allow-hidden-tool",
                         "--out",  path("cut"),   "--quiet", "--html"};
  succeed(plus(what_if, {"--remove", "box:-100,-100,0.2,100,100,0.6", "--site", "Oak Lane"}));
  const std::string html = readText("cut/whatif.html");
  const int opens = Json::parse(readText("cut/whatif.json")).at("opens");
  EXPECT_NE(html.find(">Tool: builtin:pencil. " + std::to_string(opens) + " surface point"), std::string::npos);
  EXPECT_NE(html.find("<p>Oak Lane</p>"), std::string::npos);
  EXPECT_EQ(cellsOf(html, "#1a7f37", 0).empty(), opens == 0);
  EXPECT_FALSE(cellsOf(html, "#d0d4d9", 0).empty());
  writeText("branches.txt", "low -100 -100 0.2 100 100 0.6\n");
  succeed(plus(what_if, {"--segments", path("branches.txt")}));
  const Json cuts = Json::parse(readText("cut/whatif.json")).at("cuts");
  const std::string page = readText("cut/whatif.html");
  for (const Json& cut : cuts) {
    EXPECT_TRUE(hasRow(page, {"1", "low", cut.at("region"), std::to_string(cut.at("opens").get<int>())}));
  }
}

}  // namespace
}  // namespace accessvdb::survey_test
