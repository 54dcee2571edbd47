// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What all verbs share on the command line: the common flags, --config, help and errors.
#pragma once

#include <string>

#include "options/flag_parser.h"
#include "output/program.h"

namespace accessvdb::tools {

/// Flags that every verb has.
struct CommonOptions {
  std::string device = "auto";
  int threads = 0;
  std::string config;
  bool quiet = false;
  std::string error_format = "text";
};

void addCommonOptions(FlagParser& flags, CommonOptions& options);

/// Parses flags, then takes from --config whatever the flags did not set.
/// @return false if --help was given and printed
/// @throws InvalidArgument (code 2), InputError for an unreadable config
[[nodiscard]] bool parseCommandLine(FlagParser& flags, const Arguments& arguments, const CommonOptions& options,
                                    Messages& messages);

/// @throws InvalidArgument for a bad value, DeviceError for a device that is not available
void checkCommonOptions(const CommonOptions& options);

/// The value of every option as a TOML table [VERB], in a form that --config reads back.
[[nodiscard]] std::string effectiveConfig(const FlagParser& flags);

/// One line of such a table: key = value, a number where the text is one, true or false.
[[nodiscard]] std::string configEntry(const std::string& key, const std::string& text);

/// Writes data to stdout completely, or fails. @throws OutputError
void printData(const std::string& text);

}  // namespace accessvdb::tools
