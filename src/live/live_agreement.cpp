// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/live_agreement.h"

namespace accessvdb::internal {
namespace {

/// Scans that are enough for an answer; then again with as many as the meter compares.
constexpr std::size_t kFirstAnswer = 8;

}  // namespace

void LiveAgreement::add(const io::ScanRecord& scan, const Eigen::Isometry3d& T_W_B) {
  if (kept_T_W_S_ && !io::kALittleFurtherOn.holds(*kept_T_W_S_, scan.T_W_S, meter_.medianRange_m())) return;
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
