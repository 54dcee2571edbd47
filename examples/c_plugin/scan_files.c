// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "c_plugin/scan_files.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

float* read_pcd(const char* path, size_t* count) {
  FILE* file = fopen(path, "rb");
  if (file == NULL) return NULL;
  char line[256];
  unsigned long points = 0;
  int plain = 0, binary = 0;
  while (!binary && fgets(line, sizeof line, file) != NULL) {
    if (strcmp(line, "FIELDS x y z\n") == 0) plain = 1;
    if (strncmp(line, "POINTS ", 7) == 0) points = strtoul(line + 7, NULL, 10);
    if (strncmp(line, "DATA ", 5) == 0) {
      if (strcmp(line, "DATA binary\n") != 0) break;
      binary = 1;
    }
  }
  float* xyz = NULL;
  if (plain && binary && points > 0 && points < 100000000ul) xyz = malloc(points * 3 * sizeof *xyz);
  if (xyz != NULL && fread(xyz, 3 * sizeof *xyz, points, file) != points) {
    free(xyz);
    xyz = NULL;
  }
  fclose(file);
  if (xyz != NULL) *count = points;
  return xyz;
}

/// Position and unit quaternion to a 4x4 matrix.
static void pose_matrix(const double* t, const double* q, double* T) {
  const double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const double x = q[0] / norm, y = q[1] / norm, z = q[2] / norm, w = q[3] / norm;
  const double rows[16] = {1 - 2 * (y * y + z * z),
                           2 * (x * y - z * w),
                           2 * (x * z + y * w),
                           t[0],
                           2 * (x * y + z * w),
                           1 - 2 * (x * x + z * z),
                           2 * (y * z - x * w),
                           t[1],
                           2 * (x * z - y * w),
                           2 * (y * z + x * w),
                           1 - 2 * (x * x + y * y),
                           t[2],
                           0,
                           0,
                           0,
                           1};
  memcpy(T, rows, sizeof rows);
}

double* read_tum(const char* path, size_t* count) {
  FILE* file = fopen(path, "r");
  if (file == NULL) return NULL;
  char line[512];
  size_t poses = 0, room = 0;
  double* matrices = NULL;
  while (fgets(line, sizeof line, file) != NULL) {
    double stamp, t[3], q[4];
    if (line[0] == '#') continue;
    if (sscanf(line, "%lf %lf %lf %lf %lf %lf %lf %lf", &stamp, &t[0], &t[1], &t[2], &q[0], &q[1], &q[2], &q[3]) != 8) {
      continue;
    }
    if (poses == room) {
      room = room == 0 ? 64 : 2 * room;
      double* larger = realloc(matrices, room * 16 * sizeof *matrices);
      if (larger == NULL) break;
      matrices = larger;
    }
    pose_matrix(t, q, matrices + 16 * poses++);
  }
  fclose(file);
  *count = poses;
  return matrices;
}
