// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/field_folder.h"

#include <sstream>

#include "accessvdb/error.h"
#include "accessvdb/output_check.h"
#include "accessvdb/tiles.h"

namespace accessvdb::internal {
namespace {

constexpr const char* kPointsFile = "points.ply";

[[noreturn]] void failDamaged(const std::filesystem::path& file) {
  throw InputError("tile.damaged", file.string(), "is not as it was written",
                   "Delete its folder and run accessvdb tile run again");
}

/// Of several tools; points then say which of them reach them.
std::vector<std::string> toolsOf(const FieldFolder& folder) {
  std::vector<std::string> names;
  std::istringstream list(folder.metadataOf("tools"));
  for (std::string name; std::getline(list, name, ',');) names.push_back(name);
  return names;
}

/// Thrown to leave io::visitPoints early.
struct Enough {};

}  // namespace

FieldFolder FieldFolder::open(const std::filesystem::path& path, io::OutputCheck& check) {
  FieldFolder folder;
  folder.path = path;
  if (!tiles::hasIndex(path)) {
    check.begin(path, {kPointsFile});
    const io::PointsHeader header = io::readPointsHeader(path / kPointsFile);
    folder.files = {{"", path / kPointsFile, header.points}};
    folder.points = header.points;
    folder.origin_W = header.origin_W;
    folder.voxel_size_m = header.voxel_size_m;
    folder.metadata = header.metadata;
    folder.attributes = header.attributes;
    folder.tools = toolsOf(folder);
    return folder;
  }
  const tiles::Index index = tiles::readIndex(path, check);
  folder.origin_W = {index.origin_W[0], index.origin_W[1], index.origin_W[2]};
  folder.voxel_size_m = index.voxel_size_m;
  folder.complete = index.complete;
  for (const tiles::IndexedTile& tile : index.tiles) {
    tiles::beginCheck(check, tile, {kPointsFile});
    const PointFile file = {tile.id.name(), tile.folder / kPointsFile, tile.points};
    const io::PointsHeader header = io::readPointsHeader(file.path);
    if (header.points != tile.points) failDamaged(file.path);
    if (folder.files.empty()) {
      folder.metadata = header.metadata;
      folder.attributes = header.attributes;
    }
    if (header.attributes != folder.attributes) failDamaged(file.path);
    folder.files.push_back(file);
    folder.points += tile.points;
  }
  folder.tools = toolsOf(folder);
  return folder;
}

std::string FieldFolder::metadataOf(const std::string& name) const {
  for (const auto& [key, text] : metadata) {
    if (key == name) return text;
  }
  return {};
}

void FieldFolder::visit(const Take& take) const {
  try {
    for (const PointFile& file : files) {
      std::uint64_t seen = 0;
      io::visitCarryingPoints(file.path, [&](const SurfacePoint& point, std::span<const std::int32_t> carried) {
        ++seen;
        if (!take(file, point, carried)) throw Enough();
      });
      if (seen != file.points) failDamaged(file.path);
    }
  } catch (const Enough&) {
  }
}

}  // namespace accessvdb::internal
