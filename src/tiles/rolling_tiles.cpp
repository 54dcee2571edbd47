// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/rolling_tiles.h"

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "field/field_access.h"
#include "field/left_out_points.h"
#include "field/state/state_reader.h"
#include "field/tools/tools_of_field.h"
#include "points/point_store.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr int kCellsOfEdge = 32;  // of what is left out of a tile that is not there
/// Of more, nobody keeps track: everything is closed.
constexpr std::size_t kMostBalls = std::size_t{1} << 20;
/// Of a ball, wherever its centre is: no tile lies outside.
constexpr double kEverywhere_m = std::numeric_limits<double>::max();
TileId idOf(const TileIndex& index) { return {index.first, index.second, {}}; }

void advanceTime(RollingTile& tile, const MapTime& time) {
  if (internal::FieldAccess::agesUntil(tile.field, time.age_s)) tile.behind = true;
  internal::FieldAccess::advanceTime(tile.field, time.latest_s, time.age_s);
}

}  // namespace

void RollingTile::measure() {
  const MemoryUse use = field.memoryUse();
  bytes.memory = use.map_bytes + use.point_host_bytes + ids.capacity() * sizeof ids[0];
  const auto of_gpu = internal::FieldAccess::gpuUse(field);
  bytes.memory += of_gpu ? of_gpu->host_bytes : use.mirror_bytes + use.distance_mirror_bytes + use.point_device_bytes;
  bytes.device = of_gpu ? of_gpu->device_bytes : 0;
}

RollingTiles::RollingTiles(std::vector<ToolSpec> tools, const FieldParams& params,
                           std::unique_ptr<internal::SharedTables> tables, fs::path folder, const Limits& limits,
                           std::int32_t tile_voxels, bool notes_changes)
    : tools_(std::move(tools)),
      params_(params),
      described_(describeTools(tools_, internal::resolvedFor(tools_.front(), params))),
      tables_(std::move(tables)),
      folder_(std::move(folder)),
      limits_(limits),
      tile_voxels_(tile_voxels),
      notes_changes_(notes_changes) {}

RollingTile RollingTiles::newTile(const TileIndex& id) const {
  FieldParams params = params_;
  params.window = idOf(id).window(tile_voxels_);
  RollingTile tile(internal::FieldAccess::make(tools_, params, *tables_));
  return tile;
}

Eigen::Vector3d RollingTiles::worldOf(const Eigen::Vector3f& p_L) const {
  return Eigen::Vector3d(params_.origin_W->data()) + p_L.cast<double>();
}

TileBytes RollingTiles::use() const {
  TileBytes all = {tables_->hostBytes(), tables_->deviceBytes()};
  for (const auto& [id, tile] : in_memory_) all += tile->bytes;
  for (const auto& [id, ahead] : ahead_) all += ahead.bytes;
  return all;
}

bool RollingTiles::isWithin(const TileBytes& all, double share) const {
  const auto fits = [share](std::uint64_t bytes, std::uint64_t limit) {
    return limit == 0 || static_cast<double>(bytes) <= share * static_cast<double>(limit);
  };
  return fits(all.memory, limits_.memory_bytes) && fits(all.device, limits_.device_bytes);
}

bool RollingTiles::fitsWith(TileBytes more) const {
  more += use();
  more += growth_;
  return isWithin(more, share_);
}

void RollingTiles::noteGrowth(const TileBytes& growth) {
  // A step like the largest of late may come again.
  growth_.memory = std::max(growth_.memory - growth_.memory / 16, growth.memory);
  growth_.device = std::max(growth_.device - growth_.device / 16, growth.device);
}

TileBytes RollingTiles::bytesToLoad(const TileIndex& id) const {
  if (in_memory_.contains(id) || ahead_.contains(id)) return {};
  TileBytes more;
  const auto stored = stored_.find(id);
  if (stored != stored_.end()) more = stored->second.bytes;
  more.memory = std::max(more.memory, empty_.memory);
  more.device = std::max(more.device, empty_.device);
  return more;
}

bool RollingTiles::makeRoomFor(const TileIndex& id, std::uint64_t step) {
  if (RollingTile* const known = find(id)) known->touched = step;  // it stays
  const TileBytes more = bytesToLoad(id);
  const auto isTouched = [step](const TileIndex&, const RollingTile& tile) { return tile.touched == step; };
  const auto isNeeded = [&](const TileIndex& other, const RollingTile& tile) {
    return tile.touched == step || expected_.contains(other);
  };
  const auto isRecent = [&](const TileIndex& other, const RollingTile& tile) {
    return tile.touched + kIdleSteps > step || expected_.contains(other);
  };
  while (!fitsWith(more)) {
    if (letOldestGo(isRecent) || dropOneAhead(id, step) || letOldestGo(isNeeded)) continue;
    // What the step may take besides is a guess: it leaves nothing out, and sends nothing away that is to come back.
    TileBytes all = use();
    all += more;
    if (isWithin(all)) return true;
    if (!dropOneAhead(id, step + 1) && !letOldestGo(isTouched)) return false;
  }
  return true;
}

void RollingTiles::rest() {
  for (auto& [id, tile] : in_memory_) {
    // What is being saved is being read.
    if (tile->touched != step_ && !tile->saving && internal::FieldAccess::rest(tile->field)) tile->measure();
  }
}

void RollingTiles::shrink(const TileIndex& kept) {
  const auto stays = [&kept](const TileIndex& id, const RollingTile&) { return id == kept; };
  const auto isNeeded = [&](const TileIndex& id, const RollingTile& tile) {
    return id == kept || tile.touched + kIdleSteps > step_;
  };
  while (!isWithin(use(), share_) && (letOldestGo(isNeeded) || dropOneAhead(kept, step_ + 1))) {
  }
  while (!isWithin(use()) && letOldestGo(stays)) {
  }
}

std::vector<TileIndex> RollingTiles::leavers(const Stays& stays) const {
  std::vector<TileIndex> ids;
  for (const auto& [id, tile] : in_memory_)
    if (!stays(id, *tile)) ids.push_back(id);
  const auto placeOf = [this](const TileIndex& id) {
    const auto expected = expected_.find(id);
    return expected == expected_.end() ? 0 : expected->second;
  };
  std::stable_sort(ids.begin(), ids.end(), [&](const TileIndex& a, const TileIndex& b) {
    const std::uint64_t one = in_memory_.at(a)->touched, other = in_memory_.at(b)->touched;
    return one != other ? one < other : placeOf(a) > placeOf(b);
  });
  return ids;
}

bool RollingTiles::letOldestGo(const Stays& stays) {
  const std::vector<TileIndex> ids = leavers(stays);
  if (ids.empty()) return false;
  letGo(ids.front());
  return true;
}

void RollingTiles::letGo(const TileIndex& id) {
  const auto tile = in_memory_.find(id);
  if (tile->second->as_saved || tile->second->saving) ++saved_ahead_;
  save(id, *tile->second);
  stored_[id] = *std::move(tile->second->as_saved);
  stored_[id].touched = tile->second->touched;
  in_memory_.erase(tile);
  doLater([] { malloc_trim(0); });  // what comes next gets this memory, and not more from the system
}

StoredTile RollingTiles::describe(const RollingTile& tile) {
  StoredTile stored;
  stored.serial = serial_++;
  stored.touched = tile.touched;
  stored.returns = tile.returns;
  stored.rays = tile.rays;
  stored.updated = tile.updated;
  stored.behind = tile.behind;
  stored.closed = tile.closed;
  stored.bytes = tile.bytes;
  return stored;
}

void RollingTiles::save(const TileIndex& id, RollingTile& tile) {
  endSaving(id, tile);
  if (!tile.as_saved) {
    StoredTile stored = describe(tile);
    stored.files_sha256 = filesOf(id, *stored.serial).write(tile.field, tile.ids);
    written_[*stored.serial] = id;
    tile.as_saved = std::move(stored);
  }
  ++saved_;
}

void RollingTiles::noteChange(const TileIndex& id, RollingTile& tile) {
  forgetSaving(id, tile);
  if (!tile.as_saved) return;
  removeUnlessKept(id, *tile.as_saved->serial);
  tile.as_saved.reset();
}

void RollingTiles::removeLater(const TileIndex& id, std::uint64_t serial) {
  doLater([files = filesOf(id, serial)] { files.remove(); });
}

void RollingTiles::removeUnlessKept(const TileIndex& id, std::uint64_t serial) {
  if (kept_.contains(serial) || named_.contains(serial)) return;
  written_.erase(serial);
  removeLater(id, serial);
}

double RollingTiles::cellEdge_m() const { return tile_voxels_ * params_.tsdf.voxel_size_m / kCellsOfEdge; }

RollingTile& RollingTiles::at(const TileIndex& id, const MapTime& now) {
  if (RollingTile* known = inMemory(id)) {
    advanceTime(*known, now);
    return *known;
  }
  std::unique_ptr<RollingTile> tile;
  const auto stored = stored_.find(id);
  if (stored != stored_.end()) {
    tile = std::make_unique<RollingTile>(load(id, takeAhead(id)));
    advanceTime(*tile, now);
    if (stored->second.serial && tile->lost) written_.erase(*stored->second.serial);  // nobody will name it
    if (stored->second.serial && !tile->lost) tile->as_saved = std::move(stored->second);
    stored_.erase(stored);
  } else {
    tile = std::make_unique<RollingTile>(newTile(id));
    closeIn(id, *tile);
    advanceTime(*tile, now);
    tile->measure();
    empty_ = tile->bytes;
  }
  return *in_memory_.emplace(id, std::move(tile)).first->second;
}

RollingTile& RollingTiles::growAgain(const TileIndex& id, const MapTime& now) {
  letGo(id);
  return at(id, now);
}

RollingTile* RollingTiles::inMemory(const TileIndex& id) {
  RollingTile* const tile = find(id);
  if (tile != nullptr) forgetSaving(id, *tile);
  return tile;
}

RollingTile* RollingTiles::find(const TileIndex& id) {
  const auto found = in_memory_.find(id);
  return found == in_memory_.end() ? nullptr : found->second.get();
}

RollingTile RollingTiles::readBack(const TileIndex& id, std::uint64_t serial, const std::string& files_sha256) const {
  const RollingFiles files = filesOf(id, serial);
  internal::StateReader state(files.state);
  const FieldWindow window = idOf(id).window(tile_voxels_);
  const FieldParams& found = state.head().params;
  if (!found.window || found.window->core_low != window.core_low || found.window->core_high != window.core_high ||
      found.origin_W != params_.origin_W || describeTools(tools_, found) != described_) {
    throw InputError("state.other", files.state.string(), "is the state of another tile", "Restore the folder");
  }
  files.requireWritten(state, files_sha256);
  RollingTile tile(internal::FieldAccess::load(state, tools_, params_, {}, tables_.get()));
  tile.ids = files.readIds(internal::FieldAccess::points(tile.field).size(), files_sha256);
  if (notes_changes_) static_cast<void>(internal::FieldAccess::takeChanged(tile.field));  // told before it left
  return tile;
}

RollingTile RollingTiles::startClosed(const TileIndex& id) {
  RollingTile tile = newTile(id);
  closeWhole(id, tile);
  return tile;
}

bool RollingTiles::has(const TileIndex& id) const {
  if (in_memory_.contains(id)) return true;
  const auto stored = stored_.find(id);
  return stored != stored_.end() && stored->second.serial;
}

RollingTile RollingTiles::load(const TileIndex& id, std::optional<RollingTile> tile) {
  const StoredTile& stored = stored_.at(id);
  try {
    if (!tile && !stored.serial) tile.emplace(newTile(id));
    if (!tile) tile.emplace(readBack(id, *stored.serial, stored.files_sha256));
    if (stored.serial) ++loaded_;
  } catch (const InputError& error) {
    if (!error.id().starts_with("state.")) throw;  // it may be there again, with the disk
    const std::string name = idOf(id).name();
    if (std::find(lost_.begin(), lost_.end(), name) == lost_.end()) lost_.push_back(name);
    tile.emplace(startClosed(id));
    tile->lost = true;
    tile->rays.reset();
  }
  tile->touched = stored.touched;
  tile->returns = stored.returns;
  if (!tile->lost) tile->rays = stored.rays;
  tile->updated = stored.updated;
  tile->behind = stored.behind;
  tile->closed = tile->lost ? 0 : stored.closed;
  closeIn(id, *tile);
  if (!stored.left_out.empty()) {
    std::vector<Eigen::Vector3d> centres_W;
    const double edge_m = cellEdge_m();
    for (const auto& [x, y, z] : stored.left_out)
      centres_W.push_back(
          worldOf((Eigen::Vector3d(x, y, z).array() + 0.5).matrix().cast<float>() * static_cast<float>(edge_m)));
    tile->field.leaveOut(centres_W, edge_m);  // more than half a diagonal
  }
  advanceTime(*tile, updated_at_);
  if (stored.updated && (stored.owed || tile->behind)) tile->rays.reset();  // as RollingField::update()
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
  stored.rays.reset();
  const auto edge_m = static_cast<float>(cellEdge_m());
  const auto cellOf = [edge_m](float x) { return static_cast<std::int32_t>(std::floor(x / edge_m)); };
  for (const Eigen::Vector3f& p : p_L) stored.left_out.insert({cellOf(p.x()), cellOf(p.y()), cellOf(p.z())});
}

void RollingTiles::leaveOutRays(const TileIndex& id, const internal::FieldAccess::Returns& rays) {
  // Within the tile, densely enough to come into every cell that a ray crosses, or into one beside it.
  const FieldWindow window = idOf(id).window(tile_voxels_);
  const auto v = static_cast<float>(params_.tsdf.voxel_size_m), edge_m = static_cast<float>(cellEdge_m());
  const auto isInside = [&](const Eigen::Vector3f& x_L, Eigen::Index axis) {
    const auto n = static_cast<std::size_t>(axis);
    return x_L[axis] >= static_cast<float>(window.core_low[n]) * v - edge_m &&
           x_L[axis] <= static_cast<float>(window.core_high[n]) * v + edge_m;
  };
  std::vector<Eigen::Vector3f> passed_L;
  for (std::size_t n = 0; n < rays.p_L.size(); ++n) {
    const Eigen::Vector3f& from_L = rays.q_L[rays.q_L.size() == 1 ? 0 : n];
    const Eigen::Vector3f way = rays.p_L[n] - from_L;
    const float steps = std::ceil(2 * way.norm() / edge_m);
    for (float step = 0; step <= steps; ++step) {
      const Eigen::Vector3f x_L = from_L + step / std::max(steps, 1.0F) * way;
      if (isInside(x_L, 0) && isInside(x_L, 1)) passed_L.push_back(x_L);
    }
  }
  leaveOut(id, passed_L);
}

void RollingTiles::close(std::span<const Ball> balls) {
  if (!closed_.empty() && closed_.front().radius_m >= kEverywhere_m) return;
  closed_.insert(closed_.end(), balls.begin(), balls.end());
  if (closed_.size() > kMostBalls) {
    closed_ = {{Eigen::Vector3d::Zero(), kEverywhere_m}};
    for (auto& [id, tile] : in_memory_) tile->closed = 0;
    for (auto& [id, stored] : stored_) stored.closed = 0;
  }
  for (auto& [id, tile] : in_memory_) {
    noteChange(id, *tile);
    closeIn(id, *tile);
    tile->behind = true;
  }
}

void RollingTiles::closeIn(const TileIndex& id, RollingTile& tile) const {
  for (; tile.closed < closed_.size(); ++tile.closed) {
    const Ball& ball = closed_[tile.closed];
    if (ball.radius_m >= kEverywhere_m) {
      closeWhole(id, tile);
    } else {
      tile.field.leaveOut(std::span(&ball.centre_W, 1), ball.radius_m);
    }
  }
}

void RollingTiles::closeWhole(const TileIndex& id, RollingTile& tile) const {
  const double edge_m = tile_voxels_ * params_.tsdf.voxel_size_m;
  const Eigen::Vector3d middle_L((static_cast<double>(id.first) + 0.5) * edge_m,
                                 (static_cast<double>(id.second) + 0.5) * edge_m, 0);
  const std::array<Eigen::Vector3d, 1> middle_W = {worldOf(middle_L.cast<float>())};
  tile.field.leaveOut(middle_W, internal::LeftOutPoints::kLargestRadius_m);
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
    Json tile = {{"tile", idOf(id).name()},   {"touched", stored.touched},    {"returns", stored.returns},
                 {"updated", stored.updated}, {"behind", stored.behind},      {"owed", stored.owed},
                 {"closed", stored.closed},   {"bytes", stored.bytes.memory}, {"device_bytes", stored.bytes.device}};
    if (stored.serial) {
      tile["serial"] = *stored.serial;
      tile["files_sha256"] = stored.files_sha256;
    }
    if (stored.rays) tile["rays"] = *stored.rays;
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
    named_[*tile->as_saved->serial] = id;
    add(id, *tile->as_saved);
  }
  for (const auto& [id, stored] : stored_) add(id, stored);
  // Nobody waited for the disk before: a process that is killed takes nothing away that it has written.
  while (!written_.empty()) {
    const auto [serial, id] = *written_.begin();
    try {
      filesOf(id, serial).bringToDisk();
    } catch (...) {
      // The system says once that it lost what was written: a tile that is here is written again.
      if (RollingTile* const tile = find(id); tile != nullptr && tile->as_saved && tile->as_saved->serial == serial) {
        written_.erase(serial);
        tile->as_saved.reset();
        removeLater(id, serial);
      }
      throw;
    }
    written_.erase(serial);
  }
  return tiles;
}

void RollingTiles::restore(const Json& tiles, std::vector<std::string> lost, std::vector<Ball> closed,
                           const MapTime& now) {
  updated_at_ = now;
  lost_ = std::move(lost);
  closed_ = std::move(closed);
  for (const Json& tile : tiles) {
    const TileId id = TileId::parse(tile.at("tile"));
    StoredTile stored;
    tile.at("touched").get_to(stored.touched);
    tile.at("returns").get_to(stored.returns);
    tile.at("updated").get_to(stored.updated);
    tile.at("behind").get_to(stored.behind);
    tile.at("owed").get_to(stored.owed);
    tile.at("closed").get_to(stored.closed);
    if (stored.closed > closed_.size()) throw InvalidArgument("usage.tile", id.name(), "has more than there is");
    tile.at("bytes").get_to(stored.bytes.memory);
    tile.at("device_bytes").get_to(stored.bytes.device);
    if (tile.contains("rays")) stored.rays = tile.at("rays").get<RayDigest>();
    if (tile.contains("serial")) {
      stored.serial = tile.at("serial").get<std::uint64_t>();
      tile.at("files_sha256").get_to(stored.files_sha256);
      serial_ = std::max(serial_, *stored.serial + 1);
      const RollingFiles files = filesOf({id.x, id.y}, *stored.serial);
      for (const fs::path& file : {files.state, files.ids}) {
        if (io::isFile(file)) continue;
        throw InputError("rolling.damaged", file.string(), "is missing",
                         "Restore it from a copy of the folder, or start again with another folder");
      }
    }
    for (const Json& cell : tile.at("left_out")) stored.left_out.insert(cell.get<std::array<std::int32_t, 3>>());
    if (!id.quarters.empty() || stored_.contains({id.x, id.y}))
      throw InvalidArgument("usage.tile", id.name(), "is there twice, or no whole tile");
    stored_[{id.x, id.y}] = std::move(stored);
  }
  keep(tiles);
  removeLeftovers();
}

void RollingTiles::keep(const Json& tiles) {
  named_.clear();
  const auto before = std::exchange(kept_, {});
  for (const Json& tile : tiles) {
    const TileId id = TileId::parse(tile.at("tile"));
    if (tile.contains("serial")) kept_[tile.at("serial").get<std::uint64_t>()] = {id.x, id.y};
  }
  for (const auto& [serial, id] : before) removeUnlessKept(id, serial);
  for (const DiskThread::Handle& work : std::exchange(later_, {})) disk_.finish(work);
}

void RollingTiles::forgetSaveAll() {
  for (const auto& [serial, id] : std::exchange(named_, {})) {
    // Of a tile in memory it goes when the tile changes.
    const RollingTile* const tile = find(id);
    const bool in_use = tile != nullptr && tile->as_saved && tile->as_saved->serial == serial;
    if (!in_use) removeUnlessKept(id, serial);
  }
}

void RollingTiles::removeLeftovers() const {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder_, ignored)) {
    std::uint64_t serial = 0;
    if (isRollingFile(entry.path(), serial) && !kept_.contains(serial)) fs::remove(entry, ignored);
  }
}

std::uint64_t RollingTiles::latestTouch() const {
  std::uint64_t latest = 0;
  for (const auto& [id, tile] : in_memory_) latest = std::max(latest, tile->touched);
  for (const auto& [id, stored] : stored_) latest = std::max(latest, stored.touched);
  return latest;
}

void RollingTiles::oweUpdate(const MapTime& now) {
  updated_at_ = now;
  for (auto& [id, stored] : stored_) stored.owed = stored.owed || stored.behind;
}

}  // namespace accessvdb::tiles
