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

/// Cyclic Jacobi with a fixed number of sweeps: the same operations on every machine, only +, -, *, / and sqrt.
/// @param normal  unit eigenvector of the smallest eigenvalue; for equal eigenvalues, of the lower axis
ACCESSVDB_HOSTDEV inline void smallestEigenvector(const Covariance& c, float* normal) {
  double a[3][3] = {{c.xx, c.xy, c.xz}, {c.xy, c.yy, c.yz}, {c.xz, c.yz, c.zz}};
  double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  constexpr int kSweeps = 8;  // quadratic convergence: 5 sweeps reach double precision
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (int p = 0; p < 2; ++p) {
      for (int q = p + 1; q < 3; ++q) {
        if (a[p][q] == 0) continue;
        const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
        const double sign = theta < 0 ? -1.0 : 1.0;
        const double magnitude = theta < 0 ? -theta : theta;
        const double t = magnitude > 1e150 ? 0.5 / theta : sign / (magnitude + sqrt(theta * theta + 1));
        const double cosine = 1 / sqrt(t * t + 1), sine = t * cosine;
        const int r = 3 - p - q;
        const double apq = a[p][q];
        a[p][p] -= t * apq;
        a[q][q] += t * apq;
        a[p][q] = a[q][p] = 0;
        const double arp = a[r][p], arq = a[r][q];
        a[r][p] = a[p][r] = cosine * arp - sine * arq;
        a[r][q] = a[q][r] = sine * arp + cosine * arq;
        for (int k = 0; k < 3; ++k) {
          const double vkp = v[k][p], vkq = v[k][q];
          v[k][p] = cosine * vkp - sine * vkq;
          v[k][q] = sine * vkp + cosine * vkq;
        }
      }
    }
  }
  int least = 0;
  if (a[1][1] < a[least][least]) least = 1;
  if (a[2][2] < a[least][least]) least = 2;
  const double length = sqrt(v[0][least] * v[0][least] + v[1][least] * v[1][least] + v[2][least] * v[2][least]);
  for (int k = 0; k < 3; ++k) normal[k] = static_cast<float>(v[k][least] / length);
}

}  // namespace accessvdb::kernels
