// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The folder of rays and its manifest rays.json, which is written last.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "accessvdb/tiles.h"
#include "tiles/ray_shard.h"

namespace accessvdb::tiles {

[[nodiscard]] std::filesystem::path raysFolder(const std::filesystem::path& out);

/// The id that a shard carries: of the plan without the flights after its own.
[[nodiscard]] std::string shardPlanId(const Plan& plan, std::uint64_t first_step);

struct ShardRange {
  std::uint64_t first_step = 0, end_step = 0;
};
/// Of a finished bin(): shards that are not there as they were written, by name and size.
[[nodiscard]] std::vector<ShardRange> missingShards(const std::filesystem::path& out, const Plan& plan);

/// What a tile's files are made from, as one hash. @param returns  of all steps
[[nodiscard]] std::string contentOf(const Plan& plan, const RayDigest& returns);

/// Reads the indices of all shards and writes the manifest. @param inputs  with their hashes
Binned writeBinned(const std::filesystem::path& out, const Plan& plan, const std::vector<io::InputFile>& inputs);
/// The same for tiles that were made without rays on disk.
void writeBinned(const std::filesystem::path& out, const Plan& plan, const Binned& rays);
/// From then on binned() gives nothing, and nobody takes the tiles for whole. @throws OutputError
void removeBinned(const std::filesystem::path& out);

/// Where a tile's returns are, in the order of the steps.
struct TileRays {
  std::filesystem::path shard;
  ShardSegment segment;
};
/// @throws InputError "rays.missing", "rays.damaged"
[[nodiscard]] std::vector<TileRays> raysOf(const std::filesystem::path& out, const Plan& plan, const TileIndex& tile);

}  // namespace accessvdb::tiles
