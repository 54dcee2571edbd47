// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is read and written beside the steps of a rolling field.
#include <algorithm>

#include "tiles/rolling_tiles.h"

namespace accessvdb::tiles {
namespace {

/// After which what the disk's thread was told to write has most likely been written.
constexpr std::uint64_t kWritingSteps = 4;
/// A tile that is farther than this from where it is needed is not worth its memory any more: in reaches.
constexpr double kLetGo = 1.25;
/// Part of the limits for which tiles are written before they have to leave.
constexpr std::uint64_t kWrittenPart = 4;

}  // namespace

void RollingTiles::doLater(std::function<void()> work) {
  std::erase_if(later_, [this](const auto& begun) { return disk_.hasEnded(begun); });
  later_.push_back(disk_.begin(std::move(work)));
}

void RollingTiles::expect(std::span<const TileIndex> ids, std::uint64_t step) {
  step_ = step;
  expected_.clear();
  for (std::size_t place = 0; place < ids.size(); ++place) {
    expected_[ids[place]] = place;
    const auto ahead = ahead_.find(ids[place]);
    if (ahead != ahead_.end()) ahead->second.wanted = step;
  }
}

void RollingTiles::lookAhead(const Outlook& outlook, std::uint64_t step) {
  if (limits_.memory_bytes == 0 && limits_.device_bytes == 0) return;
  readAhead(outlook, step);
  writeAhead(step);
}

/// One per step: by the next one it is known better which.
void RollingTiles::readAhead(const Outlook& outlook, std::uint64_t step) {
  std::vector<TileIndex> gone;
  for (auto& [id, ahead] : ahead_) {
    const double away_m = outlook.distance_m(id);
    if (away_m <= outlook.reach_m) ahead.wanted = step;
    if (away_m > kLetGo * outlook.reach_m && ahead.wanted < step) gone.push_back(id);
  }
  for (const TileIndex& id : gone) dropAhead(id);
  std::vector<std::pair<double, TileIndex>> order;
  for (const auto& [id, stored] : stored_) {
    if (!stored.serial || ahead_.contains(id)) continue;
    const double away_m = outlook.distance_m(id);
    if (away_m <= outlook.reach_m) order.emplace_back(away_m, id);
  }
  if (order.empty()) return;
  const auto& [away_m, wanted] = *std::min_element(order.begin(), order.end());
  const TileBytes more = bytesToLoad(wanted);
  // Only tiles make room that are less needed, and that need not be waited for.
  const auto stays = [&](const TileIndex& id, const RollingTile& tile) {
    const bool written = tile.as_saved || (tile.saving && tile.saving->since + kWritingSteps <= step);
    return !written || tile.touched + kIdleSteps > step || outlook.distance_m(id) <= kLetGo * outlook.reach_m;
  };
  for (const TileIndex& id : leavers(stays)) {
    if (fitsWith(more)) break;
    RollingTile& tile = *find(id);
    endSaving(id, tile);
    if (tile.as_saved) letGo(id);  // else when it has to, and then in words
  }
  if (fitsWith(more)) beginAhead(wanted, stored_.at(wanted), step);
}

/// One per step, of those that would leave next.
void RollingTiles::writeAhead(std::uint64_t step) {
  const auto part = [](std::uint64_t limit) { return limit / kWrittenPart; };
  if (fitsWith({part(limits_.memory_bytes), part(limits_.device_bytes)})) return;
  TileBytes written;
  for (const TileIndex& id : leavers([step](const TileIndex&, const RollingTile& tile) {
         return tile.touched + kIdleSteps > step || tile.lost;
       })) {
    RollingTile& tile = *find(id);
    if (!tile.as_saved && !tile.saving) return beginSaving(id, tile, step);
    written += tile.bytes;
    const bool enough = (limits_.memory_bytes == 0 || written.memory >= part(limits_.memory_bytes)) &&
                        (limits_.device_bytes == 0 || written.device >= part(limits_.device_bytes));
    if (enough) return;
  }
}

void RollingTiles::beginAhead(const TileIndex& id, const StoredTile& stored, std::uint64_t step) {
  const auto read = std::make_shared<std::optional<RollingTile>>();
  const auto work = disk_.begin([this, read, id, serial = *stored.serial, files_sha256 = stored.files_sha256] {
    read->emplace(readBack(id, serial, files_sha256));
  });
  ahead_[id] = {stored.bytes, step, read, work};
}

void RollingTiles::dropAhead(const TileIndex& id) {
  disk_.cancel(ahead_.at(id).work);
  ahead_.erase(id);
}

bool RollingTiles::dropOneAhead(const TileIndex& but, std::uint64_t wanted_before) {
  auto least = ahead_.end();
  for (auto ahead = ahead_.begin(); ahead != ahead_.end(); ++ahead) {
    if (ahead->first == but || ahead->second.wanted >= wanted_before) continue;
    if (least == ahead_.end() || ahead->second.wanted < least->second.wanted) least = ahead;
  }
  if (least == ahead_.end()) return false;
  dropAhead(TileIndex(least->first));
  return true;
}

std::optional<RollingTile> RollingTiles::takeAhead(const TileIndex& id) {
  const auto found = ahead_.find(id);
  if (found == ahead_.end()) return std::nullopt;
  const Ahead ahead = std::move(found->second);
  ahead_.erase(found);
  if (!disk_.finish(ahead.work)) return std::nullopt;
  ++loaded_ahead_;
  return std::move(*ahead.tile);
}

void RollingTiles::beginSaving(const TileIndex& id, RollingTile& tile, std::uint64_t step) {
  StoredTile stored = describe(tile);
  const auto sha256 = std::make_shared<std::string>();
  auto work = disk_.begin(
      [&tile, sha256, files = filesOf(id, *stored.serial)] { *sha256 = files.write(tile.field, tile.ids); });
  tile.saving.emplace(RollingTile::Saving{std::move(stored), sha256, std::move(work), step});
}

void RollingTiles::endSaving(const TileIndex& id, RollingTile& tile) {
  if (!tile.saving) return;
  if (disk_.finish(tile.saving->work)) {
    written_[*tile.saving->stored.serial] = id;
    tile.saving->stored.files_sha256 = *tile.saving->files_sha256;
    tile.as_saved = std::move(tile.saving->stored);
  }
  tile.saving.reset();
}

void RollingTiles::forgetSaving(const TileIndex& id, RollingTile& tile) {
  if (!tile.saving) return;
  if (disk_.cancel(tile.saving->work)) removeLater(id, *tile.saving->stored.serial);
  tile.saving.reset();
}

}  // namespace accessvdb::tiles
