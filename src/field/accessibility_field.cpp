// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The frame loop: the only place where the stages meet.
#include "accessvdb/accessibility_field.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_export.h"
#include "accessvdb/region.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tsdf_volume.h"
#include "accessvdb/what_if.h"
#include "change/gone_cells.h"
#include "change/gone_points.h"
#include "field/access_map.h"
#include "field/backend_choice.h"
#include "field/best_tool.h"
#include "field/field_access.h"
#include "field/field_clock.h"
#include "field/field_steps.h"
#include "field/field_views.h"
#include "field/further_tools.h"
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
#include "tsdf/scan_integrator.h"
#include "update/run_beside.h"

namespace accessvdb {
namespace {

tbb::task_arena makeArena(int threads) {
  return tbb::task_arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
}

}  // namespace

struct ACCESSVDB_PRIVATE AccessibilityField::Impl {
  /// @param tools_named  at least one  @param resolved  for the first of them
  Impl(std::vector<ToolSpec> tools_named, const FieldParams& resolved, internal::ChosenBackend chosen_backend)
      : params(resolved),
        tools(std::move(tools_named)),
        tool(tools.front().tool),
        arena(makeArena(params.threads)),
        background_arena(makeArena(params.threads)),
        chosen(std::move(chosen_backend)),
        backend(chosen.backend.get()),
        setup(tool, params, *backend),
        volume(params.tsdf),
        integrator(prepared(volume, params)),
        mirror(backend->makeArena(), params.tsdf.voxel_size_m),
        distance_mirror(makeDistanceMirror()),
        points(params, setup.directions_xy(), setup.axes_xyz()),
        map_reads(internal::makeMapReads(volume.packed(), points, params.scoring.neighbourhood_weight, core())),
        gone_cells(makeGoneCells()),
        reads(gone_cells ? internal::readsWithGone(map_reads, points, gone_points) : map_reads),
        scorer(std::make_unique<internal::PointScorer>(points, params, *backend, reads)),
        further(tools, params, {volume.packed(), points, *backend, core(), gone_cells ? &gone_points : nullptr}),
        gate(params.tsdf, params.origin_W, returnsInWindow()),
        scheduler(further.makeSchedulers(*scorer, setup)),
        steps(views) {
    static_assert(internal::ScanIntegrator::kParts <= internal::UpdateScheduler::kMostParts);
    integrator.noteDistances(distance_mirror != nullptr || scheduler->needs().distances);
    if (!scheduler->needs().changes) return;
    integrator.visitChanges(
        [this](std::size_t part, const LeafChange& change) { scheduler->noteChange(part, change); });
  }

  std::optional<internal::VoxelColumnBox> core() const {
    if (!params.window) return std::nullopt;
    return internal::coreOf(*params.window);
  }
  std::optional<internal::VoxelColumnBox> returnsInWindow() const {
    if (!params.window) return std::nullopt;
    internal::WindowReach reach = internal::windowReach(setup.tool(), params);
    for (std::size_t n = 0; n < further.size(); ++n) {
      reach = internal::unionOf(reach, internal::windowReach(further[n].setup.tool(), further[n].params));
    }
    return internal::returnsOf(*params.window, reach);
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
    if (!(p_L.lpNorm<Eigen::Infinity>() <= 1e6 * params.tsdf.voxel_size_m)) return internal::kNone;
    return points.index().find(points.voxelOf(p_L.cast<float>()));
  }

  [[nodiscard]] internal::ScoredField scored() const {
    return {*scorer, *backend, gate.origin_W(), setup.tool().rolls, core(), gone_points.published()};
  }
  [[nodiscard]] internal::ViewedParts viewed() {
    steps.requireWhole();
    const internal::ScoringTables tables = setup.tables(mirror.grid());
    const kernels::DistanceView distances = {distance_mirror ? distance_mirror->grid() : nullptr,
                                             tables.map.inverse_voxel_size};
    return {volume.packed(), *scorer,       *backend,
            tables.map,      distances,     tables.approach,
            gate.origin_W(), viewedTools(), gone_points.published()};
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
    const kernels::DirectionMask all = kernels::allDirections(setupOf(k).tool().num_directions);
    std::vector<kernels::ScoreItem> items(ids.size());
    for (std::size_t n = 0; n < ids.size(); ++n) {
      items[n].id = ids[n];
      items[n].candidates = all;
    }
    internal::ScoringTables tables = setupOf(k).tables(mirror.grid());
    tables.rule.keep_best = false;
    for (const auto& result : again.score(items, tables)) tests += result.tests;
    const internal::ScoredField field = {
        again, *backend, gate.origin_W(), setupOf(k).tool().rolls, core(), gone_points.published()};
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

  /// Points come first, beside sorting the returns for the map: what their backend then starts runs while the map takes
  /// in the scan, as does noting what an update has to know about the returns. While the backend starts on what changed
  /// in the map, the mirror takes that in. Whatever is not hidden counts as integration.
  ///
  /// An update may be running (updateAsync): sorting and binning the returns go on beside it, points and map wait until
  /// it no longer reads them, and all that the backend or the mirror sees waits for its end.
  /// @param passed_s  since the latest scan
  /// @return time taken to note what the scan changed in the map; counts as the update's
  double integrateStages(const internal::GatedScan& scan, double passed_s, FrameStats& stats) {
    const internal::TouchedPoints* touched = nullptr;
    const auto add_returns = [&] {
      steps.waitForMap();
      points.describeTouched(scheduler->needs().news);
      touched = &points.addReturns(scan.p_L, scan.q_L);
    };
    internal::runBeside(add_returns, [&] { integrator.bin(scan.p_L, scan.q_L); });
    internal::IntegrationResult result;
    const auto note_returns = [&] {
      steps.joinUpdate();
      scheduler->noteReturns(*touched, scan.p_L, scan.q_L);
    };
    std::vector<LeafChange> aged, opened;
    const auto fuse = [&] {
      aged = ageFreeSpace(passed_s);
      opened = openWhatHasGone(scan, touched->all);
      if (scheduler->needs().changes) {
        for (const std::vector<LeafChange>* changes : {&aged, &opened}) {
          for (const LeafChange& change : *changes) scheduler->noteChange(0, change);
        }
      }
      result = integrator.integrate(scan.p_L, scan.q_L, {scan.R_W_S, gate.origin_W()});
    };
    internal::runBeside(note_returns, fuse);
    stats.touched_leaves = result.touched_leaves;
    stats.new_leaves = result.new_leaves;
    stats.distance_updates = result.counts.distance_updates;
    stats.cleared_updates = result.counts.cleared_updates;
    stats.flipped_voxels = result.counts.flipped_voxels;
    const kernels::Stopwatch noting;
    std::vector<std::span<const LeafChange>> changes = {aged, opened};
    changes.insert(changes.end(), result.changes.begin(), result.changes.end());
    scheduler->noteChanges(scan.p_L, scan.q_L, {changes, result.distances});
    const double noting_ms = noting.milliseconds();
    const internal::ScoringTables tables = setup.tables(mirror.grid());
    const auto to_backend = [&] { scheduler->prepare(tables); };
    const auto to_mirror = [&] {
      if (!aged.empty()) mirror.apply(aged);
      if (!opened.empty()) mirror.apply(opened);
      if (distance_mirror) mirrorOpened(opened);
      mirrorFacts(result, stats);
      if (distance_mirror) mirrorDistances(result, stats);
    };
    internal::runBeside(to_backend, to_mirror);
    return noting_ms;
  }

  /// @return where voxels are no longer free
  std::vector<LeafChange> ageFreeSpace(double passed_s) {
    internal::PackedMap& map = volume.packed();
    return map.agesFreeSpace() ? map.generations()->pass(map, passed_s) : std::vector<LeafChange>{};
  }

  /// @return where rays opened voxels of what has gone
  std::vector<LeafChange> openWhatHasGone(const internal::GatedScan& scan, std::span<const std::uint32_t> touched) {
    std::vector<LeafChange> changes;
    if (!gone_cells) return changes;
    gone_points.noteReturns(touched);
    const std::vector<internal::OpenedLeaf> opened = gone_cells->takeScan(scan.p_L, scan.q_L, touched);
    gone_points.noteOpened(points, opened, map_reads.weights);
    for (const internal::OpenedLeaf& leaf : opened) changes.push_back(internal::openVoxels(volume.packed(), leaf));
    return changes;
  }

  /// Opened voxels are no longer observed. The leaves are as they are after the scan.
  void mirrorOpened(std::span<const LeafChange> opened) {
    std::vector<DistanceChange> distances;
    for (const LeafChange& change : opened) {
      const auto& [x, y, z] = change.origin_ijk;
      const internal::PackedMap& map = volume.packed();
      const internal::PackedLeaf* leaf = map.tree().probeConstLeaf({x, y, z});
      distances.push_back({change.origin_ijk, ~std::uint32_t{0}, internal::packedValues(*leaf), map.blockedIn(*leaf)});
    }
    if (!distances.empty()) distance_mirror->apply(distances);
  }

  /// Time passes without a return.
  void passTime(double passed_s, FrameStats& stats) {
    steps.waitForMap();
    steps.joinUpdate();
    const std::vector<LeafChange> aged = ageFreeSpace(passed_s);
    if (aged.empty()) return;
    scheduler->noteChangesAlone(aged);
    const kernels::Stopwatch mirroring;
    mirror.apply(aged);
    stats.changed_leaves += aged.size();
    stats.mirror_bytes = mirror.lastTraffic().bytes_written;
    stats.mirror_ms = mirroring.milliseconds();
  }

  UpdateStats update() {
    const kernels::Stopwatch all;
    UpdateStats stats = arena.execute([&] { return steps.run([&] { return updateStages({}); }); });
    updated = labels_current = true;
    stats.update_ms = all.milliseconds() - stats.score_ms + std::exchange(noted_ms, 0.0);
    return stats;
  }

  UpdateTicket updateAsync() {
    updated = labels_current = true;
    const double noting_ms = std::exchange(noted_ms, 0.0);
    return steps.startUpdate([this, noting_ms](const internal::BackgroundUpdate::FreeMap& free_map) {
      const kernels::Stopwatch all;
      UpdateStats stats = background_arena.execute([&] { return updateStages(free_map); });
      stats.update_ms = all.milliseconds() - stats.score_ms + noting_ms;
      return stats;
    });
  }

  UpdateStats updateStages(const internal::BackgroundUpdate::FreeMap& free_map) {
    gone_points.publish();
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
    scheduler->noteRestored();
    scans = head.scans;
    clock = internal::FieldClock(head.latest_stamp_s);
    if (volume.packed().agesFreeSpace()) volume.packed().generations()->restoreAge(head.age_s);
    while (head.updated && update().backlog > 0) {
    }
  }

  void requireRegions() const {
    if (params.window || params.update.policy != UpdatePolicy::Exact ||
        params.tsdf.region == UpdateRegion::Projective) {
      throw InvalidArgument("region.unsupported", "",
                            "parts of a map can only be taken out of a map in one piece, of the exact policy",
                            "Map the scene without tiles, with the default profile");
    }
  }
  [[nodiscard]] internal::RegionPlace regionPlace() const { return {volume.packed(), points, gate.origin_W()}; }

  Removal removeRegion(const Region& region, RemovedAs as) {
    requireRegions();
    steps.requireWhole();
    const internal::VoxelSet voxels = internal::voxelsOf(region, regionPlace());
    Removal removal;
    removal.as = as;
    removal.voxels = internal::countVoxels(voxels);
    removal.points = internal::pointsIn(voxels, points).size();
    for (const LeafChange& change : internal::flipsIfFree(volume.packed(), voxels)) {
      removal.colliding_voxels += internal::countBits(change.collides_off);
    }
    steps.run([&] {
      const std::vector<LeafChange> changes = as == RemovedAs::Free
                                                  ? internal::removeAsFree(volume.packed(), voxels)
                                                  : internal::removeAsUnknown(volume.packed(), voxels);
      for (const LeafChange& change : changes) removal.flipped_voxels += internal::flippedVoxels(change);
      mirror.apply(changes);
      if (distance_mirror && as == RemovedAs::Free) mirrorAllDistances();
      scoreAllAgain();
    });
    return removal;
  }

  /// That mirror cannot take a distance back, so it is made again.
  void mirrorAllDistances() {
    distance_mirror.reset();
    distance_mirror = makeDistanceMirror();
    internal::forEachDistanceLeaf(volume.packed(), [this](auto distances) { distance_mirror->apply(distances); });
  }

  /// Forgets the state of all points. Weights have fallen, which no scan does, and which no scheduler follows.
  void scoreAllAgain() {
    scheduler.reset();
    scorer.reset();
    scorer = std::make_unique<internal::PointScorer>(points, params, *backend, reads);
    further.forget();
    scheduler = further.makeSchedulers(*scorer, setup);
    scheduler->noteRestored();
    labels_current = false;
  }

  /// Switches bits of the mirror for a moment: a step, because one that fails half-way leaves obstacles out.
  WhatIf whatIf(const internal::VoxelSet& voxels) {
    requireCurrentLabels();
    const internal::WhatIfTables& tables = whatIfTables();
    return steps.run([&] {
      return internal::openedWithout({volume.packed(), *scorer, setup, tables, mirror, gate.origin_W()}, voxels);
    });
  }
  void requireCurrentLabels() {
    requireRegions();
    if (!further.empty()) {
      throw InvalidArgument("region.tools", std::to_string(tools.size()) + " tools",
                            "what a cut would open can only be asked of a field with one tool",
                            "Map the scene with each tool alone");
    }
    steps.requireWhole();
    if (!labels_current) {
      throw InvalidArgument("region.stale", "", "the labels are not up to date, so it is unknown what is blocked now",
                            "Call update() first");
    }
  }
  const internal::WhatIfTables& whatIfTables() {
    if (!what_if_tables) {
      what_if_tables = std::make_unique<internal::WhatIfTables>(setup, params.tsdf.voxel_size_m);
    }
    return *what_if_tables;
  }

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
  internal::ScanGate gate;
  std::unique_ptr<internal::UpdateScheduler> scheduler;
  internal::FieldViews views;
  double noted_ms = 0;          ///< noting what scans since the last update changed in the map
  std::uint64_t scans = 0;      ///< integrated
  bool updated = false;         ///< at least once
  bool labels_current = false;  ///< an update came after the last change of the map
  std::unique_ptr<internal::WhatIfTables> what_if_tables;  ///< made when first needed
  internal::FieldClock clock;
  internal::FieldSteps steps;  ///< the last member: destroyed first, it waits for an update of the others
};

AccessibilityField::AccessibilityField(const ToolGeometry& tool, const FieldParams& params)
    : AccessibilityField(
          {{tool, params.approach.orientations, params.approach.rolls, {}, params.scoring.max_collisions}}, params) {}
AccessibilityField::AccessibilityField(std::vector<ToolSpec> tools, const FieldParams& params)
    : impl_(makeArena(params.threads).execute([&] {
        const std::vector<ToolSpec> list = namedTools(std::move(tools));
        const FieldParams resolved = internal::resolvedFor(list.front(), params);
        internal::requireManyTools(list, resolved);
        return internal::onBackend(resolved.backend, [&](internal::ChosenBackend chosen) {
          return std::make_unique<Impl>(list, resolved, std::move(chosen));
        });
      })) {}
AccessibilityField::~AccessibilityField() = default;
AccessibilityField::AccessibilityField(AccessibilityField&&) noexcept = default;
AccessibilityField& AccessibilityField::operator=(AccessibilityField&&) noexcept = default;

FrameStats AccessibilityField::integrateScan(std::span<const Eigen::Vector3f> points_S,
                                             const Eigen::Isometry3d& T_W_S) {
  return integrateScan(points_S, T_W_S, std::numeric_limits<double>::quiet_NaN());
}

FrameStats AccessibilityField::integrateScan(std::span<const Eigen::Vector3f> points_S, const Eigen::Isometry3d& T_W_S,
                                             double stamp_s) {
  return impl_->integrate(
      [&](FrameStats& stats) -> const internal::GatedScan& { return impl_->gate.gate(points_S, T_W_S, stats); },
      stamp_s);
}

FrameStats AccessibilityField::integrateRays(std::span<const Eigen::Vector3d> points_W,
                                             std::span<const Eigen::Vector3d> origins_W) {
  return integrateRays(points_W, origins_W, std::numeric_limits<double>::quiet_NaN());
}

FrameStats AccessibilityField::integrateRays(std::span<const Eigen::Vector3d> points_W,
                                             std::span<const Eigen::Vector3d> origins_W, double stamp_s) {
  impl_->steps.requireUnbroken();
  if (impl_->params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("projective.rays", "", "the projective baseline needs scans with one sensor pose",
                          "Use integrateScan()");
  }
  return impl_->integrate(
      [&](FrameStats& stats) -> const internal::GatedScan& { return impl_->gate.gate(points_W, origins_W, stats); },
      stamp_s);
}

std::optional<double> AccessibilityField::latestStamp_s() const { return impl_->clock.latest_s(); }

UpdateStats AccessibilityField::update() { return impl_->update(); }
UpdateTicket AccessibilityField::updateAsync() { return impl_->updateAsync(); }

Removal AccessibilityField::removeRegion(const Region& region, RemovedAs as) {
  return impl_->arena.execute([&] { return impl_->removeRegion(region, as); });
}

WhatIf AccessibilityField::whatIf(std::span<const Region> regions) const {
  impl_->requireCurrentLabels();
  internal::VoxelSet voxels;
  for (const Region& region : regions) {
    voxels = internal::unionOf(voxels, internal::FieldAccess::voxelsOf(*this, region));
  }
  return internal::FieldAccess::whatIf(*this, voxels);
}

FieldSnapshot AccessibilityField::snapshot() const {
  impl_->steps.requireWhole();
  return impl_->arena.execute([&] { return internal::snapshotOf(*points()); });
}

FieldSnapshot AccessibilityField::unscoredSnapshot() const {
  impl_->steps.requireHostWhole();
  return impl_->arena.execute([&] { return internal::snapshotOf(*unscoredPoints()); });
}

std::unique_ptr<const SurfacePoints> AccessibilityField::points() const {
  impl_->steps.requireWhole();
  return impl_->arena.execute([&] { return impl_->scoredPoints(); });
}

FieldSnapshot AccessibilityField::toolSnapshot(std::size_t tool) const {
  impl_->steps.requireWhole();
  static_cast<void>(impl_->setupOf(tool));
  return impl_->arena.execute([&] {
    const auto fields = impl_->further.ofEach(impl_->scored());
    return internal::snapshotOf(*internal::scoredPoints(fields[tool], internal::PointStates::AsOfTheLastUpdate));
  });
}

std::unique_ptr<const SurfacePoints> AccessibilityField::unscoredPoints() const {
  impl_->steps.requireHostWhole();
  return impl_->arena.execute([&] { return internal::scoredPoints(impl_->scored(), internal::PointStates::None); });
}

FieldSnapshot AccessibilityField::evaluateFromScratch(std::uint64_t* tests) const {
  impl_->steps.requireWhole();
  return impl_->arena.execute([&] {
    std::vector<std::unique_ptr<internal::PointScorer>> scorers;
    std::vector<std::unique_ptr<const SurfacePoints>> each;
    std::uint64_t all_tests = 0;
    for (std::size_t k = 0; k < impl_->tools.size(); ++k) {
      scorers.push_back(impl_->freshScorer(k));
      each.push_back(impl_->fromScratch(k, *scorers.back(), all_tests));
    }
    if (tests != nullptr) *tests = all_tests;
    return internal::snapshotOf(*impl_->pointsOf(std::move(each)));
  });
}

std::optional<SurfacePoint> AccessibilityField::pointAt(const Eigen::Vector3d& p_W) const {
  impl_->steps.requireWhole();
  const std::uint32_t id = impl_->idAt(p_W);
  if (id == internal::kNone) return std::nullopt;
  return impl_->scoredPoint(id);
}

std::optional<AccessMap> AccessibilityField::accessMap(const Eigen::Vector3d& p_W) const { return accessMap(p_W, 0); }
std::optional<AccessMap> AccessibilityField::accessMap(const Eigen::Vector3d& p_W, std::size_t tool) const {
  impl_->steps.requireWhole();
  const internal::ScoringSetup& setup = impl_->setupOf(tool);
  const std::uint32_t id = impl_->idAt(p_W);
  if (id == internal::kNone) return std::nullopt;
  return impl_->arena.execute([&] {
    const auto scorer = impl_->freshScorer(tool);
    return AccessMap{internal::scoredPoint(impl_->further.ofEach(impl_->scored())[tool], id),
                     setup.tool().collision_limit,
                     internal::tryEveryDirection(*scorer, setup, impl_->mirror.grid(), id)};
  });
}

BatchQuery AccessibilityField::batchQuery() const { return impl_->views.query(impl_->viewed(), impl_->arena); }
DeviceView AccessibilityField::deviceView() const { return impl_->views.view(impl_->viewed(), true); }
DeviceView AccessibilityField::hostView() const { return impl_->views.view(impl_->viewed(), false); }
std::uint64_t AccessibilityField::revision() const { return impl_->views.revision(); }

const TsdfVolume& AccessibilityField::volume() const {
  impl_->steps.settle();
  return impl_->volume;
}
const ToolGeometry& AccessibilityField::tool() const { return impl_->tool; }
const std::vector<ToolSpec>& AccessibilityField::tools() const { return impl_->tools; }
const FieldParams& AccessibilityField::params() const { return impl_->params; }
Eigen::Vector3d AccessibilityField::origin_W() const { return impl_->gate.origin_W(); }
std::string AccessibilityField::deviceName() const { return impl_->backend->name(); }
std::string AccessibilityField::deviceNote() const { return impl_->chosen.note; }
std::string AccessibilityField::deviceNoteId() const { return impl_->chosen.note_id; }
double AccessibilityField::toolShareHidden() const { return impl_->setup.tool().hidden_share; }
int AccessibilityField::collisionLimit() const { return impl_->setup.tool().collision_limit; }
int AccessibilityField::collisionLimit(std::size_t tool) const { return impl_->setupOf(tool).tool().collision_limit; }

MemoryUse AccessibilityField::memoryUse() const {
  impl_->steps.settle();
  MemoryUse use;
  use.map_bytes = impl_->volume.memoryBytes();
  use.mirror_bytes = impl_->mirror.usedBytes() + impl_->mirror.hostBytes();
  if (impl_->distance_mirror) {
    use.distance_mirror_bytes = impl_->distance_mirror->usedBytes() + impl_->distance_mirror->hostBytes();
  }
  use.point_host_bytes = impl_->points.bytes() + impl_->scorer->hostBytes() + impl_->scheduler->bytes() +
                         impl_->views.bytes() + impl_->setup.hostBytes() + impl_->further.hostBytes() +
                         impl_->gate.bytes() + impl_->gone_points.bytes();
  if (impl_->gone_cells) use.point_host_bytes += impl_->gone_cells->bytes();
  use.point_device_bytes = impl_->scorer->device().bytes() + impl_->setup.deviceBytes() + impl_->further.deviceBytes() +
                           impl_->scheduler->deviceBytes();
  use.device_peak_bytes = impl_->backend->peakBytes();
  use.leaves = impl_->volume.leafCount();
  use.active_voxels = impl_->volume.activeVoxelCount();
  return use;
}

void AccessibilityField::saveState(const std::filesystem::path& file) const {
  impl_->steps.requireWhole();
  impl_->arena.execute([&] {
    internal::SavedParts parts = {impl_->volume.packed(), impl_->points, impl_->further.ownStores(), {}};
    if (impl_->gone_cells) parts.gone = internal::GoneState{impl_->gone_cells.get(), &impl_->gone_points};
    internal::writeState(file, impl_->stateHead(), parts);
  });
}

AccessibilityField AccessibilityField::loadState(const std::filesystem::path& file, const ToolGeometry& tool,
                                                 BackendKind backend, int threads) {
  internal::StateReader state(file);
  const FieldParams& saved = state.head().params;
  const ToolSpec spec = {tool, saved.approach.orientations, saved.approach.rolls, {}, saved.scoring.max_collisions};
  return internal::FieldAccess::load(state, {spec}, backend, threads);
}

AccessibilityField AccessibilityField::loadState(const std::filesystem::path& file, std::vector<ToolSpec> tools,
                                                 BackendKind backend, int threads) {
  internal::StateReader state(file);
  return internal::FieldAccess::load(state, namedTools(std::move(tools)), backend, threads);
}

void AccessibilityField::write(const std::filesystem::path& folder) const { writeField(*this, folder, {}); }

FrameStats internal::FieldAccess::integrateLocal(AccessibilityField& field, std::span<const Eigen::Vector3f> p_L,
                                                 std::span<const Eigen::Vector3f> q_L) {
  return field.impl_->integrate(
      [&](FrameStats& stats) -> const GatedScan& { return field.impl_->gate.gateLocal(p_L, q_L, stats); });
}

AccessibilityField internal::FieldAccess::load(StateReader& state, const std::vector<ToolSpec>& tools,
                                               BackendKind backend, int threads) {
  if (state.head().tool_sha256 != toolListSha256(tools)) {
    throw UnusableInput("state.tool", state.file().string(),
                        state.head().tools.empty() && tools.size() == 1 ? "is the state of a field for another tool"
                                                                        : "is the state of a field for other tools",
                        "Use the tools that it was made with, in the same pose and order, or start again");
  }
  FieldParams params = state.head().params;
  params.backend = backend;
  params.threads = threads;
  AccessibilityField field(tools, params);
  field.impl_->arena.execute([&] { field.impl_->restore(state); });
  return field;
}

const internal::PointStore& internal::FieldAccess::points(const AccessibilityField& field) {
  field.impl_->steps.settle();
  return field.impl_->points;
}

internal::VoxelSet internal::FieldAccess::voxelsOf(const AccessibilityField& field, const Region& region) {
  field.impl_->requireRegions();
  field.impl_->steps.requireWhole();
  return field.impl_->arena.execute([&] { return internal::voxelsOf(region, field.impl_->regionPlace()); });
}

std::int32_t internal::FieldAccess::leavesRead(const AccessibilityField& field) {
  field.impl_->requireRegions();
  field.impl_->steps.settle();
  const LeafFootprint& footprint = field.impl_->whatIfTables().footprint;
  std::int32_t most = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    most = std::max({most, -footprint.low()[axis], footprint.high()[axis]});
  }
  return most + 1;  // weights are read around a point, too
}

WhatIf internal::FieldAccess::whatIf(const AccessibilityField& field, const VoxelSet& voxels) {
  return field.impl_->arena.execute([&] { return field.impl_->whatIf(voxels); });
}

internal::FieldCounts internal::FieldAccess::counts(const AccessibilityField& field) {
  field.impl_->steps.settle();
  const PackedMap& map = field.impl_->volume.packed();
  FieldCounts counts;
  counts.distance_leaves = map.allocated_leaf_count;
  counts.cleared_leaves = map.leaf_count - map.allocated_leaf_count;
  counts.nodes = map.tree().nodeCount()[1];
  counts.points = field.impl_->points.size();
  counts.point_leaves = field.impl_->points.index().blocks().size();
  return counts;
}

}  // namespace accessvdb
