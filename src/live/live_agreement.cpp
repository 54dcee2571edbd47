// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/live_agreement.h"

namespace accessvdb::internal {
namespace {

constexpr double kFurtherOn = 0.1;      ///< of the range: nearer scans see the same whatever their poses are
constexpr double kTurnedOn_rad = 0.25;  ///< about 14 degrees
/// Scans that are enough for an answer; then again with as many as the meter compares.
constexpr std::size_t kFirstAnswer = 8;

}  // namespace

void LiveAgreement::add(const io::ScanRecord& scan, const Eigen::Isometry3d& T_W_B) {
  if (kept_T_W_S_) {
    const Eigen::Isometry3d moved = kept_T_W_S_->inverse() * scan.T_W_S;
    if (moved.translation().norm() < kFurtherOn * meter_.medianRange_m() &&
        Eigen::AngleAxisd(moved.linear()).angle() < kTurnedOn_rad)
      return;
  }
  kept_T_W_S_ = scan.T_W_S;
  const std::size_t before = meter_.size();
  meter_.add(scan, [T_W_B](double shift_s) -> std::optional<Eigen::Isometry3d> {
    if (shift_s != 0) return std::nullopt;
    return T_W_B;
  });
  if (meter_.size() == before) return;
  if (meter_.size() == kFirstAnswer && !measured_) measured_ = meter_.measure();
  if (meter_.size() < io::AgreementMeter::kMostScans) return;
  measured_ = meter_.measure();
  meter_ = io::AgreementMeter(range_noise_m_, T_B_S_);  // the next ones by themselves: memory stays bounded
}

}  // namespace accessvdb::internal
