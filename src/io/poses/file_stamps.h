// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Times in the names of scans.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace accessvdb::io {

/// The last run of digits of a file stem.
[[nodiscard]] std::optional<std::uint64_t> fileNumber(const std::string& stem);
/// The time in a file stem: a date, or the last digits if they have a point, or are seconds and nanoseconds, or at
/// least 10 digits not beginning with 0 (seconds, or milli-, micro-, nanoseconds by their number). Shorter whole
/// numbers are numbers, not times.
[[nodiscard]] std::optional<double> fileStamp_s(const std::string& stem);

struct FileStamps {
  std::vector<double> stamps_s;  ///< [stems]
  bool dates = false;            ///< taken to be UTC
  std::string words;             ///< what was believed, for the matching rule; empty for plain seconds
};
/// The times in all of these stems, read alike; nothing if one has none, or several are the same.
[[nodiscard]] std::optional<FileStamps> fileStamps(const std::vector<std::string>& stems);

/// Whether the names come in another order when they are sorted as text, as many programs do: scan10 before scan2.
[[nodiscard]] bool sortDifferentlyAsText(const std::vector<std::string>& stems);

}  // namespace accessvdb::io
