// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/lidar_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>

#include "accessvdb/error.h"
#include "sim/halton.h"

namespace accessvdb::sim {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// The textbook's loop: digit after digit, each worth 1 / base of the one before.
double textbookHalton(std::uint64_t index, unsigned base) {
  double value = 0, worth = 1;
  while (index > 0) {
    worth /= base;
    value += worth * static_cast<double>(index % base);
    index /= base;
  }
  return value;
}

double azimuth(const Eigen::Vector3f& d) {
  const double angle = std::atan2(static_cast<double>(d.y()), static_cast<double>(d.x()));
  return angle < -1e-9 ? angle + 2 * std::numbers::pi : angle;
}
double elevation(const Eigen::Vector3f& d) { return std::asin(static_cast<double>(d.z())); }

TEST(Halton, FirstElementsAndFarOnes) {
  const double base2[] = {0, 1.0 / 2, 1.0 / 4, 3.0 / 4, 1.0 / 8, 5.0 / 8};
  const double base3[] = {0, 1.0 / 3, 2.0 / 3, 1.0 / 9, 4.0 / 9, 7.0 / 9};
  for (std::uint64_t i = 0; i < 6; ++i) {
    EXPECT_DOUBLE_EQ(radicalInverse<2>(i), base2[i]);
    EXPECT_DOUBLE_EQ(radicalInverse<3>(i), base3[i]);
  }
  for (std::uint64_t i : {999ull, 20'000ull, 19'999'999ull, 20'000'000'000ull, 19'999'999'999'999ull}) {
    EXPECT_NEAR(radicalInverse<2>(i), textbookHalton(i, 2), 1e-15);
    EXPECT_NEAR(radicalInverse<3>(i), textbookHalton(i, 3), 1e-15);
  }
}

TEST(LidarModel, Mid360RunsThroughTheSequenceFromFrameToFrame) {
  const LidarModel model = LidarModel::named("mid360");
  ASSERT_EQ(model.rays_per_frame, 20000);
  for (const std::uint64_t frame : {0ull, 1ull, 999ull}) {
    for (const int ray : {0, 1, 2, 17, 12345, 19999}) {
      const std::uint64_t index = frame * 20000 + static_cast<std::uint64_t>(ray) + 1;
      const Eigen::Vector3f d = rayDirection_S(model, frame, ray);
      EXPECT_NEAR(d.norm(), 1, 2e-7);
      EXPECT_NEAR(azimuth(d), 2 * std::numbers::pi * textbookHalton(index, 2), 1e-6);
      EXPECT_NEAR(elevation(d), (-7 + 59 * textbookHalton(index, 3)) * kDegree, 1e-6);
    }
  }
}

TEST(LidarModel, Mid360FillsItsViewEvenlyAndNeverRepeats) {
  const LidarModel model = LidarModel::named("mid360");
  int cells[36][59] = {};
  std::set<std::pair<float, float>> seen;
  for (std::uint64_t frame = 0; frame < 3; ++frame) {
    for (int ray = 0; ray < model.rays_per_frame; ++ray) {
      const Eigen::Vector3f d = rayDirection_S(model, frame, ray);
      const double e = elevation(d) / kDegree;
      ASSERT_GE(e, -7 - 1e-4);
      ASSERT_LE(e, 52 + 1e-4);
      ++cells[std::min(35, static_cast<int>(azimuth(d) / (10 * kDegree)))][std::clamp(static_cast<int>(e + 7), 0, 58)];
      seen.insert({d.x(), d.z()});
    }
  }
  // 60 000 / (36 * 59) = 28.2 per cell; a low-discrepancy sequence stays within a few of that, random points would not.
  for (const auto& column : cells) {
    for (const int count : column) EXPECT_NEAR(count, 28.2, 7);
  }
  EXPECT_GT(seen.size(), 59'900u) << "some rays were repeated";
  EXPECT_NEAR(model.middleElevation_rad(), 22.5 * kDegree, 1e-12);
}

TEST(LidarModel, SpinningHasSixtyFourRingsOfEvenColumns) {
  const LidarModel model = LidarModel::named("spinning");
  ASSERT_EQ(model.rays_per_frame, 64 * 1024);
  std::set<long> rings, columns;
  for (int ray = 0; ray < model.rays_per_frame; ++ray) {
    const Eigen::Vector3f d = rayDirection_S(model, 0, ray);
    const double ring = (elevation(d) / kDegree + 22.5) / (45.0 / 63),
                 column = azimuth(d) / (2 * std::numbers::pi / 1024);
    ASSERT_NEAR(ring, std::round(ring), 1e-4);
    ASSERT_NEAR(column, std::round(column), 1e-3);
    rings.insert(std::lround(ring));
    columns.insert(std::lround(column) % 1024);
    ASSERT_EQ(d, rayDirection_S(model, 7, ray)) << "its grid is the same in every turn";
  }
  EXPECT_EQ(rings.size(), 64u);
  EXPECT_EQ(*rings.begin(), 0);
  EXPECT_EQ(*rings.rbegin(), 63);
  EXPECT_EQ(columns.size(), 1024u);
}

TEST(LidarModel, RefusesWhatIsNoSensor) {
  EXPECT_THROW((void)LidarModel::named("mid70"), InvalidArgument);
  const auto refused = [](auto change) {
    LidarModel model;
    change(model);
    EXPECT_THROW(model.validate(), InvalidArgument);
  };
  EXPECT_NO_THROW(LidarModel().validate());
  refused([](LidarModel& m) { m.rays_per_frame = 0; });
  refused([](LidarModel& m) { m.range_noise_m = -0.1; });
  refused([](LidarModel& m) { m.range_noise_m = std::nan(""); });
  refused([](LidarModel& m) { m.dropout = 1.5; });
  refused([](LidarModel& m) { m.dropout = std::nan(""); });
  refused([](LidarModel& m) { m.max_range_m = 0.01; });
  refused([](LidarModel& m) { m.frame_period_s = 0; });
}

}  // namespace
}  // namespace accessvdb::sim
