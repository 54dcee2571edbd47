// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/ray_files.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "io/streams/input_file.h"
#include "tiles/json_file.h"
#include "tiles/own_files.h"

namespace accessvdb::tiles {

namespace {

namespace fs = std::filesystem;

struct ShardFile {
  std::uint64_t first_step = 0, end_step = 0, bytes = 0;
};

fs::path manifestFile(const fs::path& out) { return out / "rays.json"; }

std::vector<ShardFile> shardsOf(const Json& json) {
  std::vector<ShardFile> shards;
  for (const Json& shard : json.at("shards")) {
    shards.push_back({shard.at("first_step"), shard.at("end_step"), shard.at("bytes")});
  }
  return shards;
}

/// A whole file of this plan may still be another one's copy. @throws InputError "rays.damaged"
void requireSteps(const ShardIndex& index, const ShardFile& expected, const fs::path& file) {
  if (index.first_step == expected.first_step && index.end_step == expected.end_step) return;
  throw InputError("rays.damaged", file.string(), "holds other steps than its name says",
                   "Delete it and run accessvdb tile bin again");
}

/// @return false if there is no manifest of this plan
bool readManifest(const fs::path& out, const Plan& plan, const std::function<void(const Json&)>& take) {
  if (!io::isThere(manifestFile(out))) return false;
  bool same = false;
  readJson(manifestFile(out), "rays", [&](const Json& json) {
    same = json.at("plan") == plan.id();
    if (same) take(json);
  });
  return same;
}

}  // namespace

fs::path raysFolder(const fs::path& out) { return out / "rays"; }

std::string shardPlanId(const Plan& plan, std::uint64_t first_step) { return plan.ids[plan.flightOf(first_step)]; }

std::optional<Binned> binned(const fs::path& out, const Plan& plan) {
  Binned result;
  const bool found = readManifest(out, plan, [&](const Json& json) {
    result.complete = true;
    json.at("steps").get_to(result.steps);
    json.at("points_in").get_to(result.points_in);
    json.at("points_used").get_to(result.points_used);
    json.at("returns_stored").get_to(result.returns_stored);
    json.at("truncated_points").get_to(result.truncated_points);
    json.at("bytes").get_to(result.bytes);
    for (int n = 0; n < kNumDropReasons; ++n) {
      json.at("dropped")
          .at(accessvdb::name(static_cast<DropReason>(n)))
          .get_to(result.dropped[static_cast<std::size_t>(n)]);
    }
    if (json.contains("farthest_m")) json.at("farthest_m").get_to(result.farthest_m);
    for (const Json& input : json.at("inputs")) result.inputs.push_back({input.at("path"), input.at("sha256")});
    for (const Json& tile : json.at("tiles")) {
      result.returns_of.push_back({{tile.at(0), tile.at(1), {}}, tile.at(2), tile.at(3), {}});
      if (tile.size() > 4) tile.at(4).get_to(result.returns_of.back().content);
    }
  });
  if (!found) return std::nullopt;
  return result;
}

std::vector<ShardRange> missingShards(const fs::path& out, const Plan& plan) {
  std::vector<ShardRange> missing;
  readManifest(out, plan, [&](const Json& json) {
    for (const ShardFile& shard : shardsOf(json)) {
      const fs::path file = raysFolder(out) / shardName(shard.first_step);
      if (!io::isFile(file) || io::inputFileSize(file) != shard.bytes)
        missing.push_back({shard.first_step, shard.end_step});
    }
  });
  return missing;
}

std::string contentOf(const Plan& plan, const RayDigest& returns) {
  internal::Sha256 sha256;
  sha256.update(plan.method_id.data(), plan.method_id.size());
  sha256.update(returns.data(), sizeof returns);
  return internal::hexOf(sha256.digest());
}

namespace {

void writeManifest(const fs::path& out, const Plan& plan, const Binned& result, const Json& shards) {
  Json dropped = Json::object(), files = Json::array(), list = Json::array();
  for (int n = 0; n < kNumDropReasons; ++n) {
    dropped[accessvdb::name(static_cast<DropReason>(n))] = result.dropped[static_cast<std::size_t>(n)];
  }
  for (const io::InputFile& input : result.inputs) files.push_back({{"path", input.path}, {"sha256", input.sha256}});
  for (const TileReturns& tile : result.returns_of) {
    list.push_back({tile.id.x, tile.id.y, tile.returns, tile.flights, tile.content});
  }
  writeJson(manifestFile(out), {{"plan", plan.id()},
                                {"steps", result.steps},
                                {"points_in", result.points_in},
                                {"points_used", result.points_used},
                                {"dropped", dropped},
                                {"truncated_points", result.truncated_points},
                                {"returns_stored", result.returns_stored},
                                {"bytes", result.bytes},
                                {"shards", shards},
                                {"farthest_m", result.farthest_m},
                                {"inputs", files},
                                {"tiles", list}});
}

}  // namespace

Binned writeBinned(const fs::path& out, const Plan& plan, const std::vector<io::InputFile>& inputs) {
  Binned result;
  result.complete = true;
  result.inputs = inputs;
  result.steps = plan.steps();
  std::map<TileIndex, TileReturns> tiles;
  std::map<TileIndex, RayDigest> digests;
  Json shards = Json::array();
  for (std::uint64_t step = 0; step < result.steps;) {
    const fs::path file = raysFolder(out) / shardName(step);
    const ShardIndex index = readShardIndex(file, shardPlanId(plan, step));
    requireSteps(index, {step, std::max(index.end_step, step + 1), 0}, file);
    result.points_in += index.points_in;
    result.points_used += index.points_used;
    result.truncated_points += index.truncated_points;
    for (std::size_t n = 0; n < index.dropped.size(); ++n) result.dropped[n] += index.dropped[n];
    for (const float longest_m : index.farthest_m) result.farthest_m.push_back(listedRange_m(longest_m));
    for (const ShardSegment& segment : index.segments) {
      TileReturns& tile = tiles[segment.tile];
      tile.id = {segment.tile.first, segment.tile.second, {}};
      tile.returns += segment.returns;
      tiles::add(digests[segment.tile], segment.digest);
      tile.flights = static_cast<std::uint32_t>(plan.flightOf(step) + 1);
      result.returns_stored += segment.returns;
    }
    const std::uint64_t bytes = io::inputFileSize(file);
    result.bytes += bytes;
    shards.push_back({{"first_step", index.first_step}, {"end_step", index.end_step}, {"bytes", bytes}});
    step = index.end_step;
  }
  for (auto& [index, tile] : tiles) {
    tile.content = contentOf(plan, digests[index]);
    result.returns_of.push_back(tile);
  }
  std::stable_sort(result.returns_of.begin(), result.returns_of.end(),
                   [](const TileReturns& a, const TileReturns& b) { return a.returns > b.returns; });

  writeManifest(out, plan, result, shards);
  return result;
}

void writeBinned(const fs::path& out, const Plan& plan, const Binned& rays) {
  // As after removeRays(): whoever makes a tile again reads all scans first.
  writeManifest(out, plan, rays, {{{"first_step", 0}, {"end_step", rays.steps}, {"bytes", 1}}});
}

void removeBinned(const fs::path& out) {
  std::error_code error;
  fs::remove(manifestFile(out), error);
  if (error) {
    throw OutputError("output.write", manifestFile(out).string(), "cannot be deleted (" + error.message() + ")",
                      "Check the folder's permissions");
  }
}

std::vector<TileRays> raysOf(const fs::path& out, const Plan& plan, const TileIndex& tile) {
  std::vector<TileRays> rays;
  // The folder is deleted once all tiles are done; a tile may be deleted after that.
  const bool found = io::isThere(raysFolder(out)) && readManifest(out, plan, [&](const Json& json) {
                       for (const ShardFile& shard : shardsOf(json)) {
                         const fs::path file = raysFolder(out) / shardName(shard.first_step);
                         const ShardIndex index = readShardIndex(file, shardPlanId(plan, shard.first_step));
                         requireSteps(index, shard, file);
                         for (const ShardSegment& segment : index.segments) {
                           if (segment.tile == tile) rays.push_back({file, segment});
                         }
                       }
                     });
  if (!found) {
    throw InputError("rays.missing", out.string(), "holds no rays of this plan", "Run accessvdb tile bin first");
  }
  return rays;
}

void removeRays(const fs::path& out) {
  if (const auto left = removeOwn(ownRays(out))) {
    throw OutputError("output.write", left->string(), "cannot be deleted", "Delete it yourself");
  }
}

}  // namespace accessvdb::tiles
