// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The only file on the kernel side that includes NanoVDB; 32.4 (with OpenVDB 10) to 32.9 (with 13) were tried.
/// Code uses the names that all of them have; here is what was renamed on the way.
#pragma once

#include <nanovdb/NanoVDB.h>
#include <cstdint>

#if NANOVDB_MAJOR_VERSION_NUMBER != 32 || NANOVDB_MINOR_VERSION_NUMBER < 4
#error "AccessVDB needs NanoVDB 32.4 to 32.9 (OpenVDB 10 to 13). Name one by ACCESSVDB_NANOVDB_INCLUDE_DIR."
#endif

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

/// The first word of a grid in memory.
#if defined(NANOVDB_MAGIC_GRID)  // since 32.7, which still reads the other one
inline constexpr std::uint64_t kGridMagic = NANOVDB_MAGIC_GRID;
#else
inline constexpr std::uint64_t kGridMagic = NANOVDB_MAGIC_NUMBER;
#endif

using OccupancyGrid = nanovdb::NanoGrid<bool>;
using OccupancyRoot = nanovdb::NanoRoot<bool>;
using OccupancyUpper = nanovdb::NanoUpper<bool>;
using OccupancyLower = nanovdb::NanoLower<bool>;
using OccupancyLeaf = nanovdb::NanoLeaf<bool>;

using DistanceGrid = nanovdb::NanoGrid<float>;
using DistanceLeaf = nanovdb::NanoLeaf<float>;

}  // namespace accessvdb::kernels
