// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points below the confidence bound, and which of them a scan may have brought above it.
///
/// A weight is the largest of the voxels around a point, so it can only have grown where a scan reached the point's
/// leaf (MapReads::reached). Of the many points that wait, most lie where nobody looks any more: they are not looked
/// at.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <cstdint>
#include <span>
#include <vector>

#include "points/point_store.h"

namespace accessvdb::internal {

/// Fresh points, by place.
struct FreshPlaces {
  std::vector<Index3> voxels;
  std::vector<std::uint32_t> blocks;  ///< of each, index into SurfaceIndex::blocks()
};

class FreshPoints {
 public:
  /// @param points  alive as long as this
  explicit FreshPoints(const PointStore& points) : points_(points) {}

  /// These points are fresh from now on.
  void add(std::span<const std::uint32_t> ids);
  /// A scan reached these leaves (voxel index >> 3). From any thread, but not beside the other functions.
  void noteReached(std::span<const Index3> leaves);
  /// A scan may have reached any leaf.
  void noteAll() { all_reached_ = true; }
  /// The fresh points in the leaves that were reached since the last call, in a fixed order.
  void takeReached(FreshPlaces& places);
  /// These points are not fresh any more: entries of takeReached().
  void remove(const FreshPlaces& places, std::span<const std::uint32_t> entries);

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  /// Of a cell of the index.
  struct FreshCell {
    LeafBits fresh = {};    ///< leaves with fresh points
    LeafBits reached = {};  ///< of them, those that were reached
  };
  /// number of the cell << 9 | bit of the leaf
  using LeafCode = std::uint64_t;

  const PointStore& points_;
  ChunkedArray<FreshCell> cells_;     ///< by the number of the cell
  ChunkedArray<LeafBits> of_blocks_;  ///< [blocks] voxels with a fresh point
  tbb::enumerable_thread_specific<std::vector<LeafCode>> reached_;
  bool all_reached_ = false;
};

}  // namespace accessvdb::internal
