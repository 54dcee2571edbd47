// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parameters, one struct per stage. Where marked "rule", a value of 0 means: derived by resolved() from the others.
/// The paper's symbols are in brackets. Lengths are metres, angles radians.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/attributes.h"
#include "accessvdb/export.h"
#include "accessvdb/field_window.h"
#include "accessvdb/orientations.h"

namespace accessvdb {

enum class Profile { Product, Paper };     ///< the two columns of docs/PAPER_MAP.md, "Two profiles"
enum class UpdatePolicy { Exact, Paper };  ///< how points to be scored again are chosen
/// What follows when the world changes (docs/design/change.md, "A world that changes").
///   Off    the world is still: a thing that appears near old surfaces, or where it was free for long, blocks slowly
///   Block  new things block within a few scans, whatever was measured there before
///   Full   what is gone opens by evidence, too, and free space ages (ChangeParams::free_for_s)
enum class ChangeMode { Off, Block, Full };
enum class BackendKind { Auto, Cpu, Cuda };  ///< where scoring runs
/// Which voxels a return updates; Projective is a baseline for evaluation, see ProjectiveParams.
enum class UpdateRegion { DoubleCone, FullCube, Projective };
enum class ToolForm { Voxels, SurfaceSamples };  ///< how tool collisions are counted

/// The projective baseline, for evaluation only: every voxel takes the range of the bin of the scan's range image into
/// which it falls, d = range - |x - q|, instead of every return updating the voxels around it. Used with
/// UpdateRegion::Projective, which takes scans with one sensor pose (integrateScan), not ray clouds.
struct ProjectiveParams {
  double bin_rad = 0.004363323129985824;  ///< edge of a bin, 0.25 degrees; rounded to a whole number of bins per turn
  bool in_front = false;       ///< voxels more than tau in front of a range count as tau; else only |d| <= tau counts
  bool empty_is_free = false;  ///< voxels in empty bins count as tau; else they are skipped
  bool guarded = false;        ///< nvblox's interpolation with its two guards; else the nearest range of the bin
  bool cleared_band = false;   ///< also mark the cleared band of the scan-centric method
  double elevation_min_rad = -0.12217304763960307;           ///< empty bins below are outside the view: -7 degrees
  double elevation_max_rad = 0.9075712110370514;             ///< and those above it: 52 degrees
  std::array<double, 3> box_min_W_m = {}, box_max_W_m = {};  ///< what in_front and empty_is_free may update, in the
                                                             ///< world frame; rounded outwards to leaves
};

/// How scans are fused into the truncated signed distance field (paper, "Scan-centric TSDF").
struct TsdfParams {
  double voxel_size_m = 0.01;          ///< [v] edge length of a voxel; 0.0005 .. 10
  double truncation_distance_m = 0.0;  ///< [tau] 0 = rule: max(4 v, 5 range_noise_m) (paper: max(4 v, 0.02))
  double range_noise_m = 0.02;         ///< sigma of the sensor's range noise; >= 0
  double min_range_m = 0.0;            ///< returns nearer than this are dropped
  double max_range_m = std::numeric_limits<double>::infinity();  ///< returns beyond this are dropped
  UpdateRegion region = UpdateRegion::DoubleCone;
  ProjectiveParams projective = {};    ///< only for UpdateRegion::Projective
  double cone_cos_min = 0.95;          ///< cosine of the cone's half angle; (0, 1)
  double clamp_min_m = 0.0;            ///< lower clamp of a distance sample: 0, or -tau for the unclamped variant
  std::uint32_t max_weight = 2000;     ///< [w] cap in observations; 1 .. 4095
  double cleared_radius_voxels = 2.5;  ///< cleared band: distance from the ray; 0 = thin line (paper)
  double cleared_begin_tau = 0.5;  ///< cleared band: begin, times tau, from the return towards the sensor (paper: 1)
  double cleared_end_tau = 2.25;   ///< cleared band: end, times tau; longer where the corridor is
  /// Beyond the band, rays clear a line of single voxels up to so far from their returns; infinity: to the sensor.
  /// 0: only the band. Not with a window, UpdateRegion::Projective.
  double clear_rays_m = 0.0;
  /// What the sensor's platform fills is free: a ball of this radius around each sensor position, unless something
  /// collides in it or a return of its scan lies there (FrameStats::contradicted_platforms). 0: nothing is; at most
  /// kMostPlatform_voxels. Not with a window, UpdateRegion::Projective.
  double platform_radius_m = 0.0;
};
/// Of TsdfParams::platform_radius_m.
inline constexpr double kMostPlatform_voxels = 128;

/// Which approach directions are admissible (paper, "Approach directions", "Arm path checking").
struct ApproachParams {
  int num_directions = 180;                           ///< [D] yaw steps over 2 pi; 4 .. 256
  double normal_cone_rad = 1.2217304763960306;        ///< 70 degrees
  double observation_cos_min = 0.25;                  ///< a direction was observed if dot(u, a_d) exceeds this
  std::array<double, 3> arm_tau = {0.6, 1.25, 2.25};  ///< distances of the arm samples, times tau
  double corridor_length_m = 0.0;  ///< [L] straight corridor kept free; beyond 2.25 tau sampled every tau
  bool coarse_to_fine = false;     ///< the paper's 20 degree pass and +-25 degree window; policy Paper only
  bool viewpoints = false;         ///< up to 8 stored viewpoints (paper) instead of the seen-direction mask
  /// The orientations that are tried, gravity frame. Others than yaw: at most OrientationSet::kMost; not for the
  /// paper's policy.
  OrientationSet orientations = {};
  /// How many rolls about its axis the tool may take in each orientation, evenly over a turn or, of an n-fold symmetric
  /// tool, over an n-th of one. 0 = rule: 1 for yaw, pitch, lists and turned tools, else 12 / n.
  int rolls = 0;

  /// How many there are: num_directions for yaw. @throws as OrientationSet::orientations()
  [[nodiscard]] int directionCount() const { return orientations.count(num_directions); }
};

/// Of ScoringParams::point_spacing_m: whatever moves is compared with all points within it and the range noise.
inline constexpr double kMostSpacing_voxels = 32;

/// How a direction is scored and a point labelled (paper, "Tool kernel", "Self-exclusion", "Confidence").
struct ScoringParams {
  double collision_distance_m = 0.0;   ///< [r_c] 0 = rule: 0.5 v
  double self_exclusion_voxels = 3.0;  ///< [r_s] in voxels
  ToolForm form = ToolForm::Voxels;
  int surface_samples = 1000;  ///< [M], only for SurfaceSamples
  int max_collisions = 0;      ///< [n_c - 1] most collisions of a free direction; 0 = rule (see ToolKernel); -1: none
  int neighbours = 0;          ///< [k] of the normal's PCA; 0 = rule: 10; 30, 60, 100 from sigma = v/2, v, 2v
  bool mean_positions = true;  ///< PCA on mean return positions (paper: first returns)
  bool join_neighbour_views = true;  ///< a point inherits the directions that its 10 nearest neighbours were seen from
  bool neighbourhood_weight = true;  ///< confidence from the largest weight of 3x3x3 voxels (paper: own voxel)
  double confidence_half_weight = 5.0;  ///< [k_c] c = w / (w + k_c)
  double confidence_min = 0.2;          ///< [c_min] below: not scored
  /// 0: every point is scored. Above: of the points that lie along a normal's main axis within
  /// max(2 range_noise_m, this) of each other, in a cell of this edge across it, only one where the surface is; the
  /// others are PointReason::BesideSurface. At least a voxel, at most tau and kMostSpacing_voxels; max(v,
  /// range_noise_m) is meant. Only for UpdatePolicy::Exact, range noise of at most as many voxels, and not with
  /// ChangeMode::Full.
  double point_spacing_m = 0.0;
};

/// When points are scored again.
struct UpdateParams {
  UpdatePolicy policy = UpdatePolicy::Exact;
  int budget_points = 0;                     ///< most points scored per update(); 0 = no limit. The rest is the backlog
  int changed_voxel_sample = 256;            ///< paper policy, trigger (ii)
  double changed_voxel_radius_voxels = 3.0;  ///< [r_u] paper policy, trigger (ii)
  double requeue_motion_m = 0.1;             ///< paper policy, trigger (iii)
  double stability_min = 0.7;                ///< bound on c*a for `confident` (and on a for the paper's label)
  std::uint64_t seed = 1;                    ///< for the paper policy's sample
};

/// How the map follows a world that changes.
struct ChangeParams {
  ChangeMode mode = ChangeMode::Block;  ///< Block only with UpdateRegion::DoubleCone; resolved() turns it off elsewhere
  /// [T] seconds by the scans' stamps: free space that no ray has confirmed for T to 2 T is unknown again. Infinity: it
  /// stays free. Finite only with ChangeMode::Full.
  double free_for_s = std::numeric_limits<double>::infinity();
};

/// Everything that an AccessibilityField needs besides the tool.
struct ACCESSVDB_API FieldParams {
  TsdfParams tsdf = {};
  ApproachParams approach = {};
  ScoringParams scoring = {};
  UpdateParams update = {};
  ChangeParams change = {};
  BackendKind backend = BackendKind::Auto;
  int threads = 0;  ///< 0 = all
  /// Keeps a second live mirror, of the map's distances, for DeviceView::distanceAt(). Scoring does not need it and no
  /// result depends on it; it costs time and memory (docs/design/mirror.md, "The mirror of distances").
  bool mirror_distance = false;
  /// On a GPU: fuses each scan on the host before it is scored, as without one. The same labels, later.
  bool fuse_on_host = false;
  /// On a GPU: most of its memory for the values of the map that it fuses into; what it holds no more it gets from the
  /// host again. No result depends on it. At least 64 MB. 0 = rule: 4 GB for voxels of 10 mm and more, below that five
  /// times as much for each halving that is begun, at most 64 GB. Never more than half of what is free at the start.
  std::uint64_t device_cache_bytes = 0;
  /// [m] World position of the local frame, rounded to whole voxels, in place of the first sensor's position. Fields
  /// with the same origin have the same voxels.
  std::optional<std::array<double, 3>> origin_W = std::nullopt;
  /// Limits the field to one tile. Needs origin_W; not for the paper's policy, projective fusion or ChangeMode::Full,
  /// whose results depend on the whole map.
  std::optional<FieldWindow> window = std::nullopt;
  /// What returns carry to the points (attributes.h); the files have a column of each. A point takes 4 bytes of each,
  /// and 12 for each value that its returns do not agree on. Names have up to 31 letters, digits or _, begin with
  /// a letter or _, and are none of ours.
  std::vector<CarriedAttribute> carry = {};

  /// The paper's own constants, for its tables.
  static FieldParams paper(double voxel_size_m);

  /// Copy with every rule applied. @throws InvalidArgument naming the first bad field.
  [[nodiscard]] FieldParams resolved() const;

  /// Every effective value as "name value" pairs, one per line, in a fixed order: for metadata and reports.
  [[nodiscard]] std::string describe() const;
};

}  // namespace accessvdb
