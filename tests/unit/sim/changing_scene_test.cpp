// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scenes that change: what the simulated rays hit at a time is what the distance of that time says.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "accessvdb/error.h"
#include "sim/changing_scene.h"
#include "sim/simulator.h"

namespace accessvdb::sim {
namespace {

LidarModel fewRays() {
  LidarModel model = LidarModel::named("mid360");
  model.rays_per_frame = 3000;
  return model;
}

TEST(ChangingScene, EveryReturnIsOnASurfaceThatIsThere) {
  for (const std::string& name : changingSceneNames()) {
    SCOPED_TRACE(name);
    const ChangingScene scene = changingScene(name, 0.02);
    const Simulator simulator(scene, fewRays(), 1);
    ASSERT_EQ(simulator.frames(), 480);
    for (const int index : {0, 299, 300, 315, 329, 330, 359, 360, 479}) {
      const SimulatedFrame frame = simulator.frame(index);
      EXPECT_EQ(frame.stamp_s, 0.1 * index);
      const auto distance = scene.distanceAt(frame.stamp_s);
      std::size_t returns = 0;
      for (const Eigen::Vector3f& p_S : frame.points_S) {
        if (p_S.isZero(0)) continue;
        ++returns;
        // Ranges are float32 and a few metres long.
        ASSERT_LT(std::abs(distance->at(frame.T_W_S * p_S.cast<double>())), 1e-5) << index;
      }
      EXPECT_GT(returns, 200u);
    }
  }
}

/// A part is seen from its first moment to its last, and not a frame longer.
TEST(ChangingScene, PartsComeAndGoAtTheirTimes) {
  const ChangingScene scene = changingScene("bar", 0.02);
  const Simulator simulator(scene, LidarModel::named("mid360"), 1);
  const auto seesTheBar = [&](int index) {
    const SimulatedFrame frame = simulator.frame(index);
    return std::any_of(frame.points_S.begin(), frame.points_S.end(), [&](const Eigen::Vector3f& p_S) {
      const double x_m = (frame.T_W_S * p_S.cast<double>()).x();
      return !p_S.isZero(0) && x_m > 1.9 && x_m < 1.97;
    });
  };
  EXPECT_EQ(scene.change_s, 30);
  EXPECT_EQ(scene.gone_s, 36);
  EXPECT_FALSE(seesTheBar(299));
  EXPECT_TRUE(seesTheBar(300));
  EXPECT_TRUE(seesTheBar(359));
  EXPECT_FALSE(seesTheBar(360));
  EXPECT_EQ(scene.first_new, 1u);
  EXPECT_EQ(scene.parts.size(), 2u);
}

TEST(ChangingScene, ThePersonMoves) {
  const ChangingScene scene = changingScene("person", 0.02);
  const Eigen::Vector3d where_W(1.4, 0, 0);
  // The person crosses from y = -1.5 m to 1.5 m, 0.5 m wide; the board is 0.6 m behind this place.
  EXPECT_NEAR(scene.distanceAt(30.0)->at(where_W), 0.6, 1e-9);
  EXPECT_NEAR(scene.distanceAt(31.0)->at(where_W), 0.25, 1e-9);
  EXPECT_LT(scene.distanceAt(31.5)->at(where_W), 0);
  EXPECT_NEAR(scene.distanceAt(32.1)->at(where_W), 0.35, 1e-9);
  EXPECT_NEAR(scene.distanceAt(40)->at(where_W), 0.6, 1e-9);
}

TEST(ChangingScene, UnknownNamesAreRefused) {
  EXPECT_THROW(static_cast<void>(changingScene("ghost", 0.02)), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::sim
