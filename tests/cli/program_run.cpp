// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "program_run.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>

namespace accessvdb::cli_test {
namespace {

[[noreturn]] void becomeProgram(const ProgramSetup& setup, int out, int err) {
  if (!setup.stdout_path.empty()) out = open(setup.stdout_path.c_str(), O_WRONLY);
  dup2(out, STDOUT_FILENO);
  dup2(err, STDERR_FILENO);
  if (setup.file_size_limit >= 0) {
    const auto bytes = static_cast<rlim_t>(setup.file_size_limit);
    const rlimit limit = {bytes, bytes};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  std::vector<char*> argv = {const_cast<char*>(setup.lab ? "accessvdb-lab" : "accessvdb")};
  for (const std::string& argument : setup.arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  // Another build's program, such as the one without PCL, can be put in its place.
  const char* other = std::getenv("ACCESSVDB_PROGRAM_UNDER_TEST");
  const char* program = other != nullptr ? other : ACCESSVDB_PROGRAM;
  execv(setup.lab ? ACCESSVDB_LAB_PROGRAM : program, argv.data());
  _exit(127);
}

/// Appends all available data. @return false at the end of the stream
bool drain(int descriptor, std::string& text) {
  std::array<char, 4096> buffer;
  const ssize_t count = read(descriptor, buffer.data(), buffer.size());
  if (count > 0) text.append(buffer.data(), static_cast<std::size_t>(count));
  return count > 0;
}

}  // namespace

ProgramResult runProgram(const ProgramSetup& setup) {
  int out[2], err[2];
  if (pipe2(out, O_CLOEXEC) != 0 || pipe2(err, O_CLOEXEC) != 0) return {};
  const pid_t child = fork();
  if (child == 0) becomeProgram(setup, out[1], err[1]);
  close(out[1]);
  close(err[1]);
  ProgramResult result;
  bool acted = setup.act == nullptr;
  std::array<pollfd, 2> streams = {pollfd{out[0], POLLIN, 0}, pollfd{err[0], POLLIN, 0}};
  while (streams[0].fd >= 0 || streams[1].fd >= 0) {
    poll(streams.data(), streams.size(), -1);
    for (std::size_t i = 0; i < streams.size(); ++i) {
      if (streams[i].fd < 0 || streams[i].revents == 0) continue;
      if (!drain(streams[i].fd, i == 0 ? result.out : result.err)) streams[i].fd = -1;
    }
    if (!acted && result.err.find(setup.signal_after) != std::string::npos) {
      setup.act(child);
      acted = true;
    }
  }
  close(out[0]);
  close(err[0]);
  int status = 0;
  waitpid(child, &status, 0);
  if (WIFEXITED(status)) result.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) result.signal = WTERMSIG(status);
  return result;
}

ProgramResult runProgram(std::vector<std::string> arguments) {
  ProgramSetup setup;
  setup.arguments = std::move(arguments);
  return runProgram(setup);
}

ProgramResult runLab(std::vector<std::string> arguments) {
  ProgramSetup setup;
  setup.arguments = std::move(arguments);
  setup.lab = true;
  return runProgram(setup);
}

void ProgramTest::SetUp() {
  std::string pattern = (std::filesystem::temp_directory_path() / "accessvdb_cli_XXXXXX").string();
  ASSERT_NE(mkdtemp(pattern.data()), nullptr);
  folder_ = pattern;
}

void ProgramTest::TearDown() {
  if (!folder_.empty()) std::filesystem::remove_all(folder_);
}

void ProgramTest::writeText(const std::string& name, const std::string& text) const {
  std::filesystem::create_directories((folder_ / name).parent_path());
  std::ofstream(folder_ / name) << text;
}

std::string ProgramTest::readText(const std::string& name) const {
  std::ostringstream text;
  text << std::ifstream(folder_ / name).rdbuf();
  return text.str();
}

void ProgramTest::writeWallScans(int scans, int points_a_side) const {
  std::ostringstream points;
  for (int row = 0; row < points_a_side; ++row) {
    for (int column = 0; column < points_a_side; ++column) {
      points << "2 " << -0.5 + (column + 0.5) / points_a_side << ' ' << -0.5 + (row + 0.5) / points_a_side << '\n';
    }
  }
  const int count = points_a_side * points_a_side;
  std::ostringstream pcd;
  pcd << "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << count
      << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count << "\nDATA ascii\n"
      << points.str();
  for (int scan = 0; scan < scans; ++scan) {
    char name[64];
    std::snprintf(name, sizeof name, "scans/%06d.000000.pcd", 100 + scan);
    writeText(name, pcd.str());
  }
}

void ProgramTest::writePoses(int poses, double first_stamp) const {
  std::ostringstream text;
  for (int pose = 0; pose < poses; ++pose) {
    text << first_stamp + pose << " 0 " << 0.1 * (pose % 10) << " 0 0 0 0 1\n";
  }
  writeText("poses.txt", text.str());
}

void ProgramTest::writeBoxTool(double length, double width) const {
  std::ostringstream obj;
  for (int corner = 0; corner < 8; ++corner) {
    obj << "v " << (corner & 1 ? length : 0) << ' ' << (corner & 2 ? width : -width) / 2 << ' '
        << (corner & 4 ? width : -width) / 2 << '\n';
  }
  obj << "f 1 3 4\nf 1 4 2\nf 5 6 8\nf 5 8 7\nf 1 2 6\nf 1 6 5\nf 3 7 8\nf 3 8 4\nf 1 5 7\nf 1 7 3\nf 2 4 8\nf 2 8 6\n";
  writeText("tool.obj", obj.str());
}

std::vector<std::string> ProgramTest::mapArguments(const std::vector<std::string>& more) const {
  std::vector<std::string> arguments = {
      "map",     "--scans", path("scans"), "--poses",   path("poses.txt"),    "--tool", "builtin:pencil",
      "--voxel", "0.05",    "--out",       path("out"), "--allow-hidden-tool"};
  for (std::size_t i = 0; i < more.size(); ++i) {
    // Replaces an existing flag, because giving it twice is an error.
    const auto known = std::find(arguments.begin(), arguments.end(), more[i]);
    if (known != arguments.end() && more[i].rfind("--", 0) == 0 && i + 1 < more.size()) {
      *(known + 1) = more[++i];
    } else {
      arguments.push_back(more[i]);
    }
  }
  // An empty value takes a flag away.
  for (auto flag = arguments.begin(); flag != arguments.end();) {
    const bool none = flag->starts_with("--") && flag + 1 != arguments.end() && (flag + 1)->empty();
    flag = none ? arguments.erase(flag, flag + 2) : flag + 1;
  }
  return arguments;
}

std::vector<std::string> ProgramTest::listing(const std::string& name) const {
  std::vector<std::string> names;
  std::error_code status;
  for (const auto& entry : std::filesystem::directory_iterator(folder_ / name, status)) {
    names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace accessvdb::cli_test
