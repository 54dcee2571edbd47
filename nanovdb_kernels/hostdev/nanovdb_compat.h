// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The only file on the kernel side that includes NanoVDB. Handles the header paths of 10.x and of 11 and later.
#pragma once

#include <nanovdb/NanoVDB.h>

#if defined(__CUDACC__)
#define ACCESSVDB_HOSTDEV __host__ __device__
#else
#define ACCESSVDB_HOSTDEV
#endif

/// For loops whose index selects words that must stay in a device's registers.
#if defined(__CUDA_ARCH__)
#define ACCESSVDB_UNROLL _Pragma("unroll")
#else
#define ACCESSVDB_UNROLL
#endif

namespace accessvdb::kernels {

using OccupancyGrid = nanovdb::NanoGrid<bool>;
using OccupancyRoot = nanovdb::NanoRoot<bool>;
using OccupancyUpper = nanovdb::NanoUpper<bool>;
using OccupancyLower = nanovdb::NanoLower<bool>;
using OccupancyLeaf = nanovdb::NanoLeaf<bool>;

using DistanceGrid = nanovdb::NanoGrid<float>;
using DistanceLeaf = nanovdb::NanoLeaf<float>;

}  // namespace accessvdb::kernels
