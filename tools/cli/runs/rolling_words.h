// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is said of a rolling field, and the files that it leaves: of `map --rolling` and `live --rolling`.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "accessvdb/rolling_field.h"
#include "accessvdb/write_options.h"
#include "options/map_options.h"
#include "output/error_output.h"
#include "output/report.h"

namespace accessvdb::tools {

class RollingWords {
 public:
  /// @param folder  of --rolling
  RollingWords(std::string folder, Messages& messages) : folder_(std::move(folder)), messages_(messages) {}

  void sayTiles(const RollingStatus& now, double voxel_size_m);
  /// After each scan: warns of the first one that does not fit.
  void note(const RollingStatus& now);
  /// After everything was read that will be: damage shows only then.
  void sayEnd(const RollingStatus& now);

 private:
  [[nodiscard]] std::string cure() const;

  std::string folder_;
  Messages& messages_;
  std::uint64_t short_scans_ = 0;
  double fitting_range_m_ = std::numeric_limits<double>::infinity();
};

/// What of the flags that map and live share does not go with --rolling.
[[nodiscard]] std::optional<std::string> whyNotRolling(const MapOptions& options);

/// That neither folder holds what a run with these flags does not go on with. @throws OutputError "output.foreign"
void requireRollingFolders(const MapOptions& options);

/// Scores, and writes tiles, field.json, preview.png and report.json into --out.
void writeRolling(RollingField& field, const MapOptions& options, const io::WriteOptions& files,
                  const RollingSource& source, RunReport& report, Messages& messages);

}  // namespace accessvdb::tools
