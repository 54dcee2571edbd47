// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/trajectory_coverage.h"
#include "io/median.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "accessvdb/error.h"

namespace accessvdb::io {
namespace {

constexpr double kWeek_s = 604800;
constexpr double kAdjusted_s = 1e9;             ///< LAS 1.4: adjusted standard GPS time is GPS time less this
constexpr double kUnixAtGpsZero_s = 315964800;  ///< 1980-01-06 in seconds since 1970-01-01
constexpr double kLeap_s = 18;                  ///< GPS time less UTC, since 2017
constexpr double kCovered = 0.99;
/// No scanner of a survey reaches this far; another projection or origin is at least as far off.
constexpr double kFar_m = 10e3;

std::string secondsText(double value) {
  char text[64];
  std::snprintf(text, sizeof(text), "%.3f", value);
  return text;
}

/// As few digits as say it exactly enough: whole seconds without a point.
std::string offsetText(double value) {
  char text[64];
  std::snprintf(text, sizeof(text), value == std::round(value) ? "%.0f" : "%.6f", value);
  return text;
}

std::string percentText(double share) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f %%", std::floor(share * 1000) / 10);
  return text;
}

std::string metresText(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), value < 1000 ? "%.1f m" : "%.0f m", value);
  return text;
}

struct ClockDifference {
  double offset_s;
  const char* reason;  ///< empty: none
};

constexpr std::array<ClockDifference, 5> kEpochs = {
    {{0, ""},
     {kAdjusted_s, "the cloud has adjusted standard GPS time, less 1e9 s"},
     {-kAdjusted_s, "the trajectory has adjusted standard GPS time, less 1e9 s"},
     {kUnixAtGpsZero_s, "the cloud has GPS time, the trajectory time since 1970"},
     {-kUnixAtGpsZero_s, "the cloud has time since 1970, the trajectory GPS time"}}};
constexpr std::array<ClockDifference, 3> kLeaps = {
    {{0, ""},
     {-kLeap_s, "the cloud has GPS time, the trajectory UTC (18 leap seconds)"},
     {kLeap_s, "the cloud has UTC, the trajectory GPS time (18 leap seconds)"}}};

/// Whether times can be seconds of a week; a recording may run on over the end of it.
bool isOfWeek(double first_s, double last_s) { return first_s >= 0 && last_s < 2 * kWeek_s; }

double coveredShare(const std::vector<double>& stamps_s, double offset_s, const Trajectory& trajectory) {
  std::size_t covered = 0, near = 0;
  for (const double stamp : stamps_s) covered += trajectory.at(stamp + offset_s, near) ? 1 : 0;
  return static_cast<double>(covered) / static_cast<double>(stamps_s.size());
}

std::string adviceForGaps(const std::vector<double>& stamps_s, const Trajectory& trajectory) {
  std::vector<double> gaps_s;
  for (const double stamp : stamps_s)
    if (const auto gap_s = trajectory.gapAt_s(stamp)) gaps_s.push_back(*gap_s);
  const double enough_s = sufficientGap_s(std::move(gaps_s));
  const std::string often = gapInWords(trajectory.maxGap_s()) + " or more often";
  if (!(enough_s > trajectory.maxGap_s())) return "Export the trajectory with a position every " + often;
  char value[32];
  std::snprintf(value, sizeof value, "%.2f", enough_s);
  return "Use ScanInputOptions::max_gap_s " + std::string(value) +
         " if the sensor moved evenly in between, or export positions every " + often;
}

std::string adviceForCoverage(const std::vector<double>& stamps_s, const Trajectory& trajectory, double time_offset_s) {
  const auto inside = std::count_if(stamps_s.begin(), stamps_s.end(), [&](double stamp) {
    return stamp >= trajectory.first_s() && stamp <= trajectory.last_s();
  });
  if (!stamps_s.empty() && static_cast<double>(inside) >= kCovered * static_cast<double>(stamps_s.size()))
    return adviceForGaps(stamps_s, trajectory);
  if (const auto likely = likelyClockOffset(stamps_s, trajectory))
    return "Use time_offset_s " + offsetText(time_offset_s + likely->offset_s) + ", if " + likely->reason;
  return "Use the whole trajectory of this survey, on the cloud's clock or with time_offset_s";
}

}  // namespace

std::optional<ClockOffset> likelyClockOffset(const std::vector<double>& stamps_s, const Trajectory& trajectory) {
  if (stamps_s.empty()) return std::nullopt;
  const auto [low, high] = std::minmax_element(stamps_s.begin(), stamps_s.end());
  const bool cloud_of_week = isOfWeek(*low, *high);
  // Two clocks with full dates that differ by weeks belong to two surveys.
  const bool weeks_differ = cloud_of_week != isOfWeek(trajectory.first_s(), trajectory.last_s());
  const double between_s = 0.5 * (trajectory.first_s() + trajectory.last_s()) - 0.5 * (*low + *high);
  std::optional<ClockOffset> best;
  // Where the clocks agree already, only what repairs everything is more likely than a trajectory that is too short.
  const double share_now = coveredShare(stamps_s, 0, trajectory);
  double best_share = share_now >= 0.5 ? std::max(share_now, kCovered) : 0.5;
  const auto consider = [&](double offset_s, std::initializer_list<const char*> reasons) {
    if (offset_s == 0) return;
    const double share = coveredShare(stamps_s, offset_s, trajectory);
    // The simplest of equals: those with fewer reasons come first.
    if (!(share > best_share)) return;
    best_share = share;
    best = ClockOffset{offset_s, ""};
    for (const char* const reason : reasons)
      if (*reason != '\0') best->reason += (best->reason.empty() ? "" : "; ") + std::string(reason);
  };
  for (const ClockDifference& leap : kLeaps) {
    for (const ClockDifference& epoch : kEpochs) consider(epoch.offset_s + leap.offset_s, {epoch.reason, leap.reason});
    if (!weeks_differ) continue;
    const char* const reason =
        cloud_of_week ? "the cloud has seconds of the week" : "the trajectory has seconds of the week";
    for (const ClockDifference& epoch : kEpochs) {
      const double base_s = epoch.offset_s + leap.offset_s;
      const double weeks = std::round((between_s - base_s) / kWeek_s);
      for (const double more : {0.0, -1.0, 1.0})
        consider(base_s + (weeks + more) * kWeek_s, {reason, epoch.reason, leap.reason});
    }
  }
  return best;
}

void TrajectoryCoverage::add(double stamp_s, const Eigen::Vector3d& p_W, const std::optional<Eigen::Vector3d>& q_W) {
  ++returns_;
  if (std::isfinite(stamp_s)) {
    first_s_ = any_finite_ ? std::min(first_s_, stamp_s) : stamp_s;
    last_s_ = any_finite_ ? std::max(last_s_, stamp_s) : stamp_s;
    any_finite_ = true;
    stamps_s_.add(stamp_s);
  }
  if (!q_W) return;
  ++covered_;
  const double range_m = (p_W - *q_W).norm();
  far_ += range_m > kFar_m ? 1 : 0;  // NaN is not far: it is counted where it is used
  if (std::isfinite(range_m)) ranges_m_.add(range_m);
}

void TrajectoryCoverage::check(const Trajectory& trajectory, double time_offset_s) const {
  const double share = static_cast<double>(covered_) / static_cast<double>(returns_);
  const std::string spans =
      any_finite_ ? "the cloud's times are " + secondsText(first_s_) + " to " + secondsText(last_s_) + " s" +
                        (time_offset_s == 0 ? "" : " (time_offset_s " + offsetText(time_offset_s) + " added)") +
                        ", the trajectory's " + secondsText(trajectory.first_s()) + " to " +
                        secondsText(trajectory.last_s()) + " s"
                  : "the cloud's times are not numbers";
  if (!(share >= kCovered)) {
    throw UnusableInput("trajectory.coverage", trajectory.subject(),
                        "covers " + percentText(share) + " of the returns, less than 99 %: " + spans +
                            ", and gaps of more than " + gapInWords(trajectory.maxGap_s()) + " are not bridged",
                        adviceForCoverage(stamps_s_.values(), trajectory, time_offset_s));
  }
  if (2 * far_ > covered_)
    throw UnusableInput(
        "trajectory.far", trajectory.subject(),
        std::to_string(far_) + " of " + std::to_string(covered_) +
            " returns are more than 10 km from where the sensor was at their time" +
            (ranges_m_.values().empty() ? "" : " (typically " + metresText(median(ranges_m_.values())) + ")"),
        "Use a trajectory in the cloud's own coordinates: same datum, projection and origin, in metres");
}

std::vector<std::string> TrajectoryCoverage::notices(const Trajectory& trajectory) const {
  std::vector<std::string> notices = trajectory.notices();
  notices.push_back("trajectory: " + std::to_string(trajectory.size()) + " positions from " +
                    secondsText(trajectory.first_s()) + " to " + secondsText(trajectory.last_s()) +
                    " s; returns from " + secondsText(first_s_) + " to " + secondsText(last_s_) + " s, typically " +
                    (ranges_m_.values().empty() ? "?" : metresText(median(ranges_m_.values()))) + " from the sensor");
  if (covered_ < returns_)
    notices.push_back("trajectory: " + std::to_string(returns_ - covered_) + " of " + std::to_string(returns_) +
                      " returns are skipped: there is no position within " + gapInWords(trajectory.maxGap_s()) +
                      " of their time");
  return notices;
}

}  // namespace accessvdb::io
