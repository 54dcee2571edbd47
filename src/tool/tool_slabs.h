// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool's voxels in slabs of one x, eight y and eight z, so that 64 of them meet 64 voxels of a leaf of the map at
/// a time.
#pragma once

#include <cstdint>
#include <vector>

#include "hostdev/views.h"

namespace accessvdb::internal {

/// Host-side tables behind a ToolSlabsView. Empty for tools of samples, and if they would take too much memory, which
/// only costs time.
struct ToolSlabs {
  struct Limits {
    /// Of all tables; above it, searches work without them.
    std::uint64_t bytes = std::uint64_t{512} << 20;
    /// Of the boxes; above it, slabs are kept by row. That takes about a fifth of the memory, but one more read per
    /// slab, which costs more than it spares as long as the boxes stay in the cache.
    std::uint64_t box_bytes = std::uint64_t{128} << 20;

    [[nodiscard]] Limits dividedBy(double share) const;
  };

  std::vector<std::uint64_t> words;     ///< begin with an empty one, unless kept by row
  std::vector<kernels::SlabBox> boxes;  ///< [D x 8]
  std::vector<kernels::LeafColumn> columns;
  std::vector<std::uint32_t> begin;    ///< [D x 8 x 8 + 1]
  std::vector<kernels::SlabRow> rows;  ///< of each box, if slabs are kept by row
  bool thick = false;                  ///< enough slabs are full for looking them up to pay off

  [[nodiscard]] bool empty() const { return begin.empty(); }

  /// Parallel over directions, or the parts of all of them. @param tool  host memory
  static ToolSlabs make(const kernels::ToolKernelView& tool, int num_directions, const Limits& limits);
};

}  // namespace accessvdb::internal
