// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is remembered about the directions of points: bounds that follow flips (hostdev/known_counts.h), or levels and
/// how far those of each group have aged (hostdev/known_levels.h).
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <optional>

#include "cuda/memory/growing.h"
#include "cuda/memory/range_array.h"
#include "cuda/update/update_views.cuh"
#include "launch/device_array.h"
#include "launch/exact_updater.h"

namespace accessvdb::kernels {

class KnownTables {
 public:
  /// Without the table of cells, or memory for it, nothing is remembered, which only costs time.
  KnownTables(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const ToolTables& tables,
              int num_directions);

  /// Valid until the next grow().
  [[nodiscard]] const KnownView& view() const { return view_; }
  [[nodiscard]] const CellTableView& cells() const { return cells_; }
  [[nodiscard]] const CorridorView& corridors() const { return corridors_; }
  /// Whether bounds follow flips: they do not age then.
  [[nodiscard]] bool follows() const { return view_.follows; }
  [[nodiscard]] const ArcsView& arcs() const { return arcs_; }

  void setLimit(int collision_limit);
  /// Before this update's flips: nothing has changed yet.
  void beginUpdate(std::uint32_t points, cudaStream_t stream) {
    if (view_.follows) fillBytes(view_.stirred_bits, 0, (points + 31) / 32 * sizeof(std::uint32_t), stream);
  }
  /// New points have no levels until they are admitted.
  void grow(std::uint32_t points, std::uint32_t groups, cudaStream_t stream);

  /// Bytes not taken from `memory`.
  [[nodiscard]] std::uint64_t mappedBytes() const {
    std::uint64_t bytes = 0;
    const auto add = [&](const auto& array) { bytes += array ? array->bytes() : 0; };
    add(levels_), add(notes_), add(freed_), add(counts_), add(lost_), add(counted_bits_), add(stirred_bits_);
    return bytes;
  }

 private:
  DeviceMemory& memory_;
  KnownView view_;
  CellTableView cells_;
  CorridorView corridors_;
  ArcsView arcs_;
  // Nothing else takes as much memory. Without a value nothing is remembered.
  std::optional<RangeArray<std::uint64_t>> levels_;  ///< by id
  std::optional<RangeArray<std::uint32_t>> notes_;   ///< by id
  std::optional<RangeArray<FreedWord>> freed_;       ///< by group
  // In place of levels_ and freed_, where bounds follow flips:
  std::optional<RangeArray<std::uint16_t>> counts_;  ///< by id
  std::optional<RangeArray<std::uint16_t>> lost_;    ///< by group
  std::optional<RangeArray<std::uint32_t>> counted_bits_, stirred_bits_;
  DeviceArray<DirectionArc> cell_directions_;
  DeviceArray<DirectionMask> cell_sets_, corridor_table_;
  DeviceArray<ArcsOfColumn> arcs_of_columns_;
  DeviceArray<CoveringArc> more_arcs_;
};

}  // namespace accessvdb::kernels
