// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The field as your own CUDA kernel sees it: a small struct passed by value. Compiles with nvcc and with any
/// C++20 compiler; needs NanoVDB's header and nothing else of AccessVDB's dependencies.
///
///   accessvdb::DeviceView view = field.deviceView();       // host
///   myKernel<<<blocks, threads, 0, stream>>>(view, ...);   // inside: view.occupancyAt(p_W)
///   cudaStreamSynchronize(stream);                         // before the field changes again
///   field.integrateScan(...);
///
/// Order    Everything that the view shows is complete when deviceView() returns, so any stream may read it at once.
///          The field does not know your streams: wait for your kernels before the next integrateScan(),
///          integrateRays() or update(), and before the field is destroyed. A kernel still running then reads a
///          half-changed map.
/// Validity The view belongs to one revision of the field. Those three calls end it: addresses of points may have
///          moved, so take a new view; it costs microseconds. Check `view.revision == field.revision()`.
/// Place    `on_gpu` says whose memory it is. AccessibilityField::deviceView() gives device memory only, hostView()
///          host memory only; the functions below run the same code on both.
/// Reading  Nothing may be written through it, and the grid must not go to NanoVDB's NodeManager, HDDA or statistics:
///          it is live, and patched in place.
/// Rounding The library compiles with --fmad=false; without it, positions within a rounding error of a voxel's face may
///          fall on the other side in your kernel.
#pragma once

#include <cstdint>
#include <type_traits>

#include "accessvdb/device/distance_query.h"
#include "accessvdb/device/occupancy_path.h"
#include "accessvdb/device/tool_fit.h"
#include "accessvdb/point_label.h"

namespace accessvdb {

using kernels::Occupancy;
using kernels::PathOccupancy;
using kernels::ToolBitmapView;
using kernels::ToolFit;

/// The surface points as of the last update(); index = SurfacePoint::id. Points added since are not here yet. Of
/// several tools, the state of the one that stands for each point (SurfacePoint::tool), with directions counted through
/// all tools in their order; DeviceView::axes_xyz and num_directions are then those of all. Such a view is put together
/// on the host when it is first taken after a change.
struct DevicePoints {
  /// [3 n] x y z, metres, local frame: world minus DeviceView::origin_W. Not set where the weight is 0.
  const float* position_L = nullptr;
  const float* normal_L = nullptr;           ///< [3 n] unit; zero where there is none
  const float* stability = nullptr;          ///< [n] in [0, 1]
  const std::uint16_t* score = nullptr;      ///< [n] fewest collisions of any direction; kNoScore
  const std::uint16_t* direction = nullptr;  ///< [n] best direction; kNoDirection
  const std::uint16_t* weight = nullptr;     ///< [n] observations behind the confidence; 0: not here yet
  const PointLabel* label = nullptr;         ///< [n]
  const PointReason* reason = nullptr;       ///< [n]
  std::uint32_t count = 0;                   ///< [n]
  const std::uint8_t* roll = nullptr;        ///< [n] best roll in that direction; null if the tool does not roll
};

struct DeviceView {
  kernels::OccupancyView map;           ///< the NanoVDB mirror: value bit = collides, active bit = free for the arm
  DevicePoints points;                  ///< label, reason, direction, ... of every surface point
  const float* direction_xy = nullptr;  ///< [2 D] cosine and sine of yaw 2 pi d / D; null for other orientation sets
  const float* axes_xyz = nullptr;      ///< [3 D] unit, x y z, of other orientation sets; null for yaw
  int num_directions = 0;               ///< [D]
  float voxel_size_m = 0;
  double origin_W[3] = {0, 0, 0};  ///< world position of the local origin
  std::uint64_t revision = 0;      ///< the field's, when this view was made
  bool on_gpu = false;
  /// Whether the field keeps a mirror of its distances (FieldParams::mirror_distance). Without one, every distance
  /// below is NaN; on the host, use BatchQuery.
  bool distance_available = false;
  /// That mirror, a NanoGrid<float> in index space of the local frame: metres, active = observed, background tau. If
  /// you read it yourself: a voxel that is not active was never observed, whatever its value says.
  kernels::DistanceView distance;

  /// The voxel at a world position. NaN and positions too far out are unknown.
  ACCESSVDB_HOSTDEV Occupancy occupancyAt(const double* p_W) const {
    const double p_L[3] = {p_W[0] - origin_W[0], p_W[1] - origin_W[1], p_W[2] - origin_W[2]};
    return kernels::occupancyAt(map, p_L);
  }
  /// The tool hits something there: observed, and closer than r_c to a surface. Unknown does not collide, so a false
  /// here does not mean free: see armFree().
  ACCESSVDB_HOSTDEV bool collides(const double* p_W) const { return occupancyAt(p_W) == Occupancy::Collides; }
  /// Seen to be free: observed and r_c or more from a surface, or cleared by a ray. Unknown is not free.
  ACCESSVDB_HOSTDEV bool armFree(const double* p_W) const { return occupancyAt(p_W) == Occupancy::Free; }

  /// Distance to the nearest surface as the map stores it, metres, of the voxel at a world position. It is a mean of
  /// distances along rays, clamped to [clamp_min_m, tau], so beyond tau it only says "tau or farther".
  /// NaN where the voxel was never observed, without a mirror of distances, and for NaN and positions too far out.
  /// Every comparison with NaN is false: write `distanceAt(p) >= r` for free, never `!(distanceAt(p) < r)`.
  ACCESSVDB_HOSTDEV float distanceAt(const double* p_W) const {
    const double p_L[3] = {p_W[0] - origin_W[0], p_W[1] - origin_W[1], p_W[2] - origin_W[2]};
    return kernels::distanceAt(distance, p_L);
  }
  /// Trilinear between the centres of the eight surrounding voxels. NaN as above, and where any of the eight was never
  /// observed: the edge of the known space is not a distance.
  ACCESSVDB_HOSTDEV float distanceInterpolatedAt(const double* p_W) const {
    const double p_L[3] = {p_W[0] - origin_W[0], p_W[1] - origin_W[1], p_W[2] - origin_W[2]};
    return kernels::distanceInterpolatedAt(distance, p_L);
  }

  /// A link of a robot arm, or the path it sweeps: the segment a_W b_W with a radius. Every voxel is examined whose
  /// centre is within radius_m + half a voxel's diagonal of the axis, so no voxel that the capsule enters is missed.
  ACCESSVDB_HOSTDEV PathOccupancy along(const double* a_W, const double* b_W, double radius_m) const {
    const double a_L[3] = {a_W[0] - origin_W[0], a_W[1] - origin_W[1], a_W[2] - origin_W[2]};
    const double b_L[3] = {b_W[0] - origin_W[0], b_W[1] - origin_W[1], b_W[2] - origin_W[2]};
    return kernels::occupancyAlong(map, a_L, b_L, radius_m);
  }

  /// A tool at a pose, as PoseQuery::fits() without contact. @param tool  PoseQuery::toolView()
  /// @param R_WT  [9] rotation, world from tool, column by column  @param tip_W  metres
  ACCESSVDB_HOSTDEV ToolFit fits(const ToolBitmapView& tool, const double* R_WT, const double* tip_W) const {
    const double tip_L[3] = {tip_W[0] - origin_W[0], tip_W[1] - origin_W[1], tip_W[2] - origin_W[2]};
    kernels::ToolPlace place;
    return kernels::makeToolPlace(R_WT, tip_L, map.inverse_voxel_size, place) ? kernels::toolFit(map, tool, place)
                                                                              : ToolFit{};
  }

  /// @param id  below points.count    @param p_W  out: metres, world
  /// @return false: it was never scored, so its position is not here. Of a point that only waits for that it is
  ACCESSVDB_HOSTDEV bool positionOf(std::uint32_t id, double* p_W) const {
    if (points.weight[id] == 0) return false;
    for (int axis = 0; axis < 3; ++axis) p_W[axis] = origin_W[axis] + points.position_L[3 * std::size_t(id) + axis];
    return true;
  }
  /// Unit, outwards along the tool's body. @return false: the point has no best direction
  ACCESSVDB_HOSTDEV bool directionOf(std::uint32_t id, float* direction_W) const {
    const int d = points.direction[id];
    const bool has = d < num_directions;
    const bool level = axes_xyz == nullptr;
    direction_W[0] = !has ? 0.0f : level ? direction_xy[2 * d] : axes_xyz[3 * d];
    direction_W[1] = !has ? 0.0f : level ? direction_xy[2 * d + 1] : axes_xyz[3 * d + 1];
    direction_W[2] = !has || level ? 0.0f : axes_xyz[3 * d + 2];
    return has;
  }
};
static_assert(std::is_trivially_copyable_v<DeviceView>);

}  // namespace accessvdb
