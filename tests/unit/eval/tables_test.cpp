// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Figures, requirements and files of the tables; runs are cached.
#include "eval/tables.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "accessvdb/error.h"
#include "eval/table_files.h"

namespace accessvdb::eval {
namespace {

namespace fs = std::filesystem;

std::string contentOf(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

TableRow someRow(TableColumn column, std::uint64_t tp, std::uint64_t fp, std::uint64_t fn, std::uint64_t tn) {
  TableRow row;
  row.table = "oracle";
  row.scene = "torus";
  row.method = column == TableColumn::Paper ? "paper" : "product";
  row.column = column;
  row.voxel_m = 0.001;
  row.figures = {tp, fp, fn, tn};
  row.paper = {42790, 53.6, 83.2, 100.0, 90.8};
  return row;
}

TEST(Confusion, FiguresAreThoseOfTheDefinition) {
  Confusion c;
  for (int n = 0; n < 6; ++n) c.add(true, true);
  for (int n = 0; n < 2; ++n) c.add(false, true);
  for (int n = 0; n < 3; ++n) c.add(true, false);
  for (int n = 0; n < 9; ++n) c.add(false, false);
  EXPECT_EQ(c.points(), 20u);
  EXPECT_DOUBLE_EQ(c.precision(), 75);
  EXPECT_DOUBLE_EQ(c.recall(), 100.0 * 6 / 9);
  EXPECT_DOUBLE_EQ(c.f1(), 100 * 2 * 0.75 * (6.0 / 9) / (0.75 + 6.0 / 9));
  EXPECT_DOUBLE_EQ(c.truthPercent(), 45);
  EXPECT_DOUBLE_EQ(Confusion().f1(), 0);
  EXPECT_DOUBLE_EQ((Confusion{0, 0, 5, 5}).precision(), 0);
  const std::vector<std::uint8_t> truth = {1, 1, 0, 0, 1}, found = {1, 0, 1, 0, 1};
  const Confusion compared = compare(truth, found);
  EXPECT_EQ(compared.true_accessible, 2u);
  EXPECT_EQ(compared.false_accessible, 1u);
  EXPECT_EQ(compared.false_blocked, 1u);
  EXPECT_EQ(compared.true_blocked, 1u);
}

TEST(TableRow, RequirementsHoldOrDoNot) {
  TableRow row = someRow(TableColumn::Product, 995, 5, 5, 1000);  // P = R = F1 = 99.5
  EXPECT_FALSE(row.met().has_value());
  row.must = Requirement::atLeast(99.5);
  EXPECT_TRUE(row.met().value());
  row.must = Requirement::atLeast(99.51);
  EXPECT_FALSE(row.met().value());
  row.must = Requirement::near(Requirement::Figure::Recall, 96, 4);
  EXPECT_TRUE(row.met().value());
  row.must = Requirement::near(Requirement::Figure::Precision, 95, 4);
  EXPECT_FALSE(row.met().value());  // too good is also outside the band
  row.must_hold = false;
  row.must.reset();
  EXPECT_FALSE(row.met().value());
}

TEST(TableFiles, RowsAreAsTheInterfaceHasThem) {
  TableResults results;
  results.rows = {someRow(TableColumn::Paper, 90, 18, 0, 92), someRow(TableColumn::Product, 100, 0, 0, 100)};
  results.rows[0].must = Requirement::near(Requirement::Figure::F1, 90.8, 4);
  results.rows[1].must = Requirement::atLeast(99.5);
  results.rows[1].more = {{"labels_unlike_batch", 0}};
  results.finished = {"oracle"};
  const fs::path folder = fs::path(testing::TempDir()) / "table_files";
  fs::create_directories(folder);
  writeTablesJson(folder / "tables.json", results, {{"command", "accessvdb-lab evaluate"}});
  writeTablesMarkdown(folder / "tables.md", results, {{"command", "accessvdb-lab evaluate"}});

  const auto json = nlohmann::json::parse(contentOf(folder / "tables.json"));
  EXPECT_EQ(json["origin"]["command"], "accessvdb-lab evaluate");
  ASSERT_EQ(json["rows"].size(), 2u);
  const auto& row = json["rows"][0];
  EXPECT_EQ(row["table"], "oracle");
  EXPECT_EQ(row["scene"], "torus");
  EXPECT_EQ(row["method"], "paper");
  EXPECT_DOUBLE_EQ(row["voxel_m"], 0.001);
  EXPECT_EQ(row["n"], 200);
  EXPECT_DOUBLE_EQ(row["gt_accessible_percent"], 45);
  EXPECT_NEAR(row["precision"], 83.333, 1e-3);
  EXPECT_DOUBLE_EQ(row["recall"], 100);
  EXPECT_NEAR(row["f1"], 90.909, 1e-3);
  EXPECT_EQ(row["paper"]["n"], 42790);
  EXPECT_DOUBLE_EQ(row["paper"]["f1"], 90.8);
  EXPECT_EQ(row["met"], true);
  EXPECT_EQ(json["rows"][1]["labels_unlike_batch"], 0);

  const std::string text = contentOf(folder / "tables.md");
  EXPECT_NE(text.find("| torus | 1 mm |  | 42,790 / 53.6 / 83.2 / 100.0 / 90.8 | 200 / 45.0 / 83.33 / 100.00 / "
                      "**90.91** | F1 86.8 .. 94.8: met | 200 / 50.0 / 100.00 / 100.00 / **100.00**"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("2 met, 0 missed"), std::string::npos);
  fs::remove_all(folder);
}

TEST(Tables, AnUnknownTableIsRefusedBeforeAnyWork) {
  TableOptions options;
  options.tables = {"oracle", "orakel"};
  int said = 0;
  options.observer.say = [&said](const std::string&) { ++said; };
  try {
    (void)makeTables(options);
    FAIL();
  } catch (const InvalidArgument& error) {
    EXPECT_EQ(error.subject(), "orakel");
    EXPECT_NE(error.problem().find("clamping"), std::string::npos);
  }
  EXPECT_EQ(said, 0);
  options.tables.clear();
  EXPECT_THROW((void)makeTables(options), InvalidArgument);
}

TEST(Tables, AStopKeepsWhatWasMade) {
  TableOptions options;
  options.tables = {"voxel"};
  options.observer.stop = [] { return true; };
  const TableResults results = makeTables(options);
  EXPECT_TRUE(results.stopped);
  EXPECT_TRUE(results.finished.empty());

  // After the first run: its row exists, and the table is not reported as finished.
  bool ran = false;
  options.tables = {"fast"};
  options.observer.say = [&](const std::string& line) { ran = ran || line.find(" F1 ") != std::string::npos; };
  options.observer.stop = [&] { return ran; };
  const TableResults later = makeTables(options);
  EXPECT_TRUE(later.stopped);
  EXPECT_TRUE(later.finished.empty());
  EXPECT_EQ(later.rows.size(), 1u);
}

TEST(SceneRunner, RemembersRunsAndTellsDifferentOnesApart) {
  Observer observer;
  ScanStore scans({}, observer);
  SceneRunner runner(scans, BackendKind::Cpu, 0, observer);
  RunRequest request = productRun("torus", 0.005);
  request.scans.frames = 30;
  const auto run = runner.run(request);
  EXPECT_GT(run->found.size(), 200u);
  EXPECT_EQ(run->found.size(), run->positions_W.size());
  EXPECT_EQ(run->found.size(), run->truth_shared.size());
  EXPECT_EQ(run->viewpoints_W.size(), 30u);
  EXPECT_GE(run->all_points, run->found.size());
  EXPECT_EQ(runner.run(request), run);
  RunRequest exact = request;
  exact.true_normals = true;
  const auto with_exact = runner.run(exact);
  EXPECT_EQ(with_exact->truth_exact.size(), run->found.size());
  EXPECT_EQ(with_exact->found, run->found);
  EXPECT_EQ(runner.run(request), with_exact);  // contains everything requested
  RunRequest clamped = request;
  clamped.params.tsdf.clamp_min_m = -0.01;
  EXPECT_NE(runner.run(clamped), with_exact);
}

// The filter selects points without changing labels, so filtered and unfiltered tables are comparable.
TEST(SceneRunner, TheConfidenceFilterChangesNoLabel) {
  Observer observer;
  ScanStore scans({}, observer);
  SceneRunner runner(scans, BackendKind::Cpu, 0, observer);
  RunRequest request = productRun("torus", 0.002);
  request.scans.frames = 40;
  const auto filtered = runner.run(request);
  request.params.scoring.confidence_min = 0;
  const auto all = runner.run(request);
  EXPECT_EQ(all->found.size(), all->all_points);
  EXPECT_LT(filtered->found.size(), all->found.size());
  std::size_t next = 0;
  for (std::size_t n = 0; n < filtered->found.size(); ++n, ++next) {
    while (next < all->found.size() && all->positions_W[next] != filtered->positions_W[n]) ++next;
    ASSERT_LT(next, all->found.size());
    EXPECT_EQ(all->found[next], filtered->found[n]);
    EXPECT_EQ(all->truth_shared[next], filtered->truth_shared[n]);
  }
}

}  // namespace
}  // namespace accessvdb::eval
