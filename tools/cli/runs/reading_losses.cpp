// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/reading_losses.h"

#include <string>

#include "output/run_summary.h"

namespace accessvdb::tools {

void ReadingLosses::add(const io::ScanRecord& record) {
  truncated += record.truncated_points;
  excluded += record.excluded_points;
  unposed += record.unposed_points;
  noise += record.noise_points;
  if (record.points_W.empty()) posed_noise += record.noise_points;
}

void ReadingLosses::say(const io::ScanSequence& scans, Messages& messages) const {
  if (excluded > 0) messages.notice(std::to_string(excluded) + " returns inside --exclude-box were left out");
  if (posed_noise > 0)
    messages.notice(std::to_string(posed_noise) +
                    " withheld, synthetic and noise points were left out (--keep-noise keeps them)");
  if (unposed > 0)
    messages.notice(std::to_string(unposed) +
                    " returns were left out: there is no pose at the time at which each was measured");
  sayAboutReading(scans, messages);
  if (truncated > 0) {
    messages.warning("input.truncated", std::to_string(truncated) + " points announced by the files are missing");
  }
}

}  // namespace accessvdb::tools
