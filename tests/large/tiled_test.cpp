// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "large/tiled_test.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <thread>

#include "large/walk_scans.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

}  // namespace

Ending runToItsEnd(const Flags& arguments, std::optional<double> kill_after_s) {
  const auto begin = Clock::now();
  const pid_t child = fork();
  if (child == 0) {
    const int nowhere = open("/dev/null", O_RDWR);
    for (int stream = 0; stream < 3; ++stream) dup2(nowhere, stream);
    std::vector<char*> argv = {const_cast<char*>("accessvdb")};
    for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    execv(ACCESSVDB_PROGRAM, argv.data());
    _exit(127);
  }
  Ending ending;
  if (kill_after_s) {
    std::this_thread::sleep_until(begin + std::chrono::duration<double>(*kill_after_s));
    kill(child, SIGKILL);  // not reaped yet, so the number still is the child's
  }
  int status = 0;
  rusage usage = {};
  wait4(child, &status, 0, &usage);
  ending.killed = WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
  if (WIFEXITED(status)) ending.exit_code = WEXITSTATUS(status);
  ending.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  ending.peak_bytes = static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;  // Linux counts in KiB
  return ending;
}

int countFrom(const char* variable, int usual) {
  const char* text = std::getenv(variable);
  return text != nullptr ? std::atoi(text) : usual;
}

std::optional<std::string> balmScans() {
  const char* given = std::getenv("ACCESSVDB_TEST_DATA");
  const std::string scans =
      (given != nullptr ? std::string(given) : std::string(ACCESSVDB_SOURCE_DIR) + "/../shared/data") +
      "/scans_poses_balm";
  if (!fs::exists(scans)) return std::nullopt;
  return scans;
}

void TiledTest::SetUp() {
  // Every file is brought to the disk before it counts. That is not what these tests are about, and it takes most of
  // their time.
  if (fs::is_directory("/dev/shm")) setenv("TMPDIR", "/dev/shm", 0);
  ProgramTest::SetUp();
  writeWalk(folder_, {});
  scans_ = {"--scans", path("scans"), "--poses", path("poses.txt")};
}

Flags TiledTest::plus(Flags flags, const Flags& more) const {
  flags.insert(flags.end(), more.begin(), more.end());
  return flags;
}

Flags TiledTest::map(const Flags& more, const std::string& out) const {
  return plus(plus(plus({"map", "--out", path(out)}, scans_), what_), more);
}

Flags TiledTest::plan(const Flags& more, const std::string& out) const {
  return plus(plus(plus({"tile", "plan", path(out)}, scans_), what_), more);
}

Flags TiledTest::step(const std::string& name, const Flags& more, const std::string& out) const {
  return plus({"tile", name, path(out)}, more);
}

std::string TiledTest::succeed(const Flags& arguments) const {
  const ProgramResult result = runProgram(arguments);
  std::string command;
  for (const std::string& argument : arguments) command += argument + " ";
  EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.err;
  return result.out + result.err;
}

std::string TiledTest::refuse(const Flags& arguments, int exit_code, const std::string& id) const {
  const ProgramResult result = runProgram(arguments);
  EXPECT_EQ(result.exit_code, exit_code) << result.err;
  std::istringstream lines(result.err);
  std::string error;
  int errors = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.find("error[") == std::string::npos) continue;
    error = line;
    ++errors;
  }
  EXPECT_EQ(errors, 1) << result.err;
  EXPECT_NE(error.find("error[" + id + "]"), std::string::npos) << result.err;
  return error;
}

std::vector<std::string> TiledTest::tilesOf(const std::string& out) const {
  std::istringstream lines(runProgram(step("list", {"--quiet"}, out)).out);
  std::vector<std::string> names;
  for (std::string line; std::getline(lines, line);) names.push_back(line);
  return names;
}

void TiledTest::expectSameFiles(const std::string& file, const std::string& expected) const {
  const std::string bytes = readText(file), expected_bytes = readText(expected);
  EXPECT_GT(expected_bytes.size(), 1000u) << expected;
  EXPECT_TRUE(bytes == expected_bytes) << file << " has " << bytes.size() << " bytes, " << expected << " has "
                                       << expected_bytes.size();
}

void TiledTest::expectOnePiece(const std::string& out) {
  if (!one_piece_) succeed(map({"--tiles", "off", "--threads", "2"}, "one_piece"));
  one_piece_ = true;
  succeed(step("merge", {"--points", path("all.ply"), "--vdb", path("all.vdb")}, out));
  expectSameFiles("all.ply", "one_piece/points.ply");
  expectSameFiles("all.vdb", "one_piece/field.vdb");
}

void TiledTest::expectNoLeftovers(const std::string& out) const {
  EXPECT_FALSE(fs::exists(folder_ / out / "rays"));
  for (const fs::path& folder : {folder_, folder_ / out}) {
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      const std::string name = entry.path().filename().string();
      EXPECT_FALSE(name.starts_with(".") || name.ends_with(".tmp") || name == "merged_points.ply") << entry.path();
    }
  }
}

void TiledTest::flipByte(const std::string& file, std::uint64_t offset) const {
  std::fstream stream(folder_ / file, std::ios::binary | std::ios::in | std::ios::out);
  ASSERT_TRUE(stream) << file;
  stream.seekg(static_cast<std::streamoff>(offset));
  const int byte = stream.get();
  ASSERT_NE(byte, EOF) << file;
  stream.seekp(static_cast<std::streamoff>(offset));
  stream.put(static_cast<char>(byte ^ 0x15));
}

std::uint64_t TiledTest::sizeOf(const std::string& file) const { return fs::file_size(folder_ / file); }

}  // namespace accessvdb::large_test
