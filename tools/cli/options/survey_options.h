// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags for clouds of surveys, which are in the world frame: where the sensor was, and how LAZ is decoded; and how
/// times and poses are brought together.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "accessvdb/scan_io.h"
#include "options/flag_parser.h"

namespace accessvdb::tools {

struct SurveyOptions {
  std::string trajectory, stations, laz_command, ray;
  double time_offset_s = 0, max_gap_s = 0.2;
  std::string match = "auto";
  bool keep_noise = false;
  std::string crs;
  bool index = false;
  std::string carry;  ///< NAME or NAME=COLUMN, with kBetweenValues between several
};

/// An attribute of the scans, and its column in the results.
struct CarriedName {
  std::string in_scans, column;
};
[[nodiscard]] std::vector<CarriedName> carriedNames(const SurveyOptions& options);
/// For every verb that maps scans into files.
void addCarryOption(FlagParser& flags, SurveyOptions& options);

void addSurveyOptions(FlagParser& flags, SurveyOptions& options);
/// --max-gap alone, for poses that arrive.
void addGapOption(FlagParser& flags, SurveyOptions& options);

/// Copies them into the library's options.
void applySurveyOptions(const SurveyOptions& options, io::ScanInputOptions& input);

/// Names and values of those that were given, for the report.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> givenSurveyOptions(const SurveyOptions& options);

}  // namespace accessvdb::tools
