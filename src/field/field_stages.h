// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The stages of a field, and how they are put together. What happens to them: frame_loop.h (scans and updates),
/// query/answers.h, regions/field_regions.h and state/field_state.h.
#pragma once

#include <tbb/task_arena.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/tsdf_volume.h"
#include "change/gone_cells.h"
#include "change/gone_points.h"
#include "field/backend_choice.h"
#include "field/field_clock.h"
#include "field/field_steps.h"
#include "field/leading_map.h"
#include "field/left_out_points.h"
#include "field/left_out_returns.h"
#include "field/mirrors.h"
#include "field/query/changed_points.h"
#include "field/query/field_views.h"
#include "field/query/pose_fits.h"
#include "field/regions/what_if.h"
#include "field/scan_gate.h"
#include "field/thread_count.h"
#include "field/tools/tools_of_field.h"
#include "tsdf/scan_integrator.h"
#include "update/scheduler.h"

namespace accessvdb::internal {

/// What was done so far, and how far the labels are behind the map.
struct LabelState {
  double noted_ms = 0;        ///< noting what scans since the last update changed in the map
  std::uint64_t scans = 0;    ///< integrated
  bool updated = false;       ///< at least once
  bool current = false;       ///< an update came after the last change of the map
  std::uint64_t backlog = 0;  ///< points that the last update left; one that runs may write it
};

/// A scan whose returns are among the points, and not yet in the map.
struct ScanUnderWay {
  const GatedScan* scan = nullptr;
  const GatedScan* placed = nullptr;       ///< what of it can become points
  const TouchedPoints* touched = nullptr;  ///< by it
  MapChangesOfScan changes;
  bool fused_ahead = false;                 ///< by a device that leads, or it had no room for it
  std::optional<kernels::FusedScan> ahead;  ///< what it did
  FrameStats stats;
  double milliseconds = 0;  ///< so far
};

struct FieldStages {
  /// @param specs  named, at least one  @param resolved  for the first of them  @param tables  of several fields, or
  /// null
  FieldStages(std::vector<ToolSpec> specs, const FieldParams& resolved, ChosenBackend chosen_backend,
              const TableProgress& progress, SharedTables* tables);

  [[nodiscard]] bool leads() const { return lead && lead->leads(); }
  /// LeadingMap::diverged(): makeDeviceAgain() must follow.
  [[nodiscard]] bool diverged() const { return lead && lead->diverged(); }
  /// Call before values of the map or the mirror are changed by others than scans: from then on the host fuses first.
  void stopLeading();
  /// After stopLeading(), once the host has changed the map: the device leads again if it may and has room. It knows
  /// nothing of voxels that were left out.
  void leadAgain();
  /// The same of a device that holds nothing of the map yet.
  void beginToLead();
  /// Forgets the state of all points.
  void scoreAllAgain();

  /// Waits for the update and for the host's map, which still need all members.
  ~FieldStages() { steps.wait(); }
  FieldStages(const FieldStages&) = delete;
  FieldStages& operator=(const FieldStages&) = delete;

  /// AccessibilityField::memoryUse(), without the map and its mirror of facts.
  [[nodiscard]] MemoryUse pointMemory() const;

  /// Of a tile, whose other points are not the user's.
  [[nodiscard]] std::optional<VoxelColumnBox> core() const;
  /// Points that are unscored whatever their state says; by id.
  [[nodiscard]] std::span<const std::uint8_t> withheld() const {
    return left_out_points.withheld(gone_points.published());
  }

  FieldParams params;  ///< resolved, for the first tool
  tbb::task_arena arena;
  tbb::task_arena background_arena;  ///< of updateAsync(): a scan that waits for it may fill the other
  ChosenBackend chosen;
  kernels::Backend* backend;
  TsdfVolume volume;
  PackedMap& map;
  ScanIntegrator integrator;
  Mirrors mirrors;
  GonePoints gone_points;
  std::unique_ptr<LeadingMap> lead;  ///< null: the host fuses first
  int times_made_again = 0;          ///< makeDeviceAgain()
  ToolsOfField tools;
  PointStore& points;  ///< the first tool's, to which the frame loop adds returns
  MapReads map_reads;  ///< what points see of the map; where something has gone, see the tools' reads
  std::unique_ptr<GoneCells> gone_cells;  ///< only for ChangeMode::Full
  LeftOutPoints left_out_points;
  ScanGate gate;
  LeftOutReturns left_out;
  FieldClock clock;
  std::unique_ptr<UpdateScheduler> scheduler;
  int budget_points;  ///< of the next update
  FieldViews views;
  PoseFits pose_fits;
  LabelState labels;
  std::unique_ptr<ChangedPoints> changed_points;  ///< made when first asked for
  std::optional<ScanUnderWay> under_way;          ///< between beginScan() and endScan()
  std::unique_ptr<WhatIfTables> what_if_tables;   ///< made when first needed
  FieldSteps steps;  ///< the last member: destroyed first, it waits for an update of the others

 private:
  [[nodiscard]] std::unique_ptr<LeadingMap> makeLead();
};

}  // namespace accessvdb::internal
