// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which leaves of the mirror hold something that collides: one bit per leaf, one word per vertical column of 16
/// leaves, and the lower nodes by place. Rebuilt for every update: one read per leaf, little next to the search.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "cuda/search/hash_view.cuh"
#include "launch/backend.h"

namespace accessvdb::kernels {

/// Lower nodes of the mirror by place, and which of their leaves hold something that collides.
struct BusyMapView {
  static constexpr std::uint32_t kColumns = 256;  ///< columns of leaves per lower node
  static constexpr int kEntries = 2;              ///< words per node in a window
  HashView hash;
  std::uint32_t* number_at = nullptr;  ///< [slots of the hash]
  std::uint32_t* nodes = nullptr;      ///< [lower nodes] byte offset from the grid / 32
  std::uint16_t* bits = nullptr;       ///< [lower nodes x 16 x 16] x, y of a column of leaves; bit z
};

/// Counts the lower nodes of the mirror. @param lowers  zeroed device memory
void launchCountLowers(const OccupancyGrid* grid, std::uint32_t* lowers, cudaStream_t stream);
/// @param busy    with an empty hash; hash and arrays have room for `lowers` nodes
/// @param listed  zeroed device memory: number of nodes listed
void launchBusyMap(const OccupancyGrid* grid, const BusyMapView& busy, std::uint32_t lowers, std::uint32_t* listed,
                   cudaStream_t stream);

}  // namespace accessvdb::kernels
