// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points of an updater: what neighbourhoods are made of, and which points lie where.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>

#include "cuda/memory/staging.h"
#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"
#include "launch/point_updater.h"

namespace accessvdb::kernels {

class PointTables {
 public:
  /// Points whose neighbours are found at a time.
  static constexpr std::uint32_t kPart = 1u << 17;

  /// @param view  out: rule, groups.log2
  PointTables(DeviceMemory& memory, const UpdaterTables& tables, UpdateView& view);

  /// Makes room for what is admitted. @param view  in: num_points and index.blocks, as they were; out: points, state
  /// (but for its bits), index, groups, num_points
  void grow(const AdmitInput& input, UpdateView& view, cudaStream_t stream);
  /// Takes it in. @param first_place  of the news in view.places, or kNoIndex: nobody asks what they matter to
  void admit(const AdmitInput& input, std::uint32_t first_place, const UpdateView& view, cudaStream_t stream);
  void setWeights(std::span<const PointWeight> weights, const UpdateView& view, cudaStream_t stream);

  /// Room to make the neighbourhoods of so many points in parts of up to kPart, and to keep those of a part.
  void growParts(std::uint32_t points);
  /// Only the room to make them.
  void growFound(std::uint32_t points);
  /// Of view.moved[first .. first + count), as far as there are so many, at most kPart.
  /// @return [count], kept until the next call
  Neighbourhood* makeNeighbourhoods(const UpdateView& view, std::uint32_t first, std::uint32_t count,
                                    cudaStream_t stream);
  /// @param to  [count]
  void makeNeighbourhoods(const UpdateView& view, std::uint32_t first, std::uint32_t count, Neighbourhood* to,
                          cudaStream_t stream);

 private:
  void growPoints(std::uint32_t points, std::size_t kept);
  void growBlocks(const AdmitInput& input, UpdateView& view, cudaStream_t stream);
  void refreshIndex(BlockIndexView& index, std::uint32_t blocks) const;

  DeviceMemory& memory_;
  std::size_t words_;
  // By id.
  DeviceArray<std::uint32_t> block_;
  DeviceArray<float> mean_, to_sensor_, reach_;
  DeviceArray<std::uint64_t> own_seen_;
  // By block.
  DeviceArray<std::uint64_t> hash_keys_;
  DeviceArray<std::uint32_t> hash_blocks_, first_, count_, ids_, group_of_;
  DeviceArray<std::int32_t> leaf_;
  DeviceArray<float> block_reach_;
  // By group.
  DeviceArray<std::int32_t> group_leaf_;
  DeviceArray<std::uint8_t> with_points_;
  // Of a part of the points.
  DeviceArray<FoundNeighbours> found_;
  DeviceArray<Neighbourhood> part_;
  Staging<PointNews> news_;
  Staging<BlockNews> blocks_news_;
  Staging<std::uint32_t> ids_news_;
  Staging<PointWeight> weights_;
};

}  // namespace accessvdb::kernels
