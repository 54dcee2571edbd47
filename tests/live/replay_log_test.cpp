// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// map --replay-log: a live session's files, byte for byte, from its scan log and the same scans. Logs that are
/// damaged, of other scans, or of a run that no log can repeat are refused.
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "accessvdb/live_session.h"
#include "accessvdb/scan_io.h"
#include "cli/program_run.h"
#include "options/map_options.h"
#include "options/tools_given.h"
#include "output/scan_log.h"

namespace accessvdb::live_test {
namespace {

namespace fs = std::filesystem;
using cli_test::ProgramResult;
using cli_test::runProgram;
using nlohmann::json;

constexpr std::int64_t kFirst_ns = 1'700'000'000'000'000'000, kStep_ns = 100'000'000;
constexpr int kScans = 10;

class ReplayLogTest : public cli_test::ProgramTest {
 protected:
  struct Flight {
    std::vector<io::ScanRecord> scans;
    std::vector<LivePose> poses;
  };

  /// Scans and poses with times as a live stream has them.
  void simulate() {
    const ProgramResult result =
        cli_test::runLab({"simulate", "--scene", "pine", "--tree-height", "4", "--frames", std::to_string(kScans),
                          "--range-noise", "0.01", "--out", path("flight")});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    std::ifstream poses(path("flight/poses.txt"));
    std::string stamped;
    for (std::string line; std::getline(poses, line);) {
      if (line.empty() || line.front() == '#') continue;
      std::istringstream numbers(line);
      double stamp_s = 0;
      LivePose pose;
      numbers >> stamp_s;
      for (int axis = 0; axis < 3; ++axis) numbers >> pose.p_W[axis];
      double q[4];
      for (double& value : q) numbers >> value;
      ASSERT_TRUE(numbers) << line;
      pose.q_W_B = Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
      pose.stamp_ns = stampOf(flight_.poses.size());
      flight_.poses.push_back(pose);
      stamped += std::to_string(pose.stamp_ns / 1'000'000'000) + "." +
                 std::to_string(pose.stamp_ns % 1'000'000'000 / kStep_ns) + line.substr(line.find(' ')) + "\n";
    }
    writeText("stamped.txt", stamped);
    auto scans = io::ScanSequence::open({.scans = path("flight/scans"), .poses = path("stamped.txt")});
    ASSERT_EQ(scans.size(), static_cast<std::size_t>(kScans));
    for (std::size_t n = 0; n < scans.size(); ++n) flight_.scans.push_back(scans.read(n));
  }
  static std::int64_t stampOf(std::size_t n) { return kFirst_ns + static_cast<std::int64_t>(n) * kStep_ns; }

  [[nodiscard]] tools::MapOptions given() const {
    tools::MapOptions map;
    map.scans = path("flight/scans");
    map.tool.tool = "builtin:pruner";
    map.voxel_m = 0.05;
    map.range_noise_m = 0.01;
    map.common.device = "cpu";
    map.change = change_;
    if (change_ == "full") map.free_for = "60";
    return map;
  }
  [[nodiscard]] std::vector<std::string> mapFlags(const std::string& log) const {
    std::vector<std::string> flags = {"map",
                                      "--scans",
                                      path("flight/scans"),
                                      "--poses",
                                      path("stamped.txt"),
                                      "--tool",
                                      "builtin:pruner",
                                      "--voxel",
                                      "0.05",
                                      "--range-noise",
                                      "0.01",
                                      "--device",
                                      "cpu",
                                      "--change",
                                      change_,
                                      "--out",
                                      path("out"),
                                      "--replay-log",
                                      path(log),
                                      "--error-format",
                                      "json"};
    if (change_ == "full") flags.insert(flags.end(), {"--free-for", "60"});
    return flags;
  }

  /// What live does, in this process. @param between  after each scan
  void live(const LiveOptions& options, std::size_t turns_a_scan, const std::vector<bool>& sent = {}) {
    LiveSession session(tools::loadTools(given()), tools::fieldParams(given()), options);
    tools::ScanLog log(path("log"));
    bool full = false;
    const auto step = [&] {
      const auto done = session.step();
      log.dropped(session.takeDropped());
      if (!done) return false;
      log.taken(*done, session.status().surface_points);
      if (session.status().memory_full && !std::exchange(full, true)) log.note(tools::scan_log::kFull, done->stamp_ns);
      return true;
    };
    for (std::size_t n = 0; n < flight_.scans.size(); ++n) {
      if (!sent.empty() && !sent[n]) continue;
      session.addPose(flight_.poses[n]);
      session.addScan({stampOf(n), flight_.scans[n].points_S});
      for (std::size_t turn = 0; turn < turns_a_scan && step(); ++turn) {
      }
    }
    session.endOfPoses();
    while (step()) {
    }
    log.finish(session.status().allDropped());
    status_ = session.status();
    fs::create_directories(path("live"));
    session.field().write(path("live"));
  }
  void expectSameFiles() const {
    for (const char* file : {"points.ply", "field.vdb", "field_points.vdb"})
      EXPECT_TRUE(readText(std::string("live/") + file) == readText(std::string("out/") + file)) << file;
  }
  void replay() {
    const ProgramResult result = runProgram(mapFlags("log"));
    ASSERT_EQ(result.exit_code, 0) << result.err;
    expectSameFiles();
    fs::remove_all(path("out"));
  }
  /// @return the id of the refusal, which has to be one line and leave no result
  std::string refusal(const std::string& log, int exit_code, const std::vector<std::string>& more = {}) {
    writeText("bad", log);
    std::vector<std::string> flags = mapFlags("bad");
    flags.insert(flags.end(), more.begin(), more.end());
    const ProgramResult result = runProgram(flags);
    EXPECT_EQ(result.exit_code, exit_code) << result.err;
    std::string id;
    std::istringstream lines(result.err);
    for (std::string line; std::getline(lines, line);) {
      if (line.find("\"error\"") == std::string::npos) continue;
      EXPECT_EQ(id, "") << "two errors: " << result.err;
      id = json::parse(line)["id"].get<std::string>();
    }
    for (const char* file : {"points.ply", "field.vdb", "field_points.vdb", "preview.png"})
      EXPECT_FALSE(fs::exists(path(std::string("out/") + file))) << file;
    fs::remove_all(path("out"));
    return id;
  }

  Flight flight_;
  LiveStatus status_;
  std::string change_ = "full";
};

TEST_F(ReplayLogTest, HasTheFilesOfTheLiveMap) {
  simulate();
  struct Case {
    const char* change;
    double budget_ms;
    std::size_t update_every, turns_a_scan;
  };
  for (const Case& c : {Case{"full", 1, 1, 2}, Case{"block", 12, 1, 3}, Case{"full", 1, 3, 2}, Case{"full", 0, 3, 1}}) {
    SCOPED_TRACE(c.change + std::string(", budget ") + std::to_string(c.budget_ms) + " ms, every " +
                 std::to_string(c.update_every));
    change_ = c.change;
    LiveOptions options;
    options.budget_ms = c.budget_ms;
    options.update_every = c.update_every;
    live(options, c.turns_a_scan);
    EXPECT_EQ(status_.taken, kScans);
    if (c.budget_ms == 1) {
      EXPECT_GT(status_.backlog_max, 2000U);
      EXPECT_GT(status_.backlog_steps, 10U);
    }
    replay();
  }
}

/// Late scans, scans that were dropped without a trace, and a map that stopped growing are repeated, too.
TEST_F(ReplayLogTest, RepeatsWhatWasLateDroppedOrFull) {
  simulate();
  LiveOptions options;
  options.budget_ms = 1;
  options.queue_scans = 1;
  live(options, 0);
  EXPECT_GT(status_.late, 2U);
  replay();

  options = {};
  options.budget_ms = 1;
  std::vector<bool> sent(kScans, true);
  sent[3] = sent[6] = false;  // another recording has them
  live(options, 2, sent);
  replay();

  options.memory_limit_bytes = std::uint64_t{9} << 20;
  live(options, 2);
  ASSERT_TRUE(status_.memory_full);
  EXPECT_GT(status_.left_out_returns, 0U) << status_.memory_bytes;
  EXPECT_NE(readText("log").find(" full\n"), std::string::npos);
  replay();
}

TEST_F(ReplayLogTest, RefusesLogsThatAreDamaged) {
  simulate();
  LiveOptions options;
  options.budget_ms = 1;
  live(options, 2);
  const std::string log = readText("log");
  const std::size_t rows = static_cast<std::size_t>(std::count(log.begin(), log.end(), '\n')) - 2;
  const std::size_t row = log.find('\n') + 1, second = log.find('\n', row) + 1, last = log.rfind("# end");
  const std::string head = log.substr(0, row), one = log.substr(row, second - row);
  const auto with = [&](const std::string& first_row) { return head + first_row + log.substr(second); };
  const auto changed = [&](int word, const std::string& to) {
    std::istringstream words(one);
    std::string text, each;
    for (int n = 0; words >> each; ++n) text += (n > 0 ? " " : "") + (n == word ? to : each);
    return with(text + "\n");
  };
  const std::string stamp = one.substr(0, one.find(' '));

  // Cut off at any place.
  for (const std::size_t end :
       {std::size_t{0}, row - 1, row, second - 5, second, last, log.size() - 4, log.size() - 1}) {
    const std::string id = refusal(log.substr(0, end), 3);
    EXPECT_TRUE(id == "replay.damaged" || id == "replay.unfinished") << end << ": " << id;
  }
  EXPECT_EQ(refusal(log.substr(0, last), 3), "replay.unfinished");
  EXPECT_EQ(refusal(head + log.substr(second), 3), "replay.damaged") << "a row is missing";
  EXPECT_EQ(refusal(log + one, 3), "replay.damaged");
  EXPECT_EQ(refusal(log.substr(row), 3), "replay.damaged");
  EXPECT_EQ(refusal("# stamp_ns outcome waited_ms latency_ms changed_points\n" + log.substr(row), 3), "replay.damaged");

  for (const char* budget : {"-5", "nan", "NaN", "inf", "1e3", "2000000001", "99999999999999999999", "", "0x10", "3.5"})
    EXPECT_EQ(refusal(changed(5, budget), 3), "replay.damaged") << budget;
  for (const char* number : {"-1", "nan", "inf", "1e400", "x"})
    for (const int word : {2, 3, 4, 6, 7}) EXPECT_EQ(refusal(changed(word, number), 3), "replay.damaged") << number;
  for (const char* bad : {"nan", "1.5", "", "99999999999999999999"})
    EXPECT_EQ(refusal(changed(0, bad), 3), "replay.damaged") << bad;
  EXPECT_EQ(refusal(changed(1, "stolen"), 3), "replay.damaged");
  EXPECT_EQ(refusal(changed(1, "late"), 3), "replay.damaged") << "late with a budget";
  EXPECT_EQ(refusal(changed(1, "backlog"), 3), "replay.damaged") << "before any scan";
  EXPECT_EQ(refusal(changed(5, "-"), 3), "replay.damaged") << "a backlog without a budget";
  EXPECT_EQ(refusal(with(one.substr(0, one.size() - 1) + " 7\n"), 3), "replay.damaged");
  EXPECT_EQ(refusal(with("\n"), 3), "replay.damaged");
  EXPECT_EQ(refusal(with(std::string("\0\x01\xff\n", 4)), 3), "replay.damaged");
  EXPECT_EQ(refusal(with(std::string(100'000, 'x') + "\n"), 3), "replay.damaged");
  // The same scan twice.
  EXPECT_EQ(refusal(head + one + one + log.substr(second), 3), "replay.damaged");

  EXPECT_EQ(refusal(head + stamp + " queue_full\n" + log.substr(row), 4), "replay.lost");
  EXPECT_EQ(refusal(head + stamp + " failed\n" + log.substr(row), 4), "replay.lost");
  EXPECT_EQ(refusal(head + one + stamp + " changed\n" + log.substr(second), 4), "replay.lost");
  EXPECT_EQ(
      refusal(log.substr(0, last) + "# 7 more were dropped; report.json counts them by reason\n" + log.substr(last), 4),
      "replay.lost");
  EXPECT_EQ(refusal(head + "# end of 0 rows\n", 4), "replay.scans");
  EXPECT_EQ(refusal(head + stamp + " no_pose\n# end of 1 rows\n", 4), "replay.scans");

  // What is right in itself, and of something else.
  EXPECT_EQ(refusal(changed(0, std::to_string(kFirst_ns - 50'000'000)), 4), "replay.scans");
  EXPECT_EQ(refusal(changed(5, "300"), 4), "replay.differs");
  EXPECT_EQ(refusal(changed(6, "1"), 4), "replay.differs");
  EXPECT_EQ(refusal(changed(7, "1"), 4), "replay.differs");
  EXPECT_EQ(refusal(log, 4, {"--max-range", "3"}), "replay.differs");
  EXPECT_EQ(refusal(log, 2, {"--update-every", "1"}), "usage.replay");
  EXPECT_EQ(refusal(log, 2, {"--every", "2"}), "usage.replay");
  EXPECT_EQ(refusal(log, 2, {"--sequence", "2"}), "usage.replay");
  EXPECT_EQ(refusal(log, 2, {"--checkpoint", path("checkpoint")}), "usage.replay");
  EXPECT_EQ(refusal(log, 2, {"--tiles", "12.8"}), "usage.tiles");
  EXPECT_EQ(refusal(log, 2, {"--rolling", path("rolling")}), "usage.rolling");
  fs::remove(path("bad"));
  EXPECT_EQ(runProgram(mapFlags("nowhere")).exit_code, 3);
  // Dropped scans that changed nothing are no reason.
  writeText("log", head + stamp + " no_pose\n" + stamp + " paused\n" + log.substr(row, last - row) + "# end of " +
                       std::to_string(rows + 2) + " rows\n");
  replay();
}

/// A log of one recording and the scans of another that has the same times.
TEST_F(ReplayLogTest, RefusesAnotherRecording) {
  simulate();
  LiveOptions options;
  options.budget_ms = 1;
  live(options, 2);
  const ProgramResult result =
      cli_test::runLab({"simulate", "--scene", "box", "--frames", std::to_string(kScans), "--out", path("other")});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  fs::remove_all(path("flight/scans"));
  fs::rename(path("other/scans"), path("flight/scans"));
  EXPECT_EQ(refusal(readText("log"), 4), "replay.differs");
}

}  // namespace
}  // namespace accessvdb::live_test
