// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A program as it was built against version 2 of the C API: with the header of that time, beside this file. It must run
/// with every later library, unchanged.
#include <stdio.h>
#include <stdlib.h>

#include "c_api.h"

#if ACCESSVDB_C_API_VERSION != 2
#error "this is not the header of version 2"
#endif

static int failures = 0;

#define CHECK(condition)                                                      \
  do {                                                                        \
    if (!(condition)) {                                                       \
      fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #condition); \
      ++failures;                                                             \
    }                                                                         \
  } while (0)

enum { SIDE = 101, POINTS = SIDE * SIDE };

int main(void) {
  static float wall_S[3 * POINTS];
  const double T_W_S[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  accessvdb_error error = {.struct_size = sizeof error};
  accessvdb_params params = {.struct_size = sizeof params};
  accessvdb_frame_stats frame = {.struct_size = sizeof frame};
  accessvdb_update_stats update = {.struct_size = sizeof update};
  accessvdb_counts counts = {.struct_size = sizeof counts};
  accessvdb_tool* tool = NULL;
  accessvdb_field* field = NULL;
  size_t count = 0;
  int n;

  CHECK(accessvdb_c_api_version() >= ACCESSVDB_C_API_VERSION);
  CHECK(accessvdb_tool_builtin("builtin:pencil", &tool, &error) == ACCESSVDB_OK);
  CHECK(accessvdb_params_defaults(&params) == ACCESSVDB_OK);
  params.voxel_size_m = 0.05;
  CHECK(accessvdb_field_create(tool, &params, &field, &error) == ACCESSVDB_OK);
  accessvdb_tool_free(tool);
  if (field == NULL) return 1;
  for (n = 0; n < POINTS; ++n) { /* a wall at x = 2 m */
    wall_S[3 * n] = 2.0f;
    wall_S[3 * n + 1] = -1.0f + 0.02f * (float)(n % SIDE);
    wall_S[3 * n + 2] = -1.0f + 0.02f * (float)(n / SIDE);
  }
  for (n = 0; n < 4; ++n) {
    CHECK(accessvdb_field_integrate_scan(field, wall_S, POINTS, T_W_S, &frame) == ACCESSVDB_OK);
    CHECK(frame.points_in == POINTS && frame.points_used == POINTS && frame.touched_leaves > 0);
    CHECK(frame.struct_size == sizeof frame);
  }
  CHECK(accessvdb_field_update(field, &update) == ACCESSVDB_OK);
  CHECK(update.scored_points > 500 && update.label_changes > 500 && update.backlog == 0);
  CHECK(update.struct_size == sizeof update);
  CHECK(accessvdb_field_take_snapshot(field, &count) == ACCESSVDB_OK);
  CHECK(accessvdb_field_get_counts(field, &counts) == ACCESSVDB_OK);
  CHECK(counts.points == count && counts.labels[ACCESSVDB_ACCESSIBLE] > 500);
  CHECK(counts.labels[0] + counts.labels[1] + counts.labels[2] == count);
  accessvdb_point* points = malloc((count + 1) * sizeof *points);
  if (points == NULL) return 1;
  points[count].id = 12345; /* the library must write neither more points nor longer ones */
  CHECK(accessvdb_field_copy_points(field, 0, count, points, sizeof *points) == ACCESSVDB_OK);
  CHECK(points[0].id == 0 && points[count - 1].id == count - 1 && points[count].id == 12345);
  accessvdb_point_answer answer;
  CHECK(accessvdb_field_query_points(field, points[7].position_W, 1, &answer, sizeof answer) == ACCESSVDB_OK);
  CHECK(answer.point_id == 7 && answer.label == points[7].label);
  free(points);
  accessvdb_field_free(field);
  if (failures == 0) puts("all well");
  return failures == 0 ? 0 : 1;
}
