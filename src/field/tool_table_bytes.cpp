// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <vector>

#include "accessvdb/tool_tables.h"
#include "field/scoring_setup.h"
#include "hostdev/voxel_scale.h"
#include "launch/backend.h"
#include "tool/tool_kernel.h"
#include "tool/tool_slabs.h"
#include "update/corridor_offsets.h"
#include "update/known_directions.h"

namespace accessvdb {
namespace {

/// Quarter and half turns, and those between them: for most tools the fewest and the most columns.
constexpr int kSampledDirections = 8;

/// How far the tool reaches from its tip, horizontally.
double horizontalReach_m(const ToolGeometry& tool) {
  float reach_m = 0;
  for (const Eigen::Vector3f& vertex : tool.vertices_T()) reach_m = std::max(reach_m, vertex.head<2>().norm());
  return static_cast<double>(reach_m);
}

/// Voxels of the box of all offsets, of every direction.
double offsetBoxVoxels(const ToolGeometry& tool, const internal::ToolKernel& sampled, int num_directions,
                       double voxel_size_m) {
  double x = sampled.max_ijk[0] - sampled.min_ijk[0] + 1, y = sampled.max_ijk[1] - sampled.min_ijk[1] + 1;
  if (num_directions > kSampledDirections) {  // directions in between reach farther
    x = y = 2 * std::floor(horizontalReach_m(tool) / voxel_size_m + 0.5) + 1;
  }
  return x * y * (sampled.max_ijk[2] - sampled.min_ijk[2] + 1);
}

}  // namespace

ToolTableBytes toolTableBytes(const ToolGeometry& tool, const FieldParams& params) {
  const FieldParams resolved = params.resolved();
  const int directions = resolved.approach.num_directions, sampled = std::min(directions, kSampledDirections);
  const double share = static_cast<double>(directions) / sampled;
  const internal::ToolKernel kernel = internal::ToolKernel::sampled(tool, resolved, sampled);
  const auto bytesOf = [](const auto& list) { return static_cast<double>(list.size() * sizeof(list[0])); };
  const double columns = share * bytesOf(kernel.columns);
  const double tables = columns + share * bytesOf(kernel.samples);

  const bool on_host = resolved.backend != BackendKind::Cuda;
  double held = on_host ? 2 * tables : tables;  // a backend has its own copy
  if (on_host && columns <= static_cast<double>(kernels::PreparedTool::kMostColumnBytes)) {
    // The corridor counts, because windows reach as far; so do directions between the sampled ones.
    std::vector<double> distances = internal::armDistances(resolved);
    const auto offsetsAt = [&] {
      std::vector<float> offsets;
      for (int d = 0; d < sampled; ++d) {
        const double yaw = 2 * 3.141592653589793 * d / sampled;
        for (const double distance : distances) {
          offsets.push_back(static_cast<float>(distance * std::cos(yaw)));
          offsets.push_back(static_cast<float>(distance * std::sin(yaw)));
          offsets.push_back(0);
        }
      }
      return offsets;
    };
    kernels::ApproachView approach;
    approach.num_directions = sampled;
    std::vector<float> offsets = offsetsAt();
    approach.num_arm = static_cast<int>(distances.size());
    approach.arm_offsets = offsets.data();
    if (resolved.update.policy == UpdatePolicy::Exact) {
      held += static_cast<double>(internal::CorridorOffsets(approach, resolved.tsdf.voxel_size_m).bytes());
    }
    if (directions > sampled) {
      distances.push_back(horizontalReach_m(tool));
      offsets = offsetsAt();
      approach.num_arm = static_cast<int>(distances.size());
      approach.arm_offsets = offsets.data();
    }
    const kernels::VoxelScale scale(resolved.tsdf.voxel_size_m);
    const auto prepared = kernels::makeCpuBackend()->prepareTool(kernel.view(), approach, scale.inverse_float32);
    held += share * static_cast<double>(prepared->bytes());
  }
  double making = held;
  if (resolved.backend != BackendKind::Cpu && !kernel.use_samples) {
    // As in ScoringSetup: slabs as they are found, and again in one list, which then goes to the GPU.
    constexpr auto kMost = static_cast<double>(internal::ToolSlabs::kMostBytes);
    const auto slabs = internal::ToolSlabs::make(kernel.view(), sampled, static_cast<std::uint64_t>(kMost / share));
    making +=
        2 * (slabs.empty() ? kMost : share * (bytesOf(slabs.words) + bytesOf(slabs.columns) + bytesOf(slabs.full)));
  }
  if (resolved.update.policy == UpdatePolicy::Exact && on_host && !kernel.use_samples) {
    // The table of directions by cell: one cell more at either end of each axis.
    const double cells = offsetBoxVoxels(tool, kernel, directions, resolved.tsdf.voxel_size_m) / 64;
    const double table = sizeof(kernels::DirectionArc) * cells;
    if (table <= static_cast<double>(internal::KnownDirections::kMostCellTableBytes)) held += table;
  }
  return {static_cast<std::uint64_t>(held), static_cast<std::uint64_t>(std::max(held, making))};
}

}  // namespace accessvdb
