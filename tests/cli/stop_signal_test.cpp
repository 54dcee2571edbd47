// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Signals: SIGHUP stops as SIGTERM does, unless it was ignored at the start, and no signal waits for ever for somebody
/// else's program.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "checkpoint_world.h"
#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

class StopSignal : public ProgramTest {
 protected:
  /// A run that gets the signal once its first checkpoint is there.
  ProgramResult stopWith(int signal) {
    constexpr int kScans = 79;
    writePoses(80);
    writeScansOf({}, folder_ / "scans", 0, kScans);
    writeBoxTool(0.9, 0.1);
    ProgramSetup setup;
    setup.arguments = mapArguments({"--tool", path("tool.obj"), "--tool-unit", "m", "--width", "64", "--height", "48",
                                    "--checkpoint", path("cp"), "--checkpoint-every", "1ms"});
    setup.signal_after = "predicted peak memory";
    setup.act = [&](pid_t process) {
      for (int n = 0; n < 10'000 && !fs::exists(folder_ / "cp" / "state.json"); ++n) usleep(1'000);
      kill(process, signal);
    };
    return runProgram(setup);
  }
};

TEST_F(StopSignal, HangupWritesACheckpoint) {
  const auto before = ::signal(SIGHUP, SIG_DFL);  // nohup may have started this test
  const ProgramResult stopped = stopWith(SIGHUP);
  ::signal(SIGHUP, before);
  ASSERT_EQ(stopped.exit_code, 128 + SIGHUP) << stopped.err;
  EXPECT_NE(stopped.err.find("stopped by SIGHUP"), std::string::npos) << stopped.err;
  EXPECT_TRUE(fs::exists(folder_ / "out" / "points.ply")) << "the finished part is saved";
  const ProgramResult resumed =
      runProgram(mapArguments({"--tool", path("tool.obj"), "--tool-unit", "m", "--resume", path("cp"), "--quiet"}));
  EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
}

TEST_F(StopSignal, HangupIsIgnoredUnderNohup) {
  const auto before = ::signal(SIGHUP, SIG_IGN);
  const ProgramResult result = stopWith(SIGHUP);
  ::signal(SIGHUP, before);
  EXPECT_EQ(result.exit_code, 0) << result.err;
}

/// Verbs that only compute and then write: one line, a code, and nothing of what was being written.
TEST_F(StopSignal, LeavesNoHalfWrittenFile) {
  writeWallScans(4, 120);
  writePoses();
  writeBoxTool(0.9, 0.1);
  const std::vector<std::string> tool = {"--tool", path("tool.obj"), "--tool-unit", "m"};
  const auto with = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), tool.begin(), tool.end());
    return arguments;
  };
  const ProgramResult mapped = runProgram(mapArguments(
      {"--voxel", "0.01", "--tool", path("tool.obj"), "--tool-unit", "m", "--checkpoint", path("cp"), "--quiet"}));
  ASSERT_EQ(mapped.exit_code, 0) << mapped.err;
  fs::create_directories(path("new"));
  const std::vector<std::string> verbs[] = {
      with({"report", "--map", path("out"), "--out", path("new/x.html")}),
      with({"render", "--width", "4000", "--height", "4000", "--out", path("new/x.png")}),
      with({"whatif", path("cp"), "--remove", "box:1.9,-1,-1,2.1,0,1", "--out", path("new")})};
  for (const auto& arguments : verbs) {
    SCOPED_TRACE(arguments.front());
    ProgramSetup setup;
    setup.arguments = arguments;
    setup.signal_after = "accessvdb: ";
    bool written = false;
    setup.act = [&](pid_t process) {
      siginfo_t ended = {};
      while (!written && waitid(P_PID, static_cast<id_t>(process), &ended, WEXITED | WNOHANG | WNOWAIT) == 0 &&
             ended.si_pid == 0) {
        for (const std::string& name : listing("new")) written = written || name.ends_with(".tmp");
      }
      kill(process, SIGTERM);
    };
    // A file may be written before the test sees that it is.
    ProgramResult stopped;
    for (int n = 0; n < 50 && stopped.exit_code != 128 + SIGTERM; ++n) {
      fs::remove_all(path("new"));
      fs::create_directories(path("new"));
      written = false;
      stopped = runProgram(setup);
    }
    EXPECT_TRUE(written);
    EXPECT_EQ(stopped.exit_code, 128 + SIGTERM) << stopped.err;
    EXPECT_NE(stopped.err.find("accessvdb: stopped by SIGTERM"), std::string::npos) << stopped.err;
    for (const std::string& name : listing("new")) EXPECT_FALSE(name.ends_with(".tmp")) << name;
  }
}

/// The decoder of LAZ files writes nothing for two minutes.
TEST_F(StopSignal, EndsARunThatWaitsForAnotherProgram) {
  writeText("scans/a.laz", "LASF");
  writeText("decoder.sh", "touch \"$1\"\nsleep 120 2>/dev/null >/dev/null\n");
  writeBoxTool(0.9, 0.1);
  const std::string decoder = "/bin/sh " + path("decoder.sh") + " " + path("waits");
  const std::vector<std::string> arguments =
      mapArguments({"--poses", "", "--sensor-at", "0,0,0", "--tool", path("tool.obj"), "--tool-unit", "m",
                    "--laz-command", decoder});
  const pid_t child = fork();
  if (child == 0) {
    std::vector<char*> argv = {const_cast<char*>("accessvdb")};
    for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    execv(ACCESSVDB_PROGRAM, argv.data());
    _exit(127);
  }
  for (int n = 0; n < 10'000 && !fs::exists(folder_ / "waits"); ++n) usleep(1'000);
  ASSERT_TRUE(fs::exists(folder_ / "waits"));
  kill(child, SIGTERM);
  int status = 0;
  pid_t ended = 0;
  constexpr auto kMost = std::chrono::seconds(30);  // it waits five seconds, on a machine that may be busy
  for (const auto begin = Clock::now(); ended == 0 && Clock::now() - begin < kMost;) {
    ended = waitpid(child, &status, WNOHANG);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  if (ended == 0) {
    kill(child, SIGKILL);
    waitpid(child, &status, 0);
  }
  EXPECT_EQ(ended, child) << "SIGTERM did not end it";
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGTERM);
}

}  // namespace
}  // namespace accessvdb::cli_test
