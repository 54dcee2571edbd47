// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whether the scans of a flight agree, while it goes on: scans from a little further on are compared with each other.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>

#include "accessvdb/program/scan_agreement.h"
#include "accessvdb/scan_io.h"

namespace accessvdb::internal {

class LiveAgreement {
 public:
  /// @param T_B_S  as LiveOptions::T_B_S
  LiveAgreement(double range_noise_m, const std::optional<Eigen::Isometry3d>& T_B_S)
      : range_noise_m_(range_noise_m), T_B_S_(T_B_S), meter_(range_noise_m, T_B_S) {}

  /// Keeps the scan if it was taken far enough from the last one that was kept.
  void add(const io::ScanRecord& scan, const Eigen::Isometry3d& T_W_B);
  /// Of the latest scans that were compared, however few there are by the end.
  [[nodiscard]] io::ScanAgreement latest() const { return measured_ ? *measured_ : meter_.measure(); }

 private:
  double range_noise_m_;
  std::optional<Eigen::Isometry3d> T_B_S_;
  io::AgreementMeter meter_;
  std::optional<Eigen::Isometry3d> kept_T_W_S_;
  std::optional<io::ScanAgreement> measured_;
};

}  // namespace accessvdb::internal
