// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which rules made a state.
#pragma once

#include <cstdint>

namespace accessvdb::internal {

/// Raise it with every change after which the same scans give another map, other points or other labels: a state that
/// older rules made would silently mix both. Not for changes of speed, and not for a parameter's default, because a
/// state keeps its parameters. The layout of the file has a number of its own (kStateSchema in state_head.h).
inline constexpr std::uint32_t kRulesVersion = 5;

}  // namespace accessvdb::internal
