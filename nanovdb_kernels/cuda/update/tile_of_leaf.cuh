// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which tile of FlipsView a leaf lies in.
#pragma once

#include <cstdint>

#include "cuda/update/update_views.cuh"

namespace accessvdb::kernels {

/// @param leaf  voxel index >> 3
__device__ inline std::uint64_t tileOfLeaf(const std::int32_t* leaf) {
  return placeKey(leaf[0] >> FlipsView::kTileLog2, leaf[1] >> FlipsView::kTileLog2, leaf[2] >> 4);
}

}  // namespace accessvdb::kernels
