// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which scans of a sequence are compared.
#include <algorithm>

#include "accessvdb/program/scan_agreement.h"

namespace accessvdb::io {
namespace {

/// Places along the way, each with the scans that see it from a little further on.
constexpr std::size_t kPlaces = AgreementMeter::kMostScans / 3;
/// The first step after `from`, and before `end`, that is so much further on; else the last one.
std::size_t stepFurtherOn(const ScanSequence& scans, std::size_t from, std::size_t end, const FurtherOn& further_on,
                          double range_m) {
  const auto begin = scans.givenPose(from);
  for (std::size_t step = from + 1; begin && step < end; ++step) {
    const auto pose = scans.givenPose(step);
    if (pose && further_on.holds(*begin, *pose, range_m)) return step;
  }
  return end - 1;
}

}  // namespace

AgreementMeter measureAgreement(ScanSequence& scans, double range_noise_m,
                                const std::optional<Eigen::Isometry3d>& T_B_S) {
  AgreementMeter meter(range_noise_m, T_B_S);
  const std::size_t count = scans.size();
  const auto add = [&](std::size_t step) {
    meter.add(scans.read(step), [&scans, step](double shift_s) { return scans.givenPose(step, shift_s); });
  };
  if (count <= AgreementMeter::kMostScans) {
    for (std::size_t step = 0; step < count; ++step) add(step);
    return meter;
  }
  for (std::size_t place = 0; place < kPlaces; ++place) {
    const std::size_t first = place * count / kPlaces, end = (place + 1) * count / kPlaces;
    add(first);
    std::size_t step = first;
    for (const FurtherOn& further_on : {kALittleFurtherOn, kMuchFurtherOn}) {
      step = std::max(step + 1, stepFurtherOn(scans, first, end, further_on, meter.medianRange_m()));
      if (step >= end) break;
      add(step);
    }
  }
  return meter;
}

}  // namespace accessvdb::io
