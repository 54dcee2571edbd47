// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The files of one tile, its manifest tile.json, and the marks of tiles that are run as quarters.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "accessvdb/tiles.h"

namespace accessvdb::tiles {

inline constexpr const char* kPointsFile = "points.ply";
inline constexpr const char* kLasFile = "points.las";
inline constexpr const char* kGridsFile = "field.vdb";
inline constexpr const char* kPointGridFile = "field_points.vdb";
inline constexpr const char* kOrderFile = "order.bin";
inline constexpr const char* kFirstFile = "first.bin";
inline constexpr const char* kTileManifest = "tile.json";

[[nodiscard]] std::filesystem::path tileFolder(const std::filesystem::path& out, const TileId& id);

/// @param id     of the tile, or of a part of it
/// @param whole  its returns, which the files must be made from
/// @return nothing if it is not finished, or made from others: of another plan, older than its last flight, or before
///         its poses were corrected  @throws InputError "tile.damaged"
[[nodiscard]] std::optional<Tile> readTile(const std::filesystem::path& out, const Plan& plan, const TileId& id,
                                           const TileReturns& whole);
/// @param folder  where the tile's files are until they are complete
void writeTile(const std::filesystem::path& folder, const Plan& plan, const Tile& tile);

/// Takes the folder of a finished tile away, as a whole, and deletes it. @throws OutputError "output.foreign"
void removeTile(const std::filesystem::path& out, const TileId& id);

/// @param whole  as of readTile()
[[nodiscard]] bool isSplit(const std::filesystem::path& out, const Plan& plan, const TileId& id,
                           const TileReturns& whole);
void markSplit(const std::filesystem::path& out, const Plan& plan, const TileId& id, const TileReturns& whole);
/// Left beside the tiles by who has given this one up, until it is finished or split.
/// @throws InputError "tile.damaged"
[[nodiscard]] std::optional<Poison> readPoison(const std::filesystem::path& out, const TileId& id);

/// Removes what killed processes left of attempts to run any tile: nobody may ever try the same one again.
void removeAttempts(const std::filesystem::path& out);

/// A folder of its own for one attempt to run a tile, removed unless it was put in place.
class AttemptFolder {
 public:
  enum class Leftovers { Remove, AreGone };
  /// @param leftovers  what to do about them first (removeAttempts()): it takes a look at all tiles
  AttemptFolder(const std::filesystem::path& out, const TileId& id, Leftovers leftovers = Leftovers::Remove);
  ~AttemptFolder();
  AttemptFolder(const AttemptFolder&) = delete;
  AttemptFolder& operator=(const AttemptFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// Gives the folder its final name. If another process was faster, its files stay: they are the same.
  void putInPlace(const Plan& plan, const TileReturns& whole);
  /// The same, whatever is there.
  void replace();

 private:
  void place(const std::function<bool()>& stays);

  std::filesystem::path out_, path_;
  TileId id_;
  int lock_ = -1;
  bool placed_ = false;
};

/// order.bin: where each point of points.ply comes in the order of one piece.
#pragma pack(push, 4)
struct PointOrder {
  std::uint32_t step = 0;   ///< that brought its first return
  std::uint64_t place = 0;  ///< of its voxel
  auto operator<=>(const PointOrder&) const = default;
};
#pragma pack(pop)
static_assert(sizeof(PointOrder) == 12);

/// first.bin: of each point of points.ply, for points.las, where the scans are LAS.
#pragma pack(push, 1)
struct StoredFirst {
  double gps_time = 0;
  std::uint8_t point_class = 0;
};
#pragma pack(pop)
static_assert(sizeof(StoredFirst) == 9);

}  // namespace accessvdb::tiles
