// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/rolling_tiles.h"

#include <malloc.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tiles.h"
#include "field/field_access.h"
#include "field/state/state_reader.h"
#include "field/tools/tools_of_field.h"
#include "io/streams/input_file.h"
#include "points/point_store.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr int kCellsOfEdge = 32;  // of what is left out of a tile that is not there
constexpr const char *kState = ".state", *kIds = ".ids";

/// Whether a name is one that we give: X_Y.SERIAL.state, X_Y.SERIAL.ids.
bool isOwnName(const std::string& name, std::uint64_t& serial) {
  for (const std::string ending : {kState, kIds}) {
    if (!name.ends_with(ending)) continue;
    const std::string rest = name.substr(0, name.size() - ending.size());
    const std::size_t dot = rest.find('.');
    if (dot == std::string::npos) return false;
    try {
      static_cast<void>(TileId::parse(rest.substr(0, dot)));
    } catch (const InvalidArgument&) {
      return false;
    }
    const char* const end = rest.data() + rest.size();
    const auto [last, error] = std::from_chars(rest.data() + dot + 1, end, serial);
    return error == std::errc() && last == end;
  }
  return false;
}

TileId idOf(const TileIndex& index) { return {index.first, index.second, {}}; }

void writeIds(const fs::path& file, const std::vector<std::uint32_t>& ids) {
  io::writeFileDurably(file, [&](std::ostream& stream) {
    stream.write(reinterpret_cast<const char*>(ids.data()), static_cast<std::streamsize>(ids.size() * sizeof ids[0]));
  });
}

/// @throws InputError "state.damaged"; another one if the file cannot be read
std::vector<std::uint32_t> readIds(const fs::path& file, std::size_t count, const std::string& sha256) {
  std::vector<std::uint32_t> ids(count);
  static_cast<void>(io::inputFileSize(file));
  std::ifstream in(file, std::ios::binary);
  if (!in.is_open()) throw InputError("input.unreadable", file.string(), "cannot be opened", "Check its permissions");
  in.read(reinterpret_cast<char*>(ids.data()), static_cast<std::streamsize>(count * sizeof ids[0]));
  if (in.bad()) throw InputError("input.unreadable", file.string(), "cannot be read to its end", "Check the disk");
  if (!in || in.peek() != std::ifstream::traits_type::eof() || io::sha256OfFile(file) != sha256) {
    throw InputError("state.damaged", file.string(), "is not as it was written", "Use another disk");
  }
  return ids;
}

}  // namespace

void RollingTile::measure() {
  const MemoryUse use = field.memoryUse();
  bytes.memory = use.map_bytes + use.point_host_bytes + ids.capacity() * sizeof ids[0];
  const std::uint64_t of_backend = use.mirror_bytes + use.distance_mirror_bytes + use.point_device_bytes;
  (field.deviceName() == "cpu" ? bytes.memory : bytes.device) += of_backend;
}

RollingTiles::RollingTiles(std::vector<ToolSpec> tools, const FieldParams& params,
                           std::unique_ptr<internal::SharedTables> tables, fs::path folder, const Limits& limits,
                           std::int32_t tile_voxels)
    : tools_(std::move(tools)),
      params_(params),
      described_(describeTools(tools_, internal::resolvedFor(tools_.front(), params))),
      tables_(std::move(tables)),
      folder_(std::move(folder)),
      limits_(limits),
      tile_voxels_(tile_voxels) {}

AccessibilityField RollingTiles::newField(const TileIndex& id) const {
  FieldParams params = params_;
  params.window = idOf(id).window(tile_voxels_);
  return internal::FieldAccess::make(tools_, params, *tables_);
}

fs::path RollingTiles::file(const TileIndex& id, std::uint64_t serial, const char* ending) const {
  return folder_ / (idOf(id).name() + "." + std::to_string(serial) + ending);
}

Eigen::Vector3d RollingTiles::worldOf(const Eigen::Vector3f& p_L) const {
  return Eigen::Vector3d(params_.origin_W->data()) + p_L.cast<double>();
}

TileBytes RollingTiles::use() const {
  TileBytes all = {tables_->hostBytes(), tables_->deviceBytes()};
  for (const auto& [id, tile] : in_memory_) all += tile->bytes;
  return all;
}

bool RollingTiles::isWithin(const TileBytes& all) const {
  return (limits_.memory_bytes == 0 || all.memory <= limits_.memory_bytes) &&
         (limits_.device_bytes == 0 || all.device <= limits_.device_bytes);
}

bool RollingTiles::fitsWith(TileBytes more) const {
  more += use();
  more += growth_;
  return isWithin(more);
}

void RollingTiles::noteGrowth(const TileBytes& growth) {
  // A step like the largest of late may come again.
  growth_.memory = std::max(growth_.memory - growth_.memory / 16, growth.memory);
  growth_.device = std::max(growth_.device - growth_.device / 16, growth.device);
}

bool RollingTiles::makeRoomFor(const TileIndex& id, std::uint64_t step) {
  RollingTile* const known = inMemory(id);
  if (known != nullptr) known->touched = step;  // it stays
  const auto stored = stored_.find(id);
  TileBytes more;
  if (known == nullptr) {
    if (stored != stored_.end()) more = stored->second.bytes;
    more.memory = std::max(more.memory, empty_.memory);
    more.device = std::max(more.device, empty_.device);
  }
  while (!fitsWith(more)) {
    if (letOldestGo([step](const TileIndex&, const RollingTile& tile) { return tile.touched == step; })) continue;
    more += use();
    return isWithin(more);  // what the step may take besides is a guess, and leaves nothing out
  }
  return true;
}

void RollingTiles::shrink(const TileIndex& kept) {
  while (!isWithin(use()) && letOldestGo([&kept](const TileIndex& id, const RollingTile&) { return id == kept; })) {
  }
}

bool RollingTiles::letOldestGo(const std::function<bool(const TileIndex& id, const RollingTile& tile)>& stays) {
  auto oldest = in_memory_.end();
  for (auto tile = in_memory_.begin(); tile != in_memory_.end(); ++tile) {
    if (stays(tile->first, *tile->second)) continue;
    if (oldest == in_memory_.end() || tile->second->touched < oldest->second->touched) oldest = tile;
  }
  if (oldest == in_memory_.end()) return false;
  save(oldest->first, *oldest->second);
  stored_[oldest->first] = *std::move(oldest->second->as_saved);
  in_memory_.erase(oldest);
  malloc_trim(0);  // what comes next gets this memory, and not more from the system
  return true;
}

void RollingTiles::save(const TileIndex& id, RollingTile& tile) {
  if (!tile.as_saved) {
    StoredTile stored;
    stored.serial = serial_++;
    stored.touched = tile.touched;
    stored.returns = tile.returns;
    stored.updated = tile.updated;
    stored.behind = tile.behind;
    stored.bytes = tile.bytes;
    const fs::path ids = file(id, *stored.serial, kIds);
    try {
      tile.field.saveState(file(id, *stored.serial, kState));
      writeIds(ids, tile.ids);
    } catch (...) {
      removeFiles(id, *stored.serial);
      throw;
    }
    stored.ids_sha256 = io::sha256OfFile(ids);
    tile.as_saved = std::move(stored);
  }
  ++saved_;
}

void RollingTiles::noteChange(const TileIndex& id, RollingTile& tile) {
  if (!tile.as_saved) return;
  removeUnlessKept(id, *tile.as_saved->serial);
  tile.as_saved.reset();
}

void RollingTiles::removeUnlessKept(const TileIndex& id, std::uint64_t serial) const {
  if (!kept_.contains(serial)) removeFiles(id, serial);
}

double RollingTiles::cellEdge_m() const { return tile_voxels_ * params_.tsdf.voxel_size_m / kCellsOfEdge; }

void RollingTiles::removeFiles(const TileIndex& id, std::uint64_t serial) const {
  std::error_code ignored;
  for (const char* ending : {kState, kIds}) fs::remove(file(id, serial, ending), ignored);
}

RollingTile& RollingTiles::at(const TileIndex& id, const MapTime& now) {
  if (RollingTile* known = inMemory(id)) {
    internal::FieldAccess::advanceTime(known->field, now.latest_s, now.age_s);
    return *known;
  }
  std::unique_ptr<RollingTile> tile;
  const auto stored = stored_.find(id);
  if (stored != stored_.end()) {
    tile = std::make_unique<RollingTile>(load(id, now));
    if (stored->second.serial && !tile->lost) removeUnlessKept(id, *stored->second.serial);
    stored_.erase(stored);
  } else {
    tile = std::make_unique<RollingTile>(newField(id));
    internal::FieldAccess::advanceTime(tile->field, now.latest_s, now.age_s);
    tile->measure();
    empty_ = tile->bytes;
  }
  return *in_memory_.emplace(id, std::move(tile)).first->second;
}

RollingTile& RollingTiles::growAgain(const TileIndex& id, const MapTime& now) {
  save(id, *in_memory_.at(id));
  stored_[id] = *std::move(in_memory_.at(id)->as_saved);
  in_memory_.erase(id);
  return at(id, now);
}

RollingTile* RollingTiles::inMemory(const TileIndex& id) {
  const auto found = in_memory_.find(id);
  return found == in_memory_.end() ? nullptr : found->second.get();
}

RollingTile RollingTiles::readBack(const TileIndex& id, const StoredTile& stored) {
  if (!stored.serial) return RollingTile(newField(id));
  internal::StateReader state(file(id, *stored.serial, kState));
  const FieldWindow window = idOf(id).window(tile_voxels_);
  const FieldParams& found = state.head().params;
  if (!found.window || found.window->core_low != window.core_low || found.window->core_high != window.core_high ||
      found.origin_W != params_.origin_W || describeTools(tools_, found) != described_) {
    throw InputError("state.other", state.file().string(), "is the state of another tile", "Restore the folder");
  }
  RollingTile tile(internal::FieldAccess::load(state, tools_, params_.backend, params_.threads, {}, tables_.get()));
  const std::size_t points = internal::FieldAccess::points(tile.field).size();
  tile.ids = readIds(file(id, *stored.serial, kIds), points, stored.ids_sha256);
  ++loaded_;
  return tile;
}

RollingTile RollingTiles::startClosed(const TileIndex& id) {
  RollingTile tile(newField(id));
  const std::array<Eigen::Vector3d, 1> anywhere_W = {worldOf({0, 0, 0})};
  constexpr double kEverywhere_m = 1e6;
  tile.field.leaveOut(anywhere_W, kEverywhere_m);
  return tile;
}

RollingTile RollingTiles::load(const TileIndex& id, const MapTime& now) {
  const StoredTile& stored = stored_.at(id);
  std::optional<RollingTile> tile;
  try {
    tile.emplace(readBack(id, stored));
  } catch (const InputError& error) {
    if (!error.id().starts_with("state.")) throw;  // it may be there again, with the disk
    const std::string name = idOf(id).name();
    if (std::find(lost_.begin(), lost_.end(), name) == lost_.end()) lost_.push_back(name);
    tile.emplace(startClosed(id));
    tile->lost = true;
  }
  tile->touched = stored.touched;
  tile->returns = stored.returns;
  tile->updated = stored.updated;
  tile->behind = stored.behind;
  if (!stored.left_out.empty()) {
    std::vector<Eigen::Vector3d> centres_W;
    const double edge_m = cellEdge_m();
    for (const auto& [x, y, z] : stored.left_out)
      centres_W.push_back(
          worldOf((Eigen::Vector3d(x, y, z).array() + 0.5).matrix().cast<float>() * static_cast<float>(edge_m)));
    tile->field.leaveOut(centres_W, edge_m);  // more than half a diagonal
  }
  internal::FieldAccess::advanceTime(tile->field, now.latest_s, now.age_s);
  if (stored.owed || stored.updated) {
    tile->field.update();
    tile->updated = true;
    tile->behind = false;
  }
  tile->measure();
  return *std::move(tile);
}

void RollingTiles::leaveOut(const TileIndex& id, std::span<const Eigen::Vector3f> p_L) {
  StoredTile& stored = stored_[id];
  const auto edge_m = static_cast<float>(cellEdge_m());
  const auto cellOf = [edge_m](float x) { return static_cast<std::int32_t>(std::floor(x / edge_m)); };
  for (const Eigen::Vector3f& p : p_L) stored.left_out.insert({cellOf(p.x()), cellOf(p.y()), cellOf(p.z())});
}

std::vector<TileIndex> RollingTiles::all() const {
  std::vector<TileIndex> ids;
  for (const auto& [id, tile] : in_memory_) ids.push_back(id);
  for (const auto& [id, tile] : stored_) ids.push_back(id);
  std::sort(ids.begin(), ids.end());
  return ids;
}

Json RollingTiles::saveAll() {
  Json tiles = Json::array();
  const auto add = [&](const TileIndex& id, const StoredTile& stored) {
    Json tile = {{"tile", idOf(id).name()},      {"touched", stored.touched},
                 {"returns", stored.returns},    {"updated", stored.updated},
                 {"behind", stored.behind},      {"owed", stored.owed},
                 {"bytes", stored.bytes.memory}, {"device_bytes", stored.bytes.device}};
    if (stored.serial) {
      tile["serial"] = *stored.serial;
      tile["ids_sha256"] = stored.ids_sha256;
    }
    Json left_out = Json::array();
    for (const auto& cell : stored.left_out) left_out.push_back(cell);
    tile["left_out"] = left_out;
    tiles.push_back(tile);
  };
  for (const auto& [id, tile] : in_memory_) {
    if (!tile->as_saved) {
      save(id, *tile);
      --saved_;  // it has not left
    }
    kept_.insert(*tile->as_saved->serial);
    add(id, *tile->as_saved);
  }
  for (const auto& [id, stored] : stored_) add(id, stored);
  return tiles;
}

void RollingTiles::restore(const Json& tiles, std::vector<std::string> lost) {
  lost_ = std::move(lost);
  for (const Json& tile : tiles) {
    const TileId id = TileId::parse(tile.at("tile"));
    StoredTile stored;
    tile.at("touched").get_to(stored.touched);
    tile.at("returns").get_to(stored.returns);
    tile.at("updated").get_to(stored.updated);
    tile.at("behind").get_to(stored.behind);
    tile.at("owed").get_to(stored.owed);
    tile.at("bytes").get_to(stored.bytes.memory);
    tile.at("device_bytes").get_to(stored.bytes.device);
    if (tile.contains("serial")) {
      stored.serial = tile.at("serial").get<std::uint64_t>();
      tile.at("ids_sha256").get_to(stored.ids_sha256);
      serial_ = std::max(serial_, *stored.serial + 1);
    }
    for (const Json& cell : tile.at("left_out")) stored.left_out.insert(cell.get<std::array<std::int32_t, 3>>());
    if (!id.quarters.empty() || stored_.contains({id.x, id.y}))
      throw InvalidArgument("usage.tile", id.name(), "is there twice, or no whole tile");
    stored_[{id.x, id.y}] = std::move(stored);
  }
  keep(tiles);
}

void RollingTiles::keep(const Json& tiles) {
  kept_.clear();
  for (const Json& tile : tiles)
    if (tile.contains("serial")) kept_.insert(tile.at("serial").get<std::uint64_t>());
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder_, ignored)) {
    std::uint64_t serial = 0;
    if (isOwnName(entry.path().filename().string(), serial) && !kept_.contains(serial)) fs::remove(entry, ignored);
  }
}

std::uint64_t RollingTiles::latestTouch() const {
  std::uint64_t latest = 0;
  for (const auto& [id, tile] : in_memory_) latest = std::max(latest, tile->touched);
  for (const auto& [id, stored] : stored_) latest = std::max(latest, stored.touched);
  return latest;
}

void RollingTiles::oweUpdate() {
  for (auto& [id, stored] : stored_) stored.owed = stored.owed || stored.behind;
}

}  // namespace accessvdb::tiles
