// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The frame loop: the only place where the stages meet.
#include "accessvdb/accessibility_field.h"

#include <tbb/task_arena.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_export.h"
#include "accessvdb/tsdf_volume.h"
#include "change/gone_cells.h"
#include "change/gone_points.h"
#include "field/access_map.h"
#include "field/backend_choice.h"
#include "field/field_access.h"
#include "field/field_clock.h"
#include "field/field_steps.h"
#include "field/field_views.h"
#include "field/new_thing_margin.h"
#include "field/point_weights.h"
#include "field/rules_version.h"
#include "field/scan_gate.h"
#include "field/scored_points.h"
#include "field/scoring_setup.h"
#include "field/state_reader.h"
#include "field/state_writer.h"
#include "launch/backend.h"
#include "launch/stopwatch.h"
#include "mirror/nanovdb_mirror.h"
#include "tsdf/scan_integrator.h"
#include "update/make_scheduler.h"
#include "update/run_beside.h"

namespace accessvdb {
namespace {

tbb::task_arena makeArena(int threads) {
  return tbb::task_arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
}

}  // namespace

struct ACCESSVDB_PRIVATE AccessibilityField::Impl {
  Impl(const ToolGeometry& tool_geometry, const FieldParams& resolved, internal::ChosenBackend chosen_backend)
      : params(resolved),
        tool(tool_geometry),
        arena(makeArena(params.threads)),
        background_arena(makeArena(params.threads)),
        chosen(std::move(chosen_backend)),
        backend(chosen.backend.get()),
        setup(tool, params, *backend),
        volume(params.tsdf),
        gate(params.tsdf, params.origin_W, returnsInWindow()),
        integrator(prepared(volume, params)),
        mirror(backend->makeArena(), params.tsdf.voxel_size_m),
        distance_mirror(makeDistanceMirror()),
        points(params, setup.directions_xy(), setup.axes_xyz()),
        map_reads(internal::makeMapReads(volume.packed(), points, params.scoring.neighbourhood_weight, core())),
        gone_cells(makeGoneCells()),
        reads(gone_cells ? internal::readsWithGone(map_reads, points, gone_points) : map_reads),
        scorer(points, params, *backend, reads),
        scheduler(internal::makeScheduler(scorer, {setup.hostTool(), setup.hostApproach()})),
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
    return internal::returnsOf(*params.window, internal::windowReach(setup.tool(), params));
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
    return {scorer, *backend, gate.origin_W(), core(), gone_points.published()};
  }
  [[nodiscard]] internal::ViewedParts viewed() {
    steps.requireWhole();
    const internal::ScoringTables tables = setup.tables(mirror.grid());
    const kernels::DistanceView distances = {distance_mirror ? distance_mirror->grid() : nullptr,
                                             tables.map.inverse_voxel_size};
    return {volume.packed(), scorer,          *backend,        tables.map,
            distances,       tables.approach, gate.origin_W(), gone_points.published()};
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
        steps.runBesideUpdate([&] { noting_ms = integrateStages(scan, passed_s, stats); });
      } else if (passed_s > 0 && volume.packed().agesFreeSpace()) {
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
        for (const auto& changes : {aged, opened}) {
          for (const LeafChange& change : changes) scheduler->noteChange(0, change);
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
    updated = true;
    stats.update_ms = all.milliseconds() - stats.score_ms + std::exchange(noted_ms, 0.0);
    return stats;
  }

  UpdateTicket updateAsync() {
    updated = true;
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
    head.tool_sha256 = tool.sha256();
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
    if (gone_cells) state.readGone(*gone_cells, gone_points);
    scheduler->noteRestored();
    scans = head.scans;
    clock = internal::FieldClock(head.latest_stamp_s);
    if (volume.packed().agesFreeSpace()) volume.packed().generations()->restoreAge(head.age_s);
    while (head.updated && update().backlog > 0) {
    }
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
  ToolGeometry tool;
  tbb::task_arena arena;
  tbb::task_arena background_arena;  ///< of updateAsync(): a scan that waits for it may fill the other
  internal::ChosenBackend chosen;
  kernels::Backend* backend;
  internal::ScoringSetup setup;
  TsdfVolume volume;
  internal::ScanGate gate;
  internal::ScanIntegrator integrator;
  internal::NanoVdbMirror mirror;
  std::unique_ptr<internal::DistanceMirror> distance_mirror;  ///< only for FieldParams::mirror_distance
  internal::PointStore points;
  internal::MapReads map_reads;
  std::unique_ptr<internal::GoneCells> gone_cells;  ///< only for ChangeMode::Full
  internal::GonePoints gone_points;
  internal::MapReads reads;  ///< what points see of the map
  internal::PointScorer scorer;
  std::unique_ptr<internal::UpdateScheduler> scheduler;
  internal::FieldViews views;
  double noted_ms = 0;      ///< noting what scans since the last update changed in the map
  std::uint64_t scans = 0;  ///< integrated
  bool updated = false;     ///< at least once
  internal::FieldClock clock;
  internal::FieldSteps steps;  ///< the last member: destroyed first, it waits for an update of the others
};

AccessibilityField::AccessibilityField(const ToolGeometry& tool, const FieldParams& params)
    : impl_(makeArena(params.threads).execute([&] {
        const FieldParams resolved = params.resolved();
        return internal::onBackend(resolved.backend, [&](internal::ChosenBackend chosen) {
          return std::make_unique<Impl>(tool, resolved, std::move(chosen));
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
  return impl_->arena.execute(
      [&] { return internal::scoredPoints(impl_->scored(), internal::PointStates::AsOfTheLastUpdate); });
}

std::unique_ptr<const SurfacePoints> AccessibilityField::unscoredPoints() const {
  impl_->steps.requireHostWhole();
  return impl_->arena.execute([&] { return internal::scoredPoints(impl_->scored(), internal::PointStates::None); });
}

FieldSnapshot AccessibilityField::evaluateFromScratch(std::uint64_t* tests) const {
  impl_->steps.requireWhole();
  return impl_->arena.execute([&] {
    internal::PointScorer scorer(impl_->points, impl_->params, *impl_->backend, impl_->reads);
    scorer.grow();
    std::vector<std::uint32_t> ids(impl_->points.size());
    std::iota(ids.begin(), ids.end(), 0u);
    scorer.refreshWeights(ids);
    std::erase_if(ids, [&](std::uint32_t id) { return !scorer.confidentEnough(id); });
    scorer.refreshNeighbourhoods(ids);
    scorer.upload(ids);
    const kernels::DirectionMask all = kernels::allDirections(impl_->setup.tool().num_directions);
    std::vector<kernels::ScoreItem> items(ids.size());
    for (std::size_t n = 0; n < ids.size(); ++n) {
      items[n].id = ids[n];
      items[n].candidates = all;
    }
    internal::ScoringTables tables = impl_->setup.tables(impl_->mirror.grid());
    tables.rule.keep_best = false;
    const auto results = scorer.score(items, tables);
    if (tests != nullptr) {
      *tests = 0;
      for (const auto& result : results) *tests += result.tests;
    }
    const internal::ScoredField again = {scorer, *impl_->backend, impl_->gate.origin_W(), impl_->core(),
                                         impl_->gone_points.published()};
    return internal::snapshotOf(*internal::scoredPoints(again, internal::PointStates::AsOfTheLastUpdate));
  });
}

std::optional<SurfacePoint> AccessibilityField::pointAt(const Eigen::Vector3d& p_W) const {
  impl_->steps.requireWhole();
  const std::uint32_t id = impl_->idAt(p_W);
  if (id == internal::kNone) return std::nullopt;
  return internal::scoredPoint(impl_->scored(), id);
}

std::optional<AccessMap> AccessibilityField::accessMap(const Eigen::Vector3d& p_W) const {
  impl_->steps.requireWhole();
  const std::uint32_t id = impl_->idAt(p_W);
  if (id == internal::kNone) return std::nullopt;
  return impl_->arena.execute([&] {
    internal::PointScorer scorer(impl_->points, impl_->params, *impl_->backend, impl_->reads);
    return AccessMap{internal::scoredPoint(impl_->scored(), id), collisionLimit(),
                     internal::tryEveryDirection(scorer, impl_->setup, impl_->mirror.grid(), id)};
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
const FieldParams& AccessibilityField::params() const { return impl_->params; }
Eigen::Vector3d AccessibilityField::origin_W() const { return impl_->gate.origin_W(); }
std::string AccessibilityField::deviceName() const { return impl_->backend->name(); }
std::string AccessibilityField::deviceNote() const { return impl_->chosen.note; }
std::string AccessibilityField::deviceNoteId() const { return impl_->chosen.note_id; }
double AccessibilityField::toolShareHidden() const { return impl_->setup.tool().hidden_share; }
int AccessibilityField::collisionLimit() const { return impl_->setup.tool().collision_limit; }

MemoryUse AccessibilityField::memoryUse() const {
  impl_->steps.settle();
  MemoryUse use;
  use.map_bytes = impl_->volume.memoryBytes();
  use.mirror_bytes = impl_->mirror.usedBytes() + impl_->mirror.hostBytes();
  if (impl_->distance_mirror) {
    use.distance_mirror_bytes = impl_->distance_mirror->usedBytes() + impl_->distance_mirror->hostBytes();
  }
  use.point_host_bytes = impl_->points.bytes() + impl_->scorer.hostBytes() + impl_->scheduler->bytes() +
                         impl_->views.bytes() + impl_->setup.hostBytes() + impl_->gate.bytes() +
                         impl_->gone_points.bytes();
  if (impl_->gone_cells) use.point_host_bytes += impl_->gone_cells->bytes();
  use.point_device_bytes =
      impl_->scorer.device().bytes() + impl_->setup.deviceBytes() + impl_->scheduler->deviceBytes();
  use.device_peak_bytes = impl_->backend->peakBytes();
  use.leaves = impl_->volume.leafCount();
  use.active_voxels = impl_->volume.activeVoxelCount();
  return use;
}

void AccessibilityField::saveState(const std::filesystem::path& file) const {
  impl_->steps.requireWhole();
  impl_->arena.execute([&] {
    std::optional<internal::GoneState> gone;
    if (impl_->gone_cells) gone = internal::GoneState{impl_->gone_cells.get(), &impl_->gone_points};
    internal::writeState(file, impl_->stateHead(), impl_->volume.packed(), impl_->points, gone);
  });
}

AccessibilityField AccessibilityField::loadState(const std::filesystem::path& file, const ToolGeometry& tool,
                                                 BackendKind backend, int threads) {
  internal::StateReader state(file);
  if (state.head().tool_sha256 != tool.sha256()) {
    throw UnusableInput("state.tool", file.string(), "is the state of a field for another tool",
                        "Use the tool that it was made with, in the same pose, or start again");
  }
  FieldParams params = state.head().params;
  params.backend = backend;
  params.threads = threads;
  AccessibilityField field(tool, params);
  field.impl_->arena.execute([&] { field.impl_->restore(state); });
  return field;
}

void AccessibilityField::write(const std::filesystem::path& folder) const { writeField(*this, folder, {}); }

FrameStats internal::FieldAccess::integrateLocal(AccessibilityField& field, std::span<const Eigen::Vector3f> p_L,
                                                 std::span<const Eigen::Vector3f> q_L) {
  return field.impl_->integrate(
      [&](FrameStats& stats) -> const GatedScan& { return field.impl_->gate.gateLocal(p_L, q_L, stats); });
}

const internal::PointStore& internal::FieldAccess::points(const AccessibilityField& field) {
  field.impl_->steps.settle();
  return field.impl_->points;
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
