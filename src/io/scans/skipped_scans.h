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

/// The first three of a list in words, and how many there are.
class FirstFew {
 public:
  void add(const std::string& text) {
    if (count_++ < kShown) words_ += (words_.empty() ? "" : "; ") + text;
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] std::string inWords() const { return words_ + (count_ > kShown ? "; ..." : ""); }

 private:
  static constexpr std::size_t kShown = 3;
  std::size_t count_ = 0;
  std::string words_;
};

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
    FirstFew few;
    for (const auto& [step, reason] : reasons_) few.add(reason);
    return {ScanWarning{"scans.skipped", std::to_string(few.count()) + " of " + std::to_string(steps) +
                                             " scans are skipped: " + few.inWords()}};
  }

 private:
  std::map<std::size_t, std::string> reasons_;  ///< by step
};

}  // namespace accessvdb::io
