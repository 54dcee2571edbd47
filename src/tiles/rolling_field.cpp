// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/rolling_field.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <iomanip>
#include <iterator>
#include <limits>
#include <optional>
#include <sstream>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/program/memory_prediction.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tiles.h"
#include "accessvdb/tool_tables.h"
#include "field/field_access.h"
#include "field/field_clock.h"
#include "field/left_out_points.h"
#include "field/scan_gate.h"
#include "field/tools/shared_tables.h"
#include "launch/stopwatch.h"
#include "points/point_store.h"
#include "tiles/folder_in_use.h"
#include "tiles/ray_sorter.h"
#include "tiles/rolling_manifest.h"
#include "tiles/rolling_result.h"
#include "tiles/rolling_start.h"
#include "tiles/rolling_tiles.h"
#include "tiles/sensor_course.h"
#include "tiles/shared_scan.h"
#include "tiles/step_sorter.h"
#include "tiles/tile_grid.h"
#include "update/update_stats_sum.h"

namespace accessvdb {
namespace {

namespace fs = std::filesystem;
using internal::FieldAccess;
using tiles::RollingTile;
using tiles::TileIndex;

void add(const FrameStats& of_tile, FrameStats& stats) {
  stats.touched_leaves += of_tile.touched_leaves;
  stats.new_leaves += of_tile.new_leaves;
  stats.distance_updates += of_tile.distance_updates;
  stats.cleared_updates += of_tile.cleared_updates;
  stats.mirror_ms += of_tile.mirror_ms;
  stats.changed_leaves += of_tile.changed_leaves;
  stats.mirror_bytes += of_tile.mirror_bytes;
  stats.flipped_voxels += of_tile.flipped_voxels;
}

}  // namespace

struct ACCESSVDB_PRIVATE RollingField::Impl {
  /// @param resumed  of an earlier field's folder: that nobody else has it
  Impl(std::vector<ToolSpec> given_tools, const FieldParams& given, RollingOptions given_options,
       const TableProgress& progress, std::optional<tiles::FolderInUse> resumed = {})
      : tools(namedTools(std::move(given_tools))),
        params(toolParams(tools.front(), given).resolved()),
        options(std::move(given_options)),
        memory_limit_bytes(tiles::tileLimit(options)),
        tables(std::make_unique<internal::SharedTables>()),
        margins(tiles::marginsFrom(tables->makeAll(tools, given, progress))),
        device_limit_bytes(tiles::deviceLimit(options, tables->freeDeviceBytes(), tables->deviceBytes())),
        tile_voxels(options.tile_voxels > 0 ? options.tile_voxels : tiles::edgeSideBySide(margins, params)),
        gate(params.tsdf, given.origin_W, std::nullopt, params.carry.size()),
        sorter(tile_voxels, margins.returns_voxels, params.tsdf.voxel_size_m),
        ray_sorter(tile_voxels, margins.returns_voxels, params.tsdf.voxel_size_m),
        tiles(tools, given, std::move(tables), options.folder, {memory_limit_bytes, device_limit_bytes}, tile_voxels,
              options.notes_changes) {
    tiles::requireRolling(params, options, margins);
    in_use = resumed ? *std::move(resumed) : tiles::takeNewFolder(options.folder);
    if (given.origin_W) tiles.setOrigin(*given.origin_W);
    if (std::isfinite(params.change.free_for_s)) generations.emplace(params.change.free_for_s);
    if (!resumed) checkpoint("");  // from now on what a process leaves that is killed is known to be ours
  }

  void checkpoint(const std::string& of_caller) {
    try {
      const tiles::Json saved = tiles.saveAll();
      tiles::writeManifest(options.folder, manifest(saved, of_caller), madeWith());
      tiles.keep(saved);
    } catch (...) {
      tiles.forgetSaveAll();
      throw;
    }
    note = of_caller;
  }

  /// A step that fails half-way leaves tiles that do not agree.
  template <typename Step>
  auto run(const Step& step) {
    requireWhole();
    whole = false;
    auto result = step();
    whole = true;
    return result;
  }
  void requireWhole() const {
    if (whole) return;
    throw ResourceLimit("field.broken", "", "an earlier step failed half-way, so this field can no longer answer",
                        "Start a new field");
  }

  using Touched = std::vector<tiles::TouchedTile>;
  /// Before anything changes: tiles leave and come.
  Touched prepare(const internal::GatedScan& scan) {
    requireWhole();
    keepWithinProcess();
    const Eigen::Vector3d& origin_W = gate.origin_W();
    if (gate.hasOrigin()) tiles.setOrigin({origin_W.x(), origin_W.y(), origin_W.z()});
    tiles.noteGrowth(std::exchange(growth, {}));
    std::vector<TileIndex> ids = nearestFirst(scan);
    const std::size_t with_returns = ids.size();
    if (!ids.empty()) nearest = ids.front();
    // Returns first: nothing is left out for rays that only pass.
    if (takesEvidence()) addCrossed(scan, ids);
    Touched touched;
    ++attempt;  // also where a step is refused: what it touched may leave in the next
    tiles.expect(ids, attempt);
    for (const TileIndex& id : ids) {
      const bool is_new = !tiles.has(id);
      touched.push_back({id, tileFor(id, attempt, now()), touched.size() < with_returns, is_new});
    }
    if (!ids.empty()) lookAhead(scan.q_L.front(), ids[with_returns - 1]);
    return touched;
  }

  [[nodiscard]] tiles::MapTime now() const { return {clock.latest_s(), age_s}; }
  [[nodiscard]] bool takesEvidence() const { return params.change.mode == ChangeMode::Full; }

  /// Tiles that only rays come near, nearest first. One that never got a return has nothing that could go.
  void addCrossed(const internal::GatedScan& scan, std::vector<TileIndex>& ids) {
    std::vector<std::pair<double, TileIndex>> order;
    for (const TileIndex& id : ray_sorter.sort(scan, [this](const TileIndex& tile) { return tiles.has(tile); })) {
      if (std::find(ids.begin(), ids.end(), id) == ids.end()) order.emplace_back(distance_m(id, scan.q_L.front()), id);
    }
    std::sort(order.begin(), order.end());
    for (const auto& [distance, id] : order) ids.push_back(id);
  }

  /// @param stamp_s  not finite: none
  void take(const internal::GatedScan& scan, const Touched& touched, double stamp_s, FrameStats& stats) {
    first_ids.push_back(points);
    stamps_s.push_back(stamp_s);
    farthest_m.push_back(tiles::listedRange_m(tiles::longestRay_m(scan)));
    const double passed_s = clock.note(stamp_s);
    if (generations) {
      generations->restoreAge(age_s);
      age_s = generations->ageAfter(passed_s);
    }
    memory_short = false;
    for (const tiles::TouchedTile& each : touched) {
      if (each.tile != nullptr) continue;
      noteShort(each.id, scan);
      if (takesEvidence() && !each.is_new) tiles.leaveOutRays(each.id, ray_sorter.raysOf(each.id, scan));
      if (!each.has_returns) continue;
      const tiles::StepSorter::Returns returns = sorter.returnsOf(each.id, scan);
      tiles.leaveOut(each.id, returns.p_L);
      stats.left_out_returns += returns.p_L.size();
    }
    std::vector<Fresh> fresh;
    if (takesEvidence() && !scan.p_L.empty()) {
      fuseTogether(scan, touched, stamp_s, fresh, stats);
      ++scans;
    } else {
      for (const auto& [id, tile, has_returns, is_new] : touched) {
        if (tile == nullptr) continue;
        const tiles::StepSorter::Returns returns = sorter.returnsOf(id, scan);
        tiles.noteChange(id, *tile);
        const FrameStats of_tile =
            FieldAccess::integrateLocal(tile->field, returns.p_L, returns.q_L, stamp_s, returns.attributes);
        noteRays(*tile, returns, of_tile);
        noteFused(id, *tile, scan, of_tile, fresh, stats);
      }
    }
    name(fresh);
    tiles.rest();
    left_out_returns += stats.left_out_returns;
    taken.points_in += stats.points_in;
    taken.points_used += stats.points_used;
    for (std::size_t n = 0; n < taken.dropped.size(); ++n) taken.dropped[n] += stats.dropped[n];
    stats.surface_points = points;
  }

  template <typename Gate>
  FrameStats integrate(const Gate& gated, std::optional<double> stamp_s) {
    const kernels::Stopwatch all;
    FrameStats stats;
    requireWhole();
    const internal::GatedScan& scan = gated(stats);
    const Touched touched = prepare(scan);
    return run([&] {
      take(scan, touched, stamp_s.value_or(std::numeric_limits<double>::quiet_NaN()), stats);
      stats.integrate_ms = all.milliseconds() - stats.mirror_ms;
      return stats;
    });
  }

  void lookAhead(const Eigen::Vector3f& q_L, const TileIndex& farthest) {
    course.note(q_L, distance_m(farthest, q_L));
    const Eigen::Vector3f soon_L = course.soon_L(tile_voxels * params.tsdf.voxel_size_m);
    tiles.lookAhead({[&](const TileIndex& id) { return distance_m(id, soon_L); }, course.reach_m()}, attempt);
  }

  /// In memory and, if there is room, growing; null if there is no room for it at all.
  /// The nearest one always is in memory, so that the map is never blind.
  RollingTile* tileFor(const TileIndex& id, std::uint64_t step, const tiles::MapTime& now) {
    const bool room = tiles.makeRoomFor(id, step);
    RollingTile* tile = tiles.inMemory(id);
    if (tile == nullptr && !room && id != nearest) return nullptr;
    if (tile != nullptr && room && !tile->field.grows()) {
      tile = &tiles.growAgain(id, now);
    } else {
      if (tile != nullptr && !room && tile->field.grows()) tile->field.stopGrowing();
      tile = &tiles.at(id, now);
    }
    tile->touched = step;  // it stays, whatever the others need
    return tile;
  }

  /// A point of a core that the step brought.
  struct Fresh {
    std::uint64_t place;
    RollingTile* tile;
    std::uint32_t id;
  };

  void fuseTogether(const internal::GatedScan& scan, const Touched& touched, double stamp_s, std::vector<Fresh>& fresh,
                    FrameStats& stats) {
    Touched here;
    std::ranges::copy_if(touched, std::back_inserter(here), [](const auto& each) { return each.tile != nullptr; });
    for (const tiles::TouchedTile& each : here) {
      if (each.has_returns) tiles.noteChange(each.id, *each.tile);
    }
    const std::vector<tiles::SharedScan::OfTile> fused =
        tiles::SharedScan(scan, {stamp_s, scans, age_s}, here, sorter, ray_sorter)
            .fuse(tile_voxels, margins.returns_voxels);
    for (std::size_t n = 0; n < here.size(); ++n) {
      const tiles::TouchedTile& each = here[n];
      if (each.has_returns) {
        noteFused(each.id, *each.tile, scan, fused[n].stats, fresh, stats);
      } else if (fused[n].has_changed) {
        tiles.noteChange(each.id, *each.tile);
        each.tile->behind = true;
        measure(*each.tile);
      }
    }
  }

  /// So that corrected poses tell which tiles they leave as they are.
  void noteRays(RollingTile& tile, const tiles::StepSorter::Returns& returns, const FrameStats& of_tile) const {
    const auto step = static_cast<std::uint32_t>(first_ids.size() - 1);
    // One that does not grow may also leave out what passes, and bands beside places that it has.
    if (of_tile.left_out_returns > 0 || !tile.field.grows()) tile.rays.reset();
    if (tile.rays) tiles::add(*tile.rays, tiles::digestOfBlock(step, returns.p_L, returns.q_L, returns.attributes));
  }
  void noteFused(const TileIndex& id, RollingTile& tile, const internal::GatedScan& scan, const FrameStats& of_tile,
                 std::vector<Fresh>& fresh, FrameStats& stats) {
    const internal::PointStore& store = FieldAccess::points(tile.field);
    add(of_tile, stats);
    stats.left_out_returns += of_tile.left_out_returns;
    tile.returns += of_tile.points_used;
    tile.behind = true;
    const internal::VoxelColumnBox core = internal::coreOf(tiles::TileId{id.first, id.second, {}}.window(tile_voxels));
    for (auto point = static_cast<std::uint32_t>(tile.ids.size()); point < store.size(); ++point) {
      const internal::Index3 voxel = store.voxelOf(store.first_L(point));
      tile.ids.push_back(RollingTile::kNotOurs);
      if (core.contains(voxel)) fresh.push_back({internal::placeOf(voxel), &tile, point});
    }
    measure(tile);
    if (of_tile.left_out_returns > 0) noteShort(id, scan);
  }
  /// The process takes more than tiles count, such as what each keeps for its next scan.
  void keepWithinProcess() {
    constexpr std::uint64_t kStepsToLeave = 8;  // after which memory that tiles have left is the system's again
    constexpr double kBelow = 0.95;
    const std::uint64_t limit = options.process_limit_bytes, steps = first_ids.size();
    if (limit == 0 || steps < tightened_at + kStepsToLeave || residentMemoryBytes() <= limit / 32 * 31) return;
    tightened_at = steps;
    own_share = std::min(own_share, static_cast<double>(tiles.use().memory) / static_cast<double>(memory_limit_bytes));
    own_share *= kBelow;
    tighten();
  }
  void tighten() { tiles.tighten(std::min(share, own_share)); }

  /// What an update took may be too much. It goes on where a tile cannot be saved: no label may be missing.
  void shrink() {
    try {
      if (!not_saved) tiles.shrink(nearest);
    } catch (const OutputError&) {
      not_saved = std::current_exception();
    }
  }
  /// @throws OutputError if shrink() failed since the last call
  void requireShrunk() {
    unsaved = true;
    if (const std::exception_ptr failed = std::exchange(not_saved, nullptr)) std::rethrow_exception(failed);
    tiles.shrink(nearest);
    unsaved = false;
  }
  void measure(RollingTile& tile) {
    const tiles::TileBytes before = tile.bytes;
    tile.measure();
    growth.memory += tile.bytes.memory - std::min(tile.bytes.memory, before.memory);
    growth.device += tile.bytes.device - std::min(tile.bytes.device, before.device);
    peak_memory_bytes = std::max(peak_memory_bytes, tiles.use().memory);
  }

  /// As in one piece: by the places of their voxels.
  void name(std::vector<Fresh>& fresh) {
    std::sort(fresh.begin(), fresh.end(), [](const Fresh& a, const Fresh& b) { return a.place < b.place; });
    if (fresh.size() >= RollingTile::kNotOurs - points)
      throw ResourceLimit("limit.points", "", "the map has more points than there are ids", "Use a larger voxel");
    for (const Fresh& point : fresh) point.tile->ids[point.id] = points++;
  }

  [[nodiscard]] double distance_m(const TileIndex& id, const Eigen::Vector3f& q_L) const {
    const FieldWindow window = tiles::TileId{id.first, id.second, {}}.window(tile_voxels);
    double square = 0;
    for (std::size_t axis = 0; axis < 2; ++axis) {
      const double v = params.tsdf.voxel_size_m, x = q_L[static_cast<Eigen::Index>(axis)];
      const double outside = std::max({window.core_low[axis] * v - x, x - window.core_high[axis] * v, 0.0});
      square += outside * outside;
    }
    return std::sqrt(square);
  }
  std::vector<TileIndex> nearestFirst(const internal::GatedScan& scan) {
    if (scan.p_L.empty()) return {};
    const std::span<const TileIndex> touched = sorter.sort(scan);
    std::vector<std::pair<double, TileIndex>> order;
    for (const TileIndex& id : touched) order.emplace_back(distance_m(id, scan.q_L.front()), id);
    std::sort(order.begin(), order.end());
    std::vector<TileIndex> ids;
    for (const auto& [distance, id] : order) ids.push_back(id);
    return ids;
  }
  void noteShort(const TileIndex& id, const internal::GatedScan& scan) {
    const double margin_m = margins.returns_voxels * params.tsdf.voxel_size_m;
    const double range_m = std::max(distance_m(id, scan.q_L.front()) - margin_m, 0.0);
    fitting_range_m = memory_short ? std::min(fitting_range_m, range_m) : range_m;
    memory_short = true;
  }

  /// Adds what changed with an update of the tile.
  void noteChanged(RollingTile& tile) {
    if (!options.notes_changes) return;
    for (SurfacePoint& point : internal::FieldAccess::takeChanged(tile.field)) {
      point.id = tile.ids[point.id];
      if (point.id != RollingTile::kNotOurs) changed.push_back(point);
    }
  }
  /// @param take  gets the points of a tile
  template <typename Take>
  void visitTiles(const std::vector<TileIndex>& ids, const Take& take) {
    requireWhole();
    for (const TileIndex& id : ids) tiles.visit(id, [&](const RollingTile& tile) { take(pointsOf(tile)); });
  }
  /// By ids.
  FieldSnapshot snapshotOf(const std::vector<TileIndex>& ids) {
    FieldSnapshot snapshot;
    snapshot.origin_W = gate.origin_W();
    snapshot.voxel_size_m = params.tsdf.voxel_size_m;
    visitTiles(ids, [&](std::span<const SurfacePoint> of_tile) {
      snapshot.points.insert(snapshot.points.end(), of_tile.begin(), of_tile.end());
    });
    std::ranges::sort(snapshot.points, {}, &SurfacePoint::id);
    return snapshot;
  }

  /// @return points of the core with their ids in the larger map
  static std::vector<SurfacePoint> pointsOf(const RollingTile& tile) {
    const auto listed = tile.field.points();
    std::vector<SurfacePoint> points;
    points.reserve(listed->size());
    for (std::size_t n = 0; n < listed->size(); ++n) {
      points.push_back(listed->at(n));
      points.back().id = tile.ids[points.back().id];
    }
    return points;
  }

  [[nodiscard]] tiles::MadeWith madeWith() const { return {tools, params, tile_voxels}; }
  /// @param saved  RollingTiles::saveAll()
  [[nodiscard]] tiles::RollingManifest manifest(tiles::Json saved, const std::string& of_caller) const {
    tiles::RollingManifest manifest;
    manifest.points = points;
    manifest.scans = scans;
    manifest.age_s = age_s;
    manifest.left_out_returns = left_out_returns;
    manifest.first_ids = first_ids;
    manifest.stamps_s = stamps_s;
    manifest.farthest_m = farthest_m;
    manifest.lost_tiles = tiles.lost();
    for (const auto& [centre_W, radius_m] : tiles.closed())
      manifest.closed.push_back({centre_W.x(), centre_W.y(), centre_W.z(), radius_m});
    manifest.note = of_caller;
    manifest.taken = taken;
    manifest.tiles = std::move(saved);
    const Eigen::Vector3d& origin_W = gate.origin_W();
    if (gate.hasOrigin()) manifest.origin_W = {origin_W.x(), origin_W.y(), origin_W.z()};
    manifest.latest_s = clock.latest_s();
    if (levelling) std::copy_n(levelling->data(), 9, manifest.levelling.emplace().begin());
    return manifest;
  }
  void restore(const tiles::RollingManifest& manifest) {
    if (gate.hasOrigin() && manifest.origin_W) {
      const Eigen::Vector3d made_W(manifest.origin_W->data());
      if (made_W != gate.origin_W()) {
        std::ostringstream text;
        text << "was made with the origin " << std::setprecision(17) << made_W.x() << ',' << made_W.y() << ','
             << made_W.z();
        throw UnusableInput("rolling.changed", options.folder.string(), text.str(), "Use that origin, or leave it out");
      }
    }
    points = manifest.points;
    scans = manifest.scans;
    age_s = manifest.age_s;
    left_out_returns = manifest.left_out_returns;
    first_ids = manifest.first_ids;
    stamps_s = manifest.stamps_s;
    farthest_m = manifest.farthest_m;
    note = manifest.note;
    taken = manifest.taken;
    if (manifest.levelling) levelling = Eigen::Matrix3d(manifest.levelling->data());
    if (manifest.latest_s) clock = internal::FieldClock(*manifest.latest_s);
    if (manifest.origin_W) {
      gate.restoreOrigin(Eigen::Vector3d(manifest.origin_W->data()));
      tiles.setOrigin(*manifest.origin_W);
    }
    std::vector<tiles::RollingTiles::Ball> closed;
    for (const auto& [x, y, z, radius_m] : manifest.closed) closed.push_back({{x, y, z}, radius_m});
    try {
      tiles.restore(manifest.tiles, manifest.lost_tiles, std::move(closed), now());
    } catch (const InvalidArgument&) {
      tiles::refuseManifest(options.folder);
    }
    attempt = tiles.latestTouch();
  }

  std::vector<ToolSpec> tools;
  FieldParams params;  ///< resolved, for the first tool
  RollingOptions options;
  tiles::FolderInUse in_use;
  std::uint64_t memory_limit_bytes;                ///< of the tiles
  std::unique_ptr<internal::SharedTables> tables;  ///< until `tiles` takes it
  tiles::TileMargins margins;
  std::uint64_t device_limit_bytes;  ///< of the tiles and their tables
  std::int32_t tile_voxels;
  internal::ScanGate gate;
  tiles::StepSorter sorter;
  tiles::RaySorter ray_sorter;
  tiles::RollingTiles tiles;
  internal::FieldClock clock;
  std::optional<internal::FreeGenerations> generations;  ///< only how time passes, where free space ages
  double age_s = 0;
  std::uint64_t scans = 0;               ///< with a return, for ChangeMode::Full
  std::vector<std::uint32_t> first_ids;  ///< of each step: the first point that it brought has this id
  std::vector<double> stamps_s;          ///< of each step
  std::vector<double> farthest_m;        ///< of each step, as in Binned
  tiles::SensorCourse course;
  TileIndex nearest = {};     ///< of those that the last step touched
  std::uint64_t attempt = 0;  ///< of a step
  std::uint32_t points = 0;
  std::uint64_t left_out_returns = 0;
  tiles::TileBytes growth;  ///< of the tiles in memory, since the last step began
  bool memory_short = false, whole = true;
  double fitting_range_m = 0;
  tiles::TakenReturns taken;  ///< of all steps
  std::string note;           ///< of the last checkpoint
  std::optional<Eigen::Matrix3d> levelling;
  std::vector<SurfacePoint> changed;  ///< since takeChanged()
  std::uint64_t peak_memory_bytes = 0;
  double share = 1;      ///< RollingField::tighten()
  double own_share = 1;  ///< keepWithinProcess()
  std::uint64_t tightened_at = 0;
  bool unsaved = false;
  std::exception_ptr not_saved;  ///< what shrink() threw
};

RollingField::RollingField(std::vector<ToolSpec> tools, const FieldParams& params, RollingOptions options,
                           const TableProgress& progress)
    : impl_(std::make_unique<Impl>(std::move(tools), params, std::move(options), progress)) {}
RollingField::RollingField() = default;
RollingField::~RollingField() = default;
RollingField::RollingField(RollingField&&) noexcept = default;
RollingField& RollingField::operator=(RollingField&&) noexcept = default;

FrameStats RollingField::integrateScan(std::span<const Eigen::Vector3f> points_S, const Eigen::Isometry3d& T_W_S,
                                       std::optional<double> stamp_s, std::span<const std::int32_t> attributes) {
  const auto gate = [&](FrameStats& stats) -> const internal::GatedScan& {
    return impl_->gate.gate(points_S, T_W_S, stats, attributes);
  };
  return impl_->integrate(gate, stamp_s);
}

FrameStats RollingField::integrateRays(std::span<const Eigen::Vector3d> points_W,
                                       std::span<const Eigen::Vector3d> origins_W, std::optional<double> stamp_s,
                                       std::span<const std::int32_t> attributes) {
  const auto gate = [&](FrameStats& stats) -> const internal::GatedScan& {
    return impl_->gate.gate(points_W, origins_W, stats, attributes);
  };
  return impl_->integrate(gate, stamp_s);
}

UpdateStats RollingField::update() {
  const UpdateStats stats = impl_->run([&] {
    UpdateStats all;
    const tiles::MapTime now = impl_->now();
    for (const TileIndex& id : impl_->tiles.oldestFirst()) {
      RollingTile* const tile = impl_->tiles.inMemory(id);
      if (tile == nullptr) continue;  // one that has left gets it when it comes back
      if (FieldAccess::agesUntil(tile->field, now.age_s)) {
        impl_->tiles.noteChange(id, *tile);
        FieldAccess::advanceTime(tile->field, now.latest_s, now.age_s);
        tile->behind = true;
      }
      if (!tile->behind) continue;
      impl_->tiles.noteChange(id, *tile);
      if (tile->updated) tile->rays.reset();  // its files may be others than after one update at the end
      internal::add(tile->field.update(), all);
      tile->behind = false;
      tile->updated = true;
      impl_->noteChanged(*tile);
      impl_->measure(*tile);
      impl_->shrink();
    }
    impl_->tiles.oweUpdate(now);
    return all;
  });
  impl_->requireShrunk();
  return stats;
}

void RollingField::leaveOut(std::span<const Eigen::Vector3d> centres_W, double radius_m) {
  if (!(radius_m >= 0 && radius_m <= internal::LeftOutPoints::kLargestRadius_m)) {
    throw InvalidArgument("left_out.radius", "radius_m", "must be 0 .. 1000000 m", "Pass one in metres");
  }
  std::vector<tiles::RollingTiles::Ball> balls;
  for (const Eigen::Vector3d& centre_W : centres_W)
    if (centre_W.allFinite()) balls.push_back({centre_W, radius_m});
  impl_->run([&] {
    impl_->tiles.close(balls);
    return true;
  });
}

std::vector<SurfacePoint> RollingField::takeChanged() {
  if (!impl_->options.notes_changes) {
    throw InvalidArgument("rolling.changes", "notes_changes", "is off, so nobody notes what changes",
                          "Set it in RollingOptions");
  }
  std::vector<SurfacePoint>& all = impl_->changed;
  std::vector<SurfacePoint> last;
  std::ranges::stable_sort(all, {}, &SurfacePoint::id);
  for (std::size_t n = 0; n < all.size(); ++n)
    if (n + 1 == all.size() || all[n].id != all[n + 1].id) last.push_back(all[n]);
  all = {};  // not before nothing can fail any more: the next call has them then
  return last;
}

void RollingField::tighten(double share) {
  impl_->share = std::clamp(share, 0.0, 1.0);
  impl_->tighten();
}

void RollingField::checkpoint(const std::string& note) {
  impl_->requireWhole();
  impl_->checkpoint(note);
}

void RollingField::requireEmpty(const fs::path& folder) { tiles::FolderInUse::requireEmpty(folder); }

bool RollingField::hasCheckpoint(const fs::path& folder) { return tiles::hasManifest(folder); }

const std::string& RollingField::note() const { return impl_->note; }

const std::optional<Eigen::Matrix3d>& RollingField::levelling() const { return impl_->levelling; }
void RollingField::setLevelling(const std::optional<Eigen::Matrix3d>& R_L_W) { impl_->levelling = R_L_W; }

RollingField RollingField::resume(std::vector<ToolSpec> tools, const FieldParams& params, RollingOptions options,
                                  const TableProgress& progress) {
  const fs::path folder = options.folder;
  RollingField field;
  tiles::requireManifest(folder);  // nothing is made where there is none
  // Before it is read: another field may be writing its last checkpoint.
  tiles::FolderInUse in_use = tiles::takeFolder(folder);
  tiles::readManifest(folder, [&](const tiles::Json& json) {
    if (options.tile_voxels == 0) options.tile_voxels = tiles::tileVoxelsOf(json);
    field.impl_ = std::make_unique<Impl>(std::move(tools), params, std::move(options), progress, std::move(in_use));
    field.impl_->restore(tiles::manifestFrom(json, folder, field.impl_->madeWith()));
  });
  return field;
}

void RollingField::forEachTile(const std::function<void(std::span<const SurfacePoint> points)>& take) {
  impl_->visitTiles(impl_->tiles.all(), take);
}

FieldSnapshot RollingField::snapshot() { return impl_->snapshotOf(impl_->tiles.all()); }

FieldSnapshot RollingField::snapshotInMemory() {
  std::vector<TileIndex> ids;
  for (const auto& [id, tile] : impl_->tiles.tilesInMemory()) ids.push_back(id);
  return impl_->snapshotOf(ids);
}

RollingStatus RollingField::status() const {
  RollingStatus status;
  status.steps = impl_->first_ids.size();
  status.points = impl_->points;
  status.tile_voxels = impl_->tile_voxels;
  status.margin_voxels = impl_->margins.returns_voxels;
  status.tiles = impl_->tiles.all().size();
  status.tiles_in_memory = impl_->tiles.tilesInMemory().size();
  status.saved = impl_->tiles.saved();
  status.loaded = impl_->tiles.loaded();
  status.saved_ahead = impl_->tiles.savedAhead();
  status.loaded_ahead = impl_->tiles.loadedAhead();
  const tiles::TileBytes use = impl_->tiles.use();
  status.memory_bytes = use.memory;
  status.device_bytes = use.device;
  status.peak_memory_bytes = std::max(impl_->peak_memory_bytes, use.memory);
  status.unsaved = impl_->unsaved;
  status.memory_short = impl_->memory_short;
  status.fitting_range_m = impl_->memory_short ? impl_->fitting_range_m : 0;
  status.left_out_returns = impl_->left_out_returns;
  status.lost_tiles = impl_->tiles.lost();
  return status;
}

const FieldParams& RollingField::params() const { return impl_->params; }
const std::vector<ToolSpec>& RollingField::tools() const { return impl_->tools; }
Eigen::Vector3d RollingField::origin_W() const { return impl_->gate.origin_W(); }

std::vector<tiles::Tile> RollingField::write(const fs::path& out, const io::WriteOptions& files,
                                             const RollingSource& source) {
  io::checkWriteOptions(files);
  const Eigen::Vector3d& origin_W = impl_->gate.origin_W();
  const tiles::RollingResult result({impl_->madeWith(),
                                     {origin_W.x(), origin_W.y(), origin_W.z()},
                                     impl_->margins.returns_voxels,
                                     impl_->first_ids,
                                     impl_->stamps_s,
                                     impl_->farthest_m,
                                     impl_->taken},
                                    source, out, impl_->options.folder);
  // A tile is copied while it is written.
  if (impl_->options.process_limit_bytes > 0) impl_->tiles.tighten(impl_->own_share / 2);
  try {
    update();
  } catch (const OutputError&) {  // a tile that cannot leave is still here
  }
  try {
    std::vector<tiles::Tile> done = result.write(impl_->tiles, files);
    impl_->tighten();
    return done;
  } catch (...) {
    impl_->tighten();
    throw;
  }
}

}  // namespace accessvdb
