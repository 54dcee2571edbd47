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
