// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tables that never change: tool, directions, corridor; on the host and in the backend's memory.
#pragma once

#include <memory>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/table_progress.h"
#include "launch/backend.h"
#include "tool/tool_kernel.h"
#include "tool/tool_slabs.h"
#include "update/point_scorer.h"
#include "update/scheduled_tool.h"

namespace accessvdb::internal {

class ScoringSetup {
 public:
  ScoringSetup(const ToolGeometry& tool, const FieldParams& resolved, kernels::Backend& backend,
               const TableProgress& progress = {})
      : ScoringSetup(tool, resolved, ExpandedOrientations::of(resolved.approach), backend, progress) {}
  ScoringSetup(const ScoringSetup&) = delete;
  ScoringSetup& operator=(const ScoringSetup&) = delete;

  [[nodiscard]] const ToolKernel& tool() const { return tool_; }
  [[nodiscard]] const kernels::DirectionTable& directions() const { return directions_; }
  [[nodiscard]] kernels::ToolKernelView hostTool() const { return tool_.view(); }
  [[nodiscard]] kernels::ApproachView hostApproach() const;
  /// @param grid  the mirror, in the backend's memory
  [[nodiscard]] ScoringTables tables(const kernels::OccupancyGrid* grid) const;
  /// For a scheduler. @param scorer  of the points that are scored with these tables
  [[nodiscard]] ScheduledTool scheduledFor(PointScorer& scorer) const;
  [[nodiscard]] std::uint64_t hostBytes() const;
  [[nodiscard]] std::uint64_t deviceBytes() const { return memory_.bytes(); }  ///< in the backend's memory

 private:
  ScoringSetup(const ToolGeometry& tool, const FieldParams& resolved, const ExpandedOrientations& orientations,
               kernels::Backend& backend, const TableProgress& progress);
  void loadSlabs();

  FieldParams params_;
  ToolKernel tool_;
  kernels::DirectionTable directions_;
  std::vector<float> arm_offsets_;  ///< [D x num_arm x 3]
  int num_arm_ = 0;
  kernels::CountedMemory memory_;
  kernels::DeviceArray<kernels::VoxelColumn> d_columns_;
  kernels::DeviceArray<kernels::LeafColumn> d_leaf_columns_;
  bool slabs_are_thick_ = false;
  kernels::DeviceArray<kernels::SlabRow> d_slab_rows_;
  kernels::DeviceArray<kernels::SlabBox> d_slab_boxes_;
  kernels::DeviceArray<std::uint64_t> d_slab_words_;
  kernels::DeviceArray<std::uint32_t> d_column_begin_, d_sample_begin_, d_leaf_column_begin_;
  kernels::DeviceArray<float> d_samples_, d_directions_, d_axes_, d_arm_offsets_;
  std::unique_ptr<kernels::PreparedTool> prepared_;
};

/// Distances of the corridor's samples from the surface, metres: the three of the paper, then every tau up to the
/// corridor's length, and its end.
std::vector<double> armDistances(const FieldParams& resolved);

}  // namespace accessvdb::internal
