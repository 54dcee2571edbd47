// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What became of each scan of a live map.
#pragma once

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/live_session.h"

namespace accessvdb::tools {

/// A line per scan: its time in nanoseconds, and "taken" or "late" (only fused) with what it took, or why it was
/// dropped.
class ScanLog {
 public:
  explicit ScanLog(const std::string& path) : path_(path) {
    if (path.empty()) return;
    out_.open(path, std::ios::trunc);
    out_ << "# stamp_ns outcome waited_ms latency_ms changed_points\n" << std::flush;
    check();
  }
  void taken(const LiveStep& step) {
    if (path_.empty()) return;
    char text[160];
    std::snprintf(text, sizeof text, "%lld %s %.3f %.3f %zu\n", static_cast<long long>(step.stamp_ns),
                  step.late ? "late" : "taken", step.waited_ms, step.latency_ms, step.changed.size());
    out_ << text << std::flush;
    check();
  }
  void dropped(const std::vector<DroppedScan>& scans) {
    if (path_.empty()) return;
    for (const DroppedScan& scan : scans) out_ << scan.stamp_ns << " " << name(scan.reason) << "\n";
    listed_ += scans.size();
    out_ << std::flush;
    check();
  }
  /// @param dropped  scans in all: in a flood, more may come at once than a session remembers
  void finish(std::uint64_t dropped) {
    if (path_.empty() || dropped == listed_) return;
    out_ << "# " << dropped - listed_ << " more were dropped; report.json counts them by reason\n" << std::flush;
    check();
  }

 private:
  void check() const {
    if (!out_) throw OutputError("output.write", path_, "cannot be written", "Check the folder and free space");
  }
  std::string path_;
  std::ofstream out_;
  std::uint64_t listed_ = 0;  ///< of the dropped scans
};

}  // namespace accessvdb::tools
