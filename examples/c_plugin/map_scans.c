// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a plug-in does: loads the library at run time, checks its version, maps scans, reads labels.
///   map_scans_in_c libaccessvdb.so SCAN_FOLDER [VOXEL_M [OUT_FOLDER]]
/// The folder contains 000000.pcd, 000001.pcd, ... and poses.txt, as make_sample_scans writes them.
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "accessvdb/c_api.h"
#include "c_plugin/scan_files.h"

/// Every function that this plug-in uses, with its type in the header.
#define FUNCTIONS(X)                                                                                               \
  X(version)                                                                                                       \
  X(c_api_version)                                                                                                 \
  X(label_name)                                                                                                    \
  X(reason_name) X(tool_builtin) X(tool_free) X(params_defaults) X(field_create) X(field_free) X(field_error_text) \
      X(field_integrate_scan) X(field_update) X(field_take_snapshot) X(field_copy_points) X(field_get_counts)      \
          X(field_write)

#define DECLARE(name) __typeof__(accessvdb_##name)* name;
static struct { FUNCTIONS(DECLARE) } api;
#undef DECLARE

static int load_library(const char* path) {
  void* library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  if (library == NULL) {
    fprintf(stderr, "map_scans_in_c: %s\n", dlerror());
    return 0;
  }
  // POSIX allows a function pointer in a void*; C does not, hence the copy.
#define LOAD(name)                                                              \
  do {                                                                          \
    void* symbol = dlsym(library, "accessvdb_" #name);                          \
    if (symbol == NULL) {                                                       \
      fprintf(stderr, "map_scans_in_c: %s has no accessvdb_%s\n", path, #name); \
      return 0;                                                                 \
    }                                                                           \
    memcpy(&api.name, &symbol, sizeof symbol);                                  \
  } while (0);
  FUNCTIONS(LOAD)
#undef LOAD
  if (api.c_api_version() < ACCESSVDB_C_API_VERSION) {
    fprintf(stderr, "map_scans_in_c: the library is %s, older than this plug-in\n", api.version());
    return 0;
  }
  return 1;
}

/// Feeds every scan with a pose into the field. @return scans used, -1 after an error
static int integrate_folder(accessvdb_field* field, const char* folder) {
  char path[4096];
  size_t poses = 0;
  snprintf(path, sizeof path, "%s/poses.txt", folder);
  double* T_W_S = read_tum(path, &poses);
  int used = 0;
  for (size_t n = 0; n < poses; ++n) {
    size_t count = 0;
    snprintf(path, sizeof path, "%s/%06zu.pcd", folder, n);
    float* points_S = read_pcd(path, &count);
    if (points_S == NULL) {
      fprintf(stderr, "map_scans_in_c: %s: not a binary PCD with the fields x y z\n", path);
      used = -1;
      break;
    }
    accessvdb_frame_stats stats = {.struct_size = sizeof stats};
    const int code = api.field_integrate_scan(field, points_S, count, T_W_S + 16 * n, &stats);
    free(points_S);
    if (code != ACCESSVDB_OK) {
      fprintf(stderr, "map_scans_in_c: %s: %s\n", path, api.field_error_text(field));
      used = -1;
      break;
    }
    ++used;
  }
  free(T_W_S);
  return used;
}

/// Counts labels and reasons, and visits the points one by one, as a plug-in would.
static int print_labels(accessvdb_field* field) {
  size_t count = 0;
  accessvdb_counts counts = {.struct_size = sizeof counts};
  if (api.field_take_snapshot(field, &count) != ACCESSVDB_OK) return 0;
  if (api.field_get_counts(field, &counts) != ACCESSVDB_OK) return 0;
  accessvdb_point* points = calloc(count > 0 ? count : 1, sizeof *points);
  if (points == NULL) return 0;
  if (api.field_copy_points(field, 0, count, points, sizeof *points) != ACCESSVDB_OK) {
    free(points);
    return 0;
  }
  uint64_t seen[ACCESSVDB_NUM_LABELS] = {0};
  for (size_t n = 0; n < count; ++n) ++seen[points[n].label];
  free(points);
  printf("points %zu\n", count);
  for (int label = 0; label < ACCESSVDB_NUM_LABELS; ++label) {
    if (seen[label] != counts.labels[label]) return 0;
    printf("%s %llu\n", api.label_name(label), (unsigned long long)seen[label]);
  }
  for (int reason = 1; reason < ACCESSVDB_NUM_REASONS; ++reason) {
    printf("reason %s %llu\n", api.reason_name(reason), (unsigned long long)counts.reasons[reason]);
  }
  return 1;
}

int main(int argc, char** argv) {
  if (argc < 3) {
    fprintf(stderr, "usage: map_scans_in_c libaccessvdb.so SCAN_FOLDER [VOXEL_M [OUT_FOLDER]]\n");
    return ACCESSVDB_ERROR_USAGE;
  }
  if (!load_library(argv[1])) return ACCESSVDB_ERROR_INPUT;

  accessvdb_error error = {.struct_size = sizeof error};
  accessvdb_params params = {.struct_size = sizeof params};
  accessvdb_tool* tool = NULL;
  accessvdb_field* field = NULL;
  api.params_defaults(&params);
  params.voxel_size_m = argc > 3 ? atof(argv[3]) : 0.05;
  if (api.tool_builtin("builtin:pruner", &tool, &error) != ACCESSVDB_OK ||
      api.field_create(tool, &params, &field, &error) != ACCESSVDB_OK) {
    fprintf(stderr, "map_scans_in_c: %s\n", error.text);
    api.tool_free(tool);
    return error.code;
  }
  api.tool_free(tool);  // the field has its own copy

  int code = ACCESSVDB_ERROR_INPUT;
  const int scans = integrate_folder(field, argv[2]);
  if (scans > 0) {
    code = api.field_update(field, NULL);
    if (code == ACCESSVDB_OK) printf("library %s\nscans %d\n", api.version(), scans);
    if (code == ACCESSVDB_OK && !print_labels(field)) code = ACCESSVDB_ERROR_INTERNAL;
    if (code == ACCESSVDB_OK && argc > 4) code = api.field_write(field, argv[4]);
    if (code != ACCESSVDB_OK) fprintf(stderr, "map_scans_in_c: %s\n", api.field_error_text(field));
  } else if (scans == 0) {
    fprintf(stderr, "map_scans_in_c: %s: no scans\n", argv[2]);
  }
  api.field_free(field);
  return code;
}
