// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The state of the points of a field of several tools as if it were that of one: at each point, of the tool that
/// stands for it (best_tool.h). Directions are counted through all tools. For views of a field at one moment.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "launch/counted_memory.h"
#include "update/point_scorer.h"
#include "update/scored_arrays.h"

namespace accessvdb::internal {

struct ViewedTool {
  const PointScorer& scorer;
  kernels::ApproachView approach;  ///< in host memory
  std::uint16_t collision_limit;
  bool grown;  ///< as ToolVerdict::grown
};

class MergedTools {
 public:
  /// @param tools  of the same points, as many as there are in the first one's state
  MergedTools(kernels::Backend& backend, std::span<const ViewedTool> tools);
  MergedTools(const MergedTools&) = delete;
  MergedTools& operator=(const MergedTools&) = delete;

  /// In the backend's memory; what does not depend on the tool is that of the first one.
  [[nodiscard]] const kernels::PointStateView& view() const { return view_; }
  [[nodiscard]] const float* axes_xyz() const { return d_axes_.data(); }  ///< [3 D] in the backend's memory
  [[nodiscard]] int numDirections() const { return num_directions_; }     ///< [D] of all tools

 private:
  kernels::CountedMemory memory_;
  ScoredArrays arrays_;
  kernels::PointStateView view_;
  int num_directions_ = 0;
  kernels::DeviceArray<float> d_axes_;
};

}  // namespace accessvdb::internal
