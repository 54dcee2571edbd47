// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points of an updater: what neighbourhoods are made of, and which points lie where.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <optional>

#include "cuda/memory/range_array.h"
#include "cuda/memory/staging.h"
#include "cuda/update/competition_tables.h"
#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"
#include "launch/point_delta.h"

namespace accessvdb::kernels {

class PointTables {
 public:
  /// Most points whose neighbours are found at a time, one by one.
  static constexpr std::uint32_t kChunk = 1u << 16;

  /// @param keeps  whether neighbourhoods follow what moves (hostdev/kept_neighbours.h)
  PointTables(const std::shared_ptr<DeviceContext>& context, DeviceMemory& memory, const NeighbourTables& tables,
              bool keeps);

  /// Valid until the next grow().
  [[nodiscard]] const PointsView& view() const { return view_; }
  /// Sets the current arrays of the host's point state.
  void setState(const PointStateView& points) { view_.points = points; }

  /// Of points that are not all scored; else no choice is made.
  [[nodiscard]] CompetitionView competition() const { return competition_ ? competition_->view() : CompetitionView(); }
  /// Before points are admitted for the next update.
  void clearTouched(cudaStream_t stream) {
    if (competition_) competition_->clearTouched(stream);
  }

  /// Bytes not taken from `memory`.
  [[nodiscard]] std::uint64_t mappedBytes() const {
    return block_.bytes() + mean_.bytes() + to_sensor_.bytes() + own_seen_.bytes() + reach_.bytes() + kept_.bytes() +
           (competition_ ? competition_->mappedBytes() : 0);
  }

  /// Makes room for what is admitted.
  void grow(const AdmitInput& input, cudaStream_t stream);
  /// Admits it, once there is room. @param first_place  index of the first delta in moved.places, or kNoIndex: nothing
  /// has a neighbourhood yet  @return the deltas on the device, valid for work queued before the next call
  DeviceList<PointDelta> admit(const AdmitInput& input, const MovedView& moved, const KnownView& known,
                               std::uint32_t first_place, cudaStream_t stream);
  void setWeights(std::span<const PointWeight> weights, cudaStream_t stream);

  /// Makes room to find the neighbourhoods of this many points in chunks of up to kChunk, and to keep those of a chunk.
  void growChunks(std::uint32_t points);
  /// The neighbourhoods of moved points that were made are not stored.
  void forgetKept(const MovedView& moved, cudaStream_t stream) const;
  /// Makes room to find those of this many moved points near touched ones.
  void growLeft(std::uint32_t points);
  /// @param part  at most kChunk points  @param failed  see launchNearest
  /// @return [part.count], kept until the next call
  FoundNeighbourhood* makeNeighbourhoods(const PointChunk& part, std::uint32_t* failed, cudaStream_t stream);
  /// The same for moved points near touched ones.
  FoundNeighbourhood* makeByCell(const MovedView& moved, const PointChunk& part, cudaStream_t stream);
  /// Needs growLeft() for as many, or growChunks().
  void makeByCell(const MovedView& moved, std::uint32_t begin, std::uint32_t end, FoundNeighbourhood* to,
                  cudaStream_t stream);
  /// @param to  [part.count]
  void makeNeighbourhoods(const PointChunk& part, std::uint32_t* failed, FoundNeighbourhood* to, cudaStream_t stream);

 private:
  void growPoints(std::uint32_t points, cudaStream_t stream);
  void growBlocks(const AdmitInput& input, cudaStream_t stream);
  void refreshIndex(std::uint32_t blocks);
  void chooseOnSurface(const PointChunk& part, FoundNeighbourhood* found, cudaStream_t stream) const;

  DeviceMemory& memory_;
  std::size_t words_;
  int multiprocessors_;
  bool by_cell_;  ///< whether most neighbourhoods of moved points can be made cell by cell
  bool keeps_;
  PointsView view_;
  // By id.
  RangeArray<std::uint32_t> block_;
  RangeArray<float> mean_, to_sensor_, reach_;
  RangeArray<std::uint64_t> own_seen_;
  RangeArray<KeptNeighbours> kept_;
  // By block.
  DeviceArray<std::uint64_t> hash_keys_;
  DeviceArray<std::uint32_t> hash_blocks_, first_, count_, ids_, group_of_;
  DeviceArray<std::int32_t> leaf_;
  DeviceArray<float> block_reach_;
  // By group.
  DeviceArray<std::int32_t> group_leaf_;
  DeviceArray<std::uint8_t> with_points_;
  DeviceArray<std::uint32_t> left_;               ///< moved points whose neighbourhoods are not made cell by cell
  std::optional<CompetitionTables> competition_;  ///< if not every point is scored
  // For one part of the points.
  DeviceArray<FoundNeighbours> found_;
  DeviceArray<FoundNeighbourhood> part_;
  Staging<PointDelta> deltas_;
  Staging<BlockDelta> block_deltas_;
  Staging<std::uint32_t> block_ids_;
  Staging<PointWeight> weights_;
};

}  // namespace accessvdb::kernels
