// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The frame loop: the only place where the stages meet.
#pragma once

#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/region.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tsdf_volume.h"
#include "accessvdb/what_if.h"
#include "change/gone_cells.h"
#include "change/gone_points.h"
#include "field/backend_choice.h"
#include "field/best_tool.h"
#include "field/field_clock.h"
#include "field/field_steps.h"
#include "field/field_views.h"
#include "field/further_tools.h"
#include "field/left_out_points.h"
#include "field/new_thing_margin.h"
#include "field/point_weights.h"
#include "field/region_voxels.h"
#include "field/rules_version.h"
#include "field/scan_gate.h"
#include "field/scored_points.h"
#include "field/scoring_setup.h"
#include "field/state_reader.h"
#include "field/state_writer.h"
#include "field/what_if.h"
#include "launch/backend.h"
#include "launch/stopwatch.h"
#include "mirror/nanovdb_mirror.h"
#include "tsdf/leaf_facts.h"
#include "tsdf/scan_integrator.h"
#include "update/run_beside.h"

namespace accessvdb {
namespace internal {

inline tbb::task_arena makeArena(int threads) {
  return tbb::task_arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
}

}  // namespace internal

struct ACCESSVDB_PRIVATE AccessibilityField::Impl {
  /// @param tools_named  at least one  @param resolved  for the first of them
  Impl(std::vector<ToolSpec> tools_named, const FieldParams& resolved, internal::ChosenBackend chosen_backend,
       const TableProgress& progress)
      : params(resolved),
        tools(std::move(tools_named)),
        tool(tools.front().tool),
        arena(internal::makeArena(params.threads)),
        background_arena(internal::makeArena(params.threads)),
        chosen(std::move(chosen_backend)),
        backend(chosen.backend.get()),
        setup(tool, params, *backend, progress),
        volume(params.tsdf),
        integrator(prepared(volume, params)),
        mirror(backend->makeArena(), params.tsdf.voxel_size_m),
        distance_mirror(makeDistanceMirror()),
        points(params, setup.directions_xy(), setup.axes_xyz()),
        map_reads(internal::makeMapReads(volume.packed(), points, params.scoring.neighbourhood_weight, core())),
        gone_cells(makeGoneCells()),
        reads(gone_cells ? internal::readsWithGone(map_reads, points, gone_points) : map_reads),
        scorer(std::make_unique<internal::PointScorer>(points, params, *backend, reads)),
        further(tools, params, {volume.packed(), points, *backend, core(), gone_cells ? &gone_points : nullptr},
                progress),
        left_out(reachOfTools(), params),
        gate(params.tsdf, params.origin_W, returnsInWindow()),
        scheduler(further.makeSchedulers(*scorer, setup)),
        steps(views) {
    static_assert(internal::ScanIntegrator::kParts <= internal::UpdateScheduler::kMostParts);
    static_assert(internal::FreeGenerations::kParts <= internal::UpdateScheduler::kMostParts);
    integrator.noteDistances(distance_mirror != nullptr || scheduler->needs().distances);
    if (!scheduler->needs().changes) return;
    integrator.visitChanges(
        [this](std::size_t part, const LeafChange& change) { scheduler->noteChange(part, change); });
  }

  std::optional<internal::VoxelColumnBox> core() const {
    if (!params.window) return std::nullopt;
    return internal::coreOf(*params.window);
  }
  internal::WindowReach reachOfTools() const {
    internal::WindowReach reach = internal::windowReach(setup.tool(), params);
    for (std::size_t n = 0; n < further.size(); ++n) {
      reach = internal::unionOf(reach, internal::windowReach(further[n].setup.tool(), further[n].params));
    }
    return reach;
  }
  std::optional<internal::VoxelColumnBox> returnsInWindow() const {
    if (!params.window) return std::nullopt;
    return internal::returnsOf(*params.window, reachOfTools());
  }

  std::unique_ptr<internal::DistanceMirror> makeDistanceMirror() {
    if (!params.mirror_distance) return nullptr;
    const internal::DistanceLeaves leaves = {volume.packed().distanceCode(),
                                             static_cast<float>(params.tsdf.truncation_distance_m)};
    return std::make_unique<internal::DistanceMirror>(backend->makeArena(), params.tsdf.voxel_size_m,
                                                      internal::DistanceMirror::kDefaultRootCapacity, leaves);
  }

  std::unique_ptr<internal::GoneCells> makeGoneCells() const {
    if (params.change.mode != ChangeMode::Full) return nullptr;
    return std::make_unique<internal::GoneCells>(volume.packed(), points, params.tsdf);
  }

  static internal::PackedMap& prepared(TsdfVolume& volume, const FieldParams& params) {
    volume.packed().setCollisionDistance(static_cast<float>(params.scoring.collision_distance_m));
    if (params.change.mode != ChangeMode::Off) {
      volume.packed().blockNewThings(static_cast<float>(internal::farFromSurfaces_m(params)));
    }
    if (std::isfinite(params.change.free_for_s)) volume.packed().ageFreeSpace(params.change.free_for_s);
    return volume.packed();
  }

  /// Of the point in the voxel that contains p_W; kNone if there is none.
  [[nodiscard]] std::uint32_t idAt(const Eigen::Vector3d& p_W) const {
    if (!p_W.allFinite()) return internal::kNone;
    const Eigen::Vector3d p_L = p_W - gate.origin_W();
    if (!(p_L.lpNorm<Eigen::Infinity>() <= internal::kFarthestVoxel * params.tsdf.voxel_size_m)) return internal::kNone;
    return points.index().find(points.voxelOf(p_L));
  }

  [[nodiscard]] internal::ScoredField scored() const {
    return {*scorer, *backend, gate.origin_W(), setup.tool().rolls, core(), backlog > 0 || !labels_current, withheld()};
  }
  /// Points that are unscored whatever their state says.
  [[nodiscard]] std::span<const std::uint8_t> withheld() const { return left_out.withheld(gone_points.published()); }
  [[nodiscard]] internal::ViewedParts viewed() {
    steps.requireWhole();
    const internal::ScoringTables tables = setup.tables(mirror.grid());
    const kernels::DistanceView distances = {distance_mirror ? distance_mirror->grid() : nullptr,
                                             tables.map.inverse_voxel_size};
    return {volume.packed(), *scorer,         *backend,      tables.map, distances,
            tables.approach, gate.origin_W(), viewedTools(), withheld()};
  }
  /// None if there is only one.
  [[nodiscard]] std::vector<internal::ViewedTool> viewedTools() const {
    std::vector<internal::ViewedTool> viewed;
    if (further.empty()) return viewed;
    viewed.push_back({*scorer, setup.hostApproach(), setup.tool().collision_limit});
    for (std::size_t n = 0; n < further.size(); ++n) {
      const internal::ScoringSetup& own = further[n].setup;
      viewed.push_back({*further[n].scorer, own.hostApproach(), own.tool().collision_limit});
    }
    return viewed;
  }

  /// The parts of a tool. @param k  below tools.size(), else @throws InvalidArgument "tool.index"
  [[nodiscard]] const internal::ScoringSetup& setupOf(std::size_t k) const {
    if (k >= tools.size()) {
      throw InvalidArgument("tool.index", std::to_string(k),
                            "is not one of the field's " + std::to_string(tools.size()) + " tools",
                            "Count them from 0");
    }
    return k == 0 ? setup : further[k - 1].setup;
  }
  [[nodiscard]] const internal::PointScorer& scorerOf(std::size_t k) const {
    return k == 0 ? *scorer : *further[k - 1].scorer;
  }
  [[nodiscard]] std::vector<std::uint16_t> collisionLimits() const {
    std::vector<std::uint16_t> limits;
    for (std::size_t k = 0; k < tools.size(); ++k) limits.push_back(setupOf(k).tool().collision_limit);
    return limits;
  }
  /// All points, with the state of the best tool at each.
  [[nodiscard]] std::unique_ptr<const SurfacePoints> scoredPoints() const {
    std::vector<std::unique_ptr<const SurfacePoints>> each;
    for (const internal::ScoredField& field : further.ofEach(scored())) {
      each.push_back(internal::scoredPoints(field, internal::PointStates::AsOfTheLastUpdate));
    }
    return pointsOf(std::move(each));
  }
  [[nodiscard]] std::unique_ptr<const SurfacePoints> pointsOf(
      std::vector<std::unique_ptr<const SurfacePoints>> each) const {
    if (each.size() == 1) return std::move(each.front());
    return std::make_unique<internal::PointsOfTools>(std::move(each), collisionLimits());
  }
  [[nodiscard]] SurfacePoint scoredPoint(std::uint32_t id) const {
    if (further.empty()) return internal::scoredPoint(scored(), id);
    std::vector<SurfacePoint> each;
    for (const internal::ScoredField& field : further.ofEach(scored())) {
      each.push_back(internal::scoredPoint(field, id));
    }
    return internal::pointOfTools(each, collisionLimits());
  }
  /// The points of one tool, scored anew. @param tests  increased by those that it took
  [[nodiscard]] std::unique_ptr<const SurfacePoints> fromScratch(std::size_t k, internal::PointScorer& again,
                                                                 std::uint64_t& tests) const {
    again.grow();
    std::vector<std::uint32_t> ids(points.size());
    std::iota(ids.begin(), ids.end(), 0u);
    again.refreshWeights(ids);
    std::erase_if(ids, [&](std::uint32_t id) { return !again.confidentEnough(id); });
    again.refreshNeighbourhoods(ids);
    again.upload(ids);
    // Of a wide set, masks are not read.
    const int masked = std::min(setupOf(k).tool().num_directions, kernels::kMostMaskedDirections);
    const kernels::DirectionMask all = kernels::allDirections(masked);
    std::vector<kernels::ScoreItem> items(ids.size());
    for (std::size_t n = 0; n < ids.size(); ++n) {
      items[n].id = ids[n];
      items[n].candidates = all;
    }
    internal::ScoringTables tables = setupOf(k).tables(mirror.grid());
    tables.rule.keep_best = false;
    for (const auto& result : again.score(items, tables)) tests += result.tests;
    const internal::ScoredField field = {again,  *backend, gate.origin_W(), setupOf(k).tool().rolls,
                                         core(), false,    withheld()};
    return internal::scoredPoints(field, internal::PointStates::AsOfTheLastUpdate);
  }
  [[nodiscard]] std::unique_ptr<internal::PointScorer> freshScorer(std::size_t k) const {
    const internal::PointScorer& of_tool = scorerOf(k);
    return std::make_unique<internal::PointScorer>(of_tool.points(), of_tool.params(), *backend, of_tool.reads());
  }

  /// @param gated  returns the scan that passed the gate
  /// @param stamp_s  not finite: the scan has none
  template <typename Gated>
  FrameStats integrate(const Gated& gated, double stamp_s = std::numeric_limits<double>::quiet_NaN()) {
    const kernels::Stopwatch all;
    FrameStats stats;
    double noting_ms = 0;
    steps.requireUnbroken();
    arena.execute([&] {
      const internal::GatedScan& scan = gated(stats);
      const double passed_s = clock.note(stamp_s);
      if (!scan.p_L.empty()) {
        labels_current = false;
        steps.runBesideUpdate([&] { noting_ms = integrateStages(scan, passed_s, stats); });
      } else if (passed_s > 0 && volume.packed().agesFreeSpace()) {
        labels_current = false;
        steps.runBesideUpdate([&] { passTime(passed_s, stats); });
      }
    });
    ++scans;
    stats.surface_points = points.size();
    noted_ms += noting_ms;
    stats.integrate_ms = all.milliseconds() - stats.mirror_ms - noting_ms;
    return stats;
  }

  /// Returns are added to the points while they are sorted for the map and the map ages. Then the backend starts on the
  /// points while the map fuses the scan, and what an update has to know about the returns is noted; last, it starts on
  /// the changes while the mirror takes them in. Only time that is not hidden counts as integration.
  ///
  /// An update may be running (updateAsync): sorting and binning the returns go on beside it, points and map wait until
  /// it no longer reads them, and all that the backend or the mirror sees waits for its end.
  /// @param passed_s  since the latest scan
  /// @return time taken to note what the scan changed in the map; counts as the update's
  double integrateStages(const internal::GatedScan& scan, double passed_s, FrameStats& stats) {
    const internal::TouchedPoints* touched = nullptr;
    const internal::GatedScan* placed = &scan;  // what can become points
    const auto add_returns = [&] {
      steps.waitForMap();
      points.describeTouched(scheduler->needs().news);
      if (!volume.packed().grows()) placed = &placedReturns(scan, stats);
      touched = &points.addReturns(placed->p_L, placed->q_L);
    };
    std::vector<std::span<const LeafChange>> aged;
    // What is news is judged before free space ages.
    const auto bin_and_age = [&] {
      integrator.bin(scan.p_L, scan.q_L);
      if (!volume.packed().agesFreeSpace()) return;
      steps.waitForMap();
      aged = ageFreeSpace(passed_s);
    };
    internal::runBeside(add_returns, bin_and_age);
    internal::IntegrationResult result;
    const auto note_returns = [&] {
      steps.joinUpdate();
      scheduler->noteReturns(*touched, placed->p_L, placed->q_L);
    };
    std::vector<LeafChange> opened;
    const auto fuse = [&] {
      opened = openWhatHasGone(scan, touched->all);
      if (scheduler->needs().changes) {
        scheduler->noteEachPart(aged);
        for (const LeafChange& change : opened) scheduler->noteChange(0, change);
      }
      result = integrator.integrate(scan.p_L, scan.q_L, {scan.R_W_S, gate.origin_W()});
    };
    internal::runBeside(note_returns, fuse);
    stats.touched_leaves = result.touched_leaves;
    stats.new_leaves = result.new_leaves;
    stats.distance_updates = result.counts.distance_updates;
    stats.cleared_updates = result.counts.cleared_updates;
    stats.flipped_voxels = result.counts.flipped_voxels;
    if (!result.left_out.empty()) noteLeftOut(result.left_out);
    const kernels::Stopwatch noting;
    std::vector<std::span<const LeafChange>> changes = aged;
    changes.emplace_back(opened);
    changes.insert(changes.end(), result.changes.begin(), result.changes.end());
    scheduler->noteChanges(placed->p_L, placed->q_L, {changes, result.distances});
    const double noting_ms = noting.milliseconds();
    const internal::ScoringTables tables = setup.tables(mirror.grid());
    const auto to_backend = [&] { scheduler->prepare(tables); };
    const auto to_mirror = [&] {
      if (!aged.empty()) mirror.applyParts(aged);
      if (!opened.empty()) mirror.apply(opened);
      if (distance_mirror) mirrorOpened(opened);
      mirrorFacts(result, stats);
      if (distance_mirror) mirrorDistances(result, stats);
    };
    internal::runBeside(to_backend, to_mirror);
    return noting_ms;
  }

  // field_left_out.cpp: returns for which the map has no place.
  const internal::GatedScan& placedReturns(const internal::GatedScan& scan, FrameStats& stats);
  void noteLeftOut(std::span<const openvdb::Coord> leaves);
  void keepShut(std::span<const internal::OpenedLeaf> opened);
  void restoreLeftOut(internal::StateReader& state);

  /// @return where voxels are no longer free
  std::vector<std::span<const LeafChange>> ageFreeSpace(double passed_s) {
    internal::PackedMap& map = volume.packed();
    if (!map.agesFreeSpace()) return {};
    return map.generations()->pass(map, passed_s);
  }

  /// @return where rays opened voxels of what has gone
  std::vector<LeafChange> openWhatHasGone(const internal::GatedScan& scan, std::span<const std::uint32_t> touched) {
    if (!gone_cells) return {};
    gone_points.noteReturns(touched);
    const std::vector<internal::OpenedLeaf> opened = gone_cells->takeScan(scan.p_L, scan.q_L, touched);
    gone_points.noteOpened(points, opened, map_reads.weights);
    if (!volume.packed().leftOut().empty()) keepShut(opened);
    return internal::openVoxels(volume.packed(), opened);
  }

  /// Opened voxels are no longer observed. The leaves are as they are after the scan.
  void mirrorOpened(std::span<const LeafChange> opened) {
    std::vector<DistanceChange> distances;
    for (const LeafChange& change : opened) {
      const auto& [x, y, z] = change.origin_ijk;
      const internal::PackedMap& map = volume.packed();
      distances.push_back(internal::distancesOf(map, *map.tree().probeConstLeaf({x, y, z})));
    }
    if (!distances.empty()) distance_mirror->apply(distances);
  }

  /// Time passes without a return.
  void passTime(double passed_s, FrameStats& stats) {
    steps.waitForMap();
    steps.joinUpdate();
    const std::vector<std::span<const LeafChange>> aged = ageFreeSpace(passed_s);
    if (aged.empty()) return;
    scheduler->noteChangesAlone(aged);
    const kernels::Stopwatch mirroring;
    mirror.applyParts(aged);
    for (const auto& part : aged) stats.changed_leaves += part.size();
    stats.mirror_bytes = mirror.lastTraffic().bytes_written;
    stats.mirror_ms = mirroring.milliseconds();
  }

  UpdateStats update() {
    const kernels::Stopwatch all;
    UpdateStats stats = arena.execute([&] { return steps.run([&] { return updateStages({}); }); });
    updated = labels_current = true;
    backlog = stats.backlog;
    stats.update_ms = all.milliseconds() - stats.score_ms + std::exchange(noted_ms, 0.0);
    return stats;
  }

  UpdateTicket updateAsync() {
    const double noting_ms = std::exchange(noted_ms, 0.0);
    UpdateTicket ticket = steps.startUpdate([this, noting_ms](const internal::BackgroundUpdate::FreeMap& free_map) {
      const kernels::Stopwatch all;
      UpdateStats stats = background_arena.execute([&] { return updateStages(free_map); });
      stats.update_ms = all.milliseconds() - stats.score_ms + noting_ms;
      backlog = stats.backlog;
      return stats;
    });
    updated = labels_current = true;
    return ticket;
  }

  UpdateStats updateStages(const internal::BackgroundUpdate::FreeMap& free_map) {
    gone_points.publish();
    left_out.publish(points, volume.packed().leftOut(), gone_points.published(), gate.origin_W());
    scheduler->whenMapIsFree(free_map);
    return scheduler->update(setup.tables(mirror.grid()));
  }

  [[nodiscard]] internal::StateHead stateHead() const {
    internal::StateHead head;
    head.rules_version = internal::kRulesVersion;
    head.version = ACCESSVDB_VERSION;
    head.tool_sha256 = toolListSha256(tools);
    head.tools = further.saved(tools);
    head.params = params;
    if (gate.hasOrigin()) head.origin_W = gate.origin_W();
    head.updated = updated;
    head.scans = scans;
    head.latest_stamp_s = clock.latest_s();
    if (volume.packed().agesFreeSpace()) head.age_s = volume.packed().generations()->age_s();
    return head;
  }

  /// Only for a new field.
  void restore(internal::StateReader& state) {
    const internal::StateHead& head = state.head();
    if (head.origin_W) gate.restoreOrigin(*head.origin_W);
    state.readInto(volume.packed(), points, [this](auto facts, auto distances) {
      mirror.apply(facts);
      if (distance_mirror) distance_mirror->apply(distances);
    });
    state.readViews(points, further.ownStores());
    if (gone_cells) state.readGone(*gone_cells, gone_points);
    restoreLeftOut(state);
    scheduler->noteRestored();
    scans = head.scans;
    clock = internal::FieldClock(head.latest_stamp_s);
    if (volume.packed().agesFreeSpace()) volume.packed().generations()->restoreAge(head.age_s);
    while (head.updated && update().backlog > 0) {
    }
  }

  // field_regions.cpp: parts taken out by hand.
  void requireRegions() const;
  [[nodiscard]] internal::RegionPlace regionPlace() const { return {volume.packed(), points, gate.origin_W()}; }
  Removal removeRegion(const Region& region, RemovedAs as);
  void mirrorAllDistances();
  void scoreAllAgain();
  WhatIf whatIf(const internal::VoxelSet& voxels);
  void requireCurrentLabels();
  const internal::WhatIfTables& whatIfTables();

  void mirrorFacts(const internal::IntegrationResult& result, FrameStats& stats) {
    const kernels::Stopwatch mirroring;
    mirror.applyParts(result.changes);
    for (const auto& part : result.changes) stats.changed_leaves += part.size();
    stats.mirror_bytes = mirror.lastTraffic().bytes_written;
    stats.mirror_ms = mirroring.milliseconds();
  }

  void mirrorDistances(const internal::IntegrationResult& result, FrameStats& stats) {
    const kernels::Stopwatch mirroring;
    distance_mirror->applyParts(result.distances);
    for (const auto& part : result.distances) stats.distance_leaves += part.size();
    stats.distance_mirror_bytes = distance_mirror->lastTraffic().bytes_written;
    stats.distance_mirror_ms = mirroring.milliseconds();
  }

  FieldParams params;
  std::vector<ToolSpec> tools;
  const ToolGeometry& tool;  ///< the first
  tbb::task_arena arena;
  tbb::task_arena background_arena;  ///< of updateAsync(): a scan that waits for it may fill the other
  internal::ChosenBackend chosen;
  kernels::Backend* backend;
  internal::ScoringSetup setup;
  TsdfVolume volume;
  internal::ScanIntegrator integrator;
  internal::NanoVdbMirror mirror;
  std::unique_ptr<internal::DistanceMirror> distance_mirror;  ///< only for FieldParams::mirror_distance
  internal::PointStore points;
  internal::MapReads map_reads;
  std::unique_ptr<internal::GoneCells> gone_cells;  ///< only for ChangeMode::Full
  internal::GonePoints gone_points;
  internal::MapReads reads;  ///< what points see of the map
  std::unique_ptr<internal::PointScorer> scorer;
  internal::FurtherTools further;
  internal::LeftOutPoints left_out;
  internal::GatedScan placed_scan;  ///< kept so that memory is reused
  internal::ScanGate gate;
  std::unique_ptr<internal::UpdateScheduler> scheduler;
  internal::FieldViews views;
  double noted_ms = 0;          ///< noting what scans since the last update changed in the map
  std::uint64_t scans = 0;      ///< integrated
  bool updated = false;         ///< at least once
  bool labels_current = false;  ///< an update came after the last change of the map
  std::uint64_t backlog = 0;    ///< points that the last update left; one that runs may write it
  std::unique_ptr<internal::WhatIfTables> what_if_tables;  ///< made when first needed
  internal::FieldClock clock;
  internal::FieldSteps steps;  ///< the last member: destroyed first, it waits for an update of the others
};

}  // namespace accessvdb
