// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Normal of a neighbourhood: eigenvector of the smallest eigenvalue of its covariance.
#pragma once

#include <cmath>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// Symmetric 3x3 matrix.
struct Covariance {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
};

/// One covariance at a time.
namespace one_normal {

using Real = double;
using Flag = bool;
ACCESSVDB_HOSTDEV inline Real real(double value) { return value; }
ACCESSVDB_HOSTDEV inline Real plus(Real x, Real y) { return x + y; }
ACCESSVDB_HOSTDEV inline Real minus(Real x, Real y) { return x - y; }
ACCESSVDB_HOSTDEV inline Real times(Real x, Real y) { return x * y; }
ACCESSVDB_HOSTDEV inline Real over(Real x, Real y) { return x / y; }
ACCESSVDB_HOSTDEV inline Real root(Real x) { return sqrt(x); }
ACCESSVDB_HOSTDEV inline Real negative(Real x) { return -x; }
ACCESSVDB_HOSTDEV inline Real magnitude(Real x) { return x < 0 ? -x : x; }
ACCESSVDB_HOSTDEV inline Real lower(Real x, Real y) { return x < y ? x : y; }
ACCESSVDB_HOSTDEV inline Real higher(Real x, Real y) { return x > y ? x : y; }
ACCESSVDB_HOSTDEV inline Flag isBelow(Real x, Real y) { return x < y; }
ACCESSVDB_HOSTDEV inline Flag atMost(Real x, Real y) { return x <= y; }
ACCESSVDB_HOSTDEV inline Flag differ(Real x, Real y) { return x != y; }
ACCESSVDB_HOSTDEV inline Real choose(Flag flag, Real yes, Real no) { return flag ? yes : no; }
ACCESSVDB_HOSTDEV inline bool areAll(Flag flag) { return flag; }
ACCESSVDB_HOSTDEV inline bool areNone(Flag flag) { return !flag; }
// Uses what is defined above.
#include "hostdev/surface_normal_body.h"

}  // namespace one_normal

/// @param normal  unit eigenvector of the smallest eigenvalue; for equal eigenvalues, of the lower axis
ACCESSVDB_HOSTDEV inline void smallestEigenvector(const Covariance& c, float* normal) {
  double a[3][3] = {{c.xx, c.xy, c.xz}, {c.xy, c.yy, c.yz}, {c.xz, c.yz, c.zz}}, vector[3];
  one_normal::smallestOf(a, vector);
  for (int k = 0; k < 3; ++k) normal[k] = static_cast<float>(vector[k]);
}

}  // namespace accessvdb::kernels
