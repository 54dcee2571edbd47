// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whether the scans agree about what is where, asked before work begins: wrong poses make a wrong map.
#pragma once

#include <string>

#include "accessvdb/program/scan_agreement.h"
#include "accessvdb/scan_io.h"
#include "options/map_options.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// Measures, says it in one line, and warns where it is doubtful.
/// @throws UnusableInput "poses.disagree", unless --allow-disagreement makes it a warning
io::ScanAgreement checkAgreement(const MapOptions& options, double range_noise_m, io::ScanSequence& scans,
                                 Messages& messages);

/// "98.5 % of 4020 returns agree with what other scans saw (12 scans)", or why it was not measured.
[[nodiscard]] std::string agreementInWords(const io::ScanAgreement& agreement);
/// What live warns of; nothing where the scans agree, or where that is not known.
[[nodiscard]] std::optional<std::string> agreementWarning(const io::ScanAgreement& agreement);
/// What to do about a change of the poses with which the scans agree better.
[[nodiscard]] std::string cureInWords(const io::PoseCure& cure);

}  // namespace accessvdb::tools
