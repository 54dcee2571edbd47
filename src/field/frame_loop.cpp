// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/frame_loop.h"

#include <array>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "launch/stopwatch.h"
#include "update/run_beside.h"

namespace accessvdb::internal {
namespace {

/// @return where voxels are no longer free
std::vector<std::span<const LeafChange>> ageFreeSpace(FieldStages& field, double age_s) {
  field.steps.waitForMap();
  return field.map.generations()->passTo(field.map, age_s);
}

double ageAfter(const FieldStages& field, double passed_s) { return field.map.generations()->ageAfter(passed_s); }

/// @return where voxels of what has gone are opened
std::vector<LeafChange> open(FieldStages& field, std::span<const OpenedLeaf> opened,
                             std::span<const std::uint32_t> touched) {
  field.gone_points.noteReturns(touched);
  field.gone_points.noteOpened(field.points, opened, field.map_reads.weights);
  field.left_out.keepShut(opened);
  return openVoxels(field.map, opened);
}

/// The host's map has the scan in any case.
void joinUpdateOf(FieldStages& field, const GatedScan& scan) {
  try {
    field.steps.joinUpdate();
  } catch (...) {
    field.lead->takeOnHost(scan.p_L, scan.q_L, {scan.R_W_S, field.gate.origin_W()});
    throw;
  }
}

void countFused(const IntegrationResult& fused, FrameStats& stats) {
  stats.touched_leaves = fused.touched_leaves;
  stats.new_leaves = fused.new_leaves;
  stats.distance_updates = fused.counts.distance_updates;
  stats.cleared_updates = fused.counts.cleared_updates;
  stats.flipped_voxels = fused.counts.flipped_voxels;
  stats.contradicted_platforms = fused.contradicted_platforms;
}

/// What a device that leads did, without the changes, which it keeps.
IntegrationResult resultOf(const kernels::FusedScan& ahead) {
  IntegrationResult result;
  result.touched_leaves = ahead.touched_leaves;
  result.new_leaves = ahead.growth.leaves.size();
  result.counts = ahead.counts;
  return result;
}

/// @return where rays opened voxels of what has gone
std::vector<LeafChange> openWhatHasGone(FieldStages& field, const ScanUnderWay& under_way) {
  if (!field.gone_cells) return {};
  const std::vector<std::uint32_t>& touched = under_way.touched->all;
  return open(field, field.gone_cells->takeScan(under_way.scan->p_L, under_way.scan->q_L, touched), touched);
}

void fuseAhead(FieldStages& field, ScanUnderWay& under_way) {
  const GatedScan& scan = *under_way.scan;
  under_way.fused_ahead = true;
  under_way.ahead = field.lead->fuse(scan.p_L, scan.q_L, {scan.R_W_S, field.gate.origin_W()});
}

/// Gate > points beside bins > age, open, fuse beside the backend's first look at the points > scheduler beside
/// mirrors. Only time that is not hidden counts as integration. Where a device leads, it fuses into the mirror itself,
/// and the host's map gets the scan later.
///
/// An update may be running (updateLabelsAsync): sorting and binning the returns go on beside it, points and map wait
/// until it no longer reads them, and all that the backend or a mirror sees waits for its end.
/// @param passed_s  since the latest scan
void beginScan(FieldStages& field, ScanUnderWay& under_way, double passed_s) {
  const GatedScan& scan = *under_way.scan;
  const auto add_points = [&] {
    field.steps.waitForMap();
    const bool describes = field.scheduler->needs().deltas;
    field.points.describeTouched(describes);
    const GatedScan& placed = field.left_out.placed(scan, under_way.stats);
    under_way.placed = &placed;
    under_way.touched = &field.points.placeReturns(placed.p_L, placed.q_L);
    const auto index = [&] {
      field.points.indexNew();
      if (describes) field.scheduler->noteBlocks(under_way.touched->changed_blocks);
    };
    runBeside([&] { field.points.sumReturns(placed.p_L, placed.q_L, placed.attributes); }, index);
    field.points.endReturns();
  };
  // What is news is judged before free space ages.
  const auto bin_and_age = [&] {
    if (field.leads()) {
      field.lead->prepare(scan.p_L, scan.q_L);
      if (!field.steps.mayUpdate()) {  // nobody reads the mirror
        fuseAhead(field, under_way);
        if (under_way.ahead) field.scheduler->prepareFlips(field.mirrors.grid());
      }
    } else {
      field.integrator.bin(scan.p_L, scan.q_L);
    }
    if (field.map.agesFreeSpace()) under_way.changes.aged = ageFreeSpace(field, ageAfter(field, passed_s));
  };
  if (field.leads()) {
    runBeside(bin_and_age, add_points);  // a failure of the host must not be hidden by the device's
  } else {
    runBeside(add_points, bin_and_age);
  }
}

/// @param open  () -> where voxels of what has gone are opened
/// @return time taken to note what the scan changed in the map; counts as the update's
template <typename Open>
double endScan(FieldStages& field, ScanUnderWay& under_way, const Open& open) {
  UpdateScheduler& scheduler = *field.scheduler;
  const GatedScan &scan = *under_way.scan, &placed = *under_way.placed;
  MapChangesOfScan& changes = under_way.changes;
  FrameStats& stats = under_way.stats;
  const std::optional<kernels::FusedScan>& ahead = under_way.ahead;
  const auto note_points = [&] {
    field.steps.joinUpdate();
    scheduler.noteReturns(*under_way.touched, placed.p_L, placed.q_L);
  };
  const auto open_and_fuse = [&] {
    changes.opened = open();
    if (scheduler.needs().changes) {
      scheduler.noteEachList(changes.aged);
      for (const LeafChange& change : changes.opened) scheduler.noteChange(0, change);
    }
    if (field.leads() && !under_way.fused_ahead) fuseAhead(field, under_way);
    if (!ahead) changes.fused = field.integrator.integrate(scan.p_L, scan.q_L, {scan.R_W_S, field.gate.origin_W()});
  };
  if (field.leads() && !under_way.fused_ahead) joinUpdateOf(field, scan);  // the device writes the mirror
  runBeside(note_points, open_and_fuse);
  if (under_way.fused_ahead && !ahead) field.stopLeading();
  countFused(ahead ? resultOf(*ahead) : changes.fused, stats);
  field.left_out.note(changes.fused.left_out);

  const kernels::Stopwatch noting;
  scheduler.noteChanges(placed.p_L, placed.q_L, {changes.facts(), changes.fused.distances});
  const double noting_ms = noting.milliseconds();
  const auto mirror = [&] {
    if (ahead) {
      stats.changed_leaves = ahead->changed_leaves;
      stats.fused_on_device = true;
    } else if (!field.diverged()) {  // else it is made again
      field.mirrors.take(changes, stats);
    }
  };
  runBeside([&] { scheduler.prepare(field.mirrors.grid()); }, mirror);
  if (ahead && !field.lead->pays()) field.stopLeading();
  if (field.diverged()) makeDeviceAgain(field);
  return noting_ms;
}

/// Time passes without a return.
void passTime(FieldStages& field, double age_s, FrameStats& stats) {
  field.steps.joinUpdate();
  const std::vector<std::span<const LeafChange>> aged = ageFreeSpace(field, age_s);
  if (aged.empty()) return;
  field.scheduler->noteChangesAlone(aged);
  field.mirrors.takeFacts(aged, stats);
}

double takeScan(FieldStages& field, const GatedScan& scan, double passed_s, FrameStats& stats) {
  ScanUnderWay under_way;
  under_way.scan = &scan;
  under_way.stats = stats;
  beginScan(field, under_way, passed_s);
  const double noting_ms = endScan(field, under_way, [&] { return openWhatHasGone(field, under_way); });
  stats = under_way.stats;
  return noting_ms;
}

/// Rays without a return here may open voxels.
void openAlone(FieldStages& field, std::span<const OpenedLeaf> opened, FrameStats& stats) {
  MapChangesOfScan changes;
  changes.opened = open(field, opened, {});
  if (changes.opened.empty()) return;
  const std::array<std::span<const LeafChange>, 1> lists = {changes.opened};
  field.scheduler->noteChangesAlone(lists);
  field.mirrors.take(changes, stats);
}

UpdateStats update(FieldStages& field, const BackgroundUpdate::ReleaseMap& release_map) {
  publishWithheld(field);
  field.scheduler->whenMapIsReleased(release_map);
  const UpdateStats stats = field.scheduler->update(field.mirrors.grid(), field.budget_points);
  field.labels.backlog = stats.backlog;
  return stats;
}

}  // namespace

FrameStats integrateScan(FieldStages& field, const GateScan& gate, double stamp_s) {
  const kernels::Stopwatch all;
  FrameStats stats;
  double noting_ms = 0;
  field.steps.requireUnbroken();
  field.arena.execute([&] {
    const GatedScan& scan = gate(stats);
    const double passed_s = field.clock.note(stamp_s);
    if (!scan.p_L.empty()) {
      field.labels.current = false;
      field.steps.runBesideUpdate([&] { noting_ms = takeScan(field, scan, passed_s, stats); });
    } else if (passed_s > 0 && field.map.agesFreeSpace()) {
      field.labels.current = false;
      field.steps.runBesideUpdate([&] { passTime(field, ageAfter(field, passed_s), stats); });
    }
  });
  ++field.labels.scans;
  stats.surface_points = field.points.size();
  field.labels.noted_ms += noting_ms;
  stats.integrate_ms = all.milliseconds() - stats.mirror_ms - noting_ms;
  return stats;
}

void beginScan(FieldStages& field, const GateScan& gate, std::span<const Eigen::Vector3f> ray_p_L,
               std::span<const Eigen::Vector3f> ray_q_L, double stamp_s) {
  const kernels::Stopwatch all;
  ScanUnderWay& under_way = field.under_way.emplace();
  field.steps.requireUnbroken();
  field.arena.execute([&] {
    under_way.scan = &gate(under_way.stats);
    const double passed_s = field.clock.note(stamp_s);
    const bool any = !under_way.scan->p_L.empty();
    field.labels.current = false;
    field.steps.runBesideUpdate([&] {
      if (any) {
        beginScan(field, under_way, passed_s);
      } else if (passed_s > 0 && field.map.agesFreeSpace()) {
        passTime(field, ageAfter(field, passed_s), under_way.stats);
      }
      field.gone_cells->count(ray_p_L, ray_q_L, any ? under_way.touched->all : std::vector<std::uint32_t>());
    });
  });
  under_way.milliseconds = all.milliseconds();
}

FrameStats endScan(FieldStages& field, std::span<const OpenedLeaf> opened) {
  const kernels::Stopwatch all;
  ScanUnderWay& under_way = *field.under_way;
  FrameStats& stats = under_way.stats;
  double noting_ms = 0;
  field.steps.requireUnbroken();
  field.arena.execute([&] {
    field.steps.runBesideUpdate([&] {
      if (under_way.scan->p_L.empty()) {
        openAlone(field, opened, stats);
      } else {
        noting_ms = endScan(field, under_way, [&] { return open(field, opened, under_way.touched->all); });
      }
    });
  });
  ++field.labels.scans;
  stats.surface_points = field.points.size();
  field.labels.noted_ms += noting_ms;
  stats.integrate_ms = under_way.milliseconds + all.milliseconds() - stats.mirror_ms - noting_ms;
  const FrameStats of_scan = stats;
  field.under_way.reset();
  return of_scan;
}

void makeDeviceAgain(FieldStages& field) {
  // A device of which the memory fails again and again is of no use.
  constexpr int kMostTimes = 3;
  try {
    field.stopLeading();
    if (++field.times_made_again > kMostTimes || !field.map.leftOut().empty()) throwDiverged();
    field.chosen.note_id = "device.diverged";
    field.chosen.note = "the map on the GPU was no longer that on the host, so it was made again (" +
                        std::to_string(field.times_made_again) + " times so far)";
    const bool pays = field.lead->pays();
    field.views.expire();
    field.scoreAllAgain();
    field.lead.reset();
    field.mirrors.makeFactsAgain();
    if (pays) field.beginToLead();
    if (!field.labels.updated) return;
    publishWithheld(field);
    field.labels.backlog = field.scheduler->update(field.mirrors.grid(), 0).backlog;
    field.labels.current = true;
  } catch (const std::bad_alloc&) {  // the host's map is whole
    throwDiverged();
  }
}

void publishWithheld(FieldStages& field) {
  field.gone_points.publish();
  field.left_out_points.publish(field.points, field.map.leftOut(), field.gone_points.published(),
                                field.gate.origin_W());
}

void advanceTime(FieldStages& field, std::optional<double> latest_s, double age_s) {
  field.steps.requireUnbroken();
  field.clock = FieldClock(latest_s);
  if (!field.map.agesFreeSpace() || !(age_s > field.map.generations()->age_s())) return;
  field.labels.current = false;
  FrameStats ignored;
  field.arena.execute([&] { field.steps.runBesideUpdate([&] { passTime(field, age_s, ignored); }); });
}

UpdateStats updateLabels(FieldStages& field) {
  const kernels::Stopwatch all;
  UpdateStats stats = field.arena.execute([&] { return field.steps.runUpdate([&] { return update(field, {}); }); });
  field.labels.updated = field.labels.current = true;
  stats.update_ms = all.milliseconds() - stats.score_ms + std::exchange(field.labels.noted_ms, 0.0);
  return stats;
}

UpdateTicket updateLabelsAsync(FieldStages& field) {
  const double noting_ms = std::exchange(field.labels.noted_ms, 0.0);
  UpdateTicket ticket = field.steps.startUpdate([&field, noting_ms](const BackgroundUpdate::ReleaseMap& release_map) {
    const kernels::Stopwatch all;
    UpdateStats stats = field.background_arena.execute([&] { return update(field, release_map); });
    stats.update_ms = all.milliseconds() - stats.score_ms + noting_ms;
    return stats;
  });
  field.labels.updated = field.labels.current = true;
  return ticket;
}

}  // namespace accessvdb::internal
