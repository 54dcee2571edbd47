// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Every instruction set finds what a plain loop finds; float32 stays within the bound that callers rely on.
#include "points/near_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::Random;

struct Cloud {
  NearPositions positions;
  std::vector<Eigen::Vector3f> p;

  Cloud(Random& random, std::size_t count, const Eigen::Vector3f& around, double half) {
    for (std::size_t n = 0; n < count; ++n) {
      p.push_back(around + random.point(half));
      positions.add(p.back().x(), p.back().y(), p.back().z());
    }
  }
};

double squaredDistance(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  return (a.cast<double>() - b.cast<double>()).squaredNorm();
}

class EveryNearKernel : public testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    const NearKernelList list = runnableNearKernels();
    if (GetParam() >= list.count) GTEST_SKIP() << "not on this machine";
    kernels = list.kernels[GetParam()];
  }
  const NearKernels* kernels = nullptr;
};

TEST_P(EveryNearKernel, FindsWhatIsWithinUpToTheSlack) {
  Random random(1);
  std::size_t found_total = 0, at_bound = 0;
  for (int trial = 0; trial < 400; ++trial) {
    // Up to ten thousand metres from the origin, and lengths with every remainder.
    const Eigen::Vector3f around = random.point(trial % 4 == 0 ? 1e4 : 5);
    const Cloud cloud(random, static_cast<std::size_t>(trial % 67), around, 0.5);
    const Eigen::Vector3f c = around + random.point(0.3);
    float squared = static_cast<float>(random.uniform(0, 0.3));
    // Every third bound is one of the distances.
    if (trial % 3 == 0 && !cloud.p.empty()) squared = static_cast<float>(squaredDistance(cloud.p.front(), c));
    std::vector<std::uint32_t> found(cloud.positions.lanes() + NearPositions::kLanes);
    const std::size_t count = kernels->within(cloud.positions.x(), cloud.positions.y(), cloud.positions.z(),
                                              cloud.positions.lanes(), c.data(), squared, found.data());
    found.resize(count);
    ASSERT_TRUE(std::is_sorted(found.begin(), found.end()));
    const double bound = static_cast<double>(squared), slack = static_cast<double>(kFloatSlack);
    for (std::uint32_t n = 0; n < cloud.p.size(); ++n) {
      const double exact = squaredDistance(cloud.p[n], c);
      const bool listed = std::binary_search(found.begin(), found.end(), n);
      if (listed) {
        ASSERT_LE(exact * (1 - slack), bound);
      } else {
        ASSERT_GE(exact * (1 + slack), bound);
      }
      at_bound += std::abs(exact - bound) <= slack * bound ? 1u : 0u;
    }
    if (count > 0) {
      ASSERT_LT(found.back(), cloud.p.size());  // the rest of the last lane is never found
    }
    ASSERT_EQ(kernels->any_within(cloud.positions.x(), cloud.positions.y(), cloud.positions.z(),
                                  cloud.positions.lanes(), c.data(), squared),
              count > 0);
    found_total += count;
  }
  EXPECT_GT(found_total, 1000u);
  EXPECT_GT(at_bound, 50u);
}

TEST_P(EveryNearKernel, EqualsThePlainOne) {
  const NearKernelList list = runnableNearKernels();
  const NearKernels& plain = *list.kernels[list.count - 1];
  Random random(2);
  for (int trial = 0; trial < 200; ++trial) {
    const Cloud cloud(random, static_cast<std::size_t>(random.between(1, 200)), random.point(3), 0.4);
    const Eigen::Vector3f c = random.point(3);
    const auto squared = static_cast<float>(random.uniform(0, 12));
    const auto list_of = [&](const NearKernels& set) {
      std::vector<std::uint32_t> found(cloud.positions.lanes() + NearPositions::kLanes);
      found.resize(set.within(cloud.positions.x(), cloud.positions.y(), cloud.positions.z(), cloud.positions.lanes(),
                              c.data(), squared, found.data()));
      return found;
    };
    ASSERT_EQ(list_of(*kernels), list_of(plain));
  }
}

INSTANTIATE_TEST_SUITE_P(Points, EveryNearKernel, testing::Values(0, 1, 2));

}  // namespace
}  // namespace accessvdb::internal
