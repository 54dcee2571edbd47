// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The time of a field, by the stamps of its scans alone.
#pragma once

#include <cmath>
#include <optional>

namespace accessvdb::internal {

class FieldClock {
 public:
  FieldClock() = default;
  explicit FieldClock(std::optional<double> latest_s) : latest_s_(latest_s) {}

  /// A stamp that is not finite, or earlier than the latest, changes nothing.
  /// @return seconds that have passed since the latest stamp before; 0 for the first
  double note(double stamp_s) {
    if (!std::isfinite(stamp_s) || (latest_s_ && !(stamp_s > *latest_s_))) return 0;
    const double passed_s = latest_s_ ? stamp_s - *latest_s_ : 0;
    latest_s_ = stamp_s;
    return passed_s;
  }
  [[nodiscard]] std::optional<double> latest_s() const { return latest_s_; }

 private:
  std::optional<double> latest_s_;
};

}  // namespace accessvdb::internal
