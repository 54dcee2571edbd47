// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Included inside a namespace by normal_kernels.cpp, after surface_normal_body.h for kLanes doubles; hence no include
// guard.

inline void smallestEigenvectors(const kernels::Covariance* covariances, std::size_t count, float* normals) {
  for (std::size_t first = 0; first < count; first += kLanes) {
    const std::size_t left = count - first;
    alignas(64) double entries[6][kLanes];
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const kernels::Covariance& c = covariances[first + (lane < left ? lane : left - 1)];
      entries[0][lane] = c.xx, entries[1][lane] = c.xy, entries[2][lane] = c.xz;
      entries[3][lane] = c.yy, entries[4][lane] = c.yz, entries[5][lane] = c.zz;
    }
    const Real xy = load(entries[1]), xz = load(entries[2]), yz = load(entries[4]);
    Real a[3][3] = {{load(entries[0]), xy, xz}, {xy, load(entries[3]), yz}, {xz, yz, load(entries[5])}};
    Real vector[3];
    smallestOf(a, vector);
    alignas(64) float found[3][kLanes];
    for (int axis = 0; axis < 3; ++axis) storeFloats(found[axis], vector[axis]);
    for (std::size_t lane = 0; lane < kLanes && lane < left; ++lane) {
      for (std::size_t axis = 0; axis < 3; ++axis) normals[3 * (first + lane) + axis] = found[axis][lane];
    }
  }
}
