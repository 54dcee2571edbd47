// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Maps in tiles by the built program, compared with one piece by the same program.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cli/program_run.h"

namespace accessvdb::large_test {

using Flags = std::vector<std::string>;
using cli_test::ProgramResult;
using cli_test::runProgram;

/// How a process ended that was perhaps killed.
struct Ending {
  bool killed = false;
  int exit_code = -1;
  double seconds = 0;
  std::uint64_t peak_bytes = 0;
};
/// @param kill_after_s  SIGKILL after this time, unless it has ended
[[nodiscard]] Ending runToItsEnd(const Flags& arguments, std::optional<double> kill_after_s = std::nullopt);

/// A number from the environment, for longer runs than the usual ones.
[[nodiscard]] int countFrom(const char* variable, int usual);

class TiledTest : public cli_test::ProgramTest {
 protected:
  /// A walk through several tiles of 6.4 m at 5 cm, with builtin:pencil.
  void SetUp() override;

  /// Flags that say what is mapped: scans_ and, where given, others.
  Flags scans_,
      what_ = {"--tool", "builtin:pencil",     "--voxel", "0.05", "--device", "cpu", "--width", "200", "--height",
               "100",    "--allow-hidden-tool"};

  [[nodiscard]] Flags plus(Flags flags, const Flags& more) const;
  [[nodiscard]] Flags map(const Flags& more, const std::string& out = "out") const;   ///< arguments of map
  [[nodiscard]] Flags plan(const Flags& more, const std::string& out = "out") const;  ///< arguments of tile plan
  [[nodiscard]] Flags step(const std::string& name, const Flags& more = {}, const std::string& out = "out") const;

  /// Runs the program, which has to succeed. @return what it printed
  std::string succeed(const Flags& arguments) const;
  /// Has to fail with this code and id, in one line. @return the line
  std::string refuse(const Flags& arguments, int exit_code, const std::string& id) const;
  [[nodiscard]] std::vector<std::string> tilesOf(const std::string& out = "out") const;

  /// Merges the tiles of `out` and compares with one piece, by bytes.
  void expectOnePiece(const std::string& out = "out");
  void expectSameFiles(const std::string& file, const std::string& expected) const;
  /// Nothing temporary is anywhere in the folder, and no rays.
  void expectNoLeftovers(const std::string& out = "out") const;

  void flipByte(const std::string& file, std::uint64_t offset) const;
  [[nodiscard]] std::uint64_t sizeOf(const std::string& file) const;

 private:
  bool one_piece_ = false;
};

/// The folder of recorded scans of BALM, if there is one.
[[nodiscard]] std::optional<std::string> balmScans();

}  // namespace accessvdb::large_test
