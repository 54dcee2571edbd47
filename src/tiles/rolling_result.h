// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a rolling field leaves at the end: a folder like that of `map --tiles`.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "accessvdb/rolling_field.h"
#include "accessvdb/tiles.h"
#include "tiles/rolling_manifest.h"
#include "tiles/rolling_tiles.h"

namespace accessvdb::tiles {

class RollingResult {
 public:
  /// What it is the result of.
  struct Of {
    MadeWith made_with;
    std::array<double, 3> origin_W;
    std::int32_t margin_voxels;
    const std::vector<std::uint32_t>& first_ids;  ///< as in RollingManifest
    const std::vector<double>&stamps_s, &farthest_m;
    const TakenReturns& taken;
  };
  /// @param own  folder of the field
  /// @throws OutputError "output.foreign" for a folder with the result of other steps, or with the field itself in it
  RollingResult(const Of& of, const RollingSource& source, std::filesystem::path out, const std::filesystem::path& own);

  /// All tiles, one in memory at a time, and then the plan. Of a whole result that is there, a tile gives way to one
  /// with other bytes once that is written; the rest of an earlier call goes. @return them
  /// @throws InputError "rolling.damaged" for a tile that is lost, and whole there
  std::vector<Tile> write(RollingTiles& tiles, const io::WriteOptions& files) const;

 private:
  [[nodiscard]] Plan planOf() const;
  /// Whether what is there is whole, and of files with the same content.
  [[nodiscard]] bool isRepeat() const;
  [[noreturn]] void refuseLost(const TileId& id) const;
  /// @param content  contentOf()
  [[nodiscard]] Tile writeOne(const TileIndex& index, const RollingTile& tile, const std::string& content, bool lost,
                              const io::WriteOptions& files) const;
  [[nodiscard]] std::string contentOf(const RollingTiles& tiles, const RollingTile& tile) const;
  [[nodiscard]] Binned raysOf(const std::vector<Tile>& done) const;

  Of of_;
  const RollingSource& source_;
  std::filesystem::path out_;
  Plan plan_;
};

}  // namespace accessvdb::tiles
