// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Every instruction set finds what a plain loop finds; float32 stays within the bound that callers rely on.
#include "points/near_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "hostdev/neighbour_rule.h"
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
    const KernelList<NearKernels> list = runnableNearKernels();
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
  const KernelList<NearKernels> list = runnableNearKernels();
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

/// Candidates around a centre, as a search lays them out, with what the rule says of each.
struct Candidates {
  std::vector<float> metres;
  std::vector<double> steps;
  std::vector<kernels::NeighbourOffset> offsets;
  OffsetArrays arrays;

  Candidates(Random& random, std::size_t count, const Eigen::Vector3f& c, double half, double steps_per_m)
      : metres(3 * (count + OffsetArrays::kPadded)), steps(4 * (count + OffsetArrays::kPadded), -1.0) {
    const std::size_t room = count + OffsetArrays::kPadded;
    arrays.count = count;
    arrays.x_m = metres.data(), arrays.y_m = arrays.x_m + room, arrays.z_m = arrays.y_m + room;
    arrays.x = steps.data(), arrays.y = arrays.x + room, arrays.z = arrays.y + room, arrays.squared = arrays.z + room;
    for (std::size_t n = 0; n < count; ++n) {
      const Eigen::Vector3f p = n == 0 ? c : Eigen::Vector3f(c + random.point(half));
      arrays.x_m[n] = p.x(), arrays.y_m[n] = p.y(), arrays.z_m[n] = p.z();
      offsets.push_back(kernels::neighbourOffset(c.data(), p.data(), steps_per_m));
    }
  }
};

TEST_P(EveryNearKernel, MeasuresAndSumsAsTheRuleDoes) {
  Random random(3);
  const double radius_m = 0.5, steps_per_m = kernels::neighbourStepsPerMetre(radius_m);
  for (int trial = 0; trial < 300; ++trial) {
    const Eigen::Vector3f c = random.point(trial % 4 == 0 ? 1e4 : 5);
    const auto count = static_cast<std::size_t>(trial % 131);
    const Candidates candidates(random, count, c, radius_m, steps_per_m);
    const OffsetArrays& arrays = candidates.arrays;
    kernels->measure(arrays, c.data(), steps_per_m);
    for (std::size_t n = 0; n < count; ++n) {
      const kernels::NeighbourOffset& offset = candidates.offsets[n];
      ASSERT_EQ(arrays.x[n], static_cast<double>(offset.x));
      ASSERT_EQ(arrays.y[n], static_cast<double>(offset.y));
      ASSERT_EQ(arrays.z[n], static_cast<double>(offset.z));
      ASSERT_EQ(arrays.squared[n], static_cast<double>(offset.squared()));
    }
    // Every third bound is one of the distances.
    auto most = static_cast<std::int64_t>(random.uniform(0, 1) *
                                          static_cast<double>(kernels::neighbourRadiusSquared(radius_m)));
    if (trial % 3 == 0 && count > 0) most = candidates.offsets[count / 2].squared();
    std::vector<std::uint32_t> expected;
    kernels::NeighbourSums sums;
    std::int64_t farthest = 0;
    for (std::uint32_t n = 0; n < count; ++n) {
      const kernels::NeighbourOffset& offset = candidates.offsets[n];
      if (offset.squared() > most) continue;
      expected.push_back(n);
      sums.add(offset);
      farthest = std::max(farthest, offset.squared());
    }
    std::vector<std::uint32_t> found(count);
    const auto bound = static_cast<double>(most);
    ASSERT_EQ(kernels->count_within(arrays, bound), expected.size());
    found.resize(kernels->list_within(arrays, bound, found.data()));
    ASSERT_EQ(found, expected);
    const OffsetSums of_kernel = kernels->sums_within(arrays, bound);
    const auto whole = [](double sum) { return static_cast<std::int64_t>(sum); };
    ASSERT_EQ(of_kernel.count, sums.count);
    ASSERT_EQ(whole(of_kernel.farthest), farthest);
    ASSERT_EQ((std::array{whole(of_kernel.x), whole(of_kernel.y), whole(of_kernel.z)}),
              (std::array{sums.x, sums.y, sums.z}));
    ASSERT_EQ((std::array{whole(of_kernel.xx), whole(of_kernel.xy), whole(of_kernel.xz), whole(of_kernel.yy),
                          whole(of_kernel.yz), whole(of_kernel.zz)}),
              (std::array{sums.xx, sums.xy, sums.xz, sums.yy, sums.yz, sums.zz}));
  }
}

INSTANTIATE_TEST_SUITE_P(Points, EveryNearKernel, testing::Values(0, 1, 2));

}  // namespace
}  // namespace accessvdb::internal
