// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What became of each scan of a live map, and how many points each update scored. `map --replay-log` reads it
/// (runs/replay_log.h; docs/file_formats.md, "Scan log").
#pragma once

#include <cinttypes>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/live_session.h"

namespace accessvdb::tools {

namespace scan_log {

inline constexpr const char* kHeader =
    "# stamp_ns outcome waited_ms latency_ms changed_points budget_points backlog points";
/// Of rows that are no dropped scans.
inline constexpr const char* kTaken = "taken";      ///< a scan that was fused
inline constexpr const char* kLate = "late";        ///< the same, without an update
inline constexpr const char* kBacklog = "backlog";  ///< an update without a scan
inline constexpr const char* kFull = "full";        ///< from here on the map does not grow
inline constexpr const char* kChanged = "changed";  ///< a command changed the map
inline constexpr const char* kNoUpdate = "-";       ///< in place of its budget and backlog
/// Begins the last line of a run that ended, with the number of lines before it that are no comments.
inline constexpr const char* kEnd = "# end of ";
inline constexpr const char* kMoreDropped = " more were dropped";

}  // namespace scan_log

class ScanLog {
 public:
  explicit ScanLog(const std::string& path) : path_(path) {
    if (path.empty()) return;
    out_.open(path, std::ios::trunc);
    out_ << scan_log::kHeader << "\n" << std::flush;
    check();
  }
  /// @param points  in the map after the step
  void taken(const LiveStep& step, std::uint64_t points) {
    if (path_.empty()) return;
    const char* const outcome = step.only_backlog ? scan_log::kBacklog : step.late ? scan_log::kLate : scan_log::kTaken;
    char text[256], update[64];
    std::snprintf(update, sizeof update, "%s %s", scan_log::kNoUpdate, scan_log::kNoUpdate);
    if (step.budget_points)
      std::snprintf(update, sizeof update, "%d %" PRIu64, *step.budget_points, step.scored.backlog);
    std::snprintf(text, sizeof text, "%" PRId64 " %s %.3f %.3f %zu %s %" PRIu64 "\n", step.stamp_ns, outcome,
                  step.waited_ms, step.latency_ms, step.changed.size(), update, points);
    write(text);
  }
  void dropped(const std::vector<DroppedScan>& scans) {
    if (path_.empty()) return;
    for (const DroppedScan& scan : scans) write(std::to_string(scan.stamp_ns) + " " + name(scan.reason) + "\n");
    listed_ += scans.size();
  }
  /// @param what  kFull or kChanged  @param stamp_ns  of the last scan
  void note(const char* what, std::int64_t stamp_ns) {
    if (!path_.empty()) write(std::to_string(stamp_ns) + " " + what + "\n");
  }
  /// @param dropped  scans in all: in a flood, more may come at once than a session remembers
  void finish(std::uint64_t dropped) {
    if (path_.empty()) return;
    if (dropped != listed_) {
      out_ << "# " << dropped - listed_ << scan_log::kMoreDropped << "; report.json counts them by reason\n";
    }
    out_ << scan_log::kEnd << rows_ << " rows\n" << std::flush;
    check();
  }

 private:
  void write(const std::string& row) {
    out_ << row << std::flush;
    check();
    ++rows_;
  }
  void check() const {
    if (!out_) throw OutputError("output.write", path_, "cannot be written", "Check the folder and free space");
  }
  std::string path_;
  std::ofstream out_;
  std::uint64_t rows_ = 0, listed_ = 0;  ///< listed: of the dropped scans
};

}  // namespace accessvdb::tools
