// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The accessibility field: scans go in, labelled surface points come out.
///
/// Not thread-safe: call it from one thread at a time. Internally it uses all threads of the machine, and the result is
/// bit for bit the same for any number of them.
///
/// While an updateAsync() runs, every call waits for its end, except integrateScan() and integrateRays(), which wait
/// only where they would change what it reads, and those that read what never changes (tool(), params(), deviceName(),
/// ...).
///
/// When a step fails half-way (out of memory, a map beyond its limits, a lost GPU), the field stops answering: every
/// later call throws ResourceLimit "field.broken", except volume(), unscoredSnapshot() and unscoredPoints(), which live
/// on the host. Bad scans and poses are refused before anything changes.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/table_progress.h"
#include "accessvdb/tool_geometry.h"
#include "accessvdb/types.h"
#include "accessvdb/update_ticket.h"

namespace accessvdb {

class BatchQuery;
class PoseQuery;
class Region;
class SurfacePoints;
enum class RemovedAs : std::uint8_t;
struct Removal;
struct WhatIf;
struct AccessMap;
class TsdfVolume;
struct DeviceView;
struct ToolSpec;
namespace internal {
struct FieldAccess;
class SharedTables;
}  // namespace internal

class ACCESSVDB_API AccessibilityField {
 public:
  /// @throws InvalidArgument (params), ResourceLimit (tool too large for the voxel size), DeviceError
  AccessibilityField(const ToolGeometry& tool, const FieldParams& params = {});
  /// Several tools over one map: each point says which of them reach it (docs/tools.md), and each tool's result is that
  /// of a field with it alone. Include tool_spec.h. @param params  for all; orientations, rolls and max_collisions are
  /// each tool's own  @param progress  of the tools' tables (table_progress.h)
  /// @throws InvalidArgument "tool.count", "tool.name", "tool.policy" (the paper's policy knows one tool)
  explicit AccessibilityField(std::vector<ToolSpec> tools, const FieldParams& params = {},
                              const TableProgress& progress = {});
  ~AccessibilityField();
  AccessibilityField(AccessibilityField&&) noexcept;
  AccessibilityField& operator=(AccessibilityField&&) noexcept;

  /// Fuses one scan. Bad returns are counted, never used.
  /// @param points_S  returns in the sensor frame, metres; exactly (0,0,0) means "no return"
  /// @param T_W_S     pose, sensor to world, rigid
  /// @throws UnusableInput for a pose that is not finite or not rigid; nothing has changed then
  FrameStats integrateScan(std::span<const Eigen::Vector3f> points_S, const Eigen::Isometry3d& T_W_S);
  /// @param stamp_s  time of the scan's first return, seconds of any clock. A number that is not finite counts as
  ///                 missing; in place of one that is earlier than the latest so far, the latest is used.
  /// @param attributes  what the returns carry: a row for each, with as many values as FieldParams::carry names, or
  ///                     kNoAttribute; empty: nothing  @throws InvalidArgument "carry.sizes"
  FrameStats integrateScan(std::span<const Eigen::Vector3f> points_S, const Eigen::Isometry3d& T_W_S, double stamp_s,
                           std::span<const std::int32_t> attributes = {});

  /// Fuses rays that each have their own origin (ray clouds), or one origin for all.
  /// @param points_W   [n] returns in the world frame
  /// @param origins_W  [n] or [1] sensor positions in the world frame
  FrameStats integrateRays(std::span<const Eigen::Vector3d> points_W, std::span<const Eigen::Vector3d> origins_W);
  FrameStats integrateRays(std::span<const Eigen::Vector3d> points_W, std::span<const Eigen::Vector3d> origins_W,
                           double stamp_s, std::span<const std::int32_t> attributes = {});
  /// From now on the map gets no leaf and no leaf gets values. Where a return would need some, it is left out, and
  /// the voxels that it would have changed block: they collide and are not free for an arm, and points whose neighbours
  /// may lie there are unscored with reason `confidence`. What the map has a place for is fused as if it grew. So at
  /// every moment the accessible points are among those of a field that grows. Part of a saved state is what was left
  /// out, not that the map stopped growing.
  /// @param most_left_out_leaves  leaves of 8^3 voxels in which single voxels are kept, 350 bytes each with their share
  /// of
  ///                              the mirror; beyond, all points near them are unscored
  /// @throws InvalidArgument "projective.limit" with projective fusion
  void stopGrowing(std::size_t most_left_out_leaves = std::size_t{1} << 17);
  [[nodiscard]] bool grows() const;
  /// Returns that this field will never get, although there were some, lay at most so far from these positions: from
  /// the next update() on, points whose labels may depend on them are unscored with reason `confidence`, for good.
  /// @param radius_m  0 .. 1e6  @throws InvalidArgument "left_out.radius"
  void leaveOut(std::span<const Eigen::Vector3d> centres_W, double radius_m);

  /// The field's time: the latest stamp of a scan. It never runs backwards, and is no clock of this machine: the same
  /// input gives the same bytes at any time. Nothing while no scan had a stamp.
  [[nodiscard]] std::optional<double> latestStamp_s() const;

  /// Scores what changed since the last update().
  UpdateStats update();
  /// The budget of the updates from now on, in place of UpdateParams::budget_points: most points that each scores, for
  /// each tool; 0: no limit, and the next one scores all that wait. Points that wait are unscored, with reason
  /// Confidence, whatever they were before. The same calls with the same budgets give the same
  /// bits on one backend. Not in params() and saved states.
  /// @param points  0 .. 2e9  @throws InvalidArgument "config.range"
  void setBudgetPoints(int points);
  /// The same update, with the same bits, on a thread of its own: returns at once, or after an earlier one. The next
  /// scan may be fused meanwhile, so that a stream of scans gets through at the rate of the slower of the two:
  ///     UpdateTicket ticket;
  ///     for (const Scan& scan : scans) {
  ///       field.integrateScan(scan.points_S, scan.T_W_S);  // beside the update of the scan before
  ///       ticket = field.updateAsync();
  ///     }
  ///     ticket.wait();
  /// Its errors come from UpdateTicket::wait(); other calls then throw "field.broken".
  /// @throws ResourceLimit "field.broken" after an earlier failure
  [[nodiscard]] UpdateTicket updateAsync();

  /// Takes out of the map what lies in a region: a person says that it was cut, or has gone (region.h). Voxels of
  /// RemovedAs::Unknown, the default, keep blocking until a scan sees through them; those of Free are free at once, and
  /// their points unscored with reason `changed`. All points are unscored until the next update(), which scores all.
  /// @throws UnusableInput "region.outside" (the map has observed nothing there), "region.ids" (no such points)
  /// @throws InvalidArgument "region.unsupported" (a tile of a larger map, the paper's policy, projective fusion)
  Removal removeRegion(const Region& region, RemovedAs as = RemovedAs{});
  /// Which points would open if all that lies in the regions went (as RemovedAs::Free), without changing the map:
  /// exactly those that removeRegion() and update() would open. Labels must be up to date: update() has left no
  /// backlog. Ends the validity of views and queries, as an update does; see what_if.h. @throws as removeRegion()
  [[nodiscard]] WhatIf whatIf(std::span<const Region> regions) const;

  /// All points with their labels, as of the last update(). Points that came later are unscored.
  [[nodiscard]] FieldSnapshot snapshot() const;
  /// The same points as a field with one of the tools alone would have them.
  /// @throws InvalidArgument "tool.index"
  [[nodiscard]] FieldSnapshot toolSnapshot(std::size_t tool) const;
  /// The same points as the host alone knows them: position and weight, all unscored. Needs no device, so it can still
  /// be saved after one was lost or ran out of memory. @throws ResourceLimit "field.broken" after other failures
  [[nodiscard]] FieldSnapshot unscoredSnapshot() const;
  /// The points of snapshot() and unscoredSnapshot() in less memory: 24 bytes per point, or 2, instead of 112. They
  /// read from this field: use them before the next call that changes it. @throws as those do
  [[nodiscard]] std::unique_ptr<const SurfacePoints> points() const;
  [[nodiscard]] std::unique_ptr<const SurfacePoints> unscoredPoints() const;

  /// The same points scored again from scratch against the current map: every direction, no history. `exact` must equal
  /// it. Costs a full evaluation and changes nothing. @param tests  receives the number of (point, direction) tests
  [[nodiscard]] FieldSnapshot evaluateFromScratch(std::uint64_t* tests = nullptr) const;

  /// What the returns in that voxel carried, in the order of FieldParams::carry; empty if there is no point.
  [[nodiscard]] std::vector<std::int32_t> attributesAt(const Eigen::Vector3d& p_W) const;

  /// The point in the voxel that contains p_W, if any.
  [[nodiscard]] std::optional<SurfacePoint> pointAt(const Eigen::Vector3d& p_W) const;

  /// Why that point is as it is: every orientation tried by itself against the current map, see access_map.h. Changes
  /// nothing. Takes milliseconds and, for the time being, as much memory as the state of all points.
  /// @throws InvalidArgument "tool.index"
  [[nodiscard]] std::optional<AccessMap> accessMap(const Eigen::Vector3d& p_W, std::size_t tool = 0) const;

  /// The same for many points, by id, in about the time of scoring them in every direction. @param ids  each once
  /// @throws InvalidArgument "tool.index", "point.id" (no such point, or twice)
  [[nodiscard]] std::vector<AccessMap> accessMaps(std::span<const std::uint32_t> ids, std::size_t tool = 0) const;
  /// How far the tool can turn from its best direction at each point and stay free: the width, degrees, of the run of
  /// free directions around it, among those of the same pitch. Over a sphere, the opening angle of a cone that is as
  /// large as all free directions that hang together with it. -1: the tool does not reach the point, or its
  /// orientations are a list. @throws as accessMaps()
  [[nodiscard]] std::vector<float> freeArcs_deg(std::span<const std::uint32_t> ids, std::size_t tool = 0) const;

  /// Batched queries, at points or along a robot arm: see batch_query.h. Valid until the field next changes.
  [[nodiscard]] BatchQuery batchQuery() const;

  /// The field's tools at any pose: see pose_query.h. Valid until the field next changes.
  [[nodiscard]] PoseQuery poseQuery() const;

  /// The map's mirror and the points in GPU memory, for your own kernels: see device_view.h. Everything in it is
  /// complete when this returns; valid until the field next changes. @throws DeviceError "device.none" on the CPU
  [[nodiscard]] DeviceView deviceView() const;
  /// The same for a field on the CPU, in host memory. @throws DeviceError "device.not_host" on a GPU
  [[nodiscard]] DeviceView hostView() const;

  /// Grows with every call that changes the field: a view with a different number is out of date.
  [[nodiscard]] std::uint64_t revision() const;

  [[nodiscard]] const TsdfVolume& volume() const;
  [[nodiscard]] const ToolGeometry& tool() const;            ///< of several the first, as all that takes no tool
  [[nodiscard]] const std::vector<ToolSpec>& tools() const;  ///< at least one; named
  [[nodiscard]] const FieldParams& params() const;           ///< resolved
  [[nodiscard]] Eigen::Vector3d origin_W() const;            ///< of the local frame; set by the first scan
  [[nodiscard]] MemoryUse memoryUse() const;
  [[nodiscard]] std::string deviceName() const;  ///< "cpu" or "cuda:NAME"
  [[nodiscard]] std::string deviceNote() const;  ///< why Auto is not on a GPU, or that its map was made again; or empty
  /// The id behind that note, as of an Error: "device.no_driver", "device.not_built", "device.diverged" (made again)
  [[nodiscard]] std::string deviceNoteId() const;
  [[nodiscard]] double toolShareHidden() const;  ///< inside the self-exclusion; of all tools and turns
  /// [n_c] Fewest collisions that block a direction. @throws InvalidArgument "tool.index"
  [[nodiscard]] int collisionLimit(std::size_t tool = 0) const;

  /// Writes all that later scans and updates depend on into one file, whole or not at all; loadState() goes on from it.
  /// Takes a few MB of memory. See docs/design/state.md, "Saved state".
  /// @throws InvalidArgument "usage.checkpoint" (the paper's update policy, projective fusion), OutputError
  void saveState(const std::filesystem::path& file) const;
  /// A field that goes on where the saved one was. If that one had not been updated, everything that follows has the
  /// same bits as without the stop, on any backend. If it had, labels, and score and direction of accessible points,
  /// are those of the whole map ever after; stability and the reasons of blocked points may be others than without the
  /// stop. A state that was saved on the processor right after an update has all that this found out, and another field
  /// there takes it over; otherwise this runs a full update().
  /// @param tool  the one of the saved field
  /// @throws InputError "state.format" (not a state), "state.damaged" (naming the section)
  /// @throws UnusableInput "state.rules" (another program's rules made it), "state.tool" (it is of another tool)
  /// @throws as the constructor
  [[nodiscard]] static AccessibilityField loadState(const std::filesystem::path& file, const ToolGeometry& tool,
                                                    BackendKind backend = BackendKind::Auto, int threads = 0);

  /// The same for several tools, with the orientations and limits that they had.
  [[nodiscard]] static AccessibilityField loadState(const std::filesystem::path& file, std::vector<ToolSpec> tools,
                                                    BackendKind backend = BackendKind::Auto, int threads = 0,
                                                    const TableProgress& progress = {});
  /// The same. @param place  its backend, threads, fuse_on_host and device_cache_bytes say where the field runs; all
  ///                         other parameters are the saved field's
  [[nodiscard]] static AccessibilityField loadState(const std::filesystem::path& file, std::vector<ToolSpec> tools,
                                                    const FieldParams& place, const TableProgress& progress = {});

  /// Writes field.vdb, field_points.vdb and points.ply into a folder, each whole or not at all.
  /// @throws OutputError
  void write(const std::filesystem::path& folder) const;

 private:
  friend struct internal::FieldAccess;
  struct Impl;
  AccessibilityField(std::vector<ToolSpec> tools, const FieldParams& params, const TableProgress& progress,
                     internal::SharedTables* tables);
  std::unique_ptr<Impl> impl_;
};

}  // namespace accessvdb
