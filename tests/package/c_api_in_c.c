// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The C API used from C99: maps a wall, reads labels, and checks that invalid calls fail with their codes.
///   c_api_in_c OUT_FOLDER, which is new or empty
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "accessvdb/c_api.h"

static int failures = 0;

#define CHECK(condition)                                                      \
  do {                                                                        \
    if (!(condition)) {                                                       \
      fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #condition); \
      ++failures;                                                             \
    }                                                                         \
  } while (0)

enum { SIDE = 101, POINTS = SIDE * SIDE };

/// A wall at x = 2 m in front of the sensor. @param xyz  [3 x POINTS]
static void make_wall(float* xyz) {
  int row, column;
  for (row = 0; row < SIDE; ++row) {
    for (column = 0; column < SIDE; ++column) {
      float* p = xyz + 3 * (row * SIDE + column);
      p[0] = 2.0f;
      p[1] = -1.0f + 0.02f * (float)column;
      p[2] = -1.0f + 0.02f * (float)row;
    }
  }
}

static void check_points(accessvdb_field* field) {
  size_t count = 0, n;
  accessvdb_counts counts = {.struct_size = sizeof counts};
  CHECK(accessvdb_field_get_counts(field, &counts) == ACCESSVDB_ERROR_USAGE); /* no snapshot yet */
  CHECK(strcmp(accessvdb_field_error_id(field), "snapshot.none") == 0);
  CHECK(accessvdb_field_take_snapshot(field, &count) == ACCESSVDB_OK);
  CHECK(count > 500);
  CHECK(accessvdb_field_get_counts(field, &counts) == ACCESSVDB_OK);
  CHECK(counts.points == count);
  CHECK(counts.labels[ACCESSVDB_ACCESSIBLE] > 100);

  accessvdb_point* points = malloc(count * sizeof *points);
  CHECK(points != NULL);
  if (points == NULL) return;
  CHECK(accessvdb_field_copy_points(field, 0, count, points, sizeof *points) == ACCESSVDB_OK);
  uint64_t accessible = 0;
  for (n = 0; n < count; ++n) {
    CHECK(points[n].id == n);
    CHECK(fabs(points[n].position_W[0] - 2.0) < 1e-3);
    if (points[n].label != ACCESSVDB_ACCESSIBLE) continue;
    ++accessible;
    /* The wall is seen from x < 2, so that is where the tool's body must be: 70 degrees around -x. */
    CHECK(points[n].direction_W[0] < -0.3f);
    CHECK(points[n].reason == ACCESSVDB_REASON_NONE);
  }
  CHECK(accessible == counts.labels[ACCESSVDB_ACCESSIBLE]);

  accessvdb_point one;
  int32_t found = 0;
  CHECK(accessvdb_field_point_at(field, points[7].position_W, &one, sizeof one, &found) == ACCESSVDB_OK);
  CHECK(found == 1 && one.id == 7);
  const double nowhere[3] = {-5, 0, 0};
  CHECK(accessvdb_field_point_at(field, nowhere, &one, sizeof one, &found) == ACCESSVDB_OK);
  CHECK(found == 0);
  CHECK(accessvdb_field_copy_points(field, 1, count, points, sizeof *points) == ACCESSVDB_ERROR_USAGE);

  accessvdb_point_answer answer;
  CHECK(accessvdb_field_query_points(field, points[7].position_W, 1, &answer, sizeof answer) == ACCESSVDB_OK);
  CHECK(answer.point_id == 7 && answer.label == points[7].label && answer.weight > 0 && !answer.unknown);
  const accessvdb_capsule through = {{1.8, 0, 0}, {2.2, 0, 0}, 0.02};
  const accessvdb_capsule in_front = {{1.85, 0, 0}, {1.85, 0.1, 0}, 0.02};
  accessvdb_capsule_answer way;
  CHECK(accessvdb_field_query_capsules(field, &through, sizeof through, 1, &way, sizeof way) == ACCESSVDB_OK);
  CHECK(way.valid && way.collision && way.first_hit_t > 0.2f && way.first_hit_t < 0.6f);
  CHECK(accessvdb_field_query_capsules(field, &in_front, sizeof in_front, 1, &way, sizeof way) == ACCESSVDB_OK);
  CHECK(way.valid && !way.collision && !way.unknown);
  free(points);
}

static accessvdb_rolling* make_rolling(const char* folder, int resume, accessvdb_error* error) {
  accessvdb_tool* tool = NULL;
  accessvdb_rolling* rolling = NULL;
  accessvdb_params params = {.struct_size = sizeof params};
  const accessvdb_rolling_options options = {.struct_size = sizeof options,
                                             .folder = folder,
                                             .memory_limit_bytes = UINT64_C(1) << 32,
                                             .notes_changes = 1,
                                             .resume = resume};
  CHECK(accessvdb_tool_builtin("builtin:pencil", &tool, error) == ACCESSVDB_OK);
  CHECK(accessvdb_params_defaults(&params) == ACCESSVDB_OK);
  params.voxel_size_m = 0.05;
  const accessvdb_tool_spec specs[1] = {{.tool = tool}};
  (void)accessvdb_rolling_create(specs, sizeof specs[0], 1, &params, &options, &rolling, error);
  accessvdb_tool_free(tool);
  return rolling;
}

/// The same wall in a field of any extent, which goes on after a stop.
static void check_rolling(const float* wall_S, const char* out_folder) {
  char folder[4096], out[4096];
  accessvdb_error error = {.struct_size = sizeof error};
  accessvdb_frame_stats frame = {.struct_size = sizeof frame};
  accessvdb_update_stats update = {.struct_size = sizeof update};
  accessvdb_rolling_status status = {.struct_size = sizeof status};
  accessvdb_point point;
  const double T_W_S[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  const double ray_W[3] = {2, 0, 0}, sensor_W[3] = {0, 0, 0}, behind_W[3] = {-5, 0, 0};
  size_t count = 0, changed = 0, near = 0;
  int32_t found = 1;
  snprintf(folder, sizeof folder, "%s/rolling", out_folder);
  snprintf(out, sizeof out, "%s/tiles", out_folder);

  CHECK(accessvdb_rolling_has_checkpoint(folder, &found, &error) == ACCESSVDB_OK && found == 0);
  CHECK(make_rolling(folder, 1, &error) == NULL && error.code == ACCESSVDB_ERROR_INPUT);
  CHECK(strcmp(error.id, "rolling.missing") == 0);
  accessvdb_rolling* rolling = make_rolling(folder, 0, &error);
  CHECK(rolling != NULL);
  if (rolling == NULL) return;
  CHECK(accessvdb_rolling_copy_points(rolling, 0, 1, &point, sizeof point) == ACCESSVDB_ERROR_USAGE);
  CHECK(strcmp(accessvdb_rolling_error_id(rolling), "snapshot.none") == 0);
  CHECK(strlen(accessvdb_rolling_error_text(rolling)) > 10);
  CHECK(accessvdb_rolling_integrate_scan_at(rolling, wall_S, POINTS, T_W_S, 0.0, &frame) == ACCESSVDB_OK);
  CHECK(frame.points_used == POINTS);
  CHECK(accessvdb_rolling_integrate_rays_at(rolling, ray_W, 1, sensor_W, 1, NAN, NULL) == ACCESSVDB_OK);
  CHECK(accessvdb_rolling_leave_out(rolling, behind_W, 1, 0.2) == ACCESSVDB_OK);
  CHECK(accessvdb_rolling_tighten(rolling, 0.9) == ACCESSVDB_OK);
  CHECK(accessvdb_rolling_update(rolling, &update) == ACCESSVDB_OK && update.scored_points > 0);
  CHECK(accessvdb_rolling_take_snapshot_in_memory(rolling, &near) == ACCESSVDB_OK);
  CHECK(accessvdb_rolling_take_snapshot(rolling, &count) == ACCESSVDB_OK && count == near && count > 500);
  CHECK(accessvdb_rolling_copy_points(rolling, 7, 1, &point, sizeof point) == ACCESSVDB_OK && point.id == 7);
  CHECK(accessvdb_rolling_drop_snapshot(rolling) == ACCESSVDB_OK);
  CHECK(accessvdb_rolling_take_changed(rolling, &changed) == ACCESSVDB_OK && changed == count);
  CHECK(accessvdb_rolling_copy_changed(rolling, 7, 1, &point, sizeof point) == ACCESSVDB_OK && point.id == 7);
  CHECK(accessvdb_rolling_get_status(rolling, &status) == ACCESSVDB_OK);
  CHECK(status.steps == 2 && status.points == count && status.tiles == status.tiles_in_memory);
  CHECK(status.memory_bytes > 0 && !status.memory_short && status.lost_tile_count == 0);
  CHECK(strcmp(accessvdb_rolling_lost_tile(rolling, 0), "") == 0);
  CHECK(accessvdb_rolling_checkpoint(rolling, "one wall") == ACCESSVDB_OK);
  CHECK(accessvdb_rolling_write(rolling, out) == ACCESSVDB_OK);
  accessvdb_rolling_free(rolling);

  CHECK(accessvdb_rolling_has_checkpoint(folder, &found, &error) == ACCESSVDB_OK && found == 1);
  CHECK(make_rolling(folder, 0, &error) == NULL && error.code == ACCESSVDB_ERROR_OUTPUT);
  rolling = make_rolling(folder, 1, &error);
  CHECK(rolling != NULL && strcmp(accessvdb_rolling_note(rolling), "one wall") == 0);
  CHECK(accessvdb_rolling_get_status(rolling, &status) == ACCESSVDB_OK && status.points == count);
  accessvdb_rolling_free(rolling);
}

int main(int argc, char** argv) {
  accessvdb_error error = {.struct_size = sizeof error};
  accessvdb_params params = {.struct_size = sizeof params};
  accessvdb_tool* tool = NULL;
  accessvdb_field* field = NULL;
  static float wall_S[3 * POINTS];
  int scan;

  CHECK(accessvdb_c_api_version() == ACCESSVDB_C_API_VERSION);
  CHECK(strchr(accessvdb_version(), '.') != NULL);
  CHECK(strcmp(accessvdb_label_name(ACCESSVDB_BLOCKED), "blocked") == 0);
  CHECK(strcmp(accessvdb_reason_name(ACCESSVDB_REASON_ARM), "arm") == 0);
  CHECK(strcmp(accessvdb_reason_name(-1), "?") == 0);

  CHECK(accessvdb_tool_builtin("builtin:spoon", &tool, &error) == ACCESSVDB_ERROR_USAGE);
  CHECK(tool == NULL && error.code == ACCESSVDB_ERROR_USAGE && strstr(error.text, "spoon") != NULL);
  CHECK(accessvdb_tool_builtin("builtin:pencil", &tool, &error) == ACCESSVDB_OK);
  CHECK(accessvdb_params_defaults(&params) == ACCESSVDB_OK);
  params.voxel_size_m = 0;
  CHECK(accessvdb_field_create(tool, &params, &field, &error) == ACCESSVDB_ERROR_USAGE);
  CHECK(field == NULL && strstr(error.text, "voxel_size_m") != NULL);
  params.voxel_size_m = 0.05;
  CHECK(accessvdb_field_create(tool, &params, &field, &error) == ACCESSVDB_OK);
  accessvdb_tool_free(tool);
  if (field == NULL) return 1;

  make_wall(wall_S);
  for (scan = 0; scan < 4; ++scan) {
    const double T_W_S[16] = {1, 0, 0, 0, 0, 1, 0, 0.05 * scan, 0, 0, 1, 0, 0, 0, 0, 1};
    accessvdb_frame_stats stats = {.struct_size = sizeof stats};
    CHECK(accessvdb_field_integrate_scan(field, wall_S, POINTS, T_W_S, &stats) == ACCESSVDB_OK);
    CHECK(stats.points_used == POINTS);
  }
  accessvdb_update_stats update = {.struct_size = sizeof update};
  CHECK(accessvdb_field_update(field, &update) == ACCESSVDB_OK);
  CHECK(update.scored_points > 0 && update.backlog == 0);
  check_points(field);
  accessvdb_update* running = NULL;
  CHECK(accessvdb_field_update_async(field, &running) == ACCESSVDB_OK);
  CHECK(accessvdb_update_wait(running, &update) == ACCESSVDB_OK && update.scored_points == 0);
  accessvdb_update_free(running);
  if (argc > 1) {
    CHECK(accessvdb_field_write(field, argv[1]) == ACCESSVDB_OK);
    check_rolling(wall_S, argv[1]);
  }
  accessvdb_field_free(field);

  if (failures == 0) puts("all well");
  return failures == 0 ? 0 : 1;
}
