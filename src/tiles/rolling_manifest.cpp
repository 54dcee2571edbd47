// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/rolling_manifest.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "tiles/first_difference.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr int kManifestSchema = 3;

bool isRotation(const Eigen::Matrix3d& R) {
  constexpr double kRounding = 1e-9;
  return (R.transpose() * R - Eigen::Matrix3d::Identity()).lpNorm<Eigen::Infinity>() < kRounding && R.determinant() > 0;
}

}  // namespace

bool hasManifest(const fs::path& folder) { return io::isThere(folder / kRollingManifest, ErrorCode::Output); }

void writeManifest(const fs::path& folder, const RollingManifest& manifest, const MadeWith& made_with) {
  Json stamps = Json::array();
  for (const double stamp_s : manifest.stamps_s) stamps.push_back(std::isfinite(stamp_s) ? Json(stamp_s) : Json());
  Json json = {{"schema", kManifestSchema},
               {"program", ACCESSVDB_VERSION},
               {"parameters", describeTools(made_with.tools, made_with.params)},
               {"tool_sha256", toolListSha256(made_with.tools)},
               {"tile_voxels", made_with.tile_voxels},
               {"points", manifest.points},
               {"age_s", manifest.age_s},
               {"left_out_returns", manifest.left_out_returns},
               {"first_ids", manifest.first_ids},
               {"stamps_s", stamps},
               {"farthest_m", manifest.farthest_m},
               {"lost_tiles", manifest.lost_tiles},
               {"closed", manifest.closed},
               {"note", manifest.note},
               {"points_in", manifest.taken.points_in},
               {"points_used", manifest.taken.points_used},
               {"dropped", manifest.taken.dropped},
               {"tiles", manifest.tiles}};
  if (manifest.origin_W) json["origin_W"] = *manifest.origin_W;
  if (made_with.params.change.mode == ChangeMode::Full) json["scans"] = manifest.scans;
  if (manifest.latest_s) json["latest_s"] = *manifest.latest_s;
  if (manifest.levelling) json["levelling"] = *manifest.levelling;
  writeJson(folder / kRollingManifest, json);
}

void requireManifest(const fs::path& folder) {
  const fs::path file = folder / kRollingManifest;
  if (io::isThere(file)) return;
  throw InputError("rolling.missing", file.string(), "is not there",
                   "Name the folder of an earlier run, or start without resuming");
}

void readManifest(const fs::path& folder, const std::function<void(const Json& json)>& take) {
  requireManifest(folder);
  readJson(folder / kRollingManifest, "rolling", take);
}

std::int32_t tileVoxelsOf(const Json& json) { return json.at("tile_voxels").get<std::int32_t>(); }

void refuseManifest(const fs::path& folder) {
  throw InputError("rolling.damaged", (folder / kRollingManifest).string(), "says what no field can be",
                   "Use another folder");
}

RollingManifest manifestFrom(const Json& json, const fs::path& folder, const MadeWith& made_with) {
  const auto same = [&](const char* what, const std::string& value) {
    return json.at(what).get<std::string>() == value;
  };
  const std::string parameters = describeTools(made_with.tools, made_with.params);
  std::string other;
  if (!same("program", ACCESSVDB_VERSION)) {
    other = "by version " + json.at("program").get<std::string>();
  } else if (!same("tool_sha256", toolListSha256(made_with.tools))) {
    other = "with other tools";
  } else if (!same("parameters", parameters)) {
    other = "with " + firstDifference(json.at("parameters").get<std::string>(), parameters);
  } else if (tileVoxelsOf(json) != made_with.tile_voxels) {
    other = "with tiles of " + std::to_string(tileVoxelsOf(json)) + " voxels";
  }
  if (!other.empty()) {
    throw UnusableInput("rolling.changed", folder.string(), "was made " + other,
                        "Use what it was made with, or another folder");
  }
  if (json.at("schema").get<int>() != kManifestSchema) refuseManifest(folder);
  RollingManifest manifest;
  json.at("points").get_to(manifest.points);
  json.at("age_s").get_to(manifest.age_s);
  json.at("left_out_returns").get_to(manifest.left_out_returns);
  json.at("first_ids").get_to(manifest.first_ids);
  for (const Json& stamp : json.at("stamps_s"))
    manifest.stamps_s.push_back(stamp.is_null() ? std::numeric_limits<double>::quiet_NaN() : stamp.get<double>());
  json.at("farthest_m").get_to(manifest.farthest_m);
  json.at("lost_tiles").get_to(manifest.lost_tiles);
  json.at("closed").get_to(manifest.closed);
  json.at("note").get_to(manifest.note);
  json.at("points_in").get_to(manifest.taken.points_in);
  json.at("points_used").get_to(manifest.taken.points_used);
  json.at("dropped").get_to(manifest.taken.dropped);
  manifest.tiles = json.at("tiles");
  if (made_with.params.change.mode == ChangeMode::Full) json.at("scans").get_to(manifest.scans);
  if (json.contains("latest_s")) manifest.latest_s = json.at("latest_s").get<double>();
  if (json.contains("origin_W")) manifest.origin_W = json.at("origin_W").get<std::array<double, 3>>();
  if (json.contains("levelling")) manifest.levelling = json.at("levelling").get<std::array<double, 9>>();
  const std::vector<std::uint32_t>& first_ids = manifest.first_ids;
  const bool ordered = std::is_sorted(first_ids.begin(), first_ids.end()) &&
                       (first_ids.empty() || (first_ids.front() == 0 && first_ids.back() <= manifest.points));
  if (!ordered || first_ids.size() != manifest.stamps_s.size() || first_ids.size() != manifest.farthest_m.size() ||
      (!manifest.origin_W && !manifest.tiles.empty()))
    refuseManifest(folder);
  if (manifest.levelling && !isRotation(Eigen::Matrix3d(manifest.levelling->data()))) refuseManifest(folder);
  return manifest;
}

}  // namespace accessvdb::tiles
