// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The two formats that make_sample_scans writes, read without any library.
#ifndef C_PLUGIN_SCAN_FILES_H
#define C_PLUGIN_SCAN_FILES_H

#include <stddef.h>

/// Reads a binary PCD whose fields are x y z float32. @return [3 x *count] to be freed, NULL if it cannot be read
float* read_pcd(const char* path, size_t* count);

/// Reads a TUM file: "t x y z qx qy qz qw" per line, sensor to world. @return [16 x *count] 4x4 matrices, row-major
double* read_tum(const char* path, size_t* count);

#endif
