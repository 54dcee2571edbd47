// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/field_stages.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "field/frame_loop.h"
#include "field/new_thing_margin.h"
#include "field/point_weights.h"

namespace accessvdb::internal {
namespace {

PackedMap& prepared(TsdfVolume& volume, const FieldParams& params) {
  PackedMap& map = volume.packed();
  map.setCollisionDistance(static_cast<float>(params.scoring.collision_distance_m));
  if (params.change.mode != ChangeMode::Off) map.blockNewThings(static_cast<float>(farFromSurfaces_m(params)));
  if (std::isfinite(params.change.free_for_s)) map.ageFreeSpace(params.change.free_for_s);
  return map;
}

std::optional<VoxelColumnBox> returnsInWindow(const FieldParams& params, const WindowMargins& reach) {
  if (!params.window) return std::nullopt;
  return returnsOf(*params.window, reach);
}

}  // namespace

FieldStages::FieldStages(std::vector<ToolSpec> specs, const FieldParams& resolved, ChosenBackend chosen_backend,
                         const TableProgress& progress, SharedTables* tables)
    : params(resolved),
      arena(makeArena(params.threads)),
      background_arena(makeArena(params.threads)),
      chosen(std::move(chosen_backend)),
      backend(chosen.backend.get()),
      volume(params.tsdf),
      map(prepared(volume, params)),
      integrator(map),
      mirrors(*backend, map, params),
      tools(std::move(specs), params,
            {map, *backend, core(), params.change.mode == ChangeMode::Full ? &gone_points : nullptr, tables, &lead},
            progress),
      points(*tools.front().points),
      map_reads(makeMapReads(map, points, params.scoring.neighbourhood_weight, core())),
      gone_cells(params.change.mode == ChangeMode::Full ? std::make_unique<GoneCells>(map, points, params.tsdf, core())
                                                        : nullptr),
      left_out_points(tools.margins(), params),
      gate(params.tsdf, params.origin_W, returnsInWindow(params, tools.margins()), params.carry.size()),
      left_out(map, points, gate, left_out_points),
      scheduler(tools.makeScheduler()),
      budget_points(resolved.update.budget_points),
      steps(views) {
  points.carry(params.carry);
  static_assert(ScanIntegrator::kLists <= UpdateScheduler::kMostLists);
  static_assert(FreeGenerations::kLists <= UpdateScheduler::kMostLists);
  integrator.noteDistances(mirrors.mirrorsDistances() || scheduler->needs().distances);
  if (!scheduler->needs().changes) return;
  lead = makeLead();
  integrator.visitChanges([this](std::size_t part, const LeafChange& change) {
    if (!lead || !lead->leads()) scheduler->noteChange(part, change);
  });
  steps.catchUpBy(
      [this] {
        if (lead) lead->catchUp();
      },
      [this] {
        if (diverged()) arena.execute([this] { makeDeviceAgain(*this); });
      });
}

std::unique_ptr<LeadingMap> FieldStages::makeLead() {
  if (params.fuse_on_host || !LeadingMap::mayLead(params) || !scheduler->takesFlipsOnDevice()) return nullptr;
  const RegionShape shape(params.tsdf);
  kernels::FusionSetting setting;
  setting.region = shape;
  setting.constants = kernelConstants(map, shape);
  setting.news = map.newsRule();
  setting.votes = map.blocksNewThings();
  setting.cache_bytes = std::min(params.device_cache_bytes, backend->freeBytes() / 2);
  std::unique_ptr<kernels::ScanFuser> fuser = backend->makeScanFuser(setting, mirrors.grid());
  if (!fuser) return nullptr;
  kernels::ScanFuser* const flips_of = fuser.get();
  auto made = std::make_unique<LeadingMap>(std::move(fuser), map, integrator, mirrors.facts(), params);
  scheduler->takeFlipsOf(flips_of);
  return made;
}

void FieldStages::stopLeading() {
  if (!lead) return;
  if (lead->leads()) lead->stop();
  // Without a device that works the field is lost, and what flipped there with it.
  scheduler->takeFlipsOf(nullptr);
  lead->forgetDevice();
}

void FieldStages::leadAgain() {
  if (lead) beginToLead();
}

void FieldStages::beginToLead() {
  if (!map.grows() || !map.leftOut().empty()) return;
  lead.reset();
  try {
    lead = makeLead();
  } catch (const ResourceLimit&) {  // then the host fuses
  }
}

void FieldStages::scoreAllAgain() {
  scheduler.reset();
  tools.forget();
  scheduler = tools.makeScheduler();
  scheduler->noteRestored();
  labels.current = false;
  if (changed_points) changed_points->compareAll();
}

MemoryUse FieldStages::pointMemory() const {
  MemoryUse use;
  use.distance_mirror_bytes = mirrors.distanceBytes();
  use.point_host_bytes =
      tools.hostBytes() + views.bytes() + gate.bytes() + gone_points.bytes() + left_out_points.bytes();
  if (gone_cells) use.point_host_bytes += gone_cells->bytes();
  use.point_device_bytes = tools.deviceBytes();
  // A device that fails while removeRegion() makes it again leaves a field without it.
  if (scheduler) {
    use.point_host_bytes += scheduler->bytes();
    use.point_device_bytes += scheduler->deviceBytes();
  }
  if (lead) use.point_device_bytes += lead->deviceBytes();
  if (changed_points) {
    use.point_host_bytes += changed_points->hostBytes();
    use.point_device_bytes += changed_points->deviceBytes();
  }
  return use;
}

std::optional<VoxelColumnBox> FieldStages::core() const {
  if (!params.window) return std::nullopt;
  return coreOf(*params.window);
}

}  // namespace accessvdb::internal
