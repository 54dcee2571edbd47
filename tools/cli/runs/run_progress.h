// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How far a run of `map` is, besides its field, and whether a later run reads the same scans in the same way.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"
#include "accessvdb/types.h"
#include "options/map_options.h"

namespace accessvdb::tools {

struct RunProgress {
  std::uint64_t earlier_scans = 0;         ///< of other scan folders or clouds, added by earlier runs
  std::vector<io::InputFile> earlier;      ///< their files
  std::uint64_t next_step = 0, steps = 0;  ///< next one of this run to fuse, and how many there are
  std::uint64_t points_in = 0, points_used = 0;
  std::array<std::uint64_t, kNumDropReasons> dropped = {};
  std::uint64_t frames = 0;          ///< of --sequence, written
  std::vector<io::InputFile> poses;  ///< pose file and calibration, where there are any
  std::vector<io::InputFile> scans;  ///< files read so far, in order

  [[nodiscard]] std::uint64_t scansFused() const { return earlier_scans + next_step; }
  /// Where this run started.
  [[nodiscard]] RunProgress startOfTheseScans() const;
  /// Where a run that adds other scans starts.
  [[nodiscard]] RunProgress followedByOthers() const;
};

/// Reads back as the same number.
[[nodiscard]] std::string fullNumber(double value);

/// How the scans are read: another value would make other steps of the same files.
using Reading = std::map<std::string, std::string>;
/// Of these, hash of the coordinate system that the scans' files name.
inline constexpr const char* kSystem = "system_sha256";
/// What the options say of that.
[[nodiscard]] Reading readingOf(const MapOptions& options);

/// What --resume goes on from.
struct ResumedProgress {
  const RunProgress& progress;
  const Reading& reading;
  const std::string& folder;
};
/// Compares how its scans were listed with how they are now. @throws UnusableInput "state.params", "state.scans"
void requireSameReading(const ResumedProgress& before, Reading now, std::uint64_t steps);
/// Compares the files. @param now  with as many scans read
/// @throws UnusableInput "state.scans", naming the first difference
void requireSameInputs(const ResumedProgress& before, const RunProgress& now);
/// @throws UnusableInput
[[noreturn]] void refuseToResume(const std::string& id, const std::string& folder, const std::string& problem);

}  // namespace accessvdb::tools
