// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb live --budget-ms over DDS: all scans are taken, the backlog is worked off, and map --replay-log repeats
/// it.
///
/// ACCESSVDB_LIVE_SCANS=300 makes the long run of docs/live.md, ACCESSVDB_LIVE_BUDGET_MS=0 the one without a budget.
#include <sstream>

#include "live/dds_world.h"

namespace accessvdb::live_test {
namespace {

class LiveBudgetDds : public LiveDds {
 protected:
  /// @return the files of map --replay-log on the scans that were sent, whether or not they were taken
  ProgramResult replay() {
    std::string poses;
    fs::create_directories(path("sent"));
    for (std::size_t n = 0; n < sent_.size(); ++n) {
      char text[300];
      std::snprintf(text, sizeof text, "%06zu.pcd", n);
      fs::copy_file(sent_[n].file, fs::path(path("sent")) / text);
      const double* p = sent_[n].pose;
      std::snprintf(text, sizeof text, "%lld.%09lld %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n",
                    static_cast<long long>(sent_[n].stamp_ns / 1'000'000'000),
                    static_cast<long long>(sent_[n].stamp_ns % 1'000'000'000), p[0], p[1], p[2], p[3], p[4], p[5],
                    p[6]);
      poses += text;
    }
    writeText("sent.txt", poses);
    std::vector<std::string> arguments = {"map",   "--scans",        path("sent"),   "--poses",  path("sent.txt"),
                                          "--out", path("expected"), "--replay-log", path("log")};
    for (const std::string& flag : fieldFlags()) arguments.push_back(flag);
    for (const char* flag : {"--change", "full", "--free-for", "60"}) arguments.emplace_back(flag);
    return runProgram(arguments);
  }
  void expectSameFiles() const {
    for (const char* file : {"points.ply", "field_points.vdb", "field.vdb"})
      EXPECT_TRUE(readText(std::string("out/") + file) == readText(std::string("expected/") + file)) << file;
  }
};

TEST_F(LiveBudgetDds, TinyOnesAreRepeatedByMap) {
  simulate(scanCount(12));
  for (const char* update_every : {"1", "3"}) {
    SCOPED_TRACE(update_every);
    peer_codes_.clear();
    const ProgramResult result =
        live({peer("rate=10 listen='" + path("heard") + "'")}, {"--budget-ms", "1", "--update-every", update_every});
    EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
    expectPeersEndedWell();
    expectAllAccountedFor(sent_.size());
    const json& budget = report_["live"]["budget"];
    EXPECT_EQ(budget["ms"], 1) << report_["live"];
    EXPECT_LT(budget["points"], 2000) << "it begins with that, and shrinks";
    EXPECT_EQ(budget["backlog"], 0) << "it is worked off at the end";
    EXPECT_GT(budget["backlog_max"], 500);
    EXPECT_GT(budget["backlog_max_ms"], 0);
    EXPECT_GT(budget["backlog_steps"], 2);
    EXPECT_TRUE(json::parse(readText("heard.status")).contains("budget"));
    EXPECT_NE(result.err.find("points waited, none longer than"), std::string::npos) << result.err;
    const ProgramResult replayed = replay();
    ASSERT_EQ(replayed.exit_code, 0) << replayed.err;
    expectSameFiles();
    for (const char* name : {"sent", "expected", "out"}) fs::remove_all(path(name));
  }
}

/// At ten scans per second on two cores none is dropped.
TEST_F(LiveBudgetDds, ScansAreTakenAtTenPerSecond) {
  const char* const given = std::getenv("ACCESSVDB_LIVE_BUDGET_MS");
  simulate(scanCount(20));
  const ProgramResult result =
      live({peer("rate=10")}, {"--budget-ms", given != nullptr ? given : "80", "--queue", "1", "--threads", "2"});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  expectPeersEndedWell();
  expectAllAccountedFor(sent_.size());
  EXPECT_EQ(report_["live"]["taken"], sent_.size());
  std::printf("%zu scans, %s late, latency %s, budget %s, steps %s\n", sent_.size(),
              report_["live"]["late"].dump().c_str(), report_["live"]["latency_ms"].dump().c_str(),
              report_["live"]["budget"].dump().c_str(), report_["timing_ms"].dump().c_str());
  const ProgramResult replayed = replay();
  ASSERT_EQ(replayed.exit_code, 0) << replayed.err;
  expectSameFiles();
}

TEST_F(LiveBudgetDds, BadOnesAreRefused) {
  for (const auto& [budget, more] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"-1", {}}, {"0.5", {}}, {"60001", {}}, {"80", {"--rolling", path("rolling")}}}) {
    std::vector<std::string> arguments = {"live",      "--cloud",        "/a",      "--odom",      "/b",
                                          "--tool",    "builtin:pruner", "--voxel", "0.05",        "--out",
                                          path("out"), "--error-format", "json",    "--budget-ms", budget};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_NE(result.err.find("usage.budget"), std::string::npos) << result.err;
    EXPECT_FALSE(fs::exists(path("rolling")));
  }
}

}  // namespace
}  // namespace accessvdb::live_test
