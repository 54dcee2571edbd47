// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans that turn out to be none when they are read. Each costs itself: it has no points.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"

namespace accessvdb::io {

class SkippedScans {
 public:
  /// A step may be read more than once. @throws UnusableInput "scans.skipped" where most of `steps` are skipped
  void add(std::size_t step, const std::string& reason, std::size_t steps) {
    reasons_[step] = reason;
    if (2 * reasons_.size() > steps)
      throw UnusableInput("scans.skipped", "", "most scans cannot be used: " + reasons_.begin()->second,
                          "Check the times of the points, or leave them out with Deskew::Off");
  }
  [[nodiscard]] std::vector<ScanWarning> warnings(std::size_t steps) const {
    if (reasons_.empty()) return {};
    constexpr std::size_t kShown = 3;
    std::string words;
    std::size_t shown = 0;
    for (const auto& [step, reason] : reasons_)
      if (shown++ < kShown) words += (shown > 1 ? "; " : "") + reason;
    return {ScanWarning{"scans.skipped", std::to_string(reasons_.size()) + " of " + std::to_string(steps) +
                                             " scans are skipped: " + words +
                                             (reasons_.size() > kShown ? "; ..." : "")}};
  }

 private:
  std::map<std::size_t, std::string> reasons_;  ///< by step
};

}  // namespace accessvdb::io
