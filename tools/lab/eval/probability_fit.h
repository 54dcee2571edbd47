// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fits what SurfacePoint::access_probability is made with, and compares probabilities with what came true.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace accessvdb::eval {

inline constexpr std::size_t kFitTerms = 7;

/// One point of a fit.
struct FitSample {
  std::array<float, kFitTerms> terms = {};
  bool accessible = false;  ///< in truth
  double weight = 1;
};

/// The constants of a logistic model by greatest likelihood (Newton's method). A term whose constant has the wrong sign
/// is left out, the worst first, until none has. @param signs  of each: +1, -1, or 0 for either
[[nodiscard]] std::array<double, kFitTerms> fitOdds(std::span<const FitSample> samples,
                                                    const std::array<int, kFitTerms>& signs);

/// What was said of points, and what was so.
class Reliability {
 public:
  static constexpr std::size_t kDeciles = 10;
  /// Deciles with fewer points are no evidence.
  static constexpr std::uint64_t kLeastPoints = 500;

  /// @param said  in [0, 1]  @param label  whether the point is labelled accessible
  void add(double said, bool label, bool accessible);

  struct Decile {
    std::uint64_t points = 0, accessible = 0;
    double said = 0;  ///< sum
    [[nodiscard]] double saidPercent() const { return 100 * said / static_cast<double>(points); }
    [[nodiscard]] double wasPercent() const {
      return 100 * static_cast<double>(accessible) / static_cast<double>(points);
    }
    [[nodiscard]] bool counts() const { return points >= kLeastPoints; }
  };
  [[nodiscard]] const std::array<Decile, kDeciles>& deciles() const { return deciles_; }
  [[nodiscard]] std::uint64_t points() const { return points_; }
  /// Largest difference of the deciles that count, in percent points; 0 if there are none.
  [[nodiscard]] double farthestOff() const;
  /// Mean squared error of the probabilities, and of labels taken for 0 and 1.
  [[nodiscard]] double brier() const { return points_ > 0 ? squares_ / static_cast<double>(points_) : 0; }
  [[nodiscard]] double brierOfLabels() const { return points_ > 0 ? label_squares_ / static_cast<double>(points_) : 0; }

 private:
  std::array<Decile, kDeciles> deciles_ = {};
  std::uint64_t points_ = 0;
  double squares_ = 0, label_squares_ = 0;
};

}  // namespace accessvdb::eval
