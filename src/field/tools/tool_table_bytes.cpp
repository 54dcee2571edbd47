// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <vector>

#include "accessvdb/tool_tables.h"
#include "field/tools/scoring_setup.h"
#include "hostdev/voxel_scale.h"
#include "launch/backend.h"
#include "tool/tool_kernel.h"
#include "tool/tool_slabs.h"
#include "update/cell_directions.h"
#include "update/corridor_offsets.h"

namespace accessvdb {
namespace {

/// With yaw, these are the quarter and half turns and those between them: for most tools the fewest and the most
/// columns.
constexpr int kSampledDirections = 8;

/// Box of all offsets, of every direction and roll, in voxels from the point.
struct OffsetBox {
  Eigen::Array3d low = {0, 0, 0}, high = {0, 0, 0};
  [[nodiscard]] double voxels() const { return (high - low + 1).prod(); }
};

OffsetBox offsetBoxOf(const ToolGeometry& tool, double voxel_size_m, const internal::ExpandedOrientations& orientations,
                      const internal::ToolRolls& rolls) {
  OffsetBox box;
  const double per_voxel = 1 / voxel_size_m;
  for (const ToolOrientation& orientation : orientations.all) {
    for (int roll = 0; roll < rolls.count; ++roll) {
      const Eigen::Matrix3d R_WT = internal::rolledBy(orientation, rolls, roll).R_WT;
      for (const Eigen::Vector3f& vertex : tool.vertices_T()) {
        const Eigen::Array3d voxel =
            (R_WT * vertex.cast<double>() * per_voxel + Eigen::Vector3d(0.5, 0.5, 0.5)).array().floor();
        box.low = box.low.min(voxel);
        box.high = box.high.max(voxel);
      }
    }
  }
  return box;
}

ToolTableBytes tableBytesOf(const ToolGeometry& tool, const FieldParams& params) {
  const FieldParams resolved = params.resolved();
  const auto orientations = internal::ExpandedOrientations::of(resolved.approach);
  const int directions = orientations.count();
  const auto kernel = internal::ToolKernel::sampled(tool, resolved, orientations, kSampledDirections);
  const int sampled = kernel.num_directions;
  const double share = static_cast<double>(directions) / sampled;
  const OffsetBox box = offsetBoxOf(tool, resolved.tsdf.voxel_size_m, orientations, kernel.rolls);
  const auto bytesOf = [](const auto& list) { return static_cast<double>(list.size() * sizeof(list[0])); };
  const double columns = share * bytesOf(kernel.columns);
  const double tables = columns + share * bytesOf(kernel.samples);

  const bool on_host = resolved.backend != BackendKind::Cuda;
  double held = on_host ? 2 * tables : tables;  // a backend has its own copy
  if (on_host && columns <= static_cast<double>(kernels::PreparedTool::kMostColumnBytes)) {
    // The corridor counts, because windows reach as far; so do directions between the sampled ones.
    const std::vector<double> distances = internal::armDistances(resolved);
    const std::vector<ToolOrientation>& all = orientations.all;
    kernels::ApproachView approach;
    std::vector<float> offsets;
    if (resolved.update.policy == UpdatePolicy::Exact) {
      for (const ToolOrientation& orientation : all) internal::addOffsetsAlong(orientation, distances, offsets);
      approach.num_directions = directions;
      approach.num_arm = static_cast<int>(distances.size());
      approach.arm_offsets = offsets.data();
      held += static_cast<double>(internal::CorridorOffsets(approach, resolved.tsdf.voxel_size_m).bytes());
      offsets.clear();
    }
    const auto addCorner = [&](const Eigen::Array3d& voxel) {
      for (Eigen::Index n = 0; n < 3; ++n) {
        // A level corridor has a form of its own, so corners of level sets are level.
        offsets.push_back(orientations.is_yaw && n == 2 ? 0.0f
                                                        : static_cast<float>(voxel[n] * resolved.tsdf.voxel_size_m));
      }
    };
    for (int d = 0; d < sampled; ++d) {
      const std::size_t at = static_cast<std::size_t>(d) * all.size() / static_cast<std::size_t>(sampled);
      internal::addOffsetsAlong(all[at], distances, offsets);
      addCorner(box.low);
      addCorner(box.high);
    }
    approach.num_directions = sampled;
    approach.num_arm = static_cast<int>(distances.size()) + 2;
    approach.arm_offsets = offsets.data();
    const kernels::VoxelScale scale(resolved.tsdf.voxel_size_m);
    const auto prepared = kernels::makeCpuBackend()->prepareTool(kernel.view(), approach, scale.inverse_float32);
    held += share * static_cast<double>(prepared->bytes());
  }
  double making = held;
  if (resolved.backend != BackendKind::Cpu && !kernel.use_samples && !kernels::isWide(directions)) {
    // As in ScoringSetup: slabs as they are found, and again in one list, which then goes to the GPU.
    constexpr internal::ToolSlabs::Limits kLimits;
    const auto slabs = internal::ToolSlabs::make(kernel.view(), sampled, kLimits.dividedBy(share));
    making += 2 * (slabs.empty() ? static_cast<double>(kLimits.bytes)
                                 : share * (bytesOf(slabs.words) + bytesOf(slabs.columns) + bytesOf(slabs.rows)));
  }
  if (resolved.update.policy == UpdatePolicy::Exact && on_host && !kernel.use_samples && !kernels::isWide(directions)) {
    // The table of directions by cell: one cell more at either end of each axis.
    const double cells = box.voxels() / 64, masks = static_cast<double>(sizeof(kernels::DirectionMask)) * cells;
    if (masks <= static_cast<double>(internal::CellDirections::kMostBytes)) {
      held += orientations.is_yaw ? static_cast<double>(sizeof(kernels::DirectionArc)) * cells : masks;
      making = std::max(making, held + (orientations.is_yaw ? masks : 0));
    }
  }
  return {static_cast<std::uint64_t>(held), static_cast<std::uint64_t>(std::max(held, making))};
}

}  // namespace

ToolTableBytes toolTableBytes(const std::vector<ToolSpec>& tools, const FieldParams& params) {
  ToolTableBytes all = {0, 0};
  for (const ToolSpec& spec : tools) {
    const ToolTableBytes own = tableBytesOf(spec.tool, toolParams(spec, params));
    all.making = std::max(all.making, all.held + own.making);  // one is made after the other
    all.held += own.held;
  }
  all.making = std::max(all.making, all.held);
  return all;
}

double toolShareHidden(const ToolGeometry& tool, const FieldParams& params) {
  return internal::largestHiddenShare(tool, params.resolved());
}

}  // namespace accessvdb
