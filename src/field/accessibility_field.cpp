// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The public calls of a field.
#include "accessvdb/accessibility_field.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/error.h"
#include "accessvdb/field_export.h"
#include "accessvdb/pose_query.h"
#include "accessvdb/tsdf_volume.h"
#include "accessvdb/what_if.h"
#include "field/field_access.h"
#include "field/field_stages.h"
#include "field/frame_loop.h"
#include "field/query/answers.h"
#include "field/regions/field_regions.h"
#include "field/state/field_state.h"
#include "field/thread_count.h"

namespace accessvdb {

struct ACCESSVDB_PRIVATE AccessibilityField::Impl : internal::FieldStages {
  using FieldStages::FieldStages;
};

namespace {

/// Whether a field gets to know all that it needs from its own scans.
void requireAlone(const FieldParams& params) {
  if (!params.window || params.change.mode != ChangeMode::Full) return;
  throw InvalidArgument("config.window", "window",
                        "cannot be combined with ChangeMode::Full, whose rays reach beyond a tile",
                        "Use ChangeMode::Block, or RollingField");
}

std::uint64_t totalBytes(const MemoryUse& use) {
  return use.map_bytes + use.mirror_bytes + use.distance_mirror_bytes + use.point_host_bytes + use.point_device_bytes;
}

}  // namespace

AccessibilityField::AccessibilityField(const ToolGeometry& tool, const FieldParams& params)
    : AccessibilityField(onlyTool(tool, params), params) {}
AccessibilityField::AccessibilityField(std::vector<ToolSpec> tools, const FieldParams& params,
                                       const TableProgress& progress)
    : AccessibilityField(std::move(tools), params, progress, nullptr) {}
AccessibilityField::AccessibilityField(std::vector<ToolSpec> tools, const FieldParams& params,
                                       const TableProgress& progress, internal::SharedTables* tables)
    : impl_(internal::makeArena(internal::requireThreads(params.threads)).execute([&] {
        const std::vector<ToolSpec> list = namedTools(std::move(tools));
        const FieldParams resolved = internal::resolvedFor(list.front(), params);
        internal::requireManyTools(list, resolved);
        if (tables == nullptr) requireAlone(resolved);
        return internal::onBackend(resolved, [&](internal::ChosenBackend chosen) {
          return std::make_unique<Impl>(list, resolved, std::move(chosen), progress, tables);
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
                                             double stamp_s, std::span<const std::int32_t> attributes) {
  const internal::GateScan gate = [&](FrameStats& stats) -> const internal::GatedScan& {
    return impl_->gate.gate(points_S, T_W_S, stats, attributes);
  };
  return internal::integrateScan(*impl_, gate, stamp_s);
}

FrameStats AccessibilityField::integrateRays(std::span<const Eigen::Vector3d> points_W,
                                             std::span<const Eigen::Vector3d> origins_W) {
  return integrateRays(points_W, origins_W, std::numeric_limits<double>::quiet_NaN());
}

FrameStats AccessibilityField::integrateRays(std::span<const Eigen::Vector3d> points_W,
                                             std::span<const Eigen::Vector3d> origins_W, double stamp_s,
                                             std::span<const std::int32_t> attributes) {
  impl_->steps.requireUnbroken();
  if (impl_->params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("projective.rays", "", "the projective baseline needs scans with one sensor pose",
                          "Use integrateScan()");
  }
  const internal::GateScan gate = [&](FrameStats& stats) -> const internal::GatedScan& {
    return impl_->gate.gate(points_W, origins_W, stats, attributes);
  };
  return internal::integrateScan(*impl_, gate, stamp_s);
}

std::optional<double> AccessibilityField::latestStamp_s() const { return impl_->clock.latest_s(); }

UpdateStats AccessibilityField::update() { return internal::updateLabels(*impl_); }
UpdateTicket AccessibilityField::updateAsync() { return internal::updateLabelsAsync(*impl_); }

void AccessibilityField::setBudgetPoints(int points) {
  constexpr int kMost = 2'000'000'000;
  if (points < 0 || points > kMost) {
    throw InvalidArgument("config.range", "budget_points", std::to_string(points) + " is outside 0 .. 2000000000",
                          "Use 0 for no limit");
  }
  impl_->steps.settleUpdate();
  impl_->budget_points = points;
}

void AccessibilityField::stopGrowing(std::size_t most_left_out_leaves) {
  if (impl_->params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("projective.limit", "", "the projective baseline cannot keep a map from growing",
                          "Use another UpdateRegion");
  }
  impl_->steps.requireWhole();
  impl_->stopLeading();
  impl_->map.stopGrowing(most_left_out_leaves);
}

bool AccessibilityField::grows() const { return impl_->map.grows(); }

void AccessibilityField::leaveOut(std::span<const Eigen::Vector3d> centres_W, double radius_m) {
  if (!(radius_m >= 0 && radius_m <= internal::LeftOutPoints::kLargestRadius_m)) {
    throw InvalidArgument("left_out.radius", "radius_m", "must be 0 .. 1000000 m", "Pass one in metres");
  }
  impl_->steps.run([&] {
    impl_->labels.current = false;
    for (const Eigen::Vector3d& centre_W : centres_W) impl_->left_out_points.close(centre_W, radius_m);
  });
}

Removal AccessibilityField::removeRegion(const Region& region, RemovedAs as) {
  return impl_->arena.execute([&] { return internal::removeRegion(*impl_, region, as); });
}

WhatIf AccessibilityField::whatIf(std::span<const Region> regions) const {
  internal::requireCurrentLabels(*impl_);
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
  return impl_->arena.execute([&] { return internal::scoredPoints(*impl_); });
}

FieldSnapshot AccessibilityField::toolSnapshot(std::size_t tool) const {
  impl_->steps.requireWhole();
  const internal::ScoredField scored = internal::scoredFor(*impl_, tool);
  return impl_->arena.execute(
      [&] { return internal::snapshotOf(*internal::scoredPoints(scored, internal::PointStates::AsOfTheLastUpdate)); });
}

std::unique_ptr<const SurfacePoints> AccessibilityField::unscoredPoints() const {
  impl_->steps.requireHostWhole();
  return impl_->arena.execute(
      [&] { return internal::scoredPoints(internal::scoredFor(*impl_, 0), internal::PointStates::None); });
}

FieldSnapshot AccessibilityField::evaluateFromScratch(std::uint64_t* tests) const {
  impl_->steps.requireWhole();
  return impl_->arena.execute([&] { return internal::evaluatedFromScratch(*impl_, tests); });
}

std::optional<SurfacePoint> AccessibilityField::pointAt(const Eigen::Vector3d& p_W) const {
  impl_->steps.requireWhole();
  const std::uint32_t id = internal::idAt(*impl_, p_W);
  if (id == internal::kNone) return std::nullopt;
  return internal::scoredPoint(*impl_, id);
}

std::vector<std::int32_t> AccessibilityField::attributesAt(const Eigen::Vector3d& p_W) const {
  impl_->steps.requireHostWhole();
  std::vector<std::int32_t> values;
  const std::uint32_t id = internal::idAt(*impl_, p_W);
  const internal::PointAttributes& attributes = impl_->points.attributes();
  for (std::size_t c = 0; id != internal::kNone && c < attributes.columns(); ++c) {
    if (!isHidden(attributes.carried()[c])) values.push_back(attributes.value(id, c));
  }
  return values;
}

std::optional<AccessMap> AccessibilityField::accessMap(const Eigen::Vector3d& p_W, std::size_t tool) const {
  impl_->steps.requireWhole();
  static_cast<void>(impl_->tools.at(tool));
  const std::uint32_t id = internal::idAt(*impl_, p_W);
  if (id == internal::kNone) return std::nullopt;
  return accessMaps({&id, 1}, tool).front();
}

std::vector<AccessMap> AccessibilityField::accessMaps(std::span<const std::uint32_t> ids, std::size_t tool) const {
  impl_->steps.requireWhole();
  static_cast<void>(impl_->tools.at(tool));
  internal::requireIds(*impl_, ids);
  return impl_->arena.execute([&] { return internal::accessMapsOf(*impl_, ids, tool); });
}

std::vector<float> AccessibilityField::freeArcs_deg(std::span<const std::uint32_t> ids, std::size_t tool) const {
  impl_->steps.requireWhole();
  static_cast<void>(impl_->tools.at(tool));
  internal::requireIds(*impl_, ids);
  return impl_->arena.execute([&] { return internal::freeArcsOf(*impl_, ids, tool); });
}

BatchQuery AccessibilityField::batchQuery() const {
  return impl_->views.query(internal::viewedParts(*impl_), impl_->arena);
}
PoseQuery AccessibilityField::poseQuery() const { return impl_->pose_fits.query(internal::fitInputs(*impl_)); }
DeviceView AccessibilityField::deviceView() const { return impl_->views.view(internal::viewedParts(*impl_), true); }
DeviceView AccessibilityField::hostView() const { return impl_->views.view(internal::viewedParts(*impl_), false); }
std::uint64_t AccessibilityField::revision() const { return impl_->views.revision(); }

const TsdfVolume& AccessibilityField::volume() const {
  impl_->steps.settle();
  return impl_->volume;
}
const ToolGeometry& AccessibilityField::tool() const { return impl_->tools.specs().front().tool; }
const std::vector<ToolSpec>& AccessibilityField::tools() const { return impl_->tools.specs(); }
const FieldParams& AccessibilityField::params() const { return impl_->params; }
Eigen::Vector3d AccessibilityField::origin_W() const { return impl_->gate.origin_W(); }
std::string AccessibilityField::deviceName() const { return impl_->backend->name(); }
std::string AccessibilityField::deviceNote() const { return impl_->chosen.note; }
std::string AccessibilityField::deviceNoteId() const { return impl_->chosen.note_id; }
double AccessibilityField::toolShareHidden() const {
  double share = 0;
  for (const auto& tool : impl_->tools) share = std::max(share, tool->setup.tool().hidden_share);
  return share;
}
int AccessibilityField::collisionLimit(std::size_t tool) const { return impl_->tools.at(tool).collisionLimit(); }

MemoryUse AccessibilityField::memoryUse() const {
  impl_->steps.settle();
  MemoryUse use = impl_->pointMemory();
  use.map_bytes = impl_->volume.memoryBytes();
  use.mirror_bytes = impl_->mirrors.factBytes();
  use.device_peak_bytes = impl_->backend->peakBytes();
  use.leaves = impl_->volume.leafCount();
  use.active_voxels = impl_->volume.activeVoxelCount();
  return use;
}

void AccessibilityField::saveState(const std::filesystem::path& file) const {
  internal::FieldAccess::saveState(*this, file, io::writeFileDurably);
}

void internal::FieldAccess::saveState(const AccessibilityField& field, const std::filesystem::path& file,
                                      io::WriteFile write) {
  field.impl_->steps.requireWhole();
  field.impl_->arena.execute([&] { internal::saveState(*field.impl_, file, write); });
}

AccessibilityField AccessibilityField::loadState(const std::filesystem::path& file, const ToolGeometry& tool,
                                                 BackendKind backend, int threads) {
  internal::StateReader state(file);
  return internal::FieldAccess::load(state, onlyTool(tool, state.head().params),
                                     {.backend = backend, .threads = threads});
}

AccessibilityField AccessibilityField::loadState(const std::filesystem::path& file, std::vector<ToolSpec> tools,
                                                 BackendKind backend, int threads, const TableProgress& progress) {
  return loadState(file, std::move(tools), {.backend = backend, .threads = threads}, progress);
}

AccessibilityField AccessibilityField::loadState(const std::filesystem::path& file, std::vector<ToolSpec> tools,
                                                 const FieldParams& place, const TableProgress& progress) {
  internal::StateReader state(file);
  return internal::FieldAccess::load(state, namedTools(std::move(tools)), place, progress);
}

void AccessibilityField::write(const std::filesystem::path& folder) const { writeField(*this, folder, {}); }

std::vector<SurfacePoint> internal::FieldAccess::takeChanged(AccessibilityField& field) {
  auto& impl = *field.impl_;
  if (!impl.changed_points) impl.changed_points = std::make_unique<ChangedPoints>(*impl.backend, impl.tools.size() > 1);
  if (impl.changed_points->comparesAll()) {
    impl.steps.requireWhole();  // values of all points are read from the host's map
  } else {
    impl.steps.requireUpdated();
  }
  return impl.arena.execute([&] { return impl.changed_points->take(impl); });
}

bool internal::FieldAccess::follow(AccessibilityField& field, bool wait) {
  auto& impl = *field.impl_;
  if (wait || impl.diverged()) impl.steps.settle();
  return impl.changed_points && impl.changed_points->madeAnew();
}

std::uint64_t internal::FieldAccess::heldBytes(const AccessibilityField& field, std::uint64_t exact_above) {
  auto& impl = *field.impl_;
  impl.steps.settleUpdate();
  if (impl.leads()) {
    const MapBytes map = impl.lead->mapBytes();
    const std::uint64_t others = totalBytes(impl.pointMemory());
    if (others + map.held + map.at_most_more <= exact_above) return others + map.held;
  }
  return totalBytes(field.memoryUse());
}

FrameStats internal::FieldAccess::integrateLocal(AccessibilityField& field, std::span<const Eigen::Vector3f> p_L,
                                                 std::span<const Eigen::Vector3f> q_L, double stamp_s,
                                                 std::span<const std::int32_t> attributes) {
  const GateScan gate = [&](FrameStats& stats) -> const GatedScan& {
    return field.impl_->gate.gateLocal(p_L, q_L, stats, attributes);
  };
  return internal::integrateScan(*field.impl_, gate, stamp_s);
}

void internal::FieldAccess::beginScan(AccessibilityField& field, const Returns& returns, const Returns& rays,
                                      double stamp_s) {
  const GateScan gate = [&](FrameStats& stats) -> const GatedScan& {
    return field.impl_->gate.gateLocal(returns.p_L, returns.q_L, stats, returns.attributes);
  };
  internal::beginScan(*field.impl_, gate, rays.p_L, rays.q_L, stamp_s);
}

FrameStats internal::FieldAccess::endScan(AccessibilityField& field, std::span<const OpenedLeaf> opened) {
  return internal::endScan(*field.impl_, opened);
}

void internal::FieldAccess::visitGoneCells(AccessibilityField& field,
                                           const std::function<void(GoneCells& cells)>& visit) {
  field.impl_->arena.execute([&] { visit(*field.impl_->gone_cells); });
}

std::optional<internal::FieldGpuUse> internal::FieldAccess::gpuUse(const AccessibilityField& field) {
  auto& impl = *field.impl_;
  impl.steps.settle();
  if (impl.backend->hasHostMemory()) return std::nullopt;
  return FieldGpuUse{impl.backend->heldBytes(), impl.backend->pinnedBytes() + impl.mirrors.hostBytes()};
}

bool internal::FieldAccess::rest(AccessibilityField& field) {
  try {
    return field.impl_->arena.execute([&] { return field.impl_->map.cold().rest(); });
  } catch (const std::bad_alloc&) {  // nothing is lost: it takes what it took
    return false;
  }
}

bool internal::FieldAccess::agesUntil(const AccessibilityField& field, double age_s) {
  const PackedMap& map = field.impl_->map;
  return map.agesFreeSpace() && map.generations()->isDue(map, age_s);
}

void internal::FieldAccess::advanceTime(AccessibilityField& field, std::optional<double> latest_s, double age_s) {
  internal::advanceTime(*field.impl_, latest_s, age_s);
}

AccessibilityField internal::FieldAccess::make(const std::vector<ToolSpec>& tools, const FieldParams& params,
                                               SharedTables& tables) {
  return {tools, params, {}, &tables};
}

AccessibilityField internal::FieldAccess::load(StateReader& state, const std::vector<ToolSpec>& tools,
                                               const FieldParams& place, const TableProgress& progress,
                                               SharedTables* tables) {
  if (state.head().tool_sha256 != toolListSha256(tools)) {
    throw UnusableInput("state.tool", state.file().string(),
                        state.head().tools.empty() && tools.size() == 1 ? "is the state of a field for another tool"
                                                                        : "is the state of a field for other tools",
                        "Use the tools that it was made with, in the same pose and order and with the same margins, "
                        "or start again");
  }
  FieldParams params = state.head().params;
  params.backend = place.backend;
  params.threads = place.threads;
  params.fuse_on_host = place.fuse_on_host;
  params.device_cache_bytes = place.device_cache_bytes;
  AccessibilityField field(tools, params, progress, tables);
  field.impl_->arena.execute([&] { restoreState(*field.impl_, state); });
  return field;
}

const internal::PointStore& internal::FieldAccess::points(const AccessibilityField& field) {
  field.impl_->steps.settle();
  return field.impl_->points;
}

const internal::PackedMap& internal::FieldAccess::map(const AccessibilityField& field) {
  field.impl_->steps.settle();
  return field.impl_->map;
}

internal::VoxelSet internal::FieldAccess::voxelsOf(const AccessibilityField& field, const Region& region) {
  requireRegions(*field.impl_);
  field.impl_->steps.requireWhole();
  return field.impl_->arena.execute([&] { return voxelsIn(*field.impl_, region); });
}

std::int32_t internal::FieldAccess::leavesRead(const AccessibilityField& field) {
  requireRegions(*field.impl_);
  field.impl_->steps.settle();
  const LeafFootprint& footprint = whatIfTables(*field.impl_).footprint;
  std::int32_t most = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    most = std::max({most, -footprint.low()[axis], footprint.high()[axis]});
  }
  return most + 1;  // weights are read around a point, too
}

WhatIf internal::FieldAccess::whatIf(const AccessibilityField& field, const VoxelSet& voxels) {
  return field.impl_->arena.execute([&] { return internal::whatIf(*field.impl_, voxels); });
}

internal::FieldCounts internal::FieldAccess::counts(const AccessibilityField& field) {
  field.impl_->steps.settle();
  const PackedMap& map = field.impl_->map;
  FieldCounts counts;
  counts.distance_leaves = map.allocated_leaf_count - map.cold().leaves() +
                           (map.cold().bytes() + map.cold().leaves() * kClearedLeafBytes) / kObservedLeafBytes;
  counts.cleared_leaves = map.leaf_count - map.allocated_leaf_count;
  counts.nodes = map.tree().nodeCount()[1];
  counts.points = field.impl_->points.size();
  counts.point_leaves = field.impl_->points.index().blocks().size();
  return counts;
}

}  // namespace accessvdb
