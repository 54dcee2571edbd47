// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What failing_calls.py has found, one test for each kind: the system refuses memory, a file or a look at one
/// (failing_calls.c), or the program crashes.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "cli/program_run.h"

namespace accessvdb::cli_test {
namespace {

using nlohmann::json;

class FailingCalls : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans(3, 16);
    writePoses(3);
  }

  /// @param fault  as in failing_calls.c
  static ProgramResult runWith(const std::string& fault, const std::vector<std::string>& arguments) {
    ProgramSetup setup;
    setup.arguments = arguments;
    return runWith(fault, setup);
  }
  static ProgramResult runWith(const std::string& fault, const ProgramSetup& setup) {
    setenv("LD_PRELOAD", ACCESSVDB_FAILING_CALLS, 1);
    setenv("FAILING_CALLS", fault.c_str(), 1);
    const ProgramResult result = runProgram(setup);
    unsetenv("LD_PRELOAD");
    unsetenv("FAILING_CALLS");
    return result;
  }

  static std::ptrdiff_t errorLines(const ProgramResult& result) {
    std::ptrdiff_t count = 0;
    for (std::size_t at = 0; (at = result.err.find("accessvdb: error[", at)) != std::string::npos; ++at) ++count;
    return count;
  }

  void expectNoTemporaryFileIn(const std::string& folder) const {
    for (const std::string& name : listing(folder)) EXPECT_EQ(name.find(".tmp"), std::string::npos) << name;
  }
};

/// From the first call in main() on, so that not even the exception or its message finds memory.
TEST_F(FailingCalls, WithoutMemoryTheProgramSaysSo) {
  for (const int first : {1, 2, 3, 10, 100, 1000, 5000, 12000, 18000}) {
    SCOPED_TRACE(first);
    const std::string fault = "malloc:" + std::to_string(first) + "+:ENOMEM";
    const ProgramResult result = runWith(fault, mapArguments({"--quiet"}));
    EXPECT_EQ(result.signal, 0) << result.err;
    EXPECT_EQ(result.exit_code, 5) << result.err;
    EXPECT_EQ(errorLines(result), 1) << result.err;
    EXPECT_NE(result.err.find("error[limit.allocation]"), std::string::npos) << result.err;
    expectNoTemporaryFileIn("out");
  }
  const ProgramResult result = runWith("malloc:100+:ENOMEM", mapArguments({"--quiet", "--error-format=json"}));
  const json line = json::parse(result.err, nullptr, false);
  ASSERT_TRUE(line.is_object()) << result.err;
  EXPECT_EQ(line["id"], "limit.allocation");
  EXPECT_EQ(line["exit_code"], 5);
  EXPECT_EQ(line.size(), 6u) << "as any other error: " << result.err;
}

TEST_F(FailingCalls, ACrashIsOneLineAndLeavesNoTemporaryFile) {
  for (const int number : {SIGSEGV, SIGABRT, SIGBUS}) {
    ProgramSetup setup;
    setup.arguments = mapArguments({"--voxel", "0.02"});
    setup.signal_after = "predicted peak memory";
    setup.act = [number](pid_t process) { kill(process, number); };
    const ProgramResult result = runProgram(setup);
    EXPECT_EQ(result.signal, 0) << result.err;
    EXPECT_EQ(result.exit_code, 70) << result.err;
    EXPECT_EQ(errorLines(result), 1) << result.err;
    EXPECT_NE(result.err.find("error[internal.crash]"), std::string::npos) << result.err;
    expectNoTemporaryFileIn("out");
  }
}

/// As a fault in a loop that all threads run.
TEST_F(FailingCalls, ThreadsThatCrashTogetherLeaveOneLine) {
  for (int round = 0; round < 5; ++round) {
    ProgramSetup setup;
    setup.arguments = mapArguments({"--voxel", "0.02"});
    setup.signal_after = "predicted peak memory";
    setup.act = [](pid_t process) {
      kill(process, SIGSTOP);
      for (const auto& thread : std::filesystem::directory_iterator("/proc/" + std::to_string(process) + "/task"))
        syscall(SYS_tgkill, process, std::stoi(thread.path().filename().string()), SIGSEGV);
      kill(process, SIGCONT);
    };
    const ProgramResult result = runProgram(setup);
    EXPECT_EQ(result.signal, 0) << result.err;
    EXPECT_EQ(result.exit_code, 70) << result.err;
    EXPECT_EQ(errorLines(result), 1) << result.err;
    expectNoTemporaryFileIn("out");
  }
}

/// As of a library that does not look whether it got memory.
TEST_F(FailingCalls, ACrashWithoutMemoryIsForWantOfMemory) {
  ProgramSetup setup;
  setup.arguments = mapArguments({"--voxel", "0.02"});
  setup.signal_after = "predicted peak memory";
  setup.act = [](pid_t process) { kill(process, SIGSEGV); };
  const ProgramResult result = runWith("mmap:30+:ENOMEM", setup);
  EXPECT_EQ(result.exit_code, 70) << "fewer calls of mmap() than are let through: " << result.err;
  bool ended = false;
  for (int first = 1; first < 30 && !ended; ++first) {
    const ProgramResult short_of_memory = runWith("mmap:" + std::to_string(first) + "+:ENOMEM", setup);
    if (short_of_memory.err.find("predicted peak memory") == std::string::npos) continue;  // ended before
    EXPECT_EQ(short_of_memory.exit_code, 5) << short_of_memory.err;
    EXPECT_EQ(errorLines(short_of_memory), 1) << short_of_memory.err;
    EXPECT_NE(short_of_memory.err.find("error[limit.allocation]"), std::string::npos) << short_of_memory.err;
    expectNoTemporaryFileIn("out");
    ended = true;
  }
  EXPECT_TRUE(ended);
}

/// The state, the manifest before it and the manifest after it are put in place one after the other.
TEST_F(FailingCalls, ACheckpointThatFailsLeavesNoStateThatNobodyNames) {
  int failed = 0;
  for (const char* call : {"rename", "sync"}) {
    for (int n = 1; n <= 7; ++n) {
      const std::string fault = call + (":" + std::to_string(n)) + ":EIO";
      SCOPED_TRACE(fault);
      std::filesystem::remove_all(path("cp"));
      std::filesystem::remove_all(path("out"));
      const ProgramResult result =
          runWith(fault, mapArguments({"--checkpoint", path("cp"), "--checkpoint-every", "0", "--quiet"}));
      failed += result.err.find("warning[checkpoint.failed]") != std::string::npos ? 1 : 0;
      std::string named;
      if (std::ifstream manifest(path("cp/state.json")); manifest)
        named = "state-" + std::to_string(json::parse(manifest)["generation"].get<int>()) + ".avst";
      for (const std::string& name : listing("cp")) EXPECT_TRUE(name == "state.json" || name == named) << name;
    }
  }
  EXPECT_GE(failed, 4) << "else the calls of a checkpoint are others";
}

/// Too many open files, a disk that does not answer: what cannot be read is not damaged, missing or another's.
TEST_F(FailingCalls, WhatCannotBeReadIsNotTakenForAnothers) {
  ASSERT_EQ(runProgram(mapArguments({"--quiet"})).exit_code, 0);
  int refused = 0;
  for (const char* error : {"open:%+:EMFILE", "read:%+:EIO", "stat:%+:EIO"}) {
    for (const int first : {1, 4, 7, 10, 13, 16, 20, 30}) {
      std::string fault = error;
      fault.replace(fault.find('%'), 1, std::to_string(first));
      SCOPED_TRACE(fault);
      const ProgramResult result = runWith(fault, mapArguments({"--quiet"}));
      EXPECT_EQ(result.signal, 0) << result.err;
      EXPECT_TRUE(result.exit_code == 3 || result.exit_code == 5 || result.exit_code == 7) << result.err;
      EXPECT_EQ(errorLines(result), 1) << result.err;
      for (const char* wrong : {"did not write it", "internal.", "not valid JSON"})
        EXPECT_EQ(result.err.find(wrong), std::string::npos) << result.err;
      ++refused;
    }
  }
  EXPECT_EQ(refused, 24);
}

}  // namespace
}  // namespace accessvdb::cli_test
