// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the host tells an updater of the paper's policy on a device (update/paper_on_device.cpp): which points
/// the triggers request, against their definitions on the whole map. No GPU is needed; the updater only listens.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <vector>

#include "field/point_weights.h"
#include "field/tools/scoring_setup.h"
#include "support/listening_backend.h"
#include "tsdf/scan_integrator.h"
#include "unit/points/random_points.h"
#include "update/make_scheduler.h"

namespace accessvdb::internal {
namespace {

using test::Random;

/// What the updater was told at the last update.
struct ToldOfPaper {
  std::vector<kernels::PointWeight> crossed;
  std::vector<std::uint32_t> jumped, sampled;
  bool all_blocked = false;
  std::uint32_t budget_points = 0;
};

class PaperListener final : public kernels::PaperUpdater {
 public:
  explicit PaperListener(ToldOfPaper& told) : told_(told) {}
  void admit(const kernels::AdmitInput&) override {}
  kernels::UpdateOutcome update(const kernels::ScoringInput& input, const kernels::ConfidenceDelta& confidence,
                                const kernels::TriggeredPoints& triggered) override {
    told_.crossed.assign(confidence.crossed.begin(), confidence.crossed.end());
    told_.jumped.assign(triggered.jumped.begin(), triggered.jumped.end());
    told_.sampled.assign(triggered.sampled.begin(), triggered.sampled.end());
    told_.all_blocked = triggered.all_blocked;
    told_.budget_points = input.budget_points;
    kernels::UpdateOutcome outcome;
    outcome.evaluated = 7;
    outcome.waiting = 11;
    return outcome;
  }
  std::uint64_t bytes() const override { return 0; }

 private:
  ToldOfPaper& told_;
};

bool ascendsWithoutTwins(const std::vector<std::uint32_t>& ids) {
  return std::ranges::is_sorted(ids) && std::ranges::adjacent_find(ids) == ids.end();
}

struct PaperHostCase {
  const char* name;
  int scans_an_update = 1;
  UpdateRegion region = UpdateRegion::FullCube;
  bool first_changes_nothing = false;  ///< the scheduler is told that the first scan changed no distances
};
void PrintTo(const PaperHostCase& c, std::ostream* out) { *out << c.name; }

class DevicePaperHost : public testing::TestWithParam<PaperHostCase> {};

TEST_P(DevicePaperHost, TellsWhatTheTriggersAskFor) {
  FieldParams wanted = FieldParams::paper(0.05);
  wanted.scoring.collision_distance_m = 0.025;
  wanted.tsdf.region = GetParam().region;
  wanted.tsdf.max_weight = 2;  // a map that forgets
  wanted.update.budget_points = 40;
  wanted.update.requeue_motion_m = 1.5;
  const FieldParams params = wanted.resolved();
  const double v = params.tsdf.voxel_size_m, tau = params.tsdf.truncation_distance_m;
  PackedMap map(params.tsdf);
  map.setCollisionDistance(static_cast<float>(params.scoring.collision_distance_m));
  ScanIntegrator integrator(map);
  integrator.noteDistances(true);
  ToldOfPaper told;
  test::ListeningBackend backend({}, [&](const kernels::PaperTables& tables) {
    EXPECT_TRUE(tables.candidates.on);
    EXPECT_EQ(tables.candidates.num_directions, 180);
    EXPECT_EQ(tables.candidates.window, 12);  // 25 degrees
    for (int d = 0; d < 180; ++d) EXPECT_EQ(tables.candidates.coarse.test(d), d % 10 == 0) << d;
    EXPECT_EQ(tables.neighbours.neighbours, 10);
    EXPECT_EQ(tables.neighbours.view_neighbours, 0);
    return std::make_unique<PaperListener>(told);
  });
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  const ScoringSetup setup(tool, params, backend);
  PointStore points(params, setup.directions());
  PointScorer scorer(points, params, backend, makeMapReads(map, points, params.scoring.neighbourhood_weight));
  const auto scheduler = makePaperOnDevice(setup.scheduledFor(scorer));
  ASSERT_NE(scheduler, nullptr);
  ASSERT_TRUE(scheduler->needs().distances);

  Random random(5);
  std::vector<double> distance_m;  // of every point, after the last scan
  std::optional<Eigen::Vector3f> fired_L;
  int scans = 0;
  std::size_t all_jumped = 0, all_sampled = 0, fired = 0, quiet = 0;
  for (int update = 0; update < 12; ++update) {
    std::set<std::uint32_t> jumped;
    std::vector<Eigen::Vector3f> returns;
    bool moved = false;
    for (int scan = 0; scan < GetParam().scans_an_update; ++scan) {
      std::vector<Eigen::Vector3f> p;
      for (int n = 0; n < 150; ++n) {
        Eigen::Vector3f x = random.point(0.3f);
        x.z() = 0.01f * x.z() - (scans % 3 == 2 ? 0.17f : 0);  // a floor that sinks and rises again
        p.push_back(x);
      }
      ++scans;
      const Eigen::Vector3f q = random.point(1) + Eigen::Vector3f(0, 0, 4);
      const IntegrationResult result = integrator.integrate(p, {&q, 1});
      points.describeTouched(scheduler->needs().deltas);
      const TouchedPoints touched = points.addReturns(p, {&q, 1});
      scheduler->noteReturns(touched, p, {&q, 1});
      const bool unchanged = GetParam().first_changes_nothing && points.size() == touched.new_points;
      const MapChanges changes = {result.changes, result.distances};
      scheduler->noteChanges(p, {&q, 1}, unchanged ? MapChanges{} : changes);
      returns.insert(returns.end(), p.begin(), p.end());

      // (i) by its definition: every point is checked after every scan.
      for (std::uint32_t id = 0; id < points.size(); ++id) {
        const Index3 voxel = points.voxelOf(points.first_L(id));
        const VoxelState state = map.at(openvdb::Coord(voxel[0], voxel[1], voxel[2]));
        const double now_m = state.weight > 0 && !unchanged ? state.distance_m : tau;
        if (id < distance_m.size()) {
          if (std::fabs(now_m - distance_m[id]) > 2 * v) jumped.insert(id);
          distance_m[id] = now_m;
        } else {
          distance_m.push_back(now_m);
        }
      }
      // (iii)
      if (fired_L && (q - *fired_L).norm() > 1.5f) moved = true;
      if (!fired_L || (q - *fired_L).norm() > 1.5f) fired_L = q;
    }
    const UpdateStats stats = scheduler->update(nullptr, 40);
    EXPECT_EQ(stats.dirty_points, 7u);
    EXPECT_EQ(stats.backlog, 11u);
    EXPECT_EQ(told.budget_points, 40u);
    ASSERT_EQ(std::set<std::uint32_t>(told.jumped.begin(), told.jumped.end()), jumped) << "update " << update;
    ASSERT_TRUE(ascendsWithoutTwins(told.jumped));
    ASSERT_TRUE(ascendsWithoutTwins(told.sampled));
    ASSERT_EQ(told.all_blocked, moved) << "update " << update;
    // (ii) A drawn voxel is in the region of a return, so the points it finds are near one.
    for (const std::uint32_t id : told.sampled) {
      const float bound_m = static_cast<float>((std::sqrt(3.0) * (tau / v + 1) + 3.01) * v);
      ASSERT_TRUE(std::ranges::any_of(
          returns, [&](const Eigen::Vector3f& p) { return (points.first_L(id) - p).norm() <= bound_m; }));
    }
    all_jumped += jumped.size();
    all_sampled += told.sampled.size();
    ++(moved ? fired : quiet);
  }
  // Otherwise the comparison would prove nothing.
  EXPECT_GT(all_jumped, 30u);
  EXPECT_GT(all_sampled, 500u);
  EXPECT_GT(fired, 1u);
  EXPECT_GT(quiet, 1u);
  // Nothing new, so nothing is requested.
  static_cast<void>(scheduler->update(nullptr, 40));
  EXPECT_TRUE(told.crossed.empty() && told.jumped.empty() && told.sampled.empty() && !told.all_blocked);
}

INSTANTIATE_TEST_SUITE_P(Scans, DevicePaperHost,
                         testing::Values(PaperHostCase{.name = "ScanByScan"},
                                         PaperHostCase{.name = "ThreeScansAnUpdate", .scans_an_update = 3},
                                         PaperHostCase{.name = "Projective", .region = UpdateRegion::Projective},
                                         PaperHostCase{.name = "FirstChangesNothing", .first_changes_nothing = true}),
                         [](const auto& of) { return std::string(of.param.name); });

}  // namespace
}  // namespace accessvdb::internal
