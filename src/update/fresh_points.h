// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points below the confidence bound, and which of them a scan may have raised above it.
///
/// A point's weight is the largest of the voxels around it, so it can only have grown if a scan reached the point's
/// leaf (MapReads::reached). Most of the waiting points lie where the sensor no longer looks; they are not checked.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <cstdint>
#include <span>
#include <vector>

#include "points/point_store.h"

namespace accessvdb::internal {

/// Fresh points, by position.
struct FreshPlaces {
  std::vector<Index3> voxels;
  std::vector<std::uint32_t> blocks;  ///< per voxel, index into SurfaceIndex::blocks()
};

class FreshPoints {
 public:
  /// @param points  must outlive this
  explicit FreshPoints(const PointStore& points) : points_(points) {}

  /// Marks these points as fresh.
  void add(std::span<const std::uint32_t> ids);
  /// Notes the leaves (voxel index >> 3) that a scan reached. From any thread, but not concurrently with other
  /// functions.
  void noteReached(std::span<const Index3> leaves);
  /// Notes that a scan may have reached any leaf.
  void noteAll() { all_reached_ = true; }
  /// Takes the fresh points in the leaves reached since the last call, in a fixed order.
  void takeReached(FreshPlaces& places);
  /// Marks these points as no longer fresh. @param entries  indices into the result of takeReached()
  void remove(const FreshPlaces& places, std::span<const std::uint32_t> entries);

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  /// State of one leaf group of the index.
  struct FreshLeafGroup {
    LeafBits fresh = {};    ///< leaves with fresh points
    LeafBits reached = {};  ///< those of them that were reached
  };
  /// leaf group number << 9 | bit of the leaf.
  using LeafCode = std::uint64_t;

  const PointStore& points_;
  ChunkedArray<FreshLeafGroup> leaf_groups_;  ///< by leaf group number
  ChunkedArray<LeafBits> of_blocks_;          ///< [blocks] voxels with a fresh point
  tbb::enumerable_thread_specific<std::vector<LeafCode>> reached_;
  bool all_reached_ = false;
};

}  // namespace accessvdb::internal
