// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is told of changes, once and not less than once.
#include "points/points_as_told.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <new>
#include <vector>

namespace accessvdb::internal {
namespace {

/// Points of which one may not be readable, as where memory runs out.
class SomePoints final : public SurfacePoints {
 public:
  /// As of a tile's points, without those of its margin.
  static std::uint32_t idAt(std::size_t n) { return static_cast<std::uint32_t>(2 * n + 5); }
  explicit SomePoints(std::size_t size) : points(size) {
    for (std::size_t n = 0; n < size; ++n) points[n].id = idAt(n);
  }
  [[nodiscard]] std::size_t size() const override { return points.size(); }
  [[nodiscard]] SurfacePoint at(std::size_t index) const override {
    if (index == fails_at) throw std::bad_alloc();
    return points[index];
  }
  [[nodiscard]] Eigen::Vector3d position_W(std::size_t index) const override { return points[index].position_W; }
  [[nodiscard]] Eigen::Vector3d origin_W() const override { return Eigen::Vector3d::Zero(); }
  [[nodiscard]] double voxel_size_m() const override { return 0.1; }

  /// Of all points, those of the margin included.
  [[nodiscard]] std::uint32_t count() const { return idAt(points.size()); }

  std::vector<SurfacePoint> points;
  std::size_t fails_at = ~std::size_t{0};
};

std::vector<std::uint32_t> placesOf(const std::vector<SurfacePoint>& points) {
  std::vector<std::uint32_t> ids;
  for (const SurfacePoint& point : points) ids.push_back((point.id - SomePoints::idAt(0)) / 2);
  return ids;
}

TEST(PointsAsTold, AreNotLostIfACallFails) {
  for (const bool several : {false, true}) {
    SCOPED_TRACE(several);
    SomePoints points(20000);
    PointsAsTold told(several);
    points.fails_at = 19999;
    EXPECT_THROW(static_cast<void>(told.since(points, points.count())), std::bad_alloc);
    points.fails_at = ~std::size_t{0};
    EXPECT_EQ(told.since(points, points.count()).size(), points.size());
    EXPECT_TRUE(told.since(points, points.count()).empty());

    // As where access is withdrawn; in several tasks, before and behind the one that fails.
    points.points[3].label = PointLabel::Blocked;
    points.points[9000].direction = 7;
    points.points[19998].tools = 2;  // only counts among several tools
    points.fails_at = 9001;
    EXPECT_THROW(static_cast<void>(told.since(points, points.count())), std::bad_alloc);
    points.fails_at = ~std::size_t{0};
    EXPECT_EQ(placesOf(told.since(points, points.count())),
              several ? (std::vector<std::uint32_t>{3, 9000, 19998}) : (std::vector<std::uint32_t>{3, 9000}));
    EXPECT_TRUE(told.since(points, points.count()).empty());
  }
}

}  // namespace
}  // namespace accessvdb::internal
