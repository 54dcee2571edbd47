// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Wall time of a stage.
#pragma once

#include <chrono>

namespace accessvdb::kernels {

/// Starts on construction.
class Stopwatch {
 public:
  [[nodiscard]] double milliseconds() const {
    return std::chrono::duration<double, std::milli>(Clock::now() - start_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

}  // namespace accessvdb::kernels
