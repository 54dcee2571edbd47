// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "hostdev/surface_normal.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <random>

namespace accessvdb::test {
namespace {

Eigen::Vector3d smallest(const Eigen::Matrix3d& m) {
  const kernels::Covariance c = {m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)};
  Eigen::Vector3f normal;
  kernels::smallestEigenvector(c, normal.data());
  return normal.cast<double>();
}

/// Random clouds of points of all shapes and sizes. An eigenvector's error is about 1e-16 x (greatest / gap): below
/// float32's rounding (6e-8 per component) if the relative gap exceeds 1e-7.
TEST(SmallestEigenvector, EqualsEigenOnRandomCovariances) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> gauss;
  int compared = 0;
  for (int n = 0; n < 20000; ++n) {
    const double size = std::pow(10.0, gauss(random) * 3);
    const Eigen::Vector3d shape(1, std::pow(10.0, -std::abs(gauss(random)) * 2),
                                std::pow(10.0, -std::abs(gauss(random)) * 2));
    const Eigen::Matrix3d turn =
        Eigen::Quaterniond(gauss(random), gauss(random), gauss(random), gauss(random)).normalized().toRotationMatrix();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (int p = 0; p < 3 + n % 20; ++p) {
      const Eigen::Vector3d x =
          size * (turn * shape.cwiseProduct(Eigen::Vector3d(gauss(random), gauss(random), gauss(random))));
      covariance += x * x.transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
    const Eigen::Vector3d values = solver.eigenvalues(), normal = smallest(covariance);
    ASSERT_NEAR(normal.norm(), 1, 2e-7);
    if (values[1] - values[0] < 1e-7 * values[2]) continue;
    ++compared;
    ASSERT_LT(normal.cross(solver.eigenvectors().col(0)).norm(), 3e-7) << covariance;
  }
  EXPECT_GT(compared, 15000);
}

/// If eigenvalues coincide, any vector of the space is valid: it must have the least Rayleigh quotient.
TEST(SmallestEigenvector, DegenerateCasesGiveAUnitVectorOfTheLeastSpace) {
  std::mt19937_64 random(6);
  std::normal_distribution<double> gauss;
  for (int n = 0; n < 2000; ++n) {
    const Eigen::Matrix3d turn =
        Eigen::Quaterniond(gauss(random), gauss(random), gauss(random), gauss(random)).normalized().toRotationMatrix();
    const Eigen::Vector3d values = n % 3 == 0   ? Eigen::Vector3d(0, 0, 1)   // a line
                                   : n % 3 == 1 ? Eigen::Vector3d(1, 1, 1)   // a ball
                                                : Eigen::Vector3d(0, 1, 1);  // a disk
    const Eigen::Matrix3d m = turn * values.asDiagonal() * turn.transpose();
    const Eigen::Vector3d normal = smallest(0.5 * (m + m.transpose()));
    ASSERT_NEAR(normal.norm(), 1, 2e-7);
    ASSERT_NEAR(normal.dot(m * normal), values[0], 1e-6);
  }
}

TEST(SmallestEigenvector, ExactCases) {
  EXPECT_EQ(smallest(Eigen::Matrix3d::Zero()), Eigen::Vector3d(1, 0, 0));  // nothing known: the lower axis
  EXPECT_EQ(smallest(Eigen::Matrix3d::Identity()), Eigen::Vector3d(1, 0, 0));
  EXPECT_EQ(smallest(Eigen::Vector3d(2, 1, 1).asDiagonal().toDenseMatrix()), Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(smallest(Eigen::Vector3d(3, 2, 1).asDiagonal().toDenseMatrix()), Eigen::Vector3d(0, 0, 1));
  Eigen::Matrix3d tiny = Eigen::Matrix3d::Identity() * 1e-300;
  tiny(2, 2) = 0;
  EXPECT_EQ(smallest(tiny), Eigen::Vector3d(0, 0, 1));
}

}  // namespace
}  // namespace accessvdb::test
