// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where to look next: what proposed views resolve once they are simulated, against random ones from free space, and
/// against what was predicted. No proposed pose may touch the exact scene.
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "accessvdb/batch_query.h"
#include "accessvdb/error.h"
#include "accessvdb/next_views.h"
#include "accessvdb/surface_points.h"
#include "eval/action_scenes.h"
#include "eval/collision_field.h"
#include "sim/pine.h"
#include "sim/ray_caster.h"
#include "sim/scene_catalogue.h"

namespace accessvdb::eval {
namespace {

constexpr int kTrials = 20;
/// Of one view: a Mid-360 stays for a second.
constexpr int kFramesOfView = 10;
constexpr double kBenchmarkVoxel_m = 0.002;
constexpr std::size_t kRandomViews = 200, kBestRandom = 10, kProposed = 3;
/// Trials in which that many are simulated.
constexpr int kTrialsOfBest = 2;

/// A scene, a flight around it, and what looks at it.
struct ViewedScene {
  std::string name;
  sim::Scene scene;
  sim::Trajectory flight;
  double voxel_m = 0, body_m = 0, platform_m = 0, clear_m = 0;
  int frames = 0;  ///< of the flight, evenly over it, that the map has before it is asked
  std::string tool;
};

ViewedScene viewedPine() {
  const sim::PineParams pine;
  ViewedScene viewed = {"pine", sim::makePine(pine), {}, 0.05, 0.35, 0.6, 20, 150, "builtin:pruner"};
  sim::Helix shape;
  shape.centre_W = viewed.scene.centre_W;
  shape.radius_m = 4.5;
  shape.height_begin_m = 1 - viewed.scene.centre_W.z();
  shape.height_end_m = pine.height_m - viewed.scene.centre_W.z();
  shape.azimuth_end_rad = 4 * 2 * std::numbers::pi;
  viewed.flight = sim::helix(shape, 1200);
  return viewed;
}

ViewedScene viewedBenchmark(const std::string& name) {
  sim::BenchmarkScene benchmark = sim::benchmarkScene(name, kBenchmarkVoxel_m);
  return {name,
          std::move(benchmark.scene),
          std::move(benchmark.trajectory),
          kBenchmarkVoxel_m,
          0.05,
          0.1,
          INFINITY,
          20,
          "builtin:pencil"};
}

std::vector<Eigen::Vector3f> scanAt(const sim::RayCaster& caster, const Eigen::Isometry3d& T_W_S, std::uint64_t frame) {
  const sim::LidarModel model = sim::LidarModel::named("mid360");
  const auto rays = static_cast<std::size_t>(model.rays_per_frame);
  std::vector<Eigen::Vector3f> along_S(rays), along_W(rays), points_S;
  std::vector<float> ranges_m(rays);
  const Eigen::Matrix3f R = T_W_S.linear().cast<float>();
  for (std::size_t n = 0; n < rays; ++n) {
    along_S[n] = sim::rayDirection_S(model, frame, static_cast<int>(n));
    along_W[n] = R * along_S[n];
  }
  caster.cast(T_W_S.translation(), along_W, ranges_m);
  for (std::size_t n = 0; n < rays; ++n)
    if (std::isfinite(ranges_m[n]) && ranges_m[n] >= 0.05F) points_S.push_back(ranges_m[n] * along_S[n]);
  return points_S;
}

bool isUnresolved(const SurfacePoint& point) {
  return point.label != PointLabel::Accessible &&
         (point.reason == PointReason::Confidence || point.reason == PointReason::Unseen ||
          point.reason == PointReason::Unknown);
}

/// A map after a short part of a flight.
class ViewTrial {
 public:
  ViewTrial(TableContext& context, const ViewedScene& viewed, const sim::RayCaster& caster, int trial)
      : viewed_(viewed),
        caster_(caster),
        tool_(ToolGeometry::builtin(viewed.tool)),
        state_(std::filesystem::temp_directory_path() /
               ("accessvdb_views_" + std::to_string(std::random_device{}()) + ".state")),
        params_(clearedParams(context, viewed.voxel_m)) {
    params_.tsdf.clear_rays_m = viewed.clear_m;
    params_.tsdf.platform_radius_m = viewed.platform_m;
    AccessibilityField field(tool_, params_);
    // A quick flight: few scans, all around.
    const std::size_t poses = viewed.flight.size(), step = poses / static_cast<std::size_t>(viewed.frames);
    for (std::size_t n = step * static_cast<std::size_t>(trial) / static_cast<std::size_t>(kTrials); n < poses;
         n += step) {
      const Eigen::Isometry3d& T_W_S = viewed.flight[n];
      field.integrateScan(scanAt(caster, T_W_S, n), T_W_S);
      box_W_.extend(T_W_S.translation());
    }
    field.update();
    const auto points = field.points();
    for (std::size_t n = 0; n < points->size(); ++n) {
      const SurfacePoint point = points->at(n);
      box_W_.extend(point.position_W);
      if (isUnresolved(point)) unresolved_.push_back(point.id);
    }
    field.saveState(state_);
    device_ = field.deviceName();
  }
  ~ViewTrial() { std::filesystem::remove(state_); }
  ViewTrial(const ViewTrial&) = delete;
  ViewTrial& operator=(const ViewTrial&) = delete;

  [[nodiscard]] AccessibilityField field() const {
    return AccessibilityField::loadState(state_, tool_, params_.backend, params_.threads);
  }
  /// The unresolved points that views resolve.
  [[nodiscard]] std::set<std::uint32_t> resolvedBy(std::span<const Eigen::Isometry3d> T_W_S) const {
    AccessibilityField field = this->field();
    std::uint64_t frame = 1000000;
    for (const Eigen::Isometry3d& pose : T_W_S)
      for (int n = 0; n < kFramesOfView; ++n) field.integrateScan(scanAt(caster_, pose, frame++), pose);
    field.update();
    const auto points = field.points();
    std::set<std::uint32_t> resolved;
    for (const std::uint32_t id : unresolved_)
      if (!isUnresolved(points->at(id))) resolved.insert(id);
    return resolved;
  }
  [[nodiscard]] std::set<std::uint32_t> resolvedBy(const Eigen::Isometry3d& T_W_S) const {
    return resolvedBy(std::span(&T_W_S, 1));
  }
  /// Random places at which the body is known to be free. @param distance_m  from from_W, to a quarter
  [[nodiscard]] std::vector<Eigen::Isometry3d> randomPoses(const AccessibilityField& field, std::size_t count,
                                                           const std::optional<Eigen::Vector3d>& from_W,
                                                           double distance_m, std::mt19937& engine) const {
    const BatchQuery query = field.batchQuery();
    std::uniform_real_distribution<double> share(0, 1);
    std::normal_distribution<double> normal;
    std::vector<Eigen::Isometry3d> poses;
    for (int tries = 0; tries < 4000000 && poses.size() < count; ++tries) {
      Eigen::Vector3d p_W;
      if (from_W) {
        const Eigen::Vector3d away = Eigen::Vector3d(normal(engine), normal(engine), normal(engine)).normalized();
        p_W = *from_W + distance_m * (0.75 + 0.5 * share(engine)) * away;
      } else {
        p_W = box_W_.min() + box_W_.sizes().cwiseProduct(Eigen::Vector3d(share(engine), share(engine), share(engine)));
      }
      const CapsuleQuery ball = {p_W, p_W, viewed_.body_m};
      if (!query.along({&ball, 1})[0].free()) continue;
      Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
      T_W_S.translation() = p_W;
      poses.push_back(T_W_S);
    }
    return poses;
  }

  [[nodiscard]] const std::vector<std::uint32_t>& unresolved() const { return unresolved_; }
  [[nodiscard]] const std::string& device() const { return device_; }

 private:
  const ViewedScene& viewed_;
  const sim::RayCaster& caster_;
  ToolGeometry tool_;
  std::filesystem::path state_;
  FieldParams params_;
  Eigen::AlignedBox3d box_W_;
  std::vector<std::uint32_t> unresolved_;
  std::string device_;
};

double medianOf(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::ranges::sort(values);
  return values[values.size() / 2];
}

struct RandomViews {
  std::size_t by_best_ten = 0;  ///< what the best ten resolve together
  double best_against_median = 0;
};

RandomViews simulated(const ViewTrial& trial, const std::vector<Eigen::Isometry3d>& poses) {
  std::vector<std::set<std::uint32_t>> sets;
  std::vector<double> counts;
  for (const Eigen::Isometry3d& pose : poses) {
    sets.push_back(trial.resolvedBy(pose));
    counts.push_back(static_cast<double>(sets.back().size()));
  }
  std::set<std::uint32_t> have;
  std::vector<Eigen::Isometry3d> best;
  for (std::size_t round = 0; round < kBestRandom; ++round) {
    std::size_t at = 0, most = 0;
    for (std::size_t n = 0; n < sets.size(); ++n) {
      const auto gain = static_cast<std::size_t>(
          std::ranges::count_if(sets[n], [&](std::uint32_t id) { return !have.contains(id); }));
      if (gain > most) at = n, most = gain;
    }
    if (most == 0) break;
    have.insert(sets[at].begin(), sets[at].end());
    best.push_back(poses[at]);
  }
  const double most = counts.empty() ? 0 : *std::ranges::max_element(counts);
  return {trial.resolvedBy(best).size(), most / std::max(medianOf(counts), 1.0)};
}

void addViewRow(TableContext& context, const ViewedScene& viewed) {
  const sim::RayCaster caster(viewed.scene.mesh);
  Eigen::AlignedBox3d box_W;
  for (const Eigen::Isometry3d& T_W_S : viewed.flight) box_W.extend(T_W_S.translation());
  const CollisionField exact(viewed.scene.distance, box_W, std::max(viewed.body_m / 4, 0.01));
  std::vector<double> ratios, errors, shares, bounds;
  std::size_t poses = 0, touching = 0, without_view = 0;
  std::mt19937 engine(11);
  for (int k = 0; k < kTrials; ++k) {
    context.options.observer.checkStop();
    const ViewTrial trial(context, viewed, caster, k);
    context.device = trial.device();
    const AccessibilityField field = trial.field();
    ViewOptions options;
    options.most = 10;
    options.body_radius_m = viewed.body_m;
    const std::vector<Eigen::Isometry3d> start = trial.randomPoses(field, 1, std::nullopt, 0, engine);
    if (start.empty()) throw UnusableInput("evaluate.views", viewed.name, "has no free space");
    options.from_W = start.front().translation();
    const NextViews found = nextViews(field, options);
    for (const NextView& view : found.views) {
      ++poses;
      touching += exact.below(view.T_W_S.translation(), viewed.body_m) ? 1 : 0;
    }
    if (found.views.empty()) {
      ++without_view;
      continue;
    }
    const NextView& first = found.views.front();
    const auto resolved = static_cast<double>(trial.resolvedBy(first.T_W_S).size());
    const std::vector<Eigen::Isometry3d> random = trial.randomPoses(field, 1, options.from_W, first.travel_m, engine);
    const double by_random = random.empty() ? 0 : static_cast<double>(trial.resolvedBy(random.front()).size());
    ratios.push_back(resolved / std::max(by_random, 1.0));
    errors.push_back(std::abs(first.resolves - resolved) / std::max(resolved, 1.0));
    char line[240];
    std::snprintf(
        line, sizeof line,
        "%s %d: %zu unresolved, predicted %.0f (%.0f %.0f %.0f), resolved %.0f, a random view %.0f, %.2f m away",
        viewed.name.c_str(), k, trial.unresolved().size(), first.resolves, first.of_confidence, first.of_unseen,
        first.of_unknown, resolved, by_random, first.travel_m);
    context.options.observer.say(line);
    if (k % (kTrials / kTrialsOfBest) != 0) continue;
    options.most = kProposed;
    options.travel_m = std::numeric_limits<double>::infinity();
    std::vector<Eigen::Isometry3d> proposed;
    for (const NextView& view : nextViews(field, options).views) proposed.push_back(view.T_W_S);
    const RandomViews random_views = simulated(trial, trial.randomPoses(field, kRandomViews, std::nullopt, 0, engine));
    bounds.push_back(random_views.best_against_median);
    shares.push_back(100.0 * double(trial.resolvedBy(proposed).size()) /
                     double(std::max<std::size_t>(random_views.by_best_ten, 1)));
    std::snprintf(line, sizeof line,
                  "%s %d: three proposed views resolve %.0f %% of what the best ten of %zu random ones do",
                  viewed.name.c_str(), k, shares.back(), kRandomViews);
    context.options.observer.say(line);
  }
  TableRow row;
  row.table = "views";
  row.scene = viewed.name;
  row.method = "product";
  row.voxel_m = viewed.voxel_m;
  row.more = {{"trials", double(kTrials)},
              {"trials_without_a_view", double(without_view)},
              {"median_against_random", medianOf(ratios)},
              {"best_random_against_median_random", medianOf(bounds)},
              {"three_against_best_ten_percent", medianOf(shares)},
              {"median_error_of_prediction_percent", 100 * medianOf(errors)},
              {"poses", double(poses)},
              {"touching", double(touching)}};
  row.must_hold = medianOf(ratios) >= 2 && medianOf(shares) >= 60 && medianOf(errors) <= 0.3 && touching == 0;
  context.rows.push_back(row);
  char line[480];
  std::snprintf(
      line, sizeof line,
      "%s at %g mm: a proposed view resolves %.1f times as much as a random one (the best of %zu random ones "
      "%.1f times as much as their median), three %.0f %% of what the best ten of them do, predicted to %.0f %%, "
      "%zu of %zu poses touch the scene, %zu of %d trials got no view",
      viewed.name.c_str(), 1000 * viewed.voxel_m, medianOf(ratios), kRandomViews, medianOf(bounds), medianOf(shares),
      100 * medianOf(errors), touching, poses, without_view, kTrials);
  context.options.observer.say(line);
}

}  // namespace

void makeViewsTable(TableContext& context) {
  for (const char* name : {"unseen_1", "unseen_4"}) addViewRow(context, viewedBenchmark(name));
  addViewRow(context, viewedPine());
}

}  // namespace accessvdb::eval
