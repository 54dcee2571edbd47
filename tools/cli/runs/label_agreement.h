// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How far labels from recorded scans, for which there is no ground truth, depend on the choice of scans: labels from
/// half of the scans against those from the other half, and against the densest reconstruction, that from all.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "accessvdb/params.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tool_geometry.h"
#include "accessvdb/types.h"

namespace accessvdb::tools {

/// Two labellings of the same place, by world voxel.
struct LabelAgreement {
  /// [label in the first][label in the second], over voxels that hold a surface point in both.
  std::array<std::array<std::uint64_t, kNumPointLabels>, kNumPointLabels> voxels = {};
  std::uint64_t only_first = 0, only_second = 0;  ///< voxels with a point in only one

  /// Voxels that are accessible or blocked in both: the basis of the figures below.
  [[nodiscard]] std::uint64_t compared() const;
  /// The others: with a point in only one, or unscored in one.
  [[nodiscard]] std::uint64_t notCompared() const;
  /// Share of them with the same label, and of those accessible in each, percent; 0 if nothing was compared.
  [[nodiscard]] double agreementPercent() const;
  [[nodiscard]] double accessiblePercentOfFirst() const;
  [[nodiscard]] double accessiblePercentOfSecond() const;
  /// The first judged by the second, percent; 0 if the denominator is 0.
  [[nodiscard]] double precisionPercent() const;
  [[nodiscard]] double recallPercent() const;
  /// Cohen's kappa: 1 = equal, 0 = as if by chance. None if nothing was compared, or if both have the same single label
  /// everywhere, so that chance explains everything.
  [[nodiscard]] std::optional<double> kappa() const;
};

/// @throws InvalidArgument unless both have one voxel size
[[nodiscard]] LabelAgreement compareByVoxel(const FieldSnapshot& first, const FieldSnapshot& second);

/// One of the three maps.
struct ConsistencyPart {
  std::uint64_t scans = 0, points_in = 0, points_used = 0;
  std::array<std::uint64_t, kNumPointLabels> labels = {};
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  double seconds = 0;
};

struct ConsistencyResult {
  ConsistencyPart even, odd, all;  ///< scans 0, 2, 4, ..; 1, 3, 5, ..; and all of them
  LabelAgreement even_odd, even_all, odd_all;
};

/// Checked after every scan.
struct ConsistencyHooks {
  std::function<void(const std::string& part, std::size_t done, std::size_t total)> progress;
  std::function<bool()> stop;
};

/// Maps three times, one map in memory at a time, each scored once at its end.
/// @return none if `stop` requested it
/// @throws UnusableInput: fewer than two scans, or no return that can be used; what reading and mapping throw
[[nodiscard]] std::optional<ConsistencyResult> measureConsistency(io::ScanSequence& scans, const ToolGeometry& tool,
                                                                  const FieldParams& params,
                                                                  const ConsistencyHooks& hooks = {});

}  // namespace accessvdb::tools
