// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/rolling_start.h"

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/memory_prediction.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr std::int32_t kLargestTile_voxels = 1 << 16;

}  // namespace

void requireRolling(const FieldParams& params, const RollingOptions& options, const TileMargins& margins) {
  const auto refuse = [](const std::string& problem, const std::string& advice) {
    throw InvalidArgument("rolling.params", "params", problem, advice);
  };
  if (params.window) refuse("have a window, but a rolling field makes its own tiles", "Leave it out");
  if (params.update.budget_points > 0) refuse("have a budget, which is shared among all points", "Leave it out");
  if (params.update.policy == UpdatePolicy::Paper) refuse("have the paper's policy", "Use UpdatePolicy::Exact");
  if (params.tsdf.region == UpdateRegion::Projective) refuse("have projective fusion", "Use another UpdateRegion");
  if (params.tsdf.clear_rays_m > 0 || params.tsdf.platform_radius_m > 0) {
    refuse("clear more than tiles share, clear_rays_m or platform_radius_m", "Leave them out, or use one field");
  }
  const std::int32_t edge = options.tile_voxels;
  const bool power = edge >= FieldWindow::kEdge && (edge & (edge - 1)) == 0 && edge <= kLargestTile_voxels;
  if (edge != 0 && (!power || edge < margins.least_tile_voxels)) {
    throw InvalidArgument("rolling.tile", "tile_voxels",
                          "must be a power of two from " + std::to_string(margins.least_tile_voxels) + " to " +
                              std::to_string(kLargestTile_voxels) + " with this tool",
                          "Leave it at 0 for the rule");
  }
}

std::uint64_t tileLimit(const RollingOptions& options) {
  const std::uint64_t limit = options.process_limit_bytes;
  if (limit == 0) return options.memory_limit_bytes;
  constexpr std::uint64_t kForSteps = std::uint64_t{144} << 20, kLeastForTiles = std::uint64_t{16} << 20;
  ::malloc_trim(0);  // what an earlier field has freed is for the tiles of this one
  const std::uint64_t used = residentMemoryBytes() + kForSteps;
  const auto megabytes = [](std::uint64_t bytes) { return std::to_string(bytes >> 20); };
  if (limit < used + kLeastForTiles) {
    throw ResourceLimit(
        "limit.memory", "process_limit_bytes",
        megabytes(limit) + " MiB leave nothing for tiles: without any the program takes " + megabytes(used) + " MiB",
        "Use process_limit_bytes " + std::to_string(((used + 2 * kLeastForTiles) >> 20) + 1) + "M or more");
  }
  const std::uint64_t rest = limit - used;
  return options.memory_limit_bytes > 0 ? std::min(rest, options.memory_limit_bytes) : rest;
}

std::uint64_t deviceLimit(const RollingOptions& options, std::uint64_t free_bytes, std::uint64_t table_bytes) {
  // The rest is for what a step takes besides, and for what the driver does.
  return options.device_limit_bytes > 0 || free_bytes == 0 ? options.device_limit_bytes
                                                           : table_bytes + free_bytes / 5 * 4;
}

/// What is advised elsewhere is for the folder of the result.
FolderInUse takeFolder(const fs::path& folder) {
  try {
    io::prepareOutputFolder(folder);
    return FolderInUse(folder);
  } catch (const OutputError& error) {
    throw OutputError(
        error.id(), error.subject(), error.problem(),
        std::string(error.id() == "output.locked" ? "Wait for its end" : "Check its permissions and the disk") +
            ", or choose another folder for the tiles");
  }
}

FolderInUse takeNewFolder(const fs::path& folder) {
  FolderInUse::requireEmpty(folder);  // first: nothing is written beside what is the user's
  FolderInUse in_use = takeFolder(folder);
  FolderInUse::requireEmpty(folder);  // another field may have begun, and ended, since
  return in_use;
}

/// The largest power of two below which returns near faces of tiles are kept twice more often than it saves memory: of
/// tiles with edge e, the ones that a scan of range R touches hold about (2 R + e)^2 (1 + 2 m / e)^2, least at
/// e = 2 sqrt(m R).
std::int32_t edgeSideBySide(const TileMargins& margins, const FieldParams& params) {
  constexpr double kUsualRange_m = 30;
  const double range_m = std::min(params.tsdf.max_range_m, kUsualRange_m);
  const double wanted = 2 * std::sqrt(margins.returns_voxels * range_m / params.tsdf.voxel_size_m);
  std::int32_t edge = margins.least_tile_voxels;
  while (edge < wanted && edge < kLargestTile_voxels) edge *= 2;
  return edge;
}

}  // namespace accessvdb::tiles
