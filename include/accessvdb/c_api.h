// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// AccessVDB in plain C (C99 and later, and C++): for plug-ins that load libaccessvdb.so at run time, and for other
/// languages. Lengths are metres, angles radians; suffix _W: world frame (z up), _S: sensor frame, _T: tool frame.
///
/// Codes    Every function that can fail returns 0 (ACCESSVDB_OK) or an accessvdb_code. Nothing is thrown. The message
///          is in the field's handle (accessvdb_field_error_text) or, where there is no handle yet, in the
///          accessvdb_error that the caller passes. A call that fails with ACCESSVDB_ERROR_USAGE has changed nothing.
/// Structs  The caller sets struct_size to sizeof(the struct) before every call, so that both sides know which version
///          is meant: `accessvdb_params params = {.struct_size = sizeof params};`. Fields are only ever added at the
///          end. A smaller struct is an older version; a larger one is accepted if everything unknown to the library is
///          zero.
/// Threads  Handles are independent: different threads may use different handles. A handle serves one thread at a
///          time; a call that finds a field busy in another thread returns ACCESSVDB_ERROR_USAGE at once. Each call
///          uses all threads of the machine; labels do not depend on their number. Free a handle when no call uses it.
/// Strings  UTF-8, zero-terminated. Returned strings belong to the library and stay valid until the next call on their
///          handle.
#ifndef ACCESSVDB_C_API_H
#define ACCESSVDB_C_API_H

#include <stddef.h>
#include <stdint.h>

#include "accessvdb/export.h"

/* Grows with every addition. A program built against version N runs with a library of version N or later. */
#define ACCESSVDB_C_API_VERSION 7

#ifdef __cplusplus
#define ACCESSVDB_C_NOEXCEPT noexcept
extern "C" {
#else
#define ACCESSVDB_C_NOEXCEPT
#endif

/// The program's exit codes.
typedef enum accessvdb_code {
  ACCESSVDB_OK = 0,
  ACCESSVDB_ERROR_USAGE = 2,     ///< an argument or parameter is wrong: NULL, a size, a range, the order of calls
  ACCESSVDB_ERROR_INPUT = 3,     ///< an input cannot be read or is malformed
  ACCESSVDB_ERROR_UNUSABLE = 4,  ///< an input is well formed but cannot be used (a non-rigid pose, a tool of 100 m)
  ACCESSVDB_ERROR_RESOURCE = 5,  ///< memory or another limit; the field no longer answers
  ACCESSVDB_ERROR_DEVICE = 6,    ///< the requested device is missing or lost
  ACCESSVDB_ERROR_OUTPUT = 7,    ///< an output cannot be written durably
  ACCESSVDB_ERROR_INTERNAL = 70  ///< a bug in the library
} accessvdb_code;

enum { ACCESSVDB_UNSCORED = 0, ACCESSVDB_ACCESSIBLE = 1, ACCESSVDB_BLOCKED = 2, ACCESSVDB_NUM_LABELS = 3 };
enum {  ///< why a point is not accessible; accessvdb/point_label.h explains them
  ACCESSVDB_REASON_NONE = 0,
  ACCESSVDB_REASON_CONFIDENCE = 1,
  ACCESSVDB_REASON_NORMAL = 2,
  ACCESSVDB_REASON_UNSEEN = 3,
  ACCESSVDB_REASON_UNKNOWN = 4,
  ACCESSVDB_REASON_ARM = 5,
  ACCESSVDB_REASON_TOOL = 6,
  ACCESSVDB_NUM_REASONS = 7,           ///< those of accessvdb_counts::reasons
  ACCESSVDB_REASON_CHANGED = 7,        ///< since version 5: has gone, by rays or by removal as free; counted by itself
  ACCESSVDB_REASON_BESIDE_SURFACE = 8  ///< since version 7: with point_spacing_m, another point is scored in its place;
                                       ///< counted by itself
};
enum { ACCESSVDB_NUM_DROP_REASONS = 5 };  ///< no return, non-finite, below min range, beyond max range, out of bounds
enum {
  ACCESSVDB_UNIT_FROM_FILE = 0,  ///< only for formats that carry a unit (DAE, glTF, GLB)
  ACCESSVDB_METRE = 1,
  ACCESSVDB_CENTIMETRE = 2,
  ACCESSVDB_MILLIMETRE = 3,
  ACCESSVDB_INCH = 4
};
enum { ACCESSVDB_REGION_DOUBLE_CONE = 0, ACCESSVDB_REGION_FULL_CUBE = 1 };
enum { ACCESSVDB_FORM_VOXELS = 0, ACCESSVDB_FORM_SURFACE_SAMPLES = 1 };
enum { ACCESSVDB_POLICY_EXACT = 0, ACCESSVDB_POLICY_PAPER = 1 };
enum { ACCESSVDB_CHANGE_OFF = 0, ACCESSVDB_CHANGE_BLOCK = 1, ACCESSVDB_CHANGE_FULL = 2 };
enum { ACCESSVDB_BACKEND_AUTO = 0, ACCESSVDB_BACKEND_CPU = 1, ACCESSVDB_BACKEND_CUDA = 2 };

/// What went wrong in a call that has no handle yet.
typedef struct accessvdb_error {
  uint32_t struct_size;
  int32_t code;
  char id[64];      ///< stable dotted name, for example "tool.unit"
  char text[1024];  ///< one line: what is wrong, and what to do; truncated if longer
} accessvdb_error;

typedef struct accessvdb_tool accessvdb_tool;
typedef struct accessvdb_field accessvdb_field;
typedef struct accessvdb_update accessvdb_update;
typedef struct accessvdb_rolling accessvdb_rolling;

/// Version of the loaded library, such as "0.1.0".
ACCESSVDB_API const char* accessvdb_version(void) ACCESSVDB_C_NOEXCEPT;
/// ACCESSVDB_C_API_VERSION of the loaded library: refuse one below the version you were built with.
ACCESSVDB_API uint32_t accessvdb_c_api_version(void) ACCESSVDB_C_NOEXCEPT;
/// "unscored", "accessible", "blocked"; "?" for other numbers.
ACCESSVDB_API const char* accessvdb_label_name(int32_t label) ACCESSVDB_C_NOEXCEPT;
/// "none", "confidence", "normal", "unseen", "unknown", "arm", "tool", "changed"; "?" for other numbers.
ACCESSVDB_API const char* accessvdb_reason_name(int32_t reason) ACCESSVDB_C_NOEXCEPT;

/* ---- the tool: metres, tip at the origin, +x from the tip along the body, +z up ---------------------------------- */

/// How a mesh's own frame maps to the tool frame, in the mesh's own units and axes. A zero axis and up mean +x and +z.
typedef struct accessvdb_tool_pose {
  uint32_t struct_size;
  int32_t has_tip;  ///< 0: the tip is the origin of the mesh file; 1: it is at `tip`
  double tip[3];
  double axis[3];  ///< from the tip along the body
  double up[3];
} accessvdb_tool_pose;

typedef struct accessvdb_tool_info {
  uint32_t struct_size;
  int32_t watertight;  ///< 0 or 1
  uint64_t vertex_count, triangle_count;
  float min_T[3], max_T[3];
  float reach_m;  ///< farthest vertex from the tip
  float reserved;
} accessvdb_tool_info;

/// Reads STL, OBJ, PLY, OFF, DAE, glTF or GLB. @param pose  NULL: the mesh is already in the tool frame
/// @param error  may be NULL, here and below. *tool is NULL if the call fails.
ACCESSVDB_API int accessvdb_tool_from_mesh(const char* path, int32_t unit, const accessvdb_tool_pose* pose,
                                           accessvdb_tool** tool, accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;
/// @param vertices_T  [3 x vertex_count] x y z, metres, tool frame
/// @param triangles   [3 x triangle_count] vertex indices
/// @param name        for metadata; may be NULL
ACCESSVDB_API int accessvdb_tool_from_triangles(const float* vertices_T, size_t vertex_count, const uint32_t* triangles,
                                                size_t triangle_count, const char* name, accessvdb_tool** tool,
                                                accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;
/// @param name  "builtin:pencil" or "builtin:pruner"
ACCESSVDB_API int accessvdb_tool_builtin(const char* name, accessvdb_tool** tool,
                                         accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;
ACCESSVDB_API int accessvdb_tool_get_info(const accessvdb_tool* tool, accessvdb_tool_info* info) ACCESSVDB_C_NOEXCEPT;
ACCESSVDB_API const char* accessvdb_tool_name(const accessvdb_tool* tool) ACCESSVDB_C_NOEXCEPT;
ACCESSVDB_API const char* accessvdb_tool_sha256(const accessvdb_tool* tool) ACCESSVDB_C_NOEXCEPT;
/// Fields keep their own copy, so a tool may be freed before them. NULL is allowed.
ACCESSVDB_API void accessvdb_tool_free(accessvdb_tool* tool) ACCESSVDB_C_NOEXCEPT;

/* ---- parameters: accessvdb/params.h has their meaning, ranges and symbols ---------------------------------------- */

/// Filled by accessvdb_params_defaults(); then set what differs. Where marked "rule", 0 means derived from the others.
typedef struct accessvdb_params {
  uint32_t struct_size;
  int32_t threads;  ///< 0 = all
  int32_t backend;  ///< ACCESSVDB_BACKEND_*
  int32_t region;   ///< ACCESSVDB_REGION_*
  double voxel_size_m;
  double truncation_distance_m;  ///< 0 = rule
  double range_noise_m;
  double min_range_m, max_range_m;
  double cone_cos_min;
  double clamp_min_m;
  double cleared_radius_voxels, cleared_begin_tau, cleared_end_tau;
  uint32_t max_weight;
  int32_t num_directions;
  double normal_cone_rad;
  double observation_cos_min;
  double arm_tau[3];
  double corridor_length_m;
  int32_t coarse_to_fine, viewpoints;  ///< 0 or 1
  double collision_distance_m;         ///< 0 = rule
  double self_exclusion_voxels;
  int32_t tool_form;  ///< ACCESSVDB_FORM_*
  int32_t surface_samples;
  int32_t max_collisions;                                              ///< 0 = rule, -1 = none
  int32_t neighbours;                                                  ///< 0 = rule
  int32_t mean_positions, join_neighbour_views, neighbourhood_weight;  ///< 0 or 1
  int32_t policy;                                                      ///< ACCESSVDB_POLICY_*
  double confidence_half_weight, confidence_min;
  int32_t budget_points;
  int32_t changed_voxel_sample;
  double changed_voxel_radius_voxels;
  double requeue_motion_m;
  double stability_min;
  uint64_t seed;
  /// Version 5. "yaw", "pitch:MIN:MAX:STEP", "sphere:STEP", "sphere:STEP+yaw" or "list:FILE", angles in degrees; read
  /// by the call that it is passed to. NULL = yaw
  const char* orientations;
  int32_t change;     ///< ACCESSVDB_CHANGE_*; since version 5
  int32_t rolls;      ///< about the tool's body in each orientation, 0 = rule; since version 5
  double free_for_s;  ///< version 5: > 0, finite only with ACCESSVDB_CHANGE_FULL; infinity = free space stays free
  /// Version 6. Names of what returns carry to the points, with a blank between them; read by the call that it is
  /// passed to. NULL = nothing
  const char* carry;
  double point_spacing_m;       ///< version 7: 0 = all points are scored; else one for each cell of this edge
  double clear_rays_m;          ///< version 7: how far from their returns rays clear a line; infinity: all of it
  double platform_radius_m;     ///< version 7: a ball of this radius around the sensor's positions is free
  uint64_t device_cache_bytes;  ///< version 7: on a GPU, most of its memory for the values of the map; 0 = rule
  int32_t fuse_on_host;         ///< version 7: 0 or 1; on a GPU, each scan is fused on the host before it is scored
  uint32_t reserved;
} accessvdb_params;

/// The product's defaults. Reads only struct_size.
ACCESSVDB_API int accessvdb_params_defaults(accessvdb_params* params) ACCESSVDB_C_NOEXCEPT;
/// The paper's own constants, for its tables.
ACCESSVDB_API int accessvdb_params_paper(double voxel_size_m, accessvdb_params* params) ACCESSVDB_C_NOEXCEPT;

/* ---- the field ------------------------------------------------------------------------------------------------- */

/// What one scan did.
typedef struct accessvdb_frame_stats {
  uint32_t struct_size;
  uint32_t reserved;
  uint64_t points_in, points_used;
  uint64_t dropped[ACCESSVDB_NUM_DROP_REASONS];
  uint64_t touched_leaves, new_leaves, distance_updates, cleared_updates;
  double integrate_ms, mirror_ms;
} accessvdb_frame_stats;

/// What one update did.
typedef struct accessvdb_update_stats {
  uint32_t struct_size;
  uint32_t reserved;
  uint64_t dirty_points, scored_points, direction_tests, backlog, label_changes;
  double update_ms, score_ms;
} accessvdb_update_stats;

/// One surface point. Elements of an array have no struct_size: the calls take sizeof(accessvdb_point) once.
typedef struct accessvdb_point {
  double position_W[3];
  float normal_W[3];     ///< unit, towards the mean sensor position; zero where there is none
  float direction_W[3];  ///< unit, outwards along the tool's body; the tool travels along -direction_W
  float yaw_rad;         ///< of direction_W
  float weight;
  float confidence;    ///< [0, 1)
  float stability;     ///< [0, 1]
  uint32_t id;         ///< stable over the life of the field
  uint16_t direction;  ///< index d, yaw = 2 pi d / num_directions; 65535 = none
  uint16_t score;      ///< fewest collisions of any direction; 65535 = no direction reached the tool test
  uint8_t label;       ///< ACCESSVDB_UNSCORED, ACCESSVDB_ACCESSIBLE, ACCESSVDB_BLOCKED
  uint8_t reason;      ///< ACCESSVDB_REASON_*
  uint8_t confident;   ///< 1: accessible, confidence x stability is high, and no point waits
  uint8_t roll;        ///< version 5: index of the best roll in that direction
  uint8_t tool;        ///< version 5: of several tools, the first that reaches the point, else the closest
  uint8_t reserved[3];
  float orientation_WT[4];   ///< version 5: quaternion w x y z, world from tool, in that direction; 1 0 0 0 = none
  uint32_t tools;            ///< version 5: of several tools, bit k is 1 if tool k reaches the point
  float margin_m;            ///< version 7: of a field with margins, the largest with which the tool still reaches the
                             ///< point; -1 = it does not, or there are none
  float access_probability;  ///< version 7: how likely the exact tool reaches the point, [0, 1]; -1 = nothing is said
} accessvdb_point;

typedef struct accessvdb_counts {
  uint32_t struct_size;
  uint32_t reserved;
  uint64_t points;
  uint64_t labels[ACCESSVDB_NUM_LABELS];
  uint64_t reasons[ACCESSVDB_NUM_REASONS];
  uint64_t changed;         ///< since version 5: points with ACCESSVDB_REASON_CHANGED
  uint64_t beside_surface;  ///< since version 7: points with ACCESSVDB_REASON_BESIDE_SURFACE
} accessvdb_counts;

/// @param params  NULL: the defaults
ACCESSVDB_API int accessvdb_field_create(const accessvdb_tool* tool, const accessvdb_params* params,
                                         accessvdb_field** field, accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;
/// NULL is allowed.
ACCESSVDB_API void accessvdb_field_free(accessvdb_field* field) ACCESSVDB_C_NOEXCEPT;

/// The last failed call on this field, as one line and as a stable dotted name; "" if none has failed.
ACCESSVDB_API const char* accessvdb_field_error_text(const accessvdb_field* field) ACCESSVDB_C_NOEXCEPT;
ACCESSVDB_API const char* accessvdb_field_error_id(const accessvdb_field* field) ACCESSVDB_C_NOEXCEPT;

/// Fuses one scan. Bad returns are counted, never used.
/// @param points_S  [3 x point_count] x y z in the sensor frame; exactly (0,0,0) means "no return"
/// @param T_W_S     [16] pose, sensor to world, 4x4 row by row; rigid, last row 0 0 0 1
/// @param stats     may be NULL, here and below
ACCESSVDB_API int accessvdb_field_integrate_scan(accessvdb_field* field, const float* points_S, size_t point_count,
                                                 const double* T_W_S,
                                                 accessvdb_frame_stats* stats) ACCESSVDB_C_NOEXCEPT;
/// The same for a scan whose first return has this time, in seconds of any clock (since version 5). A stamp that is not
/// finite counts as missing; in place of one that is earlier than the latest so far, the latest is used.
ACCESSVDB_API int accessvdb_field_integrate_scan_at(accessvdb_field* field, const float* points_S, size_t point_count,
                                                    const double* T_W_S, double stamp_s,
                                                    accessvdb_frame_stats* stats) ACCESSVDB_C_NOEXCEPT;
/// Fuses rays that each have their own origin, or one origin for all.
/// @param points_W  [3 x point_count]    @param origins_W  [3 x origin_count], origin_count being point_count or 1
ACCESSVDB_API int accessvdb_field_integrate_rays(accessvdb_field* field, const double* points_W, size_t point_count,
                                                 const double* origins_W, size_t origin_count,
                                                 accessvdb_frame_stats* stats) ACCESSVDB_C_NOEXCEPT;
/// The same for rays of which the first has this time (since version 5).
ACCESSVDB_API int accessvdb_field_integrate_rays_at(accessvdb_field* field, const double* points_W, size_t point_count,
                                                    const double* origins_W, size_t origin_count, double stamp_s,
                                                    accessvdb_frame_stats* stats) ACCESSVDB_C_NOEXCEPT;
/// Both with what the returns carry (since version 6). @param attributes  [point_count x names in
/// accessvdb_params::carry] row by row, INT32_MIN for none  @param attribute_count  the number of values
ACCESSVDB_API int accessvdb_field_integrate_scan_carrying(accessvdb_field* field, const float* points_S,
                                                          size_t point_count, const double* T_W_S, double stamp_s,
                                                          const int32_t* attributes, size_t attribute_count,
                                                          accessvdb_frame_stats* stats) ACCESSVDB_C_NOEXCEPT;
ACCESSVDB_API int accessvdb_field_integrate_rays_carrying(accessvdb_field* field, const double* points_W,
                                                          size_t point_count, const double* origins_W,
                                                          size_t origin_count, double stamp_s,
                                                          const int32_t* attributes, size_t attribute_count,
                                                          accessvdb_frame_stats* stats) ACCESSVDB_C_NOEXCEPT;
/// The latest stamp of a scan so far; NaN while none had one (since version 5).
ACCESSVDB_API int accessvdb_field_latest_stamp(accessvdb_field* field, double* stamp_s) ACCESSVDB_C_NOEXCEPT;
/// Scores what changed since the last update.
ACCESSVDB_API int accessvdb_field_update(accessvdb_field* field, accessvdb_update_stats* stats) ACCESSVDB_C_NOEXCEPT;

/// Takes all points with their labels, as of the last update, and keeps them in the handle until the next snapshot.
/// Points that came after the last update are unscored. @param point_count  may be NULL
ACCESSVDB_API int accessvdb_field_take_snapshot(accessvdb_field* field, size_t* point_count) ACCESSVDB_C_NOEXCEPT;
/// Copies points [first, first + count) of the snapshot, in the order of their ids. @param points  [count]
ACCESSVDB_API int accessvdb_field_copy_points(accessvdb_field* field, size_t first, size_t count,
                                              accessvdb_point* points, size_t point_size) ACCESSVDB_C_NOEXCEPT;
/// Copies an attribute of points [first, first + count) of the snapshot (since version 6). INT32_MIN = none
/// @param column  index of its name in accessvdb_params::carry  @param values  [count]
ACCESSVDB_API int accessvdb_field_copy_attribute(accessvdb_field* field, size_t column, size_t first, size_t count,
                                                 int32_t* values) ACCESSVDB_C_NOEXCEPT;
/// Number of points in the snapshot per label and per reason.
ACCESSVDB_API int accessvdb_field_get_counts(accessvdb_field* field, accessvdb_counts* counts) ACCESSVDB_C_NOEXCEPT;
/// Frees the snapshot's memory.
ACCESSVDB_API int accessvdb_field_drop_snapshot(accessvdb_field* field) ACCESSVDB_C_NOEXCEPT;

/// The point in the voxel that contains p_W [3]; *found is 0 if there is none.
ACCESSVDB_API int accessvdb_field_point_at(accessvdb_field* field, const double* p_W, accessvdb_point* point,
                                           size_t point_size, int32_t* found) ACCESSVDB_C_NOEXCEPT;

/* ---- batched queries (since version 2); accessvdb/batch_query.h has the rules ------------------------------------ */

/// What the map and the points say at a position. Arrays take sizeof(accessvdb_point_answer) once.
typedef struct accessvdb_point_answer {
  float distance_m;        ///< of the voxel, 0 .. tau; NaN where unobserved
  float point_distance_m;  ///< to the surface point that answers; NaN without one
  float direction_W[3];    ///< its best direction, unit, outwards along the tool's body; zero where there is none
  uint32_t point_id;       ///< the voxel's, else the nearest within 3 voxels; 0xFFFFFFFF = none
  uint16_t weight;         ///< observations of the voxel; 0 = unobserved
  uint16_t direction;      ///< 65535 = none
  uint16_t score;          ///< 65535 = no direction reached the tool test
  uint8_t label;           ///< ACCESSVDB_UNSCORED if there is no point
  uint8_t reason;          ///< ACCESSVDB_REASON_*
  uint8_t unknown;         ///< 1: neither observed nor cleared, or a bad position (NaN)
  uint8_t cleared;         ///< 1: a ray passed the voxel
  uint8_t reserved[6];
} accessvdb_point_answer;

/// A link of a robot arm, or the path it sweeps. Arrays take sizeof(accessvdb_capsule) once.
typedef struct accessvdb_capsule {
  double a_W[3], b_W[3];  ///< ends of the axis; may be the same
  double radius_m;        ///< >= 0
} accessvdb_capsule;

/// What a capsule meets. Free means valid, no collision and not unknown.
typedef struct accessvdb_capsule_answer {
  float min_distance_m;  ///< from the axis to the nearest surface, as far as the map knows; NaN = nothing observed
  float first_hit_t;     ///< 0 at a .. 1 at b; NaN = no collision
  uint8_t collision;
  uint8_t unknown;  ///< 1: some voxel was neither observed nor cleared, or the capsule was not examined
  uint8_t valid;    ///< 0: a bad end or radius, or too large: split it
  uint8_t reserved[5];
} accessvdb_capsule_answer;

/// @param points_W  [3 x count] x y z    @param answers  [count] out
ACCESSVDB_API int accessvdb_field_query_points(accessvdb_field* field, const double* points_W, size_t count,
                                               accessvdb_point_answer* answers,
                                               size_t answer_size) ACCESSVDB_C_NOEXCEPT;
/// @param capsules  [count]    @param answers  [count] out
ACCESSVDB_API int accessvdb_field_query_capsules(accessvdb_field* field, const accessvdb_capsule* capsules,
                                                 size_t capsule_size, size_t count, accessvdb_capsule_answer* answers,
                                                 size_t answer_size) ACCESSVDB_C_NOEXCEPT;

/* ---- the field's tools at any pose (since version 7); accessvdb/pose_query.h has the rules ----------------------- */

/// What a tool meets at a pose. Arrays take sizeof(accessvdb_fit) once.
typedef struct accessvdb_fit {
  uint32_t collisions;       ///< colliding voxels
  uint32_t collision_limit;  ///< fewest that block: 1, in contact the field's own
  uint32_t unknown_voxels;   ///< neither observed nor cleared
  uint8_t collision;
  uint8_t unknown;
  uint8_t valid;  ///< 0: the pose is no rotation and translation, not finite or out of range: nothing was looked at
  uint8_t free;   ///< 1: no collision, and all of it was seen to be free
} accessvdb_fit;

/// What a tool meets on its way from pose to pose.
typedef struct accessvdb_path_fit {
  uint32_t struct_size;
  uint8_t collision;
  uint8_t unknown;  ///< before the first collision
  uint8_t valid;    ///< 0: no poses, a bad one, or too long a way
  uint8_t free;
  double first_hit;  ///< 1.25: a quarter of the way from the second pose to the third; NaN = nowhere
} accessvdb_path_fit;

/// @param T_WT  [16 x count] 4 x 4 matrices, world from tool, row by row    @param tool  of several; else 0
/// @param in_contact  1: the tip touches a surface point, as where the field scores it    @param fits  [count] out
ACCESSVDB_API int accessvdb_field_fits(accessvdb_field* field, const double* T_WT, size_t count, uint32_t tool,
                                       int in_contact, accessvdb_fit* fits, size_t fit_size) ACCESSVDB_C_NOEXCEPT;
/// @param T_WT  [16 x count] as above, on the way
ACCESSVDB_API int accessvdb_field_fits_along(accessvdb_field* field, const double* T_WT, size_t count, uint32_t tool,
                                             accessvdb_path_fit* fit) ACCESSVDB_C_NOEXCEPT;

/// "cpu" or "cuda:NAME".
ACCESSVDB_API const char* accessvdb_field_device(const accessvdb_field* field) ACCESSVDB_C_NOEXCEPT;
/// Every effective parameter as "name value", one per line.
ACCESSVDB_API const char* accessvdb_field_parameters(const accessvdb_field* field) ACCESSVDB_C_NOEXCEPT;

/// Writes field.vdb, field_points.vdb and points.ply into a folder, each whole or not at all.
ACCESSVDB_API int accessvdb_field_write(accessvdb_field* field, const char* folder) ACCESSVDB_C_NOEXCEPT;

/* ---- save and go on (since version 3); accessvdb/accessibility_field.h, saveState, says what is guaranteed --------
 */

/// Writes all that later scans and updates depend on into one file, whole or not at all.
ACCESSVDB_API int accessvdb_field_save_state(accessvdb_field* field, const char* file) ACCESSVDB_C_NOEXCEPT;
/// Makes a field that goes on where the saved one was. Its parameters are those of the saved one.
/// @param tool     that of the saved field, else ACCESSVDB_ERROR_UNUSABLE ("state.tool")
/// @param backend  ACCESSVDB_BACKEND_*  @param threads  0 = all; both may differ from the saved field's
/// @param error    may be NULL. *field is NULL if the call fails.
ACCESSVDB_API int accessvdb_field_load_state(const char* file, const accessvdb_tool* tool, int32_t backend,
                                             int32_t threads, accessvdb_field** field,
                                             accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;

/* ---- parts of a map taken out by hand (since version 5); accessvdb/region.h and accessvdb/what_if.h have the rules --
 */

typedef enum accessvdb_region_kind {
  ACCESSVDB_REGION_BOX = 0,    ///< voxels whose centres lie in it
  ACCESSVDB_REGION_MESH = 1,   ///< a closed triangle mesh: voxels whose centres lie inside
  ACCESSVDB_REGION_POINTS = 2  ///< surface points, with the colliding voxels that are nearest to them
} accessvdb_region_kind;

typedef enum accessvdb_removed_as {
  ACCESSVDB_REMOVED_AS_UNKNOWN = 0,  ///< keeps blocking until a scan sees through it
  ACCESSVDB_REMOVED_AS_FREE = 1
} accessvdb_removed_as;

/// Arrays take sizeof(accessvdb_region) once. What is not of its kind is not read.
typedef struct accessvdb_region {
  int32_t kind;  ///< ACCESSVDB_REGION_*
  uint32_t reserved;
  double min_W[3], max_W[3];  ///< of a box
  const double* vertices_W;   ///< [3 x vertex_count], of a mesh
  size_t vertex_count;
  const uint32_t* triangles;  ///< [3 x triangle_count] indices of vertices, of a mesh
  size_t triangle_count;
  const uint32_t* ids;  ///< [id_count] accessvdb_point::id, of points
  size_t id_count;
} accessvdb_region;

typedef struct accessvdb_removal {
  uint32_t struct_size;
  int32_t removed_as;         ///< ACCESSVDB_REMOVED_AS_*
  uint64_t voxels;            ///< observed voxels of the region
  uint64_t colliding_voxels;  ///< those that blocked the tool
  uint64_t points;            ///< surface points in them
  uint64_t flipped_voxels;    ///< voxels that scoring sees differently from now on
} accessvdb_removal;

typedef struct accessvdb_what_if {
  uint32_t struct_size;
  uint32_t reserved;
  uint64_t opens;             ///< points that would become accessible
  uint64_t voxels;            ///< observed voxels of the regions
  uint64_t colliding_voxels;  ///< those that block the tool
  uint64_t points_gone;       ///< surface points in them
  uint64_t points_tried;
  uint64_t direction_tests;
  double choose_ms, score_ms;
} accessvdb_what_if;

/// Takes out of the map what lies in a region. All points are unscored until the next update.
/// @param removed_as  ACCESSVDB_REMOVED_AS_*  @param removal  may be NULL
ACCESSVDB_API int accessvdb_field_remove_region(accessvdb_field* field, const accessvdb_region* region,
                                                size_t region_size, int32_t removed_as,
                                                accessvdb_removal* removal) ACCESSVDB_C_NOEXCEPT;
/// Which points would open if all that lies in the regions went; changes nothing. Needs labels that are up to date. The
/// points are kept in the handle until the next call.
/// @param regions  [region_count]  @param what_if  may be NULL
ACCESSVDB_API int accessvdb_field_what_if(accessvdb_field* field, const accessvdb_region* regions, size_t region_size,
                                          size_t region_count, accessvdb_what_if* what_if) ACCESSVDB_C_NOEXCEPT;
/// Copies points [first, first + count) of those that the last accessvdb_field_what_if() found, by id, with label,
/// direction and score as they would be. @param points  [count]
ACCESSVDB_API int accessvdb_field_copy_opened(accessvdb_field* field, size_t first, size_t count,
                                              accessvdb_point* points, size_t point_size) ACCESSVDB_C_NOEXCEPT;

/* ---- updates that do not block (since version 4); accessvdb/accessibility_field.h, updateAsync, has the rules ---- */

/// Begins what accessvdb_field_update() does on a thread of the library and returns, after an earlier one has ended.
/// The next scan may be fused meanwhile; every other call on the field that reads it waits. The field may be freed
/// first.
/// @param update  out; free it with accessvdb_update_free(). NULL if the call fails.
ACCESSVDB_API int accessvdb_field_update_async(accessvdb_field* field, accessvdb_update** update) ACCESSVDB_C_NOEXCEPT;
/// Waits until the update has ended, and returns its code. May be called again. @param stats  may be NULL
ACCESSVDB_API int accessvdb_update_wait(accessvdb_update* update, accessvdb_update_stats* stats) ACCESSVDB_C_NOEXCEPT;
/// *done is 1 if accessvdb_update_wait() would return at once, else 0.
ACCESSVDB_API int accessvdb_update_is_done(accessvdb_update* update, int32_t* done) ACCESSVDB_C_NOEXCEPT;
/// The last failed call on this update, as for a field.
ACCESSVDB_API const char* accessvdb_update_error_text(const accessvdb_update* update) ACCESSVDB_C_NOEXCEPT;
ACCESSVDB_API const char* accessvdb_update_error_id(const accessvdb_update* update) ACCESSVDB_C_NOEXCEPT;
/// Waits for the update. NULL is allowed.
ACCESSVDB_API void accessvdb_update_free(accessvdb_update* update) ACCESSVDB_C_NOEXCEPT;

/* ---- several tools (since version 5); accessvdb/tool_spec.h has the rules ---------------------------------------- */

/// A tool, and what a field asks of it. Arrays take sizeof(accessvdb_tool_spec) once. Begin with {0}.
typedef struct accessvdb_tool_spec {
  const accessvdb_tool* tool;  ///< copied
  const char* name;            ///< letters, digits, _ and -, at most 32; NULL = from the tool's own
  const char* orientations;    ///< as in accessvdb_params; NULL = yaw
  int32_t rolls;               ///< 0 = rule
  int32_t max_collisions;      ///< 0 = rule, -1 = none
  double margin_m;             ///< since version 7: the tool counts with everything within this of it; 0 = none. Behind
                               ///< the same tool without one, for accessvdb_point::margin_m
} accessvdb_tool_spec;

/// Makes a field of up to 32 tools over one map. Each tool's result is that of a field with it alone.
/// @param params  for all; their orientations, rolls and max_collisions are those of the tools. NULL: the defaults
ACCESSVDB_API int accessvdb_field_create_tools(const accessvdb_tool_spec* tools, size_t spec_size, size_t tool_count,
                                               const accessvdb_params* params, accessvdb_field** field,
                                               accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;
/// accessvdb_field_load_state() for several tools, the same as those of the saved field.
ACCESSVDB_API int accessvdb_field_load_state_tools(const char* file, const accessvdb_tool_spec* tools, size_t spec_size,
                                                   size_t tool_count, int32_t backend, int32_t threads,
                                                   accessvdb_field** field,
                                                   accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;
/// Number of tools of a field; 0 for a bad handle.
ACCESSVDB_API size_t accessvdb_field_tool_count(const accessvdb_field* field) ACCESSVDB_C_NOEXCEPT;
/// Name of a tool; "" for a bad index.
ACCESSVDB_API const char* accessvdb_field_tool_name(const accessvdb_field* field, size_t tool) ACCESSVDB_C_NOEXCEPT;
/// accessvdb_field_take_snapshot() with the points as a field with this tool alone would have them.
ACCESSVDB_API int accessvdb_field_take_tool_snapshot(accessvdb_field* field, size_t tool,
                                                     size_t* point_count) ACCESSVDB_C_NOEXCEPT;

/* ---- what is wrong with a tool (since version 5); accessvdb/tool_tables.h has the rules -------------------------- */

/// Width of the widest opening of a tool's surface, metres: 0 if it is closed, infinity for a sheet. Openings of up to
/// a quarter of the tool's size are closed; of a tool that is wider open only the surface counts. NaN for a bad handle.
ACCESSVDB_API double accessvdb_tool_opening_m(const accessvdb_tool* tool) ACCESSVDB_C_NOEXCEPT;
/// The largest share of a tool, of all and turned in any way, that is so near its tip that collisions there do not
/// count. If it is more than a half, labels say little.
ACCESSVDB_API int accessvdb_field_tool_share_hidden(accessvdb_field* field, double* share) ACCESSVDB_C_NOEXCEPT;

/* ---- a field of any extent in bounded memory (since version 7); accessvdb/rolling_field.h has the rules ---------- */

typedef struct accessvdb_rolling_options {
  uint32_t struct_size;
  int32_t tile_voxels;          ///< edge of a tile: a power of two, or 0 = rule
  const char* folder;           ///< where tiles go that leave memory. It may not exist yet, or be empty
  uint64_t memory_limit_bytes;  ///< of map, mirror and points of the tiles in memory. 0 = no limit
  uint64_t device_limit_bytes;  ///< of what lies on a GPU. 0 = four fifths of what is free there
  int32_t notes_changes;        ///< 0 or 1: whether accessvdb_rolling_take_changed() will be called
  int32_t resume;  ///< 1: go on after the last checkpoint in that folder, with the same tools and parameters
} accessvdb_rolling_options;

typedef struct accessvdb_rolling_status {
  uint32_t struct_size;
  int32_t memory_short;  ///< 1: in the last step not all tiles that the scan touched fitted; what did not, blocks
  int32_t tile_voxels, margin_voxels;
  uint64_t steps;   ///< scans
  uint64_t points;  ///< of all tiles
  uint64_t tiles, tiles_in_memory;
  uint64_t saved, loaded;               ///< how often a tile left, and came back
  uint64_t saved_ahead, loaded_ahead;   ///< of these: begun beside the steps, before it was needed
  uint64_t memory_bytes, device_bytes;  ///< of the tiles in memory
  uint64_t peak_memory_bytes;           ///< the most that memory_bytes was
  uint64_t left_out_returns;
  uint64_t lost_tile_count;  ///< tiles whose saved state was damaged: what they held is missing, for good
  double fitting_range_m;    ///< if memory_short: the range within which all tiles fitted
  int32_t unsaved;           ///< 1: in the last update a tile could not leave, so memory may pass the limit
  int32_t reserved;
} accessvdb_rolling_status;

/// Makes a field of up to 32 tools, as accessvdb_field_create_tools() does. Not with a budget, the paper's policy
/// or accessvdb_params::carry (ACCESSVDB_ERROR_USAGE, "rolling.params"); a folder with something
/// in it is refused without resume (ACCESSVDB_ERROR_OUTPUT, "output.foreign").
/// With resume: "rolling.missing" or "rolling.damaged" (ACCESSVDB_ERROR_INPUT), "rolling.changed"
/// (ACCESSVDB_ERROR_UNUSABLE).
/// @param options  the folder at least  @param error  may be NULL. *rolling is NULL if the call fails.
ACCESSVDB_API int accessvdb_rolling_create(const accessvdb_tool_spec* tools, size_t spec_size, size_t tool_count,
                                           const accessvdb_params* params, const accessvdb_rolling_options* options,
                                           accessvdb_rolling** rolling, accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;
/// *found is 1 if a folder has a checkpoint, whole or not, else 0.
ACCESSVDB_API int accessvdb_rolling_has_checkpoint(const char* folder, int32_t* found,
                                                   accessvdb_error* error) ACCESSVDB_C_NOEXCEPT;
/// Saves nothing: what came after the last checkpoint is lost. NULL is allowed.
ACCESSVDB_API void accessvdb_rolling_free(accessvdb_rolling* rolling) ACCESSVDB_C_NOEXCEPT;
/// The last failed call on this handle, as for a field.
ACCESSVDB_API const char* accessvdb_rolling_error_text(const accessvdb_rolling* rolling) ACCESSVDB_C_NOEXCEPT;
ACCESSVDB_API const char* accessvdb_rolling_error_id(const accessvdb_rolling* rolling) ACCESSVDB_C_NOEXCEPT;

/// As accessvdb_field_integrate_scan_at(); NAN is no stamp. Where a tile cannot be saved (ACCESSVDB_ERROR_OUTPUT),
/// nothing has changed.
ACCESSVDB_API int accessvdb_rolling_integrate_scan_at(accessvdb_rolling* rolling, const float* points_S,
                                                      size_t point_count, const double* T_W_S, double stamp_s,
                                                      accessvdb_frame_stats* stats) ACCESSVDB_C_NOEXCEPT;
/// As accessvdb_field_integrate_rays_at().
ACCESSVDB_API int accessvdb_rolling_integrate_rays_at(accessvdb_rolling* rolling, const double* points_W,
                                                      size_t point_count, const double* origins_W, size_t origin_count,
                                                      double stamp_s,
                                                      accessvdb_frame_stats* stats) ACCESSVDB_C_NOEXCEPT;
/// Returns that this field will never get, although there were some, lay at most radius_m from these positions: from
/// the next update on, points whose labels may depend on them are unscored with ACCESSVDB_REASON_CONFIDENCE, for good.
/// @param centres_W  [3 x count] x y z  @param radius_m  0 .. 1e6
ACCESSVDB_API int accessvdb_rolling_leave_out(accessvdb_rolling* rolling, const double* centres_W, size_t count,
                                              double radius_m) ACCESSVDB_C_NOEXCEPT;
/// Scores what changed since the last update. @param stats  may be NULL
ACCESSVDB_API int accessvdb_rolling_update(accessvdb_rolling* rolling,
                                           accessvdb_update_stats* stats) ACCESSVDB_C_NOEXCEPT;

/// Takes all points, also those of tiles in the folder, as accessvdb_field_take_snapshot() does.
/// @param point_count  may be NULL, here and below
ACCESSVDB_API int accessvdb_rolling_take_snapshot(accessvdb_rolling* rolling, size_t* point_count) ACCESSVDB_C_NOEXCEPT;
/// The same of the tiles in memory: the points around the sensor.
ACCESSVDB_API int accessvdb_rolling_take_snapshot_in_memory(accessvdb_rolling* rolling,
                                                            size_t* point_count) ACCESSVDB_C_NOEXCEPT;
/// Copies points [first, first + count) of the snapshot, in the order of their ids. @param points  [count]
ACCESSVDB_API int accessvdb_rolling_copy_points(accessvdb_rolling* rolling, size_t first, size_t count,
                                                accessvdb_point* points, size_t point_size) ACCESSVDB_C_NOEXCEPT;
/// Frees the snapshot's memory, which no limit counts.
ACCESSVDB_API int accessvdb_rolling_drop_snapshot(accessvdb_rolling* rolling) ACCESSVDB_C_NOEXCEPT;

/// Takes the points of tiles in memory that are new, or whose label, reason, direction or tools changed with an update,
/// since the last call, and keeps them in the handle until the next. Those of tiles in the folder come with the first
/// update after they are back. Needs notes_changes ("rolling.changes").
ACCESSVDB_API int accessvdb_rolling_take_changed(accessvdb_rolling* rolling, size_t* point_count) ACCESSVDB_C_NOEXCEPT;
/// Copies points [first, first + count) of those, by id. @param points  [count]
ACCESSVDB_API int accessvdb_rolling_copy_changed(accessvdb_rolling* rolling, size_t first, size_t count,
                                                 accessvdb_point* points, size_t point_size) ACCESSVDB_C_NOEXCEPT;

ACCESSVDB_API int accessvdb_rolling_get_status(accessvdb_rolling* rolling,
                                               accessvdb_rolling_status* status) ACCESSVDB_C_NOEXCEPT;
/// Name of a lost tile, [0, lost_tile_count) of the last status, such as "3_-2"; "" for a bad index.
ACCESSVDB_API const char* accessvdb_rolling_lost_tile(const accessvdb_rolling* rolling,
                                                      size_t index) ACCESSVDB_C_NOEXCEPT;

/// Saves what changed since the last checkpoint, whole or not at all; resume goes on from here.
/// @param note  kept with it, for you, such as which files were read; NULL = empty
ACCESSVDB_API int accessvdb_rolling_checkpoint(accessvdb_rolling* rolling, const char* note) ACCESSVDB_C_NOEXCEPT;
/// Of the last checkpoint; "" if there is none, or for a bad handle.
ACCESSVDB_API const char* accessvdb_rolling_note(const accessvdb_rolling* rolling) ACCESSVDB_C_NOEXCEPT;
/// From now on tiles leave as if the limits were this share of themselves, 0 .. 1. No result depends on it.
ACCESSVDB_API int accessvdb_rolling_tighten(accessvdb_rolling* rolling, double share) ACCESSVDB_C_NOEXCEPT;
/// Updates, and writes a folder of tiles as `map --tiles` does, for `tile merge` and whatever reads such a folder.
ACCESSVDB_API int accessvdb_rolling_write(accessvdb_rolling* rolling, const char* folder) ACCESSVDB_C_NOEXCEPT;

#ifdef __cplusplus
}  // extern "C"
#endif

#endif  // ACCESSVDB_C_API_H
