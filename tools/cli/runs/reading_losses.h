// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What reading left out of scans.
#pragma once

#include <cstdint>

#include "accessvdb/scan_io.h"
#include "output/error_output.h"

namespace accessvdb::tools {

struct ReadingLosses {
  std::uint64_t truncated = 0;    ///< announced by the files, and missing
  std::uint64_t excluded = 0;     ///< inside --exclude-box
  std::uint64_t unposed = 0;      ///< measured when there is no pose
  std::uint64_t noise = 0;        ///< withheld, synthetic or noise
  std::uint64_t posed_noise = 0;  ///< of these, of scans with one pose; of clouds their readers say it

  void add(const io::ScanRecord& record);
  void say(const io::ScanSequence& scans, Messages& messages) const;
};

}  // namespace accessvdb::tools
