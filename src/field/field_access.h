// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What tiles and orders of cuts need from a field beyond its public functions.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/what_if.h"
#include "change/gone_cells.h"
#include "io/streams/whole_file.h"
#include "tsdf/removed_voxels.h"

namespace accessvdb::internal {

class PackedMap;
class PointStore;
class SharedTables;
class StateReader;

/// Exact counts of what the field holds so far.
struct FieldCounts {
  std::uint64_t distance_leaves = 0;  ///< leaves that hold distances; compact ones as plain ones of the same memory
  std::uint64_t cleared_leaves = 0;   ///< the others
  std::uint64_t nodes = 0;            ///< of 128^3 voxels, above the leaves
  std::uint64_t points = 0;
  std::uint64_t point_leaves = 0;  ///< leaves with a point
};

struct FieldGpuUse {
  std::uint64_t device_bytes = 0, host_bytes = 0;
};

struct FieldAccess {
  /// Fuses returns that passed a gate before (ScanGate), as it left them: in the local frame, metres, float32. Ranges
  /// are not checked again. @param q_L  [n] or [1] sensor positions  @param stamp_s, attributes  as for integrateScan()
  static FrameStats integrateLocal(AccessibilityField& field, std::span<const Eigen::Vector3f> p_L,
                                   std::span<const Eigen::Vector3f> q_L,
                                   double stamp_s = std::numeric_limits<double>::quiet_NaN(),
                                   std::span<const std::int32_t> attributes = {});
  /// What passed a gate before. p_L: [n], q_L: [n] or [1]
  struct Returns {
    std::span<const Eigen::Vector3f> p_L, q_L;
    std::span<const std::int32_t> attributes = {};  ///< as for integrateScan()
  };
  /// integrateLocal() of a tile of a map with ChangeMode::Full, in two parts: between them all tiles are asked what has
  /// gone, side by side (visitGoneCells).
  /// @param returns  maybe none  @param rays  all that come near the tile
  static void beginScan(AccessibilityField& field, const Returns& returns, const Returns& rays, double stamp_s);
  /// @param opened  by the rays, in all tiles
  static FrameStats endScan(AccessibilityField& field, std::span<const OpenedLeaf> opened);
  /// With the field's threads. Only for ChangeMode::Full.
  static void visitGoneCells(AccessibilityField& field, const std::function<void(GoneCells& cells)>& visit);
  /// Of a field that a step did not touch. @return whether it may take less memory now
  static bool rest(AccessibilityField& field);
  /// AccessibilityField::saveState(). @param write  makes the file
  static void saveState(const AccessibilityField& field, const std::filesystem::path& file, io::WriteFile write);
  /// Whether advanceTime() to this age may change anything.
  [[nodiscard]] static bool agesUntil(const AccessibilityField& field, double age_s);
  /// Of a tile: brings its time to that of the larger map (frame_loop.h).
  static void advanceTime(AccessibilityField& field, std::optional<double> latest_s, double age_s);
  /// A field whose memoryUse() is without the tables, which it shares with others. @param tables  must outlive it
  [[nodiscard]] static AccessibilityField make(const std::vector<ToolSpec>& tools, const FieldParams& params,
                                               SharedTables& tables);
  /// @param tools  named  @param place  where it runs, as for AccessibilityField::loadState()
  /// @param tables  as for make(), of tools with the state's parameters; null: its own
  /// @throws UnusableInput "state.tool" if the state is not of these tools
  [[nodiscard]] static AccessibilityField load(StateReader& state, const std::vector<ToolSpec>& tools,
                                               const FieldParams& place, const TableProgress& progress = {},
                                               SharedTables* tables = nullptr);
  [[nodiscard]] static const PointStore& points(const AccessibilityField& field);
  [[nodiscard]] static const PackedMap& map(const AccessibilityField& field);
  [[nodiscard]] static FieldCounts counts(const AccessibilityField& field);
  /// Points that are new, or whose label, reason, direction or tools changed, since the call before; the first call has
  /// all. By id; of a tile, those of its core. If it throws, the next call has them. Waits for an update, but not for
  /// the host's map where a device leads.
  [[nodiscard]] static std::vector<SurfacePoint> takeChanged(AccessibilityField& field);
  /// Makes the device again if the host's map turned out to be another one. @param wait  for the host's map
  /// @return whether states of points were made anew since takeChanged(), so that there may be something to tell
  [[nodiscard]] static bool follow(AccessibilityField& field, bool wait);
  /// All bytes of memoryUse(). Where a device leads it does not wait for the host's map, and counts what that has,
  /// unless with the scans on their way it may be more than `exact_above`.
  [[nodiscard]] static std::uint64_t heldBytes(const AccessibilityField& field, std::uint64_t exact_above);
  /// In place of what memoryUse() says of mirrors and points in the backend's memory: all that this field holds there,
  /// and on the host for it. Nothing on the CPU.
  [[nodiscard]] static std::optional<FieldGpuUse> gpuUse(const AccessibilityField& field);

  /// AccessibilityField::whatIf() in two steps. @throws as that
  [[nodiscard]] static VoxelSet voxelsOf(const AccessibilityField& field, const Region& region);
  [[nodiscard]] static WhatIf whatIf(const AccessibilityField& field, const VoxelSet& voxels);
  /// Leaves within which a point may depend on a voxel, along any axis.
  [[nodiscard]] static std::int32_t leavesRead(const AccessibilityField& field);
};

}  // namespace accessvdb::internal
