// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Every instruction set gives the same bits, those of all sweeps.
#include "points/normal_kernels.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace accessvdb::internal {
namespace {

using kernels::Covariance;

/// Jacobi with all eight sweeps, one rotation after the other.
std::array<float, 3> afterAllSweeps(const Covariance& c) {
  double a[3][3] = {{c.xx, c.xy, c.xz}, {c.xy, c.yy, c.yz}, {c.xz, c.yz, c.zz}};
  double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int rotation = 0; rotation < 24; ++rotation) {
    const int p = rotation % 3 == 2 ? 1 : 0, q = rotation % 3 == 0 ? 1 : 2, r = 3 - p - q;
    const double apq = a[p][q];
    if (apq == 0) continue;
    const double theta = (a[q][q] - a[p][p]) / (2 * apq);
    double t = 0.5 / theta;
    if (!(std::abs(theta) > 1e150)) t = (theta < 0 ? -1.0 : 1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1));
    const double cosine = 1 / std::sqrt(t * t + 1), sine = t * cosine;
    a[p][p] -= t * apq;
    a[q][q] += t * apq;
    a[p][q] = a[q][p] = 0;
    const double arp = a[r][p], arq = a[r][q];
    a[r][p] = a[p][r] = cosine * arp - sine * arq;
    a[r][q] = a[q][r] = sine * arp + cosine * arq;
    for (auto& row : v) {
      const double vp = row[p], vq = row[q];
      row[p] = cosine * vp - sine * vq;
      row[q] = sine * vp + cosine * vq;
    }
  }
  int least = a[1][1] < a[0][0] ? 1 : 0;
  if (a[2][2] < a[least][least]) least = 2;
  const double length = std::sqrt(v[0][least] * v[0][least] + v[1][least] * v[1][least] + v[2][least] * v[2][least]);
  std::array<float, 3> normal;
  for (std::size_t k = 0; k < 3; ++k) normal[k] = static_cast<float>(v[k][least] / length);
  return normal;
}

/// Covariances of points in whole steps, as the neighbour search makes them: clouds, sheets, lines, and a few points on
/// a grid, where eigenvalues coincide.
std::vector<Covariance> someCovariances() {
  std::mt19937_64 random(3);
  std::normal_distribution<double> gauss;
  std::vector<Covariance> covariances(2);  // nothing known
  for (int n = 0; n < 100'003; ++n) {
    const int kind = n % 5, count = 3 + static_cast<int>(random() % 58);
    const double size = kind == 4 ? 1.5 : std::exp2(4 + static_cast<double>(random() % 16));
    const double yaw = kind == 4 ? 0 : gauss(random), pitch = kind >= 3 ? 0 : gauss(random);
    const double flat = kind == 0 ? 1 : std::pow(10, -3 * std::abs(gauss(random)));
    double s[9] = {};
    for (int p = 0; p < count; ++p) {
      const double x = size * gauss(random), y = size * gauss(random) * (kind == 2 ? flat : 1);
      const double z = kind == 3 ? 0 : size * gauss(random) * flat;
      const double turned = x * std::sin(yaw) + y * std::cos(yaw);
      const double at[3] = {std::round(x * std::cos(yaw) - y * std::sin(yaw)),
                            std::round(turned * std::cos(pitch) - z * std::sin(pitch)),
                            std::round(turned * std::sin(pitch) + z * std::cos(pitch))};
      for (int i = 0, entry = 3; i < 3; ++i) {
        s[i] += at[i];
        for (int j = i; j < 3; ++j) s[entry++] += at[i] * at[j];
      }
    }
    covariances.push_back({count * s[3] - s[0] * s[0], count * s[4] - s[0] * s[1], count * s[5] - s[0] * s[2],
                           count * s[6] - s[1] * s[1], count * s[7] - s[1] * s[2], count * s[8] - s[2] * s[2]});
  }
  return covariances;
}

TEST(NormalKernels, EveryInstructionSetGivesTheBitsOfAllSweeps) {
  const std::vector<Covariance> covariances = someCovariances();
  const KernelList<NormalKernels> list = runnableNormalKernels();
  for (int n = 0; n < list.count; ++n) {
    SCOPED_TRACE(list.kernels[static_cast<std::size_t>(n)]->name);
    std::vector<float> normals(3 * covariances.size());
    list.kernels[static_cast<std::size_t>(n)]->smallest_eigenvectors(covariances.data(), covariances.size(),
                                                                     normals.data());
    std::size_t wrong = 0;
    for (std::size_t c = 0; c < covariances.size(); ++c) {
      const std::array<float, 3> expected = afterAllSweeps(covariances[c]);
      for (std::size_t k = 0; k < 3; ++k) {
        wrong += std::bit_cast<std::uint32_t>(normals[3 * c + k]) != std::bit_cast<std::uint32_t>(expected[k]) ? 1 : 0;
      }
    }
    EXPECT_EQ(wrong, 0u);
  }
}

/// Normals are written for as many covariances as there are, not for as many as there are lanes.
TEST(NormalKernels, WriteNoMoreThanAsked) {
  const std::vector<Covariance> covariances(9, Covariance{1, 0, 0, 2, 0, 3});
  const KernelList<NormalKernels> list = runnableNormalKernels();
  for (int n = 0; n < list.count; ++n) {
    for (std::size_t count = 0; count <= covariances.size(); ++count) {
      std::vector<float> normals(3 * covariances.size() + 3, -7.0f);
      list.kernels[static_cast<std::size_t>(n)]->smallest_eigenvectors(covariances.data(), count, normals.data());
      for (std::size_t i = 0; i < normals.size(); ++i) {
        EXPECT_EQ(normals[i], i >= 3 * count ? -7.0f : i % 3 == 0 ? 1.0f : 0.0f);
      }
    }
  }
}

}  // namespace
}  // namespace accessvdb::internal
