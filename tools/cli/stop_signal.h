// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A requested stop: the first SIGINT or SIGTERM sets a flag, a second ends the program at once.
#pragma once

namespace accessvdb::tools {

void watchStopSignals();
/// 0, SIGINT or SIGTERM.
[[nodiscard]] int stopSignal();

}  // namespace accessvdb::tools
