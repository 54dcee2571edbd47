// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Do the scans agree? Wrong poses put the same surface into several places, and returns of one scan into space that
/// another scan saw free. A few scans, and some returns of each, tell.
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/scan_io.h"

namespace accessvdb::io {

/// What other scans say of returns.
struct AgreementCounts {
  std::uint64_t agreeing = 0;       ///< the other scan has a surface there
  std::uint64_t contradicting = 0;  ///< the other scan saw through that place
  std::uint64_t hidden = 0;         ///< something is in front of it
  std::uint64_t beside = 0;         ///< the other scan has no return in that direction

  /// Of the returns about which the other scan says something: 0 to 1, 1 if it says nothing.
  [[nodiscard]] double share() const {
    const auto said = static_cast<double>(agreeing + contradicting);
    return said > 0 ? static_cast<double>(agreeing) / said : 1;
  }
  [[nodiscard]] std::uint64_t asked() const { return agreeing + contradicting + hidden + beside; }
  /// What poses are compared by: from -1, all contradict, to 1, all agree.
  [[nodiscard]] double score() const {
    return asked() > 0
               ? (static_cast<double>(agreeing) - static_cast<double>(contradicting)) / static_cast<double>(asked())
               : 0;
  }
  AgreementCounts& operator+=(const AgreementCounts& other) {
    agreeing += other.agreeing;
    contradicting += other.contradicting;
    hidden += other.hidden;
    beside += other.beside;
    return *this;
  }
  friend bool operator==(const AgreementCounts&, const AgreementCounts&) = default;
};

/// How poses can be wrong.
enum class PoseFault : std::uint8_t {
  None,
  QuaternionWFirst,  ///< the file has w x y z, read as x y z w
  QuaternionWLast,   ///< the file has x y z w, read as w x y z
  Inverse,           ///< the poses are of the world in the sensor's frame
  InverseExtrinsic,  ///< ScanInputOptions::T_B_S is of the body in the sensor's frame
  Turned,            ///< the sensor is turned in the frame whose poses are given, about one of its axes
  InWorld,           ///< the scans are in the world frame already
  TimeOffset,        ///< the poses are those of another time
  Unit               ///< positions of the poses are in another unit than the scans
};

/// "none", "quaternion_w_first", "quaternion_w_last", "inverse", "inverse_extrinsic", "turned", "in_world",
/// "time_offset", "unit"
constexpr const char* name(PoseFault fault) {
  constexpr const char* kNames[] = {"none",   "quaternion_w_first", "quaternion_w_last", "inverse", "inverse_extrinsic",
                                    "turned", "in_world",           "time_offset",       "unit"};
  return kNames[static_cast<int>(fault)];
}

/// A change of the poses with which the scans agree better.
struct PoseCure {
  PoseFault fault = PoseFault::None;
  int axis = 0;      ///< Turned: 0 x, 1 y, 2 z
  double value = 0;  ///< Turned: degrees; TimeOffset: seconds to add; Unit: factor for the positions of the poses
  AgreementCounts counts = {};
};

enum class AgreementVerdict : std::uint8_t {
  NotMeasured,  ///< why_not says why
  Usual,
  Doubtful,  ///< a little below what is usual
  Disagree   ///< far below
};
/// "not_measured", "usual", "doubtful", "disagree"
constexpr const char* name(AgreementVerdict verdict) {
  constexpr const char* kNames[] = {"not_measured", "usual", "doubtful", "disagree"};
  return kNames[static_cast<int>(verdict)];
}

struct ScanAgreement {
  AgreementVerdict verdict = AgreementVerdict::NotMeasured;
  std::string why_not;  ///< of NotMeasured
  std::size_t scans = 0, pairs = 0;
  AgreementCounts counts;
  std::optional<PoseCure> cure;  ///< only where the verdict is below Usual
  /// Scans that do not agree with the others, which do: by their file, or their time in a recording.
  std::vector<std::string> outliers;
};

/// The turn that makes a direction z.
[[nodiscard]] ACCESSVDB_API Level levelFor(const Eigen::Vector3d& up_W);

/// How much further on a scan is worth comparing with another: by a share of the range, or by a turn.
struct FurtherOn {
  double share, turn_rad;
  /// @param range_m  that half of the returns of the first scan are within
  [[nodiscard]] bool holds(const Eigen::Isometry3d& T_from, const Eigen::Isometry3d& T_to, double range_m) const {
    return (T_to.translation() - T_from.translation()).norm() >= share * range_m ||
           Eigen::AngleAxisd(T_from.linear().transpose() * T_to.linear()).angle() >= turn_rad;
  }
};
/// Nearer scans see the same whatever their poses are.
inline constexpr FurtherOn kALittleFurtherOn = {0.1, 0.25};
/// Small errors show, and the view is still shared.
inline constexpr FurtherOn kMuchFurtherOn = {0.4, 0.8};

/// Collects a few scans and compares them. Same scans, same answer, on any number of threads.
class ACCESSVDB_API AgreementMeter {
 public:
  /// More would not make the answer better: all pairs of these are compared.
  static constexpr std::size_t kMostScans = 24;
  /// The pose that was given for a scan, of the body and not turned level, `shift_s` later. Nothing where unknown.
  using PoseAt = std::function<std::optional<Eigen::Isometry3d>(double shift_s)>;

  /// @param range_noise_m  one sigma  @param T_B_S  as ScanInputOptions::T_B_S
  explicit AgreementMeter(double range_noise_m, const std::optional<Eigen::Isometry3d>& T_B_S = {});
  ~AgreementMeter();
  AgreementMeter(AgreementMeter&&) noexcept;
  AgreementMeter& operator=(AgreementMeter&&) noexcept;

  /// Takes one scan, or a cloud in the world frame with one origin; others, and empty ones, are counted only.
  /// @param pose_at  empty: cures are not tried
  void add(const ScanRecord& record, const PoseAt& pose_at = {});
  [[nodiscard]] std::size_t size() const;
  /// Half of the ranges of what was added last are smaller, metres; 0 if nothing was.
  [[nodiscard]] double medianRange_m() const;
  [[nodiscard]] ScanAgreement measure() const;
  /// What is up by floors, ground and walls, where that is more than 10 degrees off z and they are clear; else nothing.
  [[nodiscard]] std::optional<Eigen::Vector3d> upBesideZ_W() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Reads a few scans of the whole sequence. @param range_noise_m, T_B_S  as for AgreementMeter
[[nodiscard]] ACCESSVDB_API AgreementMeter measureAgreement(ScanSequence& scans, double range_noise_m,
                                                            const std::optional<Eigen::Isometry3d>& T_B_S = {});

}  // namespace accessvdb::io
