// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A program of verbs: finds the verb, and turns anything that it throws into one line and an exit code.
#pragma once

#include <string>
#include <vector>

#include "output/error_output.h"

namespace accessvdb::tools {

using Arguments = std::vector<std::string>;

struct Verb {
  const char* name;
  const char* purpose;  ///< empty: not in the list of verbs
  /// Arguments are those after the verb; errors leave as exceptions.
  /// @return the exit code: 0, or 130/143 if a signal stopped the run
  int (*run)(const Arguments& arguments, Messages& messages);
};

struct Program {
  const char* name;
  const char* purpose;
  std::vector<Verb> verbs;
  const char* example;
};

/// @return the exit code
[[nodiscard]] int runProgram(const Program& program, int argc, char** argv);

}  // namespace accessvdb::tools
