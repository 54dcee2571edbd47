// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The scan log of `live` (output/scan_log.h) as a list of steps, for `map --replay-log`: fused and scored in the same
/// order and with the same budgets, the same scans have the same labels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"
#include "accessvdb/types.h"
#include "options/map_options.h"

namespace accessvdb::tools {

class ReplayLog {
 public:
  struct Update {
    int budget_points = 0;
    std::uint64_t backlog = 0;  ///< what it left
  };
  struct Row {
    enum class What : std::uint8_t { Scan, Backlog, StopGrowing };
    What what = What::Scan;
    std::size_t line = 0;
    std::int64_t stamp_ns = 0;  ///< of the scan
    std::optional<Update> update = {};
    std::uint64_t points = 0;  ///< in the map afterwards
    std::size_t step = 0;      ///< of a scan, once match() has found it

    /// As LiveSession passes it on.
    [[nodiscard]] double stamp_s() const { return static_cast<double>(stamp_ns) * 1e-9; }
  };

  /// @throws InputError "input.missing", "replay.damaged", "replay.unfinished"
  /// @throws UnusableInput "replay.lost": not all that changed the map is in it
  explicit ReplayLog(const std::string& path);

  /// Finds each of its scans. @throws UnusableInput "replay.scans" if there is one that is not among these
  void match(const io::ScanSequence& scans);
  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }
  /// @param update  nothing if the row has none  @throws UnusableInput "replay.differs" if the map is another one
  void requireSame(const Row& row, std::uint64_t points, const std::optional<UpdateStats>& update) const;

 private:
  std::string path_;
  std::vector<Row> rows_;
};

/// Flags that contradict a log. @throws InvalidArgument "usage.replay"
void requireReplayPossible(const MapOptions& options);

}  // namespace accessvdb::tools
