// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lanes of a warp.
#pragma once

namespace accessvdb::kernels {

inline constexpr unsigned kWarp = 32, kAllLanes = 0xffffffffu;

}  // namespace accessvdb::kernels
