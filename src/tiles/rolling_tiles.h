// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tiles of a rolling field: which are in memory, which lie in the folder, and how they come and go.
///
/// What is decided depends on scans and counts of bytes alone. A DiskThread has a head start with the files: it writes
/// tiles that will probably leave while they still are in memory, and reads those that will probably be needed.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/params.h"
#include "accessvdb/tool_spec.h"
#include "field/field_access.h"
#include "field/tools/shared_tables.h"
#include "tiles/disk_thread.h"
#include "tiles/json_file.h"
#include "tiles/ray_shard.h"
#include "tiles/rolling_files.h"

namespace accessvdb::tiles {

/// Where the larger map is in time.
struct MapTime {
  std::optional<double> latest_s;
  double age_s = 0;  ///< internal::FreeGenerations::age_s()
};

struct TileBytes {
  std::uint64_t memory = 0, device = 0;
  TileBytes& operator+=(const TileBytes& more) {
    memory += more.memory;
    device += more.device;
    return *this;
  }
};

/// A tile in the folder.
struct StoredTile {
  /// Part of its files' names: a file is never written twice. None if the tile has only left_out.
  std::optional<std::uint64_t> serial;
  std::string files_sha256;                ///< RollingFiles::write()
  std::uint64_t touched = 0, returns = 0;  ///< as in RollingTile
  std::optional<RayDigest> rays;           ///< likewise
  bool updated = false, behind = false;
  bool owed = false;  ///< an update that others have had
  TileBytes bytes;
  std::size_t closed = 0;                          ///< as in RollingTile
  std::set<std::array<std::int32_t, 3>> left_out;  ///< cells with returns that were left out since it was saved
};

/// One tile in memory.
class RollingTile {
 public:
  static constexpr std::uint32_t kNotOurs = ~std::uint32_t{0};

  explicit RollingTile(AccessibilityField of_tile) : field(std::move(of_tile)) {}
  /// Measures again. Costs microseconds.
  void measure();

  AccessibilityField field;
  std::vector<std::uint32_t> ids;  ///< in the larger map, by id in the tile; kNotOurs for points around the core
  std::uint64_t touched = 0;       ///< the last step that brought a return
  std::uint64_t returns = 0;
  /// Of its returns, as in rays/; none if tile run would make other files of them.
  std::optional<RayDigest> rays = RayDigest();
  bool lost = false;                   ///< made anew, closed, because its state was damaged
  bool updated = false;                ///< at least once
  bool behind = false;                 ///< a scan came after the last update
  std::size_t closed = 0;              ///< so many of RollingTiles::closed() are in the field
  TileBytes bytes;                     ///< as last measured
  std::optional<StoredTile> as_saved;  ///< its files, if nothing has changed since they were written
  /// Its files are being written: nobody else may use the field. Of a tile that has no as_saved.
  struct Saving {
    StoredTile stored;
    std::shared_ptr<std::string> files_sha256;
    DiskThread::Handle work;
    std::uint64_t since;  ///< step
  };
  std::optional<Saving> saving;
};

class RollingTiles {
 public:
  /// Steps without a return after which a tile is likely to be done with for a while: those at the end of the range get
  /// some now and then.
  static constexpr std::uint64_t kIdleSteps = 8;
  struct Limits {
    std::uint64_t memory_bytes = 0, device_bytes = 0;  ///< 0 = none
  };
  /// @param params  as the user gave them; the origin comes with the first scan  @param tables  of these tools
  /// @param notes_changes  whether takeChanged() is asked of tiles
  RollingTiles(std::vector<ToolSpec> tools, const FieldParams& params, std::unique_ptr<internal::SharedTables> tables,
               std::filesystem::path folder, const Limits& limits, std::int32_t tile_voxels, bool notes_changes);

  void setOrigin(const std::array<double, 3>& origin_W) {
    if (!params_.origin_W) params_.origin_W = origin_W;  // the disk's thread reads it
  }
  /// Whether the scan that is to come fits: of other tiles, those that were touched longest ago leave until it does.
  /// @param id     a tile that the step touches  @param step  others that it touched before stay
  bool makeRoomFor(const TileIndex& id, std::uint64_t step);
  /// RollingField::tighten().
  void tighten(double share) { share_ = share; }
  /// After a step: what it did not come near takes less memory.
  void rest();
  /// What an update took may be too much: then tiles leave, too, that the last step touched, but not this one.
  void shrink(const TileIndex& kept);
  /// The step touches these, nearest first, as far as there is room: they and what was read of them leave last.
  void expect(std::span<const TileIndex> ids, std::uint64_t step);
  /// Where the sensor goes.
  struct Outlook {
    std::function<double(const TileIndex& id)> distance_m;  ///< of a tile from where the sensor will be soon
    double reach_m;                                         ///< tiles at most this far will be needed there
  };
  /// Begins to read a tile that will probably be needed, and to write one that will probably leave. For each step, when
  /// its tiles are in memory.
  void lookAhead(const Outlook& outlook, std::uint64_t step);
  /// Whether a tile has got returns: in memory or in the folder.
  [[nodiscard]] bool has(const TileIndex& id) const;
  /// The tile in memory; made or loaded, and brought to this time.
  RollingTile& at(const TileIndex& id, const MapTime& now);
  /// A tile that is about to change: it is not being written any more.
  [[nodiscard]] RollingTile* inMemory(const TileIndex& id);
  /// A tile in memory is about to change: files that were written of it are out of date.
  void noteChange(const TileIndex& id, RollingTile& tile);
  /// The latest of all RollingTile::touched.
  [[nodiscard]] std::uint64_t latestTouch() const;
  /// Returns that the tile will never get. @param p_L  in the local frame of the map
  void leaveOut(const TileIndex& id, std::span<const Eigen::Vector3f> p_L);
  /// Rays that it will never learn of: what they pass may have gone. The same
  void leaveOutRays(const TileIndex& id, const internal::FieldAccess::Returns& rays);
  /// A ball of the world in which returns were left out; of all of it with the largest radius that there is.
  struct Ball {
    Eigen::Vector3d centre_W;
    double radius_m;
  };
  /// Of all tiles, those that will be made included. One way or the other, every tile gets all balls in the same order,
  /// as one field would.
  void close(std::span<const Ball> balls);
  [[nodiscard]] const std::vector<Ball>& closed() const { return closed_; }
  /// A tile in memory that stopped growing goes out and comes back, so that it grows again.
  RollingTile& growAgain(const TileIndex& id, const MapTime& now);
  /// Room for as much is kept in the next step. @param growth  of the tiles that the step touched
  void noteGrowth(const TileBytes& growth);
  [[nodiscard]] TileBytes use() const;

  /// Of all tiles, in order of their ids.
  [[nodiscard]] std::vector<TileIndex> all() const;
  /// Hands the tile over with labels as of the last update; one that was not in memory leaves it again.
  template <typename Take>
  void visit(const TileIndex& id, const Take& take) {
    if (RollingTile* tile = find(id)) {
      endSaving(id, *tile);
      take(*tile);
      return;
    }
    RollingTile tile = load(id, std::nullopt);
    take(tile);
  }
  [[nodiscard]] std::map<TileIndex, std::unique_ptr<RollingTile>>& tilesInMemory() { return in_memory_; }
  /// Those in memory, in the order in which they would leave.
  [[nodiscard]] std::vector<TileIndex> oldestFirst() const {
    return leavers([](const TileIndex&, const RollingTile&) { return false; });
  }

  /// Saves what has changed of the tiles in memory, which stay there. @return all tiles, for restore()
  [[nodiscard]] Json saveAll();
  /// Of a folder where another object has called saveAll(). Only while there are no tiles; labels are as of now. What
  /// else a process that was killed has left there goes.
  /// @param closed  closed() of that time
  /// @throws nlohmann::json::exception, InvalidArgument for what saveAll() does not write; InputError "rolling.damaged"
  ///         if a file is missing
  void restore(const Json& tiles, std::vector<std::string> lost, std::vector<Ball> closed, const MapTime& now);
  /// Files that saveAll() named stay until its next result is said to be kept: then those of the one before go. Nothing
  /// is under way afterwards but reading.
  void keep(const Json& tiles);
  /// The result of saveAll(), if there is one, will not be kept.
  void forgetSaveAll();

  /// All tiles in memory have had an update: those in the folder get it when they are next loaded, as of this time.
  void oweUpdate(const MapTime& now);
  [[nodiscard]] std::uint64_t saved() const { return saved_; }
  [[nodiscard]] std::uint64_t loaded() const { return loaded_; }
  [[nodiscard]] std::uint64_t savedAhead() const { return saved_ahead_; }
  [[nodiscard]] std::uint64_t loadedAhead() const { return loaded_ahead_; }
  [[nodiscard]] const std::vector<std::string>& lost() const { return lost_; }

 private:
  /// A tile that is read before it is needed. It stays in stored_, and counts as much as when it left.
  struct Ahead {
    TileBytes bytes;
    std::uint64_t wanted;  ///< the last step that expected it
    std::shared_ptr<std::optional<RollingTile>> tile;
    DiskThread::Handle work;
  };

  [[nodiscard]] RollingTile* find(const TileIndex& id);
  [[nodiscard]] RollingTile newTile(const TileIndex& id) const;
  /// As of the last update, if there was one. @param read  in advance, if it was
  [[nodiscard]] RollingTile load(const TileIndex& id, std::optional<RollingTile> read);
  /// On any thread. @param stored  with a serial
  [[nodiscard]] RollingTile readBack(const TileIndex& id, std::uint64_t serial, const std::string& files_sha256) const;
  /// What was read in advance, if anything was.
  [[nodiscard]] std::optional<RollingTile> takeAhead(const TileIndex& id);
  void beginAhead(const TileIndex& id, const StoredTile& stored, std::uint64_t step);
  void dropAhead(const TileIndex& id);
  /// One that others need more leaves. @return false if there is none
  bool dropOneAhead(const TileIndex& but, std::uint64_t wanted_before);
  /// Balls that it has not had.
  void closeIn(const TileIndex& id, RollingTile& tile) const;
  void closeWhole(const TileIndex& id, RollingTile& tile) const;
  /// A tile whose state is damaged: everything in it is closed.
  [[nodiscard]] RollingTile startClosed(const TileIndex& id);
  [[nodiscard]] StoredTile describe(const RollingTile& tile);
  void save(const TileIndex& id, RollingTile& tile);
  void beginSaving(const TileIndex& id, RollingTile& tile, std::uint64_t step);
  /// Its files are the tile's now, if they could be written.
  void endSaving(const TileIndex& id, RollingTile& tile);
  /// It will change: there never were such files.
  void forgetSaving(const TileIndex& id, RollingTile& tile);
  void doLater(std::function<void()> work);
  void removeLater(const TileIndex& id, std::uint64_t serial);
  void removeUnlessKept(const TileIndex& id, std::uint64_t serial);
  /// Whatever a process that was killed has left.
  void removeLeftovers() const;
  [[nodiscard]] double cellEdge_m() const;
  [[nodiscard]] RollingFiles filesOf(const TileIndex& id, std::uint64_t serial) const { return {folder_, id, serial}; }
  /// @param share  of the limits
  [[nodiscard]] bool isWithin(const TileBytes& all, double share = 1) const;
  /// Within what tighten() has left of the limits.
  [[nodiscard]] bool fitsWith(TileBytes more) const;
  [[nodiscard]] TileBytes bytesToLoad(const TileIndex& id) const;
  using Stays = std::function<bool(const TileIndex& id, const RollingTile& tile)>;
  /// Those that may leave, the one that was touched longest ago first; of one step, the farthest.
  [[nodiscard]] std::vector<TileIndex> leavers(const Stays& stays) const;
  void letGo(const TileIndex& id);
  /// The first of them leaves. @return false if there is none
  bool letOldestGo(const Stays& stays);
  void readAhead(const Outlook& outlook, std::uint64_t step);
  void writeAhead(std::uint64_t step);
  [[nodiscard]] Eigen::Vector3d worldOf(const Eigen::Vector3f& p_L) const;

  std::vector<ToolSpec> tools_;
  FieldParams params_;
  std::string described_;                           ///< the parameters, as all tiles have them
  std::unique_ptr<internal::SharedTables> tables_;  ///< of all tiles
  std::filesystem::path folder_;
  Limits limits_;
  std::int32_t tile_voxels_;
  bool notes_changes_;
  double share_ = 1;
  std::vector<Ball> closed_;
  std::map<TileIndex, std::unique_ptr<RollingTile>> in_memory_;
  std::map<TileIndex, StoredTile> stored_;      ///< disjoint from those in memory
  MapTime updated_at_;                          ///< the last update
  TileBytes growth_;                            ///< that the next step may take
  TileBytes empty_;                             ///< of a tile without returns, once one was made
  std::map<std::uint64_t, TileIndex> kept_;     ///< serials that the last result of saveAll() to be kept named
  std::map<std::uint64_t, TileIndex> named_;    ///< by saveAll(), until it is known whether its result is kept
  std::map<std::uint64_t, TileIndex> written_;  ///< serials whose files are not on the disk for good
  std::uint64_t serial_ = 0, saved_ = 0, loaded_ = 0, saved_ahead_ = 0, loaded_ahead_ = 0;
  std::vector<std::string> lost_;
  std::uint64_t step_ = 0;                     ///< the last that said what it expects
  std::map<TileIndex, std::size_t> expected_;  ///< its place: 0 = nearest
  std::map<TileIndex, Ahead> ahead_;           ///< of stored_
  std::vector<DiskThread::Handle> later_;      ///< what nobody waits for but saveAll()
  DiskThread disk_;                            ///< the last member: its work reads the others
};

}  // namespace accessvdb::tiles
