// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sets of inner loops, each compiled for other instructions.
#pragma once

#include <array>

namespace accessvdb::internal {

/// The sets that run on this machine, best first.
template <typename Kernels>
struct KernelList {
  std::array<const Kernels*, 3> kernels;
  int count;
};

}  // namespace accessvdb::internal
