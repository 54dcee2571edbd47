// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What points were seen from in more directions than a mask holds: slice by slice the masks of stores with fewer.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <vector>

#include "points/neighbourhood.h"
#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kSlice = 250;

/// The same returns for a store of all axes, and for one of each slice of them.
class WideAndNarrow {
 public:
  WideAndNarrow(test::Random& random, std::size_t directions)
      : params_(test::pointParams(0.05)), wide_(params_, {{}, axesOf(random, directions)}) {
    for (std::size_t first = 0; first < directions; first += kSlice) {
      const auto begin = axes_.begin() + static_cast<std::ptrdiff_t>(3 * first);
      const auto end = axes_.begin() + static_cast<std::ptrdiff_t>(3 * std::min(first + kSlice, directions));
      slices_.emplace_back(params_, kernels::DirectionTable{{}, {begin, end}});
    }
  }
  void add(const std::vector<Eigen::Vector3f>& p, const std::vector<Eigen::Vector3f>& q) {
    const std::vector<std::uint8_t> changed = wide_.addReturns(p, q).views_changed;
    std::vector<std::uint8_t> expected(changed.size(), 0);
    for (PointStore& slice : slices_) {
      const TouchedPoints& touched = slice.addReturns(p, q);
      for (std::size_t n = 0; n < expected.size(); ++n) expected[n] |= touched.views_changed[n];
    }
    EXPECT_EQ(changed, expected);
    joined_.resize(wide_.size() * static_cast<std::size_t>(wide_.directionWords()));
  }
  /// @return how many joined views of the ids changed
  std::size_t expectJoined(const std::vector<std::uint32_t>& ids) {
    const auto words = static_cast<std::size_t>(wide_.directionWords());
    const std::vector<std::uint64_t> before = joined_;
    std::vector<Neighbourhood> found(ids.size()), of_slice(ids.size());
    NeighbourhoodSearch(wide_, params_).compute(ids, found, joined_.data());
    std::vector<std::vector<bool>> expected(ids.size());
    for (const PointStore& slice : slices_) {
      NeighbourhoodSearch(slice, params_).compute(ids, of_slice);
      for (std::size_t n = 0; n < ids.size(); ++n) {
        EXPECT_EQ(found[n].normal_L, of_slice[n].normal_L);
        for (int d = 0; d < slice.numDirections(); ++d) expected[n].push_back(of_slice[n].seen.test(d));
      }
    }
    std::size_t changes = 0;
    for (std::size_t n = 0; n < ids.size(); ++n) {
      bool changed = false;
      for (std::size_t d = 0; d < 64 * words; ++d) {
        const auto bitIn = [&](const std::vector<std::uint64_t>& all) {
          return (all[ids[n] * words + d / 64] >> (d % 64) & 1) != 0;
        };
        EXPECT_EQ(bitIn(joined_), d < expected[n].size() && expected[n][d]) << ids[n] << ", direction " << d;
        changed = changed || bitIn(joined_) != bitIn(before);
      }
      EXPECT_EQ(found[n].wide_views_changed, changed) << ids[n];
      changes += changed ? 1 : 0;
      if (testing::Test::HasFailure()) break;
    }
    return changes;
  }
  [[nodiscard]] const PointStore& wide() const { return wide_; }
  [[nodiscard]] PointStore fresh() const { return PointStore(params_, {{}, axes_}); }

 private:
  const std::vector<float>& axesOf(test::Random& random, std::size_t directions) {
    while (axes_.size() < 3 * directions) {
      const Eigen::Vector3f axis = random.point(1);
      if (!(axis.norm() > 0.1f)) continue;
      for (const float x : axis.normalized()) axes_.push_back(x);
    }
    return axes_;
  }

  FieldParams params_;
  std::vector<float> axes_;
  PointStore wide_;
  std::vector<PointStore> slices_;
  std::vector<std::uint64_t> joined_;
};

TEST(WideViews, AreThoseOfTheSlices) {
  for (const std::size_t directions : {257u, 320u, 1000u}) {
    SCOPED_TRACE(directions);
    test::Random random(directions);
    WideAndNarrow stores(random, directions);
    std::vector<Eigen::Vector3f> p;
    for (int n = 0; n < 400; ++n) p.push_back(random.point(0.4));
    const auto sensors = [&] {
      std::vector<Eigen::Vector3f> q;
      const Eigen::Vector3f middle = random.point(3);
      for (std::size_t n = 0; n < p.size(); ++n) q.push_back(middle);
      return q;
    };
    stores.add(p, sensors());
    std::vector<std::uint32_t> ids(stores.wide().size());
    std::iota(ids.begin(), ids.end(), 0u);
    EXPECT_EQ(stores.expectJoined(ids), ids.size());
    EXPECT_EQ(stores.expectJoined(ids), 0u);
    // Some points, from another side: those and their neighbours change, and no others.
    p.resize(12);
    stores.add(p, sensors());
    const std::size_t changed = stores.expectJoined(ids);
    EXPECT_GT(changed, 12u);
    EXPECT_LT(changed, ids.size());

    // A store that is restored from what is stored of the points has the same views.
    PointStore again = stores.fresh();
    std::vector<StoredPoint> stored;
    for (const std::uint32_t id : ids) stored.push_back(stores.wide().stored(id));
    ASSERT_TRUE(again.restore(stored));
    for (const std::uint32_t id : ids) EXPECT_EQ(again.stored(id).seen.wide, stored[id].seen.wide);
    // A direction beyond the set, or too few words, is no point of such a store.
    if (directions % 64 != 0) stored[5].seen.wide.back() |= std::uint64_t{1} << 63;
    if (directions % 64 == 0) stored[5].seen.wide.pop_back();
    PointStore refusing = stores.fresh();
    EXPECT_FALSE(refusing.restore(stored));
  }
}

}  // namespace
}  // namespace accessvdb::internal
