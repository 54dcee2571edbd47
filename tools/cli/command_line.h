// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What all verbs share on the command line: the common flags, --config, help and errors.
#pragma once

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <string>

#include "verbs.h"

namespace accessvdb::tools {

/// Flags that every verb has.
struct CommonOptions {
  std::string device = "auto";
  int threads = 0;
  std::string config;
  bool quiet = false;
  std::string error_format = "text";
};

/// Adds the common flags to a verb's parser and sets its name, purpose and example.
void addCommonOptions(CLI::App& app, CommonOptions& options, const std::string& verb, const std::string& purpose,
                      const std::string& example);

/// Parses flags, then takes from --config whatever the flags did not set.
/// @return false if --help was given and printed
/// @throws InvalidArgument (code 2), InputError for an unreadable config
[[nodiscard]] bool parseCommandLine(CLI::App& app, const Arguments& arguments, const CommonOptions& options,
                                    Messages& messages);

/// @throws InvalidArgument for a bad value, DeviceError for a device that is not available
void checkCommonOptions(const CommonOptions& options);

/// The value of every option as a TOML table [VERB], in a form that --config reads back.
[[nodiscard]] std::string effectiveConfig(const CLI::App& app);

/// Writes data to stdout completely, or fails. @throws OutputError
void printData(const std::string& text);

}  // namespace accessvdb::tools
