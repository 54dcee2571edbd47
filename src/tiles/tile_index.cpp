// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// field.json: which tiles a folder holds, for whoever reads them.
#include <algorithm>

#include "accessvdb/error.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "tiles/json_file.h"
#include "tiles/point_file.h"
#include "tiles/tile_files.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr const char* kIndexFile = "field.json";

fs::path indexFile(const fs::path& out) { return out / kIndexFile; }

/// Whether the tile has been made again since, by its own manifest: after another flight, say.
bool isNewerThanIndex(const IndexedTile& tile) {
  bool other = false;
  try {
    readJson(tile.folder / kTileManifest, "tile", [&](const Json& json) {
      const Json& files = json.at("files");
      other = !std::all_of(tile.sha256.begin(), tile.sha256.end(), [&](const auto& file) {
        return files.contains(file.first) && files[file.first] == file.second;
      });
    });
  } catch (const InputError&) {  // then it is damaged, and nothing newer
  }
  return other;
}

using Reasons = std::array<std::uint64_t, kNumPointReasons>;
/// Those that every index lists; any more only if there are some, so that files stay as they are.
constexpr std::size_t kListedReasons = static_cast<std::size_t>(PointReason::Changed) + 1;

Json jsonOfReasons(const Reasons& reasons) {
  std::size_t count = reasons.size();
  while (count > kListedReasons && reasons[count - 1] == 0) --count;
  return Json(std::vector<std::uint64_t>(reasons.begin(), reasons.begin() + static_cast<std::ptrdiff_t>(count)));
}

void readReasons(const Json& json, Reasons& reasons) {
  for (std::size_t n = 0; n < std::min(std::max(json.size(), kListedReasons), reasons.size()); ++n) {
    json.at(n).get_to(reasons[n]);
  }
}

}  // namespace

void writeIndex(const fs::path& out, const Plan& plan, const Status& status) {
  std::vector<Tile> tiles = status.done;
  std::sort(tiles.begin(), tiles.end(), [](const Tile& a, const Tile& b) { return a.id < b.id; });
  Json list = Json::array();
  std::uint64_t points = 0;
  for (const Tile& tile : tiles) {
    Json files = Json::object();
    for (const auto& [name, sha256] : tile.sha256) files[name] = sha256;
    points += tile.points;
    list.push_back({{"tile", tile.id.name()},
                    {"folder", (fs::path("tiles") / tile.id.name()).string()},
                    {"points", tile.points},
                    {"labels", tile.labels},
                    {"reasons", jsonOfReasons(tile.reasons)},
                    {"min_W", tile.min_W},
                    {"max_W", tile.max_W},
                    {"files", files}});
  }
  Json missing = Json::array();
  for (const TileId& tile : status.todo) missing.push_back(tile.name());
  writeJson(indexFile(out), {{"schema", 1},
                             {"plan", plan.id()},
                             {"complete", status.todo.empty()},
                             {"missing", missing},
                             {"origin_W", plan.origin_W},
                             {"voxel_size_m", plan.voxel_size_m},
                             {"tile_voxels", plan.tile_voxels},
                             {"points", points},
                             {"tiles", list}});
}

bool hasIndex(const fs::path& out) { return io::isThere(indexFile(out)); }

Index readIndex(const fs::path& out) {
  Index index;
  readJson(indexFile(out), "field", [&](const Json& json) {
    json.at("complete").get_to(index.complete);
    json.at("origin_W").get_to(index.origin_W);
    json.at("voxel_size_m").get_to(index.voxel_size_m);
    json.at("tile_voxels").get_to(index.tile_voxels);
    for (const Json& entry : json.at("tiles")) {
      IndexedTile tile;
      tile.id = TileId::parse(entry.at("tile"));
      tile.folder = out / "tiles" / tile.id.name();
      entry.at("points").get_to(tile.points);
      entry.at("labels").get_to(tile.labels);
      readReasons(entry.at("reasons"), tile.reasons);
      entry.at("min_W").get_to(tile.min_W);
      entry.at("max_W").get_to(tile.max_W);
      if (entry.contains("files")) {
        for (const auto& [name, sha256] : entry["files"].items()) tile.sha256.emplace_back(name, sha256);
      }
      index.tiles.push_back(std::move(tile));
    }
  });
  return index;
}

Index readIndex(const fs::path& out, io::OutputCheck& check) {
  if (hasIndex(out)) check.begin(out, {kIndexFile});
  return io::readChecked(check, [&] { return readIndex(out); });
}

void beginCheck(io::OutputCheck& check, const IndexedTile& tile, const std::vector<std::string>& names) {
  const fs::path out = tile.folder.parent_path().parent_path();
  const std::string advice = isNewerThanIndex(tile)
                                 ? "The tile was made again since: run accessvdb tile merge " + out.string()
                                 : cureOf(out, tile.id) + "; allow_changed reads a file that you changed on purpose";
  for (const std::string& name : names) {
    const auto file =
        std::find_if(tile.sha256.begin(), tile.sha256.end(), [&](const auto& f) { return f.first == name; });
    check.begin(tile.folder / name, file == tile.sha256.end() ? std::string() : file->second, kIndexFile, advice);
  }
}

io::FieldParts partsOf(const Index& index, std::uint64_t most) {
  return partsOf(index, most, std::make_shared<io::OutputCheck>());
}

io::FieldParts partsOf(const Index& index, std::uint64_t most, std::shared_ptr<io::OutputCheck> check) {
  io::FieldParts parts;
  parts.origin_W = {index.origin_W[0], index.origin_W[1], index.origin_W[2]};
  parts.voxel_size_m = index.voxel_size_m;
  parts.count = index.tiles.size();
  std::uint64_t all = 0;
  for (const IndexedTile& tile : index.tiles) {
    all += tile.points;
    for (std::size_t n = 0; n < tile.labels.size(); ++n) parts.labels[n] += tile.labels[n];
    for (std::size_t n = 0; n < tile.reasons.size(); ++n) parts.reasons[n] += tile.reasons[n];
  }
  const std::uint64_t every = std::max<std::uint64_t>(1, (all + most - 1) / std::max<std::uint64_t>(most, 1));
  parts.read = [tiles = index.tiles, every, check = std::move(check)](std::size_t part) {
    const fs::path file = tiles.at(part).folder / kPointsFile;
    beginCheck(*check, tiles.at(part), {kPointsFile});
    try {
      return io::readChecked(*check, [&] { return io::readPointsPly(file, every); });
    } catch (const InputError& error) {
      if (error.id() == "output.changed" || error.id() == "input.contradictory") throw;
      throw InputError("tile.damaged", file.string(), "is not as it was written",
                       "Delete its folder and run accessvdb tile run again");
    }
  };
  return parts;
}

FieldSnapshot overview(const Index& index, std::uint64_t most, bool allow_changed) {
  const io::FieldParts parts = partsOf(index, most, std::make_shared<io::OutputCheck>(allow_changed));
  FieldSnapshot all;
  all.origin_W = parts.origin_W;
  all.voxel_size_m = parts.voxel_size_m;
  for (std::size_t part = 0; part < parts.count; ++part) {
    const FieldSnapshot some = parts.read(part);
    all.points.insert(all.points.end(), some.points.begin(), some.points.end());
  }
  return all;
}

}  // namespace accessvdb::tiles
