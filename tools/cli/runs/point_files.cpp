// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/point_files.h"

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"

namespace accessvdb::tools {

std::vector<std::filesystem::path> pointFilesOf(const std::filesystem::path& map, const std::string& verb,
                                                const std::string& why, io::OutputCheck& check, Messages& messages) {
  if (tiles::hasIndex(map)) {
    const tiles::Index index = tiles::readIndex(map, check);
    if (!index.complete) {
      throw UnusableInput(verb + ".unfinished", map.string(), "not all of its tiles are finished",
                          "Run accessvdb tile run and accessvdb tile merge first: " + why);
    }
    std::vector<std::filesystem::path> files;
    for (const tiles::IndexedTile& tile : index.tiles) {
      tiles::beginCheck(check, tile, {"points.ply"});
      files.push_back(tile.folder / "points.ply");
    }
    if (files.empty()) messages.warning("field.empty", map.string() + " holds no tiles");
    return files;
  }
  if (!io::isFolder(map)) {
    throw InputError("input.missing", map.string(), "no such folder", "Name the output folder of accessvdb map");
  }
  check.begin(map, {"points.ply"});
  return {map / "points.ply"};
}

}  // namespace accessvdb::tools
