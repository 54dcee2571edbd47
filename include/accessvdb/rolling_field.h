// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A field of any extent in bounded memory, which forgets nothing: tiles come and go as the sensor moves.
///
/// A tile is a field of its own (FieldParams::window) with the returns around its core. Past the memory limit, the tile
/// that was touched longest ago is saved into a folder and dropped; when the sensor comes back, it goes on from there.
/// After every update, labels, and score and direction of accessible points, are those of one field without a limit,
/// bit for bit; so are the ids of points. Where not even the tiles that one scan touches fit together, the farthest are
/// left out (RollingStatus::memory_short): their returns block, so the accessible points are among those of that field.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/table_progress.h"
#include "accessvdb/tiles.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/types.h"
#include "accessvdb/write_options.h"

namespace accessvdb {

namespace internal {
class LiveMap;
}  // namespace internal

struct RollingOptions {
  /// Where tiles go that leave memory. It may not exist yet, or be empty.
  std::filesystem::path folder;
  /// Bytes of map, mirror and points of the tiles in memory (MemoryUse), on a GPU without what lies there, but with
  /// what it takes on the host. 0 = no limit. The first scan, and a nearest tile that does not fit alone, may pass it.
  std::uint64_t memory_limit_bytes = 0;
  /// Of what lies on a GPU. 0 = four fifths of what is free there as the field is made
  std::uint64_t device_limit_bytes = 0;
  /// Of the whole process, which takes more than tiles count: they get what it leaves now, less 144 MiB for a step of
  /// scans, and leave earlier where that is too much (tighten()). 0 = no limit
  std::uint64_t process_limit_bytes = 0;
  /// Edge of a tile: FieldWindow::kEdge times a power of two, at least twice the margin that the tool needs. 0 = rule:
  /// from that margin and max_range_m, so that few returns are kept twice and little is held that no scan reaches.
  std::int32_t tile_voxels = 0;
  /// Whether takeChanged() is asked for. For each point in memory 4 bytes and 6 to 8 beside its state, on a GPU in its
  /// memory; of several tools 4 more, and the latter for each tool.
  bool notes_changes = false;
};

struct RollingStatus {
  std::uint64_t steps = 0;   ///< scans
  std::uint64_t points = 0;  ///< of all tiles
  std::int32_t tile_voxels = 0, margin_voxels = 0;
  std::uint64_t tiles = 0, tiles_in_memory = 0;
  std::uint64_t saved = 0, loaded = 0;               ///< how often a tile left, and came back
  std::uint64_t saved_ahead = 0, loaded_ahead = 0;   ///< of these: begun beside the steps, before it was needed
  std::uint64_t memory_bytes = 0, device_bytes = 0;  ///< of the tiles in memory
  std::uint64_t peak_memory_bytes = 0;               ///< the most that memory_bytes was
  bool unsaved = false;  ///< in the last update(): a tile could not leave, so memory may pass the limit
  /// In the last step: not all tiles that the scan touched fitted. What was left out blocks, for good.
  bool memory_short = false;
  double fitting_range_m = 0;  ///< then: the range within which all tiles fitted
  std::uint64_t left_out_returns = 0;
  std::vector<std::string> lost_tiles;  ///< whose saved state was damaged: what they held is missing, for good
};

/// What the folder of RollingField::write() says of where its scans came from.
struct RollingSource {
  std::string parameters;             ///< Plan::parameters, beside those of the field
  tiles::Flight flight;               ///< without stamps: the field's own
  std::vector<io::InputFile> inputs;  ///< files with their hashes
  SurveyFrame frame = {};             ///< of points.las
  std::uint64_t truncated_points = 0;
};

/// For one thread at a time, as a field. After a step that failed half-way it answers nothing any more.
class ACCESSVDB_API RollingField {
 public:
  /// @throws InvalidArgument "rolling.params" (a window, a budget, the paper's policy or projective fusion),
  ///         "rolling.tile"; ResourceLimit "limit.memory" if process_limit_bytes leaves nothing for tiles; OutputError
  ///         "output.foreign" for a folder with something in it; what AccessibilityField's constructor throws
  RollingField(std::vector<ToolSpec> tools, const FieldParams& params, RollingOptions options,
               const TableProgress& progress = {});
  ~RollingField();
  RollingField(RollingField&&) noexcept;
  RollingField& operator=(RollingField&&) noexcept;

  /// Goes on after the last checkpoint() of a field with the same tools and parameters in this folder. What came after
  /// it is not there; all that follows has the labels that it would have had (where memory is short, other returns may
  /// be left out).
  /// @throws InputError "rolling.missing" (there is none), "rolling.damaged"; UnusableInput "rolling.changed"
  [[nodiscard]] static RollingField resume(std::vector<ToolSpec> tools, const FieldParams& params,
                                           RollingOptions options, const TableProgress& progress = {});
  /// That a new field may begin in a folder: it is empty, or not there. @throws OutputError "output.foreign"
  static void requireEmpty(const std::filesystem::path& folder);
  /// Whether a folder has one, whole or not. @throws OutputError where that cannot be seen
  [[nodiscard]] static bool hasCheckpoint(const std::filesystem::path& folder);
  /// Saves what changed since the last one, whole or not at all. The tiles in memory stay there.
  /// @param note  kept with it: what the caller has to know to go on, such as which files it has read
  /// @throws OutputError
  void checkpoint(const std::string& note = {});
  /// Of the last checkpoint; empty if there is none.
  [[nodiscard]] const std::string& note() const;

  /// As AccessibilityField's. @throws also OutputError where a tile cannot be saved: then nothing has changed
  FrameStats integrateScan(std::span<const Eigen::Vector3f> points_S, const Eigen::Isometry3d& T_W_S,
                           std::optional<double> stamp_s = {}, std::span<const std::int32_t> attributes = {});
  FrameStats integrateRays(std::span<const Eigen::Vector3d> points_W, std::span<const Eigen::Vector3d> origins_W,
                           std::optional<double> stamp_s = {}, std::span<const std::int32_t> attributes = {});
  /// As AccessibilityField::leaveOut(), for tiles that will be made, too. Shows with the next update().
  void leaveOut(std::span<const Eigen::Vector3d> centres_W, double radius_m);
  /// Scores what changed since the last update(). @throws OutputError afterwards, where a tile cannot be saved
  UpdateStats update();
  /// Points of tiles in memory that are new, or whose label, reason or direction changed with an update(), or which of
  /// several tools reach them, since the last call; by ids. Those of tiles that lie in the folder come with the first
  /// update() after they are back.
  /// @throws InvalidArgument "rolling.changes" without RollingOptions::notes_changes
  [[nodiscard]] std::vector<SurfacePoint> takeChanged();

  /// From now on tiles leave as if the limits were this share of themselves, 0 .. 1: for who knows that the process
  /// takes more than the tiles say. No result depends on it: only the limits decide on what is left out.
  void tighten(double share);

  /// All points, tile by tile; in a tile by their ids. Tiles are loaded for it one at a time.
  void forEachTile(const std::function<void(std::span<const SurfacePoint> points)>& take);
  /// Points of the tiles in memory, by ids: those around the sensor.
  [[nodiscard]] FieldSnapshot snapshotInMemory();
  /// The same at once, by ids.
  [[nodiscard]] FieldSnapshot snapshot();
  [[nodiscard]] RollingStatus status() const;
  [[nodiscard]] const FieldParams& params() const;  ///< resolved, for the first tool
  [[nodiscard]] const std::vector<ToolSpec>& tools() const;
  [[nodiscard]] Eigen::Vector3d origin_W() const;  ///< of the local frame; set by the first scan

  /// Updates, and makes a folder like that of `map --tiles`: tiles/NAME/, plan.json and field.json, for
  /// `tile merge` and whatever reads such a folder. Of a result of the same steps that is there, only what differs is
  /// replaced. @return its tiles
  /// @throws OutputError "output.foreign"; InputError "rolling.damaged" for a tile that is lost here, and whole there
  std::vector<tiles::Tile> write(const std::filesystem::path& out, const io::WriteOptions& files = {},
                                 const RollingSource& source = {});

 private:
  friend class internal::LiveMap;
  RollingField();
  /// From the frame of the poses to that of the map, where a LiveSession turns them: kept with each checkpoint.
  [[nodiscard]] const std::optional<Eigen::Matrix3d>& levelling() const;
  void setLevelling(const std::optional<Eigen::Matrix3d>& R_L_W);
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb
