// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// map --checkpoint killed with signal 9 at random moments, again and again, until a run gets to its end: the files are
/// those of a run that nobody disturbed, and nothing else is left.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <iostream>
#include <random>

#include "cli/checkpoint_world.h"
#include "cli/program_run.h"
#include "cli/rolling_world.h"

namespace accessvdb::cli_test {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

unsigned long numberFrom(const char* name, unsigned long fallback) {
  const char* text = std::getenv(name);
  return text == nullptr ? fallback : std::strtoul(text, nullptr, 10);
}

double secondsSince(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// How a run ended that was to be killed after some time.
struct Ended {
  bool killed = false;
  int exit_code = -1;
};

Ended runAndKill(const std::vector<std::string>& arguments, double after_s, const fs::path& log) {
  const pid_t child = fork();
  if (child == 0) {
    const int file = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
    dup2(file, STDOUT_FILENO);
    dup2(file, STDERR_FILENO);
    std::vector<char*> argv = {const_cast<char*>("accessvdb")};
    for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    const char* other = std::getenv("ACCESSVDB_PROGRAM_UNDER_TEST");  // as in program_run.cpp
    execv(other != nullptr ? other : ACCESSVDB_PROGRAM, argv.data());
    _exit(127);
  }
  usleep(static_cast<useconds_t>(1e6 * after_s));
  kill(child, SIGKILL);  // does nothing to one that has ended but was not waited for
  int status = 0;
  waitpid(child, &status, 0);
  Ended ended;
  ended.killed = WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
  if (WIFEXITED(status)) ended.exit_code = WEXITSTATUS(status);
  return ended;
}

class KilledRun : public ProgramTest {
 protected:
  /// Whether a folder has something in it that is removed later, or lacks something.
  bool isUnfinished(const std::string& name, std::size_t files) const {
    const std::size_t found = listing(name).size();
    return found != 0 && found != files;
  }
  /// How many scans are in the checkpoint.
  int scansSaved() const {
    const std::string text = readText("cp/state.json"), key = "\"next_step\": ";
    const std::size_t at = text.find(key);
    return at == std::string::npos ? 0 : std::atoi(text.c_str() + at + key.size());
  }
  /// The state that the manifest names, the manifest, and no more.
  void expectOneCheckpoint() const {
    const std::vector<std::string> names = listing("cp");
    ASSERT_EQ(names.size(), 2u) << names.front();
    EXPECT_EQ(names[1], "state.json");
    const std::string generation = names[0].substr(6, names[0].find('.') - 6);
    EXPECT_NE(readText("cp/state.json").find("\"generation\": " + generation + ","), std::string::npos);
  }
};

/// ACCESSVDB_KILLS=N for more kills, ACCESSVDB_KILL_SEED for the first one's seed.
TEST_F(KilledRun, EndsWithTheSameFiles) {
  const unsigned long kills = numberFrom("ACCESSVDB_KILLS", 8), seed = numberFrom("ACCESSVDB_KILL_SEED", 1);
  constexpr int kScans = 40;
  writeScansOf({.points_a_side = 80}, folder_ / "scans", 0, kScans);
  writePoses(kScans);
  // The memory check's pass over the scans is short beside fusing them.
  const auto arguments = [&](const std::string& out, std::vector<std::string> more) {
    more.insert(more.end(), {"--voxel", "0.02", "--device", "cpu", "--threads", "1", "--width", "160", "--height",
                             "120", "--allow-disagreement", "--out", path(out)});
    return mapArguments(more);
  };
  const Clock::time_point start = Clock::now();
  ASSERT_EQ(runProgram(arguments("straight", {})).exit_code, 0);
  double latest_s = 0.6 * secondsSince(start);  // of a kill; a few kills shall all come in time
  std::vector<std::string> outputs = comparedOutputs();
  outputs.push_back("report.json");
  std::sort(outputs.begin(), outputs.end());

  unsigned long done = 0, hit = 0, finished = 0, halfway = 0, in_checkpoint = 0, in_outputs = 0;
  // More of them where none left a run halfway yet, or too many came after the end.
  const auto go_on = [&] { return done < kills || ((halfway == 0 || 5 * hit < 4 * done) && done < 4 * kills); };
  while (go_on() && !HasFailure()) {
    fs::remove_all(folder_ / "out");
    fs::remove_all(folder_ / "cp");
    const std::vector<std::string> resumable =
        arguments("out", {"--checkpoint", path("cp"), "--resume", path("cp"), "--checkpoint-every", "1ms"});
    // A few kills a run: each leaves it farther on, so that all of its stages are hit.
    bool killed = true;
    for (int n = 0; n < 4 && go_on() && killed; ++n, ++done) {
      std::mt19937_64 random(seed + done);
      const double after_s = latest_s * std::uniform_real_distribution<double>(0.02, 1)(random);
      const Ended ended = runAndKill(resumable, after_s, folder_ / "log");
      killed = ended.killed;
      // About one in nine comes too late, and most after the first checkpoint, however busy the machine is.
      latest_s *= !killed ? 0.85 : scansSaved() == 0 ? 1.15 : 1.02;
      hit += killed ? 1 : 0;
      halfway += killed && scansSaved() > 0 && scansSaved() < kScans ? 1 : 0;
      in_checkpoint += killed && isUnfinished("cp", 2) ? 1 : 0;
      in_outputs += killed && isUnfinished("out", 5) ? 1 : 0;
      std::cout << "ACCESSVDB_KILL_SEED=" << seed + done << " after " << after_s
                << " s: " << (ended.killed ? "killed" : "had ended") << std::endl;
      ASSERT_TRUE(ended.killed || ended.exit_code == 0) << ended.exit_code << "\n" << readText("log");
    }
    const ProgramResult last = runProgram(resumable);
    ASSERT_EQ(last.exit_code, 0) << last.err;
    ++finished;
    for (const std::string& name : comparedOutputs()) {
      const std::string expected = contentOf(folder_ / "straight" / name);
      EXPECT_FALSE(expected.empty()) << name;
      EXPECT_TRUE(expected == contentOf(folder_ / "out" / name)) << name << " differs";
    }
    EXPECT_EQ(listing("out"), outputs) << "nothing else may be left";
    expectOneCheckpoint();
  }
  std::cout << hit << " of " << done << " kills hit a running process, " << in_checkpoint
            << " of them in the middle of a checkpoint and " << in_outputs << " in the middle of the outputs; "
            << halfway << " left a checkpoint of some of the scans; " << finished << " runs got to the end\n";
  EXPECT_GE(5 * hit, 4 * done) << "too many kills came after the end";
  EXPECT_GT(halfway, 0u) << "no run had to go on from the middle";
}

/// map --rolling: at most what came after the last checkpoint is lost, so the result has the same bytes.
TEST_F(KilledRun, RollingEndsWithTheSameTiles) {
  const unsigned long kills = numberFrom("ACCESSVDB_KILLS", 6), seed = numberFrom("ACCESSVDB_KILL_SEED", 1);
  writeRollingWorld({.scans = 60, .step_m = 2, .returns_home = true}, folder_);
  const auto arguments = [&](const std::string& roll, const std::string& out, std::vector<std::string> more) {
    more.insert(more.begin(), {"--threads", "1", "--rolling", path(roll), "--out", path(out)});
    return mapOfRollingWorld(folder_, more);
  };
  const Clock::time_point start = Clock::now();
  ASSERT_EQ(runProgram(arguments("straight_roll", "straight", {})).exit_code, 0);
  double latest_s = 0.8 * secondsSince(start);
  unsigned long hit = 0, done = 0, went_on = 0;
  while (done < kills && !HasFailure()) {
    fs::remove_all(folder_ / "out");
    fs::remove_all(folder_ / "roll");
    const std::vector<std::string> resumable =
        arguments("roll", "out", {"--resume", path("roll"), "--checkpoint-every", "1ms"});
    bool killed = true;
    for (int n = 0; n < 4 && done < kills && killed; ++n, ++done) {
      std::mt19937_64 random(seed + done);
      const double after_s = latest_s * std::uniform_real_distribution<double>(0.1, 1)(random);
      const Ended ended = runAndKill(resumable, after_s, folder_ / "log");
      killed = ended.killed;
      latest_s *= !killed ? 0.85 : 1.1;
      hit += killed ? 1 : 0;
      std::cout << "ACCESSVDB_KILL_SEED=" << seed + done << " after " << after_s
                << " s: " << (ended.killed ? "killed" : "had ended") << std::endl;
      ASSERT_TRUE(ended.killed || ended.exit_code == 0) << ended.exit_code << "\n" << readText("log");
    }
    const ProgramResult last = runProgram(resumable);
    ASSERT_EQ(last.exit_code, 0) << last.err;
    went_on += last.err.find("going on after ") != std::string::npos ? 1 : 0;
    for (const std::string name : {"straight", "out"}) {
      ASSERT_EQ(runProgram({"tile", "merge", path(name), "--points", path(name + ".ply")}).exit_code, 0);
    }
    const std::string expected = contentOf(folder_ / "straight.ply");
    EXPECT_FALSE(expected.empty());
    EXPECT_TRUE(expected == contentOf(folder_ / "out.ply"));
    EXPECT_EQ(listing("roll").size(), listing("straight_roll").size()) << "nothing else may be left";
  }
  std::cout << hit << " of " << done << " kills hit a running process, " << went_on << " last runs went on\n";
  EXPECT_GE(2 * hit, done) << "too many kills came after the end";
  EXPECT_GT(went_on, 0u) << "no run had to go on";
}

}  // namespace
}  // namespace accessvdb::cli_test
