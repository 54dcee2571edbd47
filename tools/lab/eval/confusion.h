// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Labels against truth; positive = accessible.
#pragma once

#include <cstdint>
#include <span>

namespace accessvdb::eval {

struct Confusion {
  std::uint64_t true_accessible = 0;   ///< TP
  std::uint64_t false_accessible = 0;  ///< FP: the dangerous kind
  std::uint64_t false_blocked = 0;     ///< FN
  std::uint64_t true_blocked = 0;      ///< TN

  [[nodiscard]] std::uint64_t points() const {
    return true_accessible + false_accessible + false_blocked + true_blocked;
  }
  /// Percent; 0 if the denominator is 0, as in the paper's tables.
  [[nodiscard]] double precision() const { return percent(true_accessible, true_accessible + false_accessible); }
  [[nodiscard]] double recall() const { return percent(true_accessible, true_accessible + false_blocked); }
  [[nodiscard]] double f1() const {
    return percent(2 * true_accessible, 2 * true_accessible + false_accessible + false_blocked);
  }
  [[nodiscard]] double truthPercent() const { return percent(true_accessible + false_blocked, points()); }

  void add(bool truth, bool found) {
    ++(truth ? (found ? true_accessible : false_blocked) : (found ? false_accessible : true_blocked));
  }

 private:
  static double percent(std::uint64_t part, std::uint64_t whole) {
    return whole == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(whole);
  }
};

/// @param truth, found  [n] non-zero = accessible
[[nodiscard]] inline Confusion compare(std::span<const std::uint8_t> truth, std::span<const std::uint8_t> found) {
  Confusion result;
  for (std::size_t n = 0; n < truth.size(); ++n) result.add(truth[n] != 0, found[n] != 0);
  return result;
}

}  // namespace accessvdb::eval
