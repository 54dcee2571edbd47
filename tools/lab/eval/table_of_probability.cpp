// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// SurfacePoint::access_probability against exact ground truth: of points that are called likely by so many percent,
/// are as many accessible? And where its constants come from: other scenes.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/tool_spec.h"
#include "eval/collision_field.h"
#include "eval/ground_truth.h"
#include "eval/probability_fit.h"
#include "eval/table_context.h"
#include "field/query/access_probability.h"
#include "sim/pine.h"
#include "sim/simulator.h"
#include "sim/thicket.h"
#include "sim/tilt_scenes.h"

namespace accessvdb::eval {
namespace {

using internal::ProbabilityGroup;
using internal::ProbabilityModel;
using internal::ProbabilityTerms;

/// Truth is asked for so many points of a run at most, evenly spread: in the crowns it takes long.
constexpr std::size_t kJudgedOfSolids = 5000, kJudgedOfCrowns = 2500, kJudgedOfPine = 3000;
/// What has to be reached, in percent points.
constexpr double kMostOff = 5;
constexpr double kNoises_voxels[] = {0, 0.5, 1, 2};

struct ProbabilityRun {
  std::string scene;  ///< of the catalogue, "thicket_N" or "pine"
  double voxel_m = 0.005;
  double noise_voxels = 0;
  int frames = 0;  ///< 0 = the benchmark's
};

/// A point of which something is said.
struct ProbabilityPoint {
  SurfacePoint point;
  bool accessible = false;            ///< judged with the field's own normal, as its label is
  bool accessible_with_true = false;  ///< with that of the scene
};

struct ProbabilityPoints {
  std::vector<ProbabilityPoint> points;
  ProbabilityModel model;
};

sim::Helix aroundAll(double radius_m, double height_m, int turns) {
  sim::Helix path;
  path.radius_m = radius_m;
  path.height_begin_m = -height_m;
  path.height_end_m = height_m;
  path.azimuth_end_rad = turns * 2 * std::numbers::pi;
  return path;
}

/// A field that has been scanned and updated, and the truth about it.
class ProbabilityScan {
 public:
  ProbabilityScan(TableContext& context, const ProbabilityRun& run, bool with_margins) : context_(context), run_(run) {
    params_ = productRun(run.scene, run.voxel_m, run.noise_voxels * run.voxel_m).params;
    params_.backend = context.options.backend;
    params_.threads = context.options.threads;
    params_.change.mode = context.options.change;
    with_margins_ = with_margins;
    const std::string kThicket = "thicket_";
    if (run.scene.starts_with(kThicket)) {
      const sim::Scene scene = sim::makeThicket(std::stoull(run.scene.substr(kThicket.size())), run.voxel_m);
      // As in a crown, much is seen from few places.
      fly(scene, aroundAll(150 * run.voxel_m, 100 * run.voxel_m, 7), ToolGeometry::builtin("builtin:pruner"));
    } else if (run.scene == "pine") {
      const sim::PineParams pine;
      const sim::Scene scene = sim::makePine(pine);
      sim::Helix path = aroundAll(4.5, 0, 10);  // as in the table of the pine, with half of its scans
      path.centre_W = scene.centre_W;
      path.height_begin_m = 1 - scene.centre_W.z();
      path.height_end_m = pine.height_m - scene.centre_W.z();
      fly(scene, path, ToolGeometry::builtin("builtin:pruner"));
    } else {
      ScanRequest request;
      request.scene = run.scene;
      request.voxel_size_m = run.voxel_m;
      request.range_noise_m = params_.tsdf.range_noise_m;
      request.frames = run.frames;
      const auto scans = context.scans.get(request);
      distance_ = scans->benchmark.scene.distance;
      makeField(ToolGeometry::builtin("builtin:pencil"));
      for (const StoredFrame& frame : scans->frames) {
        context_.options.observer.checkStop();
        (void)field_->integrateScan(frame.hits_S, frame.T_W_S);
      }
    }
    (void)field_->update();
  }

  [[nodiscard]] ProbabilityPoints judged() const {
    ProbabilityPoints result;
    result.model = ProbabilityModel(field_->params(), field_->collisionLimit());
    for (const SurfacePoint& point : field_->snapshot().points)
      if (point.access_probability >= 0) result.points.push_back({point});
    const std::size_t most = run_.scene == "pine" ? kJudgedOfPine : crown_ ? kJudgedOfCrowns : kJudgedOfSolids;
    const std::size_t every = (result.points.size() + most - 1) / most;
    std::size_t n = 0;
    std::erase_if(result.points, [&](const ProbabilityPoint&) { return n++ % every != 0; });
    std::vector<Eigen::Vector3d> positions_W, own_W, true_W;
    Eigen::AlignedBox3d box_W;
    for (const ProbabilityPoint& each : result.points) {
      box_W.extend(positions_W.emplace_back(each.point.position_W));
      own_W.emplace_back(each.point.normal_W.cast<double>());
      true_W.push_back(distance_->outwardNormal(each.point.position_W));
    }
    const TruthOptions options = truthOptions(field_->params());
    const GroundTruth truth =
        crown_ && !box_W.isEmpty()
            ? GroundTruth(std::make_shared<const CollisionField>(distance_, box_W, 2 * options.collision_distance_m),
                          field_->tool(), options)
            : GroundTruth(distance_, field_->tool(), options);
    const auto own = truth.accessible(positions_W, own_W), with_true = truth.accessible(positions_W, true_W);
    for (std::size_t k = 0; k < result.points.size(); ++k) {
      result.points[k].accessible = own[k] != 0;
      result.points[k].accessible_with_true = with_true[k] != 0;
    }
    char line[160];
    std::snprintf(line, sizeof line, "%s at %g mm, noise %g v, %s: %zu points", run_.scene.c_str(), 1000 * run_.voxel_m,
                  run_.noise_voxels, run_.frames > 0 ? (std::to_string(run_.frames) + " frames").c_str() : "all frames",
                  result.points.size());
    context_.options.observer.say(line);
    return result;
  }

 private:
  void makeField(const ToolGeometry& tool) {
    const double v = run_.voxel_m;
    std::vector<ToolSpec> tools = {{tool}};
    if (with_margins_) tools = withMargins(std::move(tools), {v, 3 * v});
    field_ = std::make_unique<AccessibilityField>(tools, params_);
    context_.device = field_->deviceName();
  }
  void fly(const sim::Scene& scene, const sim::Helix& path, const ToolGeometry& tool) {
    constexpr int kAtOnce = 8;
    crown_ = true;
    distance_ = scene.distance;
    makeField(tool);
    sim::LidarModel model = sim::LidarModel::named("mid360");
    model.range_noise_m = params_.tsdf.range_noise_m;
    const sim::Simulator simulator(scene, model, sim::helix(path, run_.frames), 1);
    std::vector<sim::SimulatedFrame> frames(kAtOnce);
    for (int begin = 0; begin < run_.frames; begin += kAtOnce) {
      context_.options.observer.checkStop();
      const int count = std::min(kAtOnce, run_.frames - begin);
      tbb::parallel_for(0, count, [&](int n) { frames[static_cast<std::size_t>(n)] = simulator.frame(begin + n); });
      for (const sim::SimulatedFrame& frame : std::span(frames).first(static_cast<std::size_t>(count)))
        (void)field_->integrateScan(frame.points_S, frame.T_W_S);
    }
  }

  TableContext& context_;
  const ProbabilityRun& run_;
  FieldParams params_;
  bool with_margins_ = false, crown_ = false;
  std::shared_ptr<const sim::SignedDistance> distance_;
  std::unique_ptr<AccessibilityField> field_;
};

/// What the constants are fitted to: the scenes of the paper, with its pencil, and clutter, with the tool for crowns.
std::vector<ProbabilityRun> fitRuns() {
  std::vector<ProbabilityRun> runs;
  for (const double noise : kNoises_voxels) {
    for (const char* scene : {"torus", "sphere_a", "sphere_b", "ring", "box", "wall"}) {
      const bool is_plane = std::string(scene) == "box" || std::string(scene) == "wall";  // many returns in each frame
      const int few = is_plane ? 15 : 60;
      for (const auto& [voxel_m, frames] : {std::pair{0.005, 0}, {0.005, few}, {0.002, few}})
        runs.push_back({scene, voxel_m, noise, frames});
    }
  }
  for (std::size_t seed = 1; seed <= 8; ++seed) {
    const double noise = kNoises_voxels[seed / 2 % 4];
    for (const double voxel_m : {0.01, 0.02})
      runs.push_back({"thicket_" + std::to_string(seed), voxel_m, noise, seed % 2 == 0 ? 60 : 120});
  }
  return runs;
}

struct Fitted {
  ProbabilityGroup group;
  std::array<int, kFitTerms> signs;
};
/// 1, collisions, slant, noise, observations, limit, room.
constexpr Fitted kFitted[] = {{ProbabilityGroup::Accessible, {0, -1, -1, -1, 1, 0, 1}},
                              {ProbabilityGroup::AccessibleWithRoom, {0, -1, -1, -1, 1, 0, 1}},
                              {ProbabilityGroup::Tool, {0, -1, -1, 1, -1, 0, 0}},
                              {ProbabilityGroup::Arm, {0, 0, -1, 1, -1, 0, 0}},
                              {ProbabilityGroup::Unknown, {0, 0, -1, 1, -1, 0, 0}}};

/// A row of the table: deciles with enough points, as said and as it was.
TableRow reliabilityRow(const std::string& scene, std::string variant, const Reliability& reliability,
                        const Confusion& labels, bool must) {
  TableRow row;
  row.table = "probability";
  row.scene = scene;
  row.method = "product";
  row.variant = std::move(variant);
  row.figures = labels;
  row.more = {{"brier", reliability.brier()},
              {"brier_of_labels", reliability.brierOfLabels()},
              {"farthest_off", reliability.farthestOff()}};
  for (std::size_t n = 0; n < Reliability::kDeciles; ++n) {
    const Reliability::Decile& decile = reliability.deciles()[n];
    if (!decile.counts()) continue;
    const std::string from = "from_" + std::to_string(10 * n);
    row.more.emplace_back(from + "_points", static_cast<double>(decile.points));
    row.more.emplace_back(from + "_said", decile.saidPercent());
    row.more.emplace_back(from + "_was", decile.wasPercent());
  }
  if (must) row.must_hold = reliability.farthestOff() <= kMostOff;
  return row;
}

/// Runs of one row, judged both ways.
class ReliabilityOf {
 public:
  void add(const ProbabilityPoints& judged) {
    for (const ProbabilityPoint& each : judged.points) {
      const double said = each.point.access_probability;
      const bool label = each.point.label == PointLabel::Accessible;
      own_.add(said, label, each.accessible);
      with_true_.add(said, label, each.accessible_with_true);
      own_labels_.add(each.accessible, label);
      true_labels_.add(each.accessible_with_true, label);
    }
  }
  void addRows(TableContext& context, const std::string& scene, const std::string& variant, bool must) const {
    context.rows.push_back(reliabilityRow(scene, variant, own_, own_labels_, must));
    context.rows.push_back(reliabilityRow(scene, variant + ", true normals", with_true_, true_labels_, false));
  }

 private:
  Reliability own_, with_true_;
  Confusion own_labels_, true_labels_;
};

std::string noiseInWords(double noise_voxels) {
  char text[40];
  std::snprintf(text, sizeof text, "sigma = %g v", noise_voxels);
  return text;
}

}  // namespace

void makeProbabilityFit(TableContext& context) {
  std::array<std::vector<FitSample>, internal::kProbabilityGroups> samples;
  for (const ProbabilityRun& run : fitRuns()) {
    const ProbabilityPoints judged = ProbabilityScan(context, run, true).judged();
    for (const ProbabilityPoint& each : judged.points) {
      const auto add = [&](const SurfacePoint& point) {
        const std::optional<ProbabilityTerms> terms = judged.model.terms(point);
        if (!terms) return;
        // Each run counts as much as any other, however many points it has.
        samples[static_cast<std::size_t>(terms->group)].push_back(
            {terms->values(), each.accessible, 1000.0 / static_cast<double>(judged.points.size())});
      };
      add(each.point);
      SurfacePoint alone = each.point;  // as of a field without margins
      alone.margin_m = -1;
      if (each.point.margin_m >= 0) add(alone);
    }
  }
  for (const auto& [group, signs] : kFitted) {
    const std::vector<FitSample>& of_group = samples[static_cast<std::size_t>(group)];
    const std::array<double, kFitTerms> constants = fitOdds(of_group, signs);
    std::string line = "    {";
    TableRow row;
    row.table = "fit_probability";
    row.scene = name(group);
    row.method = "product";
    row.more.emplace_back("points", static_cast<double>(of_group.size()));
    constexpr const char* kNames[kFitTerms] = {"one", "collisions", "slant", "noise", "observations", "limit", "room"};
    for (std::size_t n = 0; n < kFitTerms; ++n) {
      char text[40];
      std::snprintf(text, sizeof text, "%s%.3fF", n > 0 ? ", " : "", constants[n] == 0 ? 0.0 : constants[n]);
      line += text;
      row.more.emplace_back(kNames[n], constants[n]);
    }
    context.options.observer.say(line + "},  // " + name(group));
    context.rows.push_back(row);
  }
}

void makeProbabilityTable(TableContext& context) {
  ReliabilityOf all;
  for (const double noise : kNoises_voxels) {
    ReliabilityOf of_noise;
    for (int number = 1; number <= 6; ++number) {
      const std::string scene = "unseen_" + std::to_string(number);
      ReliabilityOf of_scene;
      const bool is_box = number == 4 || number == 5;  // and has ten times as many points
      for (const auto& [voxel_m, frames] : {std::pair{0.005, 0}, {0.005, 30}, {0.002, is_box ? 30 : 100}}) {
        const ProbabilityRun run = {scene, voxel_m, noise, frames};
        const ProbabilityPoints judged = ProbabilityScan(context, run, false).judged();
        for (ReliabilityOf* sum : {&of_scene, &of_noise, &all}) sum->add(judged);
      }
      of_scene.addRows(context, scene, noiseInWords(noise), false);
    }
    of_noise.addRows(context, "unseen, all six", noiseInWords(noise), true);
  }
  all.addRows(context, "unseen, all six", "sigma = 0 to 2 v", true);
  // Made for tools that tilt; one that does not finds more hidden ways there than in any scene of the fit.
  for (const double noise : kNoises_voxels) {
    ReliabilityOf hidden;
    for (const std::string& scene : sim::tiltSceneNames())
      hidden.add(ProbabilityScan(context, ProbabilityRun{scene, 0.005, noise, 60}, false).judged());
    hidden.addRows(context, "scenes for tilting, all five", noiseInWords(noise), false);
  }
}

void makeProbabilityPineTable(TableContext& context) {
  for (const double noise : kNoises_voxels) {
    const ProbabilityRun run = {"pine", 0.01, noise, 500};
    ReliabilityOf pine;
    pine.add(ProbabilityScan(context, run, false).judged());
    pine.addRows(context, "pine", noiseInWords(noise), true);
  }
}

}  // namespace accessvdb::eval
