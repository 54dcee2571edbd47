// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tools of a field at any pose: what is made of them once, and the queries that a field gives out.
#pragma once

#include <tbb/task_arena.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <vector>

#include "accessvdb/pose_query.h"
#include "field/tools/tools_of_field.h"
#include "launch/backend.h"
#include "tool/tool_bitmap.h"
#include "tsdf/packed_map.h"

namespace accessvdb::internal {

/// A tool as poses are tried with it.
class FittedTool {
 public:
  FittedTool(const ToolGeometry& tool, const ToolScoring& scoring) : tool_(tool), scoring_(scoring) {}

  [[nodiscard]] const ToolGeometry& geometry() const { return tool_; }
  [[nodiscard]] const ToolScoring& scoring() const { return scoring_; }
  /// In the backend's memory; made when first needed. @throws ResourceLimit
  [[nodiscard]] kernels::ToolBitmapView bitmap(kernels::Backend& backend, double voxel_size_m);
  /// The field's own orientation, with its roll, that this is within rounding; else itself.
  [[nodiscard]] Eigen::Matrix3d ownOrientation(const Eigen::Matrix3d& R_WT);

 private:
  const ToolGeometry& tool_;
  const ToolScoring& scoring_;
  std::unique_ptr<ToolBitmap> bitmap_;
  kernels::DeviceArray<std::uint64_t> d_words_;
  std::vector<Eigen::Matrix3d> own_;  ///< orientations
};

/// The parts of a field that poses are tried against.
struct FitInputs {
  const PackedMap* map;
  kernels::Backend* backend;
  kernels::OccupancyView mirror;
  const ToolsOfField* tools;
  Eigen::Vector3d origin_W;
  tbb::task_arena* arena;
  std::shared_ptr<const std::atomic<std::uint64_t>> field_revision;
};

/// One per field.
class PoseFits {
 public:
  [[nodiscard]] PoseQuery query(const FitInputs& field);

 private:
  friend class accessvdb::PoseQuery;
  std::vector<std::unique_ptr<FittedTool>> tools_;
  std::mutex mutex_;  ///< of tools_, and of a GPU
};

}  // namespace accessvdb::internal
