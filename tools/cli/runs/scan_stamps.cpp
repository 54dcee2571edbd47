// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/scan_stamps.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "accessvdb/error.h"

namespace accessvdb::tools {

void requireStamps(const MapOptions& options, const FieldParams& params, const io::ScanSequence& scans,
                   Messages& messages) {
  const double free_for_s = params.change.free_for_s;
  if (!std::isfinite(free_for_s)) return;
  std::vector<double> stamps_s;
  for (std::size_t step = 0; step < scans.size(); ++step) {
    const double stamp_s = scans.stamp_s(step).value_or(std::numeric_limits<double>::quiet_NaN());
    if (std::isfinite(stamp_s)) stamps_s.push_back(stamp_s);
  }
  if (stamps_s.empty()) {
    throw UnusableInput("stamp.missing", options.scans,
                        "has no scan with a time, which --free-for " + options.free_for + " needs",
                        "Use poses with times, a trajectory or a recording, or leave --free-for out");
  }
  if (stamps_s.size() < scans.size()) {
    messages.warning("stamp.missing", std::to_string(scans.size() - stamps_s.size()) + " of " +
                                          std::to_string(scans.size()) +
                                          " scans have no time: free space does not age before them");
  }
  std::size_t far_apart = 0;
  for (std::size_t n = 1; n < stamps_s.size(); ++n) far_apart += stamps_s[n] - stamps_s[n - 1] > free_for_s ? 1 : 0;
  if (2 * far_apart > stamps_s.size()) {
    messages.warning("change.stamps", "most scans are more than " + numberText(free_for_s) +
                                          " s apart, so all free space is forgotten between them; see that their "
                                          "times are in seconds");
  }
}

}  // namespace accessvdb::tools
