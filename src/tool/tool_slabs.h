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
  /// Limit on their memory; above it, searches work without them.
  static constexpr std::uint64_t kMostBytes = std::uint64_t{512} << 20;

  std::vector<std::uint64_t> words;
  std::vector<kernels::SlabBox> boxes;  ///< [D x 8]
  std::vector<kernels::LeafColumn> columns;
  std::vector<kernels::FullSlabs> full;  ///< of each column; empty if there are few
  std::vector<std::uint32_t> begin;      ///< [D x 8 x 8 + 1]
  std::vector<kernels::SlabRow> rows;    ///< only of tools that roll

  [[nodiscard]] bool empty() const { return begin.empty(); }

  /// Parallel over directions, or the parts of all of them. @param tool  host memory
  static ToolSlabs make(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes);
};

}  // namespace accessvdb::internal
