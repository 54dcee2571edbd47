// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Normals of several neighbourhoods at a time, compiled for several instruction sets; one set is selected at run time.
/// All give the bits of hostdev/surface_normal.h, whose rule they run.
#pragma once

#include <cstddef>

#include "hostdev/surface_normal.h"
#include "processor/kernel_list.h"

namespace accessvdb::internal {

struct NormalKernels {
  const char* name;
  /// kernels::smallestEigenvector of each. @param normals  [3 count]
  void (*smallest_eigenvectors)(const kernels::Covariance* covariances, std::size_t count, float* normals);
};

/// The best set for this machine.
const NormalKernels& normalKernels();
/// All sets that run on this machine, best first.
KernelList<NormalKernels> runnableNormalKernels();

}  // namespace accessvdb::internal
