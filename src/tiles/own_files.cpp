// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/own_files.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <set>
#include <string_view>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "tiles/json_file.h"
#include "tiles/plan_lock.h"
#include "tiles/ray_files.h"
#include "tiles/ray_shard.h"
#include "tiles/rolling_files.h"
#include "tiles/rolling_manifest.h"
#include "tiles/tile_files.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kReplaced = "-replaced", kPoison = ".poison.json", kSplit = ".split.json", kTemp = ".tmp";
/// In the order in which they are deleted.
constexpr std::array kManifests = {"field.json", "rays.json", "plan.json"};
constexpr std::size_t kTempDigits = 16;
constexpr std::uint64_t kMostManifestBytes = std::uint64_t{1} << 30;

bool isRegular(const fs::path& path) { return io::entryAt(path) == fs::file_type::regular; }

bool isRealFolder(const fs::path& path) { return io::entryAt(path) == fs::file_type::directory; }

/// No object if the file is none, or is not there.
Json objectIn(const fs::path& file) {
  if (!isRegular(file)) return {};
  Json json = Json::parse(io::contentAt(file, kMostManifestBytes), nullptr, false);
  return json.is_object() ? json : Json();
}

bool isTileName(const std::string& name) {
  try {
    return !name.empty() && !TileId::parse(name).name().empty();
  } catch (const InvalidArgument&) {
    return false;
  }
}

/// What io::writeFileDurably() calls the file while it writes: ".NAME.<16 hexadecimal digits>.tmp". @return NAME
std::string targetOfTemp(const std::string& temp) {
  if (temp.size() <= kTempDigits + kTemp.size() + 2 || temp.front() != '.' || !temp.ends_with(kTemp)) return {};
  const std::size_t digits = temp.size() - kTemp.size() - kTempDigits;
  const bool hex = temp.substr(digits, kTempDigits).find_first_not_of("0123456789abcdef") == std::string::npos;
  return hex && temp[digits - 1] == '.' ? temp.substr(1, digits - 2) : std::string();
}

bool isShardName(const std::string& name) {
  constexpr std::string_view kBefore = "shard-", kAfter = ".rays";
  if (!name.starts_with(kBefore) || !name.ends_with(kAfter)) return false;
  std::uint64_t step = 0;
  const char* const end = name.data() + name.size() - kAfter.size();
  const auto [rest, error] = std::from_chars(name.data() + kBefore.size(), end, step);
  return error == std::errc() && rest == end && shardName(step) == name;
}

std::vector<fs::path> entriesOf(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) entries.push_back(entry.path());
  std::sort(entries.begin(), entries.end());
  return entries;
}

/// Sorts the entries of a folder of ours into those that a rule names and others. By name, so that tile.json, which
/// names the rest, is deleted last.
template <typename Rule>
void sortEntries(const fs::path& folder, OwnFiles& own, const Rule& isOurs) {
  for (const fs::path& entry : entriesOf(folder)) {
    const std::string name = entry.filename().string();
    if (isRegular(entry) && isOurs(entry, name)) {
      own.files.push_back(entry);
    } else if (!own.foreign) {
      own.foreign = entry;
    }
  }
  own.folders.push_back(folder);
}

void append(OwnFiles& own, OwnFiles&& more) {
  own.files.insert(own.files.end(), more.files.begin(), more.files.end());
  own.folders.insert(own.folders.end(), more.folders.begin(), more.folders.end());
  if (!own.foreign) own.foreign = more.foreign;
}

/// Marks name the tile that they are about; who drives the tiles writes some of them.
bool isMark(const fs::path& file, const std::string& name) {
  for (const std::string_view ending : {kSplit, kPoison}) {
    if (name.ends_with(ending) && isTileName(name.substr(0, name.size() - ending.size()))) {
      return objectIn(file).contains("tile");
    }
  }
  return false;
}

bool isTempOfMark(const std::string& name) {
  const std::string poison = std::string(kPoison).append(kTemp);  // of accessvdb.tiles
  if (name.starts_with(".") && name.ends_with(poison))
    return isTileName(name.substr(1, name.size() - 1 - poison.size()));
  const std::string target = targetOfTemp(name);
  return target == "probe" || (target.ends_with(kSplit) && isTileName(target.substr(0, target.size() - kSplit.size())));
}

/// A manifest beside rays/ and tiles/ that is whole, or none.
bool isOwnOrMissing(const fs::path& manifest) {
  if (!io::isTaken(manifest)) return true;
  if (!isRegular(manifest)) return false;
  try {
    readJson(manifest, "field", [](const Json&) {});
    return true;
  } catch (const InputError&) {
    return false;
  }
}

/// @return whether there is a folder to look into; a link or a file in its place is foreign
bool isThere(const fs::path& folder, OwnFiles& own) {
  if (!io::isTaken(folder)) return false;
  if (!isRealFolder(folder)) own.foreign = folder;
  return !own.foreign;
}

}  // namespace

bool isAttemptName(const std::string& name) {
  const std::size_t at = name.find(kAttemptMark);
  if (!name.starts_with(".") || at == std::string::npos || !isTileName(name.substr(1, at - 1))) return false;
  std::string number = name.substr(at + kAttemptMark.size());
  if (number.ends_with(kReplaced)) number.resize(number.size() - kReplaced.size());
  return !number.empty() && number.find_first_not_of("0123456789") == std::string::npos;
}

OwnFiles ownRays(const fs::path& out) {
  const fs::path folder = raysFolder(out);
  OwnFiles own;
  if (!isThere(folder, own)) return own;
  std::map<std::string, std::uint64_t> listed;  // and their sizes
  try {
    const Json rays = objectIn(out / "rays.json");
    if (rays.contains("shards")) {
      for (const Json& shard : rays["shards"]) listed[shardName(shard.at("first_step"))] = shard.at("bytes");
    }
  } catch (const Json::exception&) {
    listed.clear();
  }
  sortEntries(folder, own, [&](const fs::path& file, const std::string& name) {
    const std::string target = targetOfTemp(name);
    if (target == "probe" || isShardName(target) || target == kRollingManifest || serialOf(target)) return true;
    if (name == kRollingManifest) return objectIn(file).contains("tiles");
    if (std::uint64_t serial = 0; isRollingFile(file, serial)) return true;
    if (!isShardName(name)) return false;
    const auto found = listed.find(name);
    std::error_code ignored;
    return beginsAsShard(file) || (found != listed.end() && fs::file_size(file, ignored) == found->second);
  });
  return own;
}

OwnFiles ownFilesOfTile(const fs::path& folder) {
  OwnFiles own;
  std::set<std::string> names;
  if (isAttemptName(folder.filename().string())) {
    names = {kPointsFile, kLasFile, kGridsFile, kPointGridFile, kOrderFile, kFirstFile, kTileManifest};
  } else {
    const Json manifest = objectIn(folder / kTileManifest);
    if (manifest.contains("files") && manifest["files"].is_object()) {
      names.insert(kTileManifest);
      for (const auto& [name, sha256] : manifest["files"].items()) names.insert(name);
    }
  }
  sortEntries(folder, own, [&](const fs::path&, const std::string& name) {
    return names.contains(name) || names.contains(targetOfTemp(name));
  });
  return own;
}

OwnFiles ownTiles(const fs::path& out) {
  const fs::path folder = out / "tiles";
  OwnFiles own;
  if (!isThere(folder, own)) return own;
  for (const fs::path& entry : entriesOf(folder)) {
    const std::string name = entry.filename().string();
    if (isRealFolder(entry) && (isTileName(name) || isAttemptName(name))) {
      append(own, ownFilesOfTile(entry));
    } else if (isRegular(entry) && (isMark(entry, name) || isTempOfMark(name))) {
      own.files.push_back(entry);
    } else if (!own.foreign) {
      own.foreign = entry;
    }
  }
  own.folders.push_back(folder);
  return own;
}

std::optional<fs::path> removeOwn(const OwnFiles& own) {
  std::optional<fs::path> left;
  std::error_code error;
  for (const fs::path& file : own.files) {
    fs::remove(file, error);
    if (error && !left) left = file;
  }
  for (const fs::path& folder : own.folders) {
    fs::remove(folder, error);  // only if it is empty
    if (error && error != std::errc::directory_not_empty && !left) left = folder;
  }
  return left;
}

void refuseForeign(const OwnFiles& own) {
  if (!own.foreign) return;
  throw OutputError("output.foreign", own.foreign->string(),
                    "lies where accessvdb keeps its own files, and is none that it wrote, or is damaged",
                    "Move it away or delete it yourself, or choose another folder");
}

void requireOwnFolders(const fs::path& out) {
  OwnFiles manifests;
  for (const char* name : kManifests) {
    if (!isOwnOrMissing(out / name)) manifests.foreign = out / name;
  }
  for (const OwnFiles& own : {ownRays(out), ownTiles(out), manifests}) refuseForeign(own);
}

void removeOutdated(const fs::path& out, const Status& status) {
  if (!status.todo.empty() || status.done.empty()) return;
  std::set<std::string> current;
  for (const Tile& tile : status.done) current.insert(tile.id.name());
  for (const fs::path& entry : entriesOf(out / "tiles")) {
    const std::string name = entry.filename().string();
    if (!isRealFolder(entry) || !isTileName(name) || current.contains(name)) continue;
    if (!objectIn(entry / kTileManifest).contains("files") || ownFilesOfTile(entry).foreign) continue;
    removeTile(out, TileId::parse(name));
  }
}

void removePlan(const fs::path& out) {
  requireOwnFolders(out);
  const PlanLock nobody_looks(out, PlanLock::Kind::ToWrite);
  // The plan last: while it is there, the rest is known to belong to it.
  std::vector<OwnFiles> all = {{}, ownTiles(out), ownRays(out), {}};
  for (const char* name : kManifests) {
    if (io::isThere(out / name, ErrorCode::Output))
      (name == kManifests.front() ? all.front() : all.back()).files.push_back(out / name);
  }
  for (const OwnFiles& own : all) {
    if (const auto left = removeOwn(own)) {
      throw OutputError("output.write", left->string(), "cannot be deleted", "Check the folder's permissions");
    }
  }
}

}  // namespace accessvdb::tiles
