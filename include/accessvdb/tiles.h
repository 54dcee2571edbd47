// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Maps larger than memory, in tiles, with the results of one piece, bit for bit (docs/large_maps.md):
///
///   plan    what is mapped, with which parameters, in tiles of which size      plan.json
///   bin     reads every scan once and sorts its returns by tile                rays/
///   run     one tile after another, in any order, on any machine               tiles/NAME/
///   merge   one list of all points, one file for other programs                field.json, points.ply
///
/// Every file appears whole or not at all, and what says that a step is done is written last: whatever was interrupted
/// is done again by the same call. Processes may run different tiles of one folder at the same time.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/field_io.h"
#include "accessvdb/field_window.h"
#include "accessvdb/params.h"
#include "accessvdb/render.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/table_progress.h"
#include "accessvdb/tool_geometry.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/types.h"
#include "accessvdb/write_options.h"

namespace accessvdb::tiles {

/// A square of the plan's grid, or a quarter of one, or a quarter of that ...
struct ACCESSVDB_API TileId {
  std::int32_t x = 0, y = 0;  ///< the core begins at x, y times the tile's edge
  std::string quarters;       ///< one digit per level: 0 low x low y, 1 high x low y, 2 low x high y, 3 high x high y

  /// "3_-2"; for quarters "3_-2.0", "3_-2.01"
  [[nodiscard]] std::string name() const;
  /// @throws InvalidArgument "usage.tile"
  static TileId parse(const std::string& name);
  [[nodiscard]] std::array<TileId, 4> split() const;
  [[nodiscard]] TileId whole() const { return {x, y, {}}; }
  [[nodiscard]] FieldWindow window(std::int32_t tile_voxels) const;
  auto operator<=>(const TileId&) const = default;
};

struct PlannedInput {
  std::string path;  ///< absolute
  std::uint64_t bytes = 0;
  std::string sha256;  ///< of small files; empty for scans, which are hashed when they are read
};

/// The scans of one flight.
struct Flight {
  std::string options;  ///< what is read from the files, beside their content: "every 2\n..."
  std::vector<PlannedInput> inputs;
  std::vector<double> stamps_s;                               ///< of each step; 0 where unknown
  std::vector<std::pair<std::string, std::string>> settings;  ///< of the caller, to open the scans again
  /// File of poses in the plan's folder that counts instead of those that the settings name; empty: none.
  std::string poses_in_effect, poses_in_effect_sha256;
};

/// What is mapped. Two runs with equal plans make equal files.
struct ACCESSVDB_API Plan {
  std::string program;                  ///< version of the library
  std::string parameters;               ///< FieldParams::describe(), and options of the files that are written
  std::string tool_name, tool_sha256;   ///< of several tools their names, and toolListSha256()
  std::array<double, 3> origin_W = {};  ///< of the one piece, metres
  double voxel_size_m = 0;
  std::int32_t tile_voxels = 0;    ///< edge of a tile's core: FieldWindow::kEdge times a power of two
  std::int32_t margin_voxels = 0;  ///< how far outside the core returns are needed
  std::uint64_t bin_bytes = 0;     ///< returns are held in memory up to this size before they are written
  SurveyFrame frame = {};          ///< of points.las
  std::vector<Flight> flights;     ///< in the order in which they are mapped: steps of the second follow the first's

  [[nodiscard]] std::uint64_t steps() const;
  /// Index of the flight that a step belongs to. @param step  below steps()
  [[nodiscard]] std::size_t flightOf(std::uint64_t step) const;
  /// SHA-256 of what determines the results: everything above except stamps and settings.
  [[nodiscard]] const std::string& id() const { return ids.back(); }
  /// The plan's id after each flight: what was made before the next one was appended is still right where that brought
  /// no returns. Filled by identified().
  std::vector<std::string> ids;
  std::string method_id;  ///< the same without any flight: what else a tile's files are made from
};
[[nodiscard]] ACCESSVDB_API Plan identified(Plan plan);

/// Returns outside the core that a tile needs, in voxels; and the smallest edge that is worth a tile.
struct TileMargins {
  std::int32_t returns_voxels = 0;
  std::int32_t least_tile_voxels = 0;
};
/// What the tool that reaches farthest needs. @param progress  of the tools' tables
/// @throws what building a field throws
[[nodiscard]] ACCESSVDB_API TileMargins tileMargins(const std::vector<ToolSpec>& tools, const FieldParams& params,
                                                    const TableProgress& progress = {});
/// Edge of tiles that go through the scans side by side: few returns are kept twice, and little is held that no scan
/// reaches.
[[nodiscard]] ACCESSVDB_API std::int32_t edgeSideBySide(const TileMargins& margins, const FieldParams& params);

/// World position of the local frame that a field of all scans would have: the first usable sensor position, rounded.
/// Reads steps until there is one. @throws UnusableInput "scans.no_returns"
[[nodiscard]] ACCESSVDB_API std::array<double, 3> originOf(io::ScanSequence& scans, const FieldParams& params);

/// @throws OutputError
ACCESSVDB_API void writePlan(const std::filesystem::path& out, const Plan& plan);
/// @throws InputError "plan.missing", "plan.damaged"
[[nodiscard]] ACCESSVDB_API Plan readPlan(const std::filesystem::path& out);
[[nodiscard]] ACCESSVDB_API bool hasPlan(const std::filesystem::path& out);
/// @throws UnusableInput "plan.changed", naming the first difference
ACCESSVDB_API void requireSame(const Plan& wanted, const Plan& found, const std::filesystem::path& out);

/// For long calls: shown between steps; `stop` is asked between steps.
struct Watch {
  std::function<bool()> stop = [] { return false; };
  std::function<void(std::uint64_t done, std::uint64_t total, const std::string& detail)> progress =
      [](std::uint64_t, std::uint64_t, const std::string&) {};
};

/// A tile of the grid and its returns.
struct TileReturns {
  TileId id;
  std::uint64_t returns = 0;
  std::uint32_t flights = 1;  ///< up to and including the last one that brought a return
  /// Hash of all that the tile's files are made from: its returns, and the plan without its flights. A tile of an
  /// earlier plan with the same one is still right. Empty where that is not known: with ChangeMode::Full, and for a
  /// tile of a RollingField that left returns out or was scored more than once.
  std::string content = {};
};

/// What went into the rays of a plan.
struct Binned {
  bool complete = false;  ///< false if `stop` ended it
  std::uint64_t steps = 0, points_in = 0, points_used = 0, returns_stored = 0, truncated_points = 0, bytes = 0;
  std::array<std::uint64_t, kNumDropReasons> dropped = {};
  std::vector<io::InputFile> inputs;    ///< the scans, with their hashes
  std::vector<TileReturns> returns_of;  ///< most first
  /// Of each step the distance that no return is farther from its sensor than, metres; empty where it is not known.
  std::vector<double> farthest_m = {};
};

/// A plan in its folder, with the tools and the parameters that it was made from.
struct Job {
  std::filesystem::path out;
  Plan plan;
  std::vector<ToolSpec> tools;  ///< named
  FieldParams params;
};

/// For ChangeMode::Full.
struct BinLimits {
  std::uint64_t memory_bytes = 0;  ///< of the process; tiles that pass it leave memory. 0 = none
  double checkpoint_every_s = 60;  ///< a call that was killed goes on from there
};

/// Reads the scans and sorts their returns by tile. Goes on after the last finished part of an earlier call.
/// With ChangeMode::Full a ray is evidence in tiles that it only passes, so that tiles go through the scans side by
/// side (RollingField), and rays/ holds the state of each instead, without labels.
/// @param flights  the scans of each
/// @throws InputError while reading, "rays.damaged"; OutputError; UnusableInput "plan.changed" for a scan that changed;
///         ResourceLimit "limit.memory" where not even the tiles that the rays of one scan come near fit together
ACCESSVDB_API Binned bin(const Job& job, std::span<io::ScanSequence* const> flights, const Watch& watch = {},
                         const BinLimits& limits = {});
/// What an earlier bin() did; nothing if it was not finished.
[[nodiscard]] ACCESSVDB_API std::optional<Binned> binned(const std::filesystem::path& out, const Plan& plan);
/// Whether what run() reads is there: not after removeRays(), nor where the tiles are those of a RollingField, nor
/// where a later bin() was not finished. @param rays  of a finished bin()
[[nodiscard]] ACCESSVDB_API bool hasRays(const Job& job, const Binned& rays);
/// Deletes the rays once no tile needs them. What is known about them stays.
ACCESSVDB_API void removeRays(const std::filesystem::path& out);

struct RunLimits {
  /// Peak of the process that a tile may reach; larger tiles are run as their quarters, or refused with
  /// ChangeMode::Full. 0 = none
  std::uint64_t memory_bytes = 0;
  io::WriteOptions files = {};
};

/// One finished tile, as its manifest tile.json says.
struct Tile {
  TileId id;
  std::string content;  ///< TileReturns::content of the whole tile
  std::string device;
  std::uint64_t returns = 0, points = 0, leaves = 0;
  std::array<std::uint64_t, kNumPointLabels> labels = {};
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  std::array<double, 3> min_W = {}, max_W = {};  ///< of the points; metres
  double seconds = 0;
  std::uint64_t peak_bytes = 0;                             ///< of the process so far
  std::vector<std::pair<std::string, std::string>> sha256;  ///< of each file
};

/// Runs one tile, or its quarters where it would not fit. Finished ones are not run again.
/// @param which  one of Binned::returns_of or, but with ChangeMode::Full, a part of it
/// @return the finished tiles: one, or those of the quarters; fewer if `stop` ended it
/// @throws InvalidArgument "usage.tile"; ResourceLimit "limit.memory" if even the smallest would not fit; InputError
///         "rays.missing", "rays.damaged"; UnusableInput "plan.changed" if the folder has another plan by the end,
///         before the tile takes its place; OutputError
ACCESSVDB_API std::vector<Tile> run(const Job& job, const Binned& rays, const TileId& which, const RunLimits& limits,
                                    const Watch& watch = {});

/// A tile that failed again and again, so that whoever drives the run has given it up (python3 -m accessvdb.tiles).
struct Poison {
  TileId id;
  int exit_code = 0;   ///< that the program documents for this failure
  std::string reason;  ///< in words
};

/// Tiles and quarters that have returns, in the order in which to run them: most returns first.
struct Status {
  std::vector<Tile> done;
  std::vector<TileId> todo;
  std::vector<Poison> poison;  ///< among those to do: they may be tried again
  std::uint64_t split = 0;     ///< tiles that were run as quarters
};
/// @throws InputError "tile.damaged" for a damaged manifest
[[nodiscard]] ACCESSVDB_API Status status(const std::filesystem::path& out, const Plan& plan, const Binned& rays);

/// Checks that rays/ and tiles/ hold nothing but what these functions wrote, before they write or delete there.
/// @throws OutputError "output.foreign", naming one that they did not
ACCESSVDB_API void requireOwnFolders(const std::filesystem::path& out);
/// Deletes a plan with its rays and tiles, file by file, and nothing else.
/// @throws OutputError "output.foreign" before anything is deleted
ACCESSVDB_API void removePlan(const std::filesystem::path& out);
/// Deletes what killed processes left among the tiles.
ACCESSVDB_API void removeLeftovers(const std::filesystem::path& out);
/// Deletes tiles that the finished map does not have: corrected poses moved their returns elsewhere, or they are
/// quarters of one that is whole now. One with files of others stays. @param status  with nothing to do
ACCESSVDB_API void removeOutdated(const std::filesystem::path& out, const Status& status);

/// Where a scan was taken from.
struct ScanPose {
  std::string file;               ///< name of the scan's file, without its folder; empty for a recording
  std::optional<double> stamp_s;  ///< all of them have one, or it is left out
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
};
/// Writes a pose file, from which every bit is read back, into the folder of a plan, under a name that is not taken. It
/// stays there.
/// @return its name; empty if it cannot say which scan is which  @throws OutputError
[[nodiscard]] ACCESSVDB_API std::string writePosesInEffect(const std::filesystem::path& out,
                                                           std::vector<ScanPose> poses);

/// Writes field.json, which lists the finished tiles and names the others.
ACCESSVDB_API void writeIndex(const std::filesystem::path& out, const Plan& plan, const Status& status);

/// What field.json says, for whoever reads the tiles.
struct IndexedTile {
  TileId id;
  std::filesystem::path folder;  ///< with its points.ply, field.vdb and field_points.vdb
  std::uint64_t points = 0;
  std::array<std::uint64_t, kNumPointLabels> labels = {};
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  std::array<double, 3> min_W = {}, max_W = {};             ///< of the points; metres
  std::vector<std::pair<std::string, std::string>> sha256;  ///< of each file; none in older folders
};
struct Index {
  bool complete = false;  ///< every tile is finished
  std::array<double, 3> origin_W = {};
  double voxel_size_m = 0;
  std::int32_t tile_voxels = 0;
  std::vector<IndexedTile> tiles;
};
[[nodiscard]] ACCESSVDB_API bool hasIndex(const std::filesystem::path& out);
/// @throws InputError "field.missing", "field.damaged"
[[nodiscard]] ACCESSVDB_API Index readIndex(const std::filesystem::path& out);
/// The same, held against the hash in report.json. @throws also InputError "output.changed"
[[nodiscard]] ACCESSVDB_API Index readIndex(const std::filesystem::path& out, io::OutputCheck& check);
/// Begins to hash files of a tile. @param names  "points.ply", "field.vdb"
ACCESSVDB_API void beginCheck(io::OutputCheck& check, const IndexedTile& tile, const std::vector<std::string>& names);

struct StoredAnswer {
  io::StoredField::Answer field;  ///< ids of points are their numbers in the tile's points.ply
  std::optional<TileId> tile;     ///< of the point
};
/// What io::StoredField::at() says of one piece, from the tiles that are needed, one in memory at a time.
/// @throws InputError for a tile that cannot be read; "output.changed" if it is not as it was written
[[nodiscard]] ACCESSVDB_API std::vector<StoredAnswer> answersAt(const Index& index,
                                                                std::span<const Eigen::Vector3d> positions_W);
/// The same, told more of. @param check  may allow what has changed, and has the warnings
[[nodiscard]] ACCESSVDB_API std::vector<StoredAnswer> answersAt(const Index& index,
                                                                std::span<const Eigen::Vector3d> positions_W,
                                                                io::OutputCheck& check);

/// Points of all tiles for a picture, evenly thinned to about `most`: in parts, one tile in memory at a time.
/// @throws from FieldParts::read: InputError "output.changed", "tile.damaged"
[[nodiscard]] ACCESSVDB_API io::FieldParts partsOf(const Index& index, std::uint64_t most);
/// The same, told more of. @param check  may allow what has changed, and has the warnings
[[nodiscard]] ACCESSVDB_API io::FieldParts partsOf(const Index& index, std::uint64_t most,
                                                   std::shared_ptr<io::OutputCheck> check);
/// The same at once.
[[nodiscard]] ACCESSVDB_API FieldSnapshot overview(const Index& index, std::uint64_t most, bool allow_changed = false);

/// Writes the points of all tiles into one file: byte for byte the points.ply of one piece, except that its `device` is
/// "mixed" where tiles ran on different ones. A file named .las gets the points.las of one piece instead.
/// @return number of points  @throws InputError for a tile's file that is not as it was written; OutputError
ACCESSVDB_API std::uint64_t mergePoints(const std::filesystem::path& out, const Plan& plan,
                                        const std::vector<Tile>& tiles, const std::filesystem::path& file);

struct GridMerge {
  std::filesystem::path out;
  std::vector<Tile> tiles;
  std::filesystem::path points;  ///< written by mergePoints()
  std::filesystem::path file;    ///< to be written
  io::WriteOptions files = {};   ///< as of the tiles
  int threads = 0;               ///< 0 = all
};
/// Writes the grids of all tiles into one file: the field.vdb of one piece.
/// @throws InputError for a tile's file that is not as it was written; OutputError
ACCESSVDB_API void mergeGrids(const GridMerge& merge);

}  // namespace accessvdb::tiles
