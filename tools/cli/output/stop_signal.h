// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A requested stop: the first SIGINT, SIGTERM or SIGHUP sets a flag, a second ends the program at once.
#pragma once

#include "output/error_output.h"

namespace accessvdb::tools {

/// SIGHUP is left alone where it was ignored before: nohup.
void watchStopSignals();
/// For verbs that only compute and then write: a signal ends them at once by 128 + its number, with one line on stderr
/// and without half a file.
void endOnStopSignals(const Messages& messages);
/// 0, SIGINT, SIGTERM or SIGHUP. A program that neither asks nor computes for some seconds after the signal is blocked,
/// by a pipe or a dead disk, and is ended by the signal itself.
[[nodiscard]] int stopSignal();
/// "SIGTERM"
[[nodiscard]] const char* stopSignalName();

}  // namespace accessvdb::tools
