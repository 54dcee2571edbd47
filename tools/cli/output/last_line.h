// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The one line of a program that can no longer report an error in the usual way: there is no memory for it, or an
/// exception cannot reach main() (a thread of a library, a destructor), or a library crashes.
#pragma once

#include "output/error_output.h"

namespace accessvdb::tools {

/// What describeFailure() makes of std::bad_alloc; as text that needs no memory.
struct OutOfMemory {
  static constexpr int kExitCode = 5;
  static constexpr const char *kId = "limit.allocation", *kSubject = "memory",
                              *kProblem = "the machine has run out of memory",
                              *kAdvice = "Use a larger --voxel, fewer scans (--every) or a machine with more memory";
};

/// From now on std::terminate(), abort() and crashes remove unfinished files, print one error line, and end with code 5
/// where memory is what is missing, else with 70. Needs no memory.
void endWithOneLine(int argc, char** argv) noexcept;

/// For a failure that cannot be described because there is no memory for that.
[[noreturn]] void endOutOfMemory() noexcept;

}  // namespace accessvdb::tools
