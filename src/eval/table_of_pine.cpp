// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tree of the paper's field study, simulated: what visibility alone promises, and what the tool can reach.
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>

#include "accessvdb/accessibility_field.h"
#include "eval/collision_field.h"
#include "eval/ground_truth.h"
#include "eval/hidden_point_removal.h"
#include "eval/table_context.h"
#include "sim/pine.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

constexpr double kVoxel_m = 0.01;
constexpr int kFrames = 1000;
/// Around the crown, from near the ground to above the top, as a drone with a sensor would fly.
constexpr double kRadius_m = 4.5, kTurns = 10, kLowest_m = 1.0;
/// Truth is asked for this many points, evenly spread over all: the figures then stand to 0.7 points (two standard
/// errors of a share near one half).
constexpr std::size_t kJudgedPoints = 20000;
constexpr std::size_t kViewpoints = 50;
constexpr int kFramesAtOnce = 8;

struct PineCase {
  std::uint64_t seed;
  double range_noise_m;
};
constexpr PineCase kCases[] = {{1, 0.0}, {2, 0.0}, {3, 0.0}, {1, 0.02}};

sim::Trajectory flight(const sim::Scene& tree, double height_m) {
  sim::Helix shape;
  shape.centre_W = tree.centre_W;
  shape.radius_m = kRadius_m;
  shape.height_begin_m = kLowest_m - tree.centre_W.z();
  shape.height_end_m = height_m - tree.centre_W.z();
  shape.azimuth_end_rad = kTurns * 2 * std::numbers::pi;
  return sim::helix(shape, kFrames);
}

std::vector<Eigen::Vector3d> fuse(const sim::Simulator& simulator, AccessibilityField& field,
                                  const Observer& observer) {
  std::vector<Eigen::Vector3d> viewpoints_W;
  std::vector<sim::SimulatedFrame> frames(kFramesAtOnce);
  for (int begin = 0; begin < simulator.frames(); begin += kFramesAtOnce) {
    observer.checkStop();
    if (begin % (20 * kFramesAtOnce) == 0) {
      observer.say("fusing, " + std::to_string(begin) + " of " + std::to_string(simulator.frames()) + " scans");
    }
    const int count = std::min(kFramesAtOnce, simulator.frames() - begin);
    tbb::parallel_for(0, count, [&](int n) { frames[static_cast<std::size_t>(n)] = simulator.frame(begin + n); });
    for (int n = 0; n < count; ++n) {
      const sim::SimulatedFrame& frame = frames[static_cast<std::size_t>(n)];
      (void)field.integrateScan(frame.points_S, frame.T_W_S);
      viewpoints_W.push_back(frame.T_W_S.translation());
    }
  }
  return viewpoints_W;
}

double percent(double part, double whole) { return whole > 0 ? 100 * part / whole : 0; }

void addCase(TableContext& context, const PineCase& which) {
  const Observer& observer = context.options.observer;
  sim::PineParams pine;
  pine.seed = which.seed;
  observer.say("growing pine " + std::to_string(which.seed));
  const sim::Scene tree = sim::makePine(pine);
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = which.range_noise_m;
  const sim::Simulator simulator(tree, model, flight(tree, pine.height_m), which.seed);

  RunRequest request = productRun("pine", kVoxel_m, which.range_noise_m);
  request.params.backend = context.options.backend;
  request.params.threads = context.options.threads;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), request.params);
  const std::vector<Eigen::Vector3d> viewpoints_W = fuse(simulator, field, observer);
  observer.say("scoring");
  (void)field.update();
  const FieldSnapshot snapshot = field.snapshot();

  std::vector<Eigen::Vector3d> points_W, normals_W, judged_W, true_normals_W;
  std::vector<std::uint8_t> found, judged_found;
  for (const SurfacePoint& point : snapshot.points) {
    if (point.label == PointLabel::Unscored) continue;
    points_W.push_back(point.position_W);
    found.push_back(point.label == PointLabel::Accessible ? 1 : 0);
  }
  const std::size_t every = std::max<std::size_t>(1, points_W.size() / kJudgedPoints);
  std::size_t scored = 0;
  Eigen::AlignedBox3d box_W;
  for (const SurfacePoint& point : snapshot.points) {
    if (point.label == PointLabel::Unscored) continue;
    box_W.extend(point.position_W);
    if (scored++ % every != 0) continue;
    judged_W.push_back(point.position_W);
    normals_W.emplace_back(point.normal_W.cast<double>());
    true_normals_W.push_back(tree.distance->outwardNormal(point.position_W));
    judged_found.push_back(point.label == PointLabel::Accessible ? 1 : 0);
  }
  observer.say("visibility of " + std::to_string(points_W.size()) + " points");
  const auto visible = visibleFromAny(points_W, someViewpoints(viewpoints_W, kViewpoints));
  observer.checkStop();
  observer.say("truth of " + std::to_string(judged_W.size()) + " points");
  const TruthOptions options = truthOptions(field.params());
  const auto collisions =
      std::make_shared<const CollisionField>(tree.distance, box_W, 2 * options.collision_distance_m);
  const GroundTruth truth(collisions, field.tool(), options);

  TableRow row;
  row.table = "pine";
  row.scene = "pine, seed " + std::to_string(which.seed);
  row.method = "product";
  row.column = Column::Product;
  row.voxel_m = kVoxel_m;
  row.variant = which.range_noise_m > 0 ? "range noise 20 mm" : "no noise";
  row.figures = compare(truth.accessible(judged_W, normals_W), judged_found);
  row.must = Requirement::atLeast(95);
  const auto count = [](const std::vector<std::uint8_t>& flags) {
    return static_cast<double>(std::count(flags.begin(), flags.end(), 1));
  };
  const double all = static_cast<double>(points_W.size());
  const double ours = percent(count(found), all), hpr = percent(count(visible), all);
  row.more = {{"points", all}, {"accessible_percent", ours}, {"hpr_accessible_percent", hpr}};
  const auto reasons = snapshot.reasons();
  for (const PointReason reason :
       {PointReason::Normal, PointReason::Unseen, PointReason::Unknown, PointReason::Arm, PointReason::Tool}) {
    row.more.emplace_back(std::string("reason_") + name(reason) + "_percent",
                          percent(static_cast<double>(reasons[static_cast<std::size_t>(reason)]), all));
  }
  row.must_hold = hpr >= 90 && ours <= hpr - 30;  // the gap that the paper reports: 95.0 and 38.1 percent
  context.rows.push_back(row);

  row.variant += ", true normals";
  row.figures = compare(truth.accessible(judged_W, true_normals_W), judged_found);
  row.must.reset();
  row.must_hold.reset();
  row.more.clear();
  context.rows.push_back(row);
}

}  // namespace

void makePineTable(TableContext& context) {
  for (const PineCase& which : kCases) addCase(context, which);
}

}  // namespace accessvdb::eval
