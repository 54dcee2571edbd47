// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Runs the built program as a user would, and examines its output.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/types.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace accessvdb::cli_test {

struct ProgramResult {
  int exit_code = -1;  ///< -1 if a signal ended it
  int signal = 0;
  std::string out, err;
};

struct ProgramSetup {
  std::vector<std::string> arguments;
  bool lab = false;           ///< accessvdb-lab instead of accessvdb
  long file_size_limit = -1;  ///< bytes, as in ulimit -f; -1 = none
  std::string stdout_path;    ///< instead of capturing
  std::string signal_after;   ///< once this text appears on stderr, `act` is called with the process id
  std::function<void(pid_t)> act;
};

[[nodiscard]] ProgramResult runProgram(const ProgramSetup& setup);
[[nodiscard]] ProgramResult runProgram(std::vector<std::string> arguments);
[[nodiscard]] ProgramResult runLab(std::vector<std::string> arguments);

/// While it lives, a folder is locked, as by another run that writes into it.
class FolderOfAnother {
 public:
  explicit FolderOfAnother(const std::filesystem::path& folder)
      : descriptor_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    EXPECT_EQ(::flock(descriptor_, LOCK_EX | LOCK_NB), 0);
  }
  ~FolderOfAnother() { ::close(descriptor_); }
  FolderOfAnother(const FolderOfAnother&) = delete;
  FolderOfAnother& operator=(const FolderOfAnother&) = delete;

 private:
  int descriptor_;
};

/// A separate folder for each test, with tiny inputs; removed afterwards.
class ProgramTest : public ::testing::Test {
 protected:
  void SetUp() override;
  void TearDown() override;

  [[nodiscard]] std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void writeText(const std::string& name, const std::string& text) const;
  [[nodiscard]] std::string readText(const std::string& name) const;

  /// A folder "scans" with ascii PCD files of a wall 1 m x 1 m, 2 m in front of the sensor, named by time stamp.
  void writeWallScans(int scans = 4, int points_a_side = 40) const;
  /// "poses.txt" (TUM) for writeWallScans(): steps of 0.1 m along y, stamps from `first_stamp` in steps of 1 s.
  void writePoses(int poses = 4, double first_stamp = 100) const;
  /// "tool.obj": a box of the given size, in whatever unit, from the origin along +x.
  void writeBoxTool(double length, double width) const;
  /// The flags of a run over these inputs into folder "out", at 5 cm.
  /// @param more  an empty value takes its flag away: {"--poses", ""}
  [[nodiscard]] std::vector<std::string> mapArguments(const std::vector<std::string>& more = {}) const;
  /// Names of all files in folder `name`, sorted; empty if there is none.
  [[nodiscard]] std::vector<std::string> listing(const std::string& name) const;

  std::filesystem::path folder_;
};

}  // namespace accessvdb::cli_test
