// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/tile_files.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <random>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "tiles/json_file.h"
#include "tiles/own_files.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr int kNameAttempts = 100;
/// Only with ChangeMode::Full, or where not every point is scored: older files are without.
bool isOptional(PointReason reason) { return reason == PointReason::Changed || reason == PointReason::BesideSurface; }

fs::path tilesFolder(const fs::path& out) { return out / "tiles"; }
fs::path splitMark(const fs::path& out, const TileId& id) { return tilesFolder(out) / (id.name() + ".split.json"); }
fs::path poisonMark(const fs::path& out, const TileId& id) { return tilesFolder(out) / (id.name() + ".poison.json"); }

void removePoison(const fs::path& out, const TileId& id) {
  std::error_code ignored;
  fs::remove(poisonMark(out, id), ignored);
}

struct FolderLock {
  int fd = -1;         ///< holds the lock until it is closed; -1 if there is none
  bool taken = false;  ///< by another process, or the folder is gone; else the file system has no locks
};

FolderLock lockOf(const fs::path& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (fd < 0) return {-1, true};
  if (::flock(fd, LOCK_EX | LOCK_NB) == 0) return {fd, false};
  const bool taken = errno == EWOULDBLOCK;
  ::close(fd);
  return {-1, taken};
}

/// Whether an id is the plan's, after at least this many flights.
bool isOf(const Plan& plan, std::size_t flights, const std::string& id) {
  return std::find(plan.ids.begin() + static_cast<std::ptrdiff_t>(flights) - 1, plan.ids.end(), id) != plan.ids.end();
}

std::string contentIn(const Json& json) { return json.value("content", std::string()); }

/// Whether what says this was made from the same returns in the same way, be it by a plan with other poses. Where the
/// returns were never on disk, by the same plan.
bool isOf(const Plan& plan, std::size_t flights, const std::string& content, const Json& json) {
  const std::string made_from = contentIn(json);
  const bool known = !content.empty() && !made_from.empty();
  return known ? made_from == content : isOf(plan, flights, json.at("plan"));
}

}  // namespace

void removeAttempts(const fs::path& out) {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(tilesFolder(out), ignored)) {
    if (!isAttemptName(entry.path().filename().string())) continue;
    const FolderLock lock = lockOf(entry.path());
    if (lock.fd < 0) continue;
    removeOwn(ownFilesOfTile(entry.path()));
    ::close(lock.fd);
  }
}

fs::path tileFolder(const fs::path& out, const TileId& id) { return tilesFolder(out) / id.name(); }

std::optional<Tile> readTile(const fs::path& out, const Plan& plan, const TileId& id, const TileReturns& whole) {
  const fs::path manifest = tileFolder(out, id) / kTileManifest;
  if (!io::isThere(manifest)) return std::nullopt;
  Tile tile;
  tile.id = id;
  bool same = false;
  readJson(manifest, "tile", [&](const Json& json) {
    same = isOf(plan, whole.flights, whole.content, json) && json.at("tile") == id.name();
    tile.content = contentIn(json);
    json.at("device").get_to(tile.device);
    json.at("returns").get_to(tile.returns);
    json.at("points").get_to(tile.points);
    json.at("leaves").get_to(tile.leaves);
    for (int n = 0; n < kNumPointLabels; ++n) {
      json.at("labels")
          .at(accessvdb::name(static_cast<PointLabel>(n)))
          .get_to(tile.labels[static_cast<std::size_t>(n)]);
    }
    for (int n = 0; n < kNumPointReasons; ++n) {
      const auto reason = static_cast<PointReason>(n);
      if (isOptional(reason) && !json.at("reasons").contains(accessvdb::name(reason))) continue;
      json.at("reasons").at(accessvdb::name(reason)).get_to(tile.reasons[static_cast<std::size_t>(n)]);
    }
    json.at("min_W").get_to(tile.min_W);
    json.at("max_W").get_to(tile.max_W);
    json.at("seconds").get_to(tile.seconds);
    json.at("peak_bytes").get_to(tile.peak_bytes);
    for (const auto& [name, sha256] : json.at("files").items()) tile.sha256.emplace_back(name, sha256);
  });
  if (!same) return std::nullopt;
  return tile;
}

void writeTile(const fs::path& folder, const Plan& plan, const Tile& tile) {
  Json labels = Json::object(), reasons = Json::object(), files = Json::object();
  for (int n = 0; n < kNumPointLabels; ++n) {
    labels[accessvdb::name(static_cast<PointLabel>(n))] = tile.labels[static_cast<std::size_t>(n)];
  }
  for (int n = 0; n < kNumPointReasons; ++n) {
    const std::uint64_t count = tile.reasons[static_cast<std::size_t>(n)];
    const auto reason = static_cast<PointReason>(n);
    if (count > 0 || !isOptional(reason)) reasons[accessvdb::name(reason)] = count;
  }
  for (const auto& [name, sha256] : tile.sha256) files[name] = sha256;
  const FieldWindow window = tile.id.window(plan.tile_voxels);
  writeJson(folder / kTileManifest, {{"plan", plan.id()},
                                     {"tile", tile.id.name()},
                                     {"content", tile.content},
                                     {"core_low", window.core_low},
                                     {"core_high", window.core_high},
                                     {"device", tile.device},
                                     {"returns", tile.returns},
                                     {"points", tile.points},
                                     {"leaves", tile.leaves},
                                     {"labels", labels},
                                     {"reasons", reasons},
                                     {"min_W", tile.min_W},
                                     {"max_W", tile.max_W},
                                     {"seconds", tile.seconds},
                                     {"peak_bytes", tile.peak_bytes},
                                     {"files", files}});
}

void removeTile(const fs::path& out, const TileId& id) {
  const fs::path folder = tileFolder(out, id);
  refuseForeign(ownFilesOfTile(folder));
  // Named as an attempt, of which the next run removes what is left.
  std::random_device random;
  const std::string number = std::to_string(std::uint64_t{random()} << 32 | random());
  const fs::path aside = tilesFolder(out) / std::string(".").append(id.name()).append(kAttemptMark).append(number);
  std::error_code error;
  fs::rename(folder, aside, error);
  if (error) {
    throw OutputError("output.write", folder.string(), "cannot be deleted (" + error.message() + ")",
                      "Check the folder's permissions");
  }
  removeOwn(ownFilesOfTile(aside));
}

bool isSplit(const fs::path& out, const Plan& plan, const TileId& id, const TileReturns& whole) {
  if (!io::isThere(splitMark(out, id))) return false;
  bool same = false;
  readJson(splitMark(out, id), "tile", [&](const Json& json) { same = isOf(plan, 1, whole.content, json); });
  return same;
}

void markSplit(const fs::path& out, const Plan& plan, const TileId& id, const TileReturns& whole) {
  fs::create_directories(tilesFolder(out));
  writeJson(splitMark(out, id), {{"plan", plan.id()}, {"tile", id.name()}, {"content", whole.content}});
  removePoison(out, id);
}

std::optional<Poison> readPoison(const fs::path& out, const TileId& id) {
  const fs::path mark = poisonMark(out, id);
  if (!io::isThere(mark)) return std::nullopt;
  Poison poison;
  poison.id = id;
  try {  // without a hash: the driver is another program
    const Json json = Json::parse(io::contentAt(mark));
    json.at("exit_code").get_to(poison.exit_code);
    json.at("reason").get_to(poison.reason);
  } catch (const Json::exception&) {
    throw InputError("tile.damaged", mark.string(), "is damaged", "Delete it and run this step again");
  }
  return poison;
}

AttemptFolder::AttemptFolder(const fs::path& out, const TileId& id, Leftovers leftovers) : out_(out), id_(id) {
  std::error_code error;
  fs::create_directories(tilesFolder(out), error);
  if (leftovers == Leftovers::Remove) removeAttempts(out);
  std::random_device random;
  for (int n = 0; n < kNameAttempts && !error; ++n) {
    const std::string number = std::to_string(std::uint64_t{random()} << 32 | random());
    path_ = tilesFolder(out) / std::string(".").append(id.name()).append(kAttemptMark).append(number);
    if (!fs::create_directory(path_, error)) continue;
    const FolderLock lock = lockOf(path_);
    lock_ = lock.fd;
    // Until it was locked, another process may have taken it for a leftover.
    if (!lock.taken && fs::exists(path_, error)) return;
    if (lock_ >= 0) ::close(std::exchange(lock_, -1));
  }
  throw OutputError("output.write", path_.string(), "cannot be made (" + error.message() + ")",
                    "Check the folder and the disk, then run again");
}

AttemptFolder::~AttemptFolder() {
  try {
    if (!placed_) removeOwn(ownFilesOfTile(path_));
  } catch (const std::exception&) {  // what is left is cleared by the next run
  }
  if (lock_ >= 0) ::close(lock_);
}

void AttemptFolder::putInPlace(const Plan& plan, const TileReturns& whole) {
  place([&] { return readTile(out_, plan, id_, whole).has_value(); });
}

void AttemptFolder::replace() {
  place([] { return false; });
}

void AttemptFolder::place(const std::function<bool()>& stays) {
  const fs::path target = tileFolder(out_, id_);
  std::error_code error;
  fs::rename(path_, target, error);
  if (error && io::isTaken(target, ErrorCode::Output)) {
    if (stays()) return;
    // Left by an older plan, from before the last flight, or of other poses. A rename takes it away at once, so nobody
    // sees half of it.
    const OwnFiles before = ownFilesOfTile(target);
    refuseForeign(before);
    const fs::path aside = path_.string() + "-replaced";
    std::error_code ignored;
    fs::rename(target, aside, ignored);
    fs::rename(path_, target, error);
    if (error) {
      fs::rename(aside, target, ignored);
    } else {
      removeOwn(ownFilesOfTile(aside));
    }
  }
  placed_ = !error;
  if (placed_) removePoison(out_, id_);
  if (error) {
    throw OutputError("output.write", target.string(), "cannot be put in place (" + error.message() + ")",
                      "Check the folder and the disk, then run again");
  }
}

void removeLeftovers(const fs::path& out) {
  removeAttempts(out);
  io::prepareOutputFolder(tilesFolder(out));
}

}  // namespace accessvdb::tiles
