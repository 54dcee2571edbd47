// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How long scans took to become labels.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace accessvdb::internal {

/// The last latencies, of which percentiles are asked for now and then.
class Latencies {
 public:
  Latencies() { last_.reserve(kKept); }
  /// Never throws.
  void add(double ms) {
    if (last_.size() < kKept) {
      last_.push_back(ms);
    } else {
      last_[next_] = ms;
    }
    next_ = (next_ + 1) % kKept;
  }
  /// Nearest rank. @param share  in (0, 1]
  [[nodiscard]] double percentile(double share) const {
    if (last_.empty()) return 0;
    std::vector<double> sorted = last_;
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(sorted.size()))) - 1;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(rank), sorted.end());
    return sorted[rank];
  }

 private:
  static constexpr std::size_t kKept = 4096;
  std::vector<double> last_;
  std::size_t next_ = 0;
};

}  // namespace accessvdb::internal
