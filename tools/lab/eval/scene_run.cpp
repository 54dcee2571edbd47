// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/scene_run.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <sstream>
#include <utility>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "eval/ground_truth.h"

namespace accessvdb::eval {
namespace {

using Clock = std::chrono::steady_clock;
double secondsSince(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

std::string describe(const RunRequest& request) {
  std::ostringstream text;
  text.precision(17);
  const ScanRequest& scans = request.scans;
  text << scans.scene << ' ' << scans.frames << ' ' << scans.range_noise_m << ' ' << scans.seed << ' ' << request.tool
       << ' ' << request.update_every << '\n'
       << request.params.resolved().describe();
  const ProjectiveParams& image = request.params.tsdf.projective;
  text << static_cast<int>(request.params.tsdf.region) << ' ' << image.bin_rad << image.in_front << image.empty_is_free
       << image.guarded << image.cleared_band;
  return text.str();
}

/// @return tests and, if there were intermediate updates, their difference from a from-scratch evaluation at the end
void fuse(const StoredScans& scans, const RunRequest& request, const Observer& observer, AccessibilityField& field,
          EvaluatedRun& result) {
  const auto update = [&] {
    const auto start = Clock::now();
    result.direction_tests += field.update().direction_tests;
    result.update_s += secondsSince(start);
  };
  const auto start = Clock::now();
  int done = 0;
  for (const StoredFrame& frame : scans.frames) {
    observer.checkStop();
    result.distance_updates += field.integrateScan(frame.hits_S, frame.T_W_S).distance_updates;
    if (request.update_every > 0 && ++done % request.update_every == 0) update();
    result.viewpoints_W.push_back(frame.T_W_S.translation());
  }
  result.fuse_s = secondsSince(start) - result.update_s;
  update();
}

void judge(const StoredScans& scans, const RunRequest& request, const AccessibilityField& field, EvaluatedRun& result) {
  const FieldSnapshot snapshot = field.snapshot();
  result.all_points = snapshot.points.size();
  result.reasons = snapshot.reasons();
  const FieldParams& params = field.params();
  std::vector<Eigen::Vector3d> normals_W, true_normals_W;
  const auto& distance = scans.benchmark.scene.distance;
  for (const SurfacePoint& point : snapshot.points) {
    if (point.confidence < static_cast<float>(params.scoring.confidence_min)) continue;
    if (point.reason == PointReason::BesideSurface) continue;
    result.positions_W.push_back(point.position_W);
    result.found.push_back(point.label == PointLabel::Accessible ? 1 : 0);
    result.normals_W.push_back(point.normal_W);
    normals_W.emplace_back(point.normal_W.cast<double>());
    if (request.true_normals) true_normals_W.push_back(distance->outwardNormal(point.position_W));
  }
  const auto start = Clock::now();
  const GroundTruth truth(distance, field.tool(), truthOptions(params));
  result.truth_shared = truth.accessible(result.positions_W, normals_W);
  if (request.true_normals) result.truth_exact = truth.accessible(result.positions_W, true_normals_W);
  result.truth_s = secondsSince(start);
  if (request.update_every == 0) return;

  const FieldSnapshot scratch = field.evaluateFromScratch();
  for (std::size_t n = 0; n < snapshot.points.size(); ++n) {
    result.labels_unlike_scratch += snapshot.points[n].label != scratch.points[n].label ? 1 : 0;
  }
}

}  // namespace

RunRequest paperRun(const std::string& scene, double voxel_size_m) {
  RunRequest request;
  request.scans.scene = scene;
  request.scans.voxel_size_m = voxel_size_m;
  request.params = FieldParams::paper(voxel_size_m);
  return request;
}

RunRequest productRun(const std::string& scene, double voxel_size_m, double range_noise_m) {
  RunRequest request;
  request.scans.scene = scene;
  request.scans.voxel_size_m = voxel_size_m;
  request.scans.range_noise_m = range_noise_m;
  request.params.tsdf.voxel_size_m = voxel_size_m;
  request.params.tsdf.range_noise_m = range_noise_m;
  return request;
}

double surfaceSpacing_m(const FieldParams& params) {
  return std::max(params.tsdf.voxel_size_m, params.tsdf.range_noise_m);
}

SceneRunner::SceneRunner(ScanStore& scans, BackendKind backend, int threads, Observer observer, ChangeMode change,
                         bool points_of_surface)
    : scans_(scans),
      backend_(backend),
      threads_(threads),
      observer_(std::move(observer)),
      change_(change),
      points_of_surface_(points_of_surface) {}

std::shared_ptr<const EvaluatedRun> SceneRunner::run(RunRequest request) {
  if (request.params.change.mode != ChangeMode::Off) request.params.change.mode = change_;
  const bool exact =
      request.params.update.policy == UpdatePolicy::Exact && request.params.tsdf.region == UpdateRegion::DoubleCone;
  if (points_of_surface_ && exact) request.params.scoring.point_spacing_m = surfaceSpacing_m(request.params);
  const std::string key = describe(request);
  if (const auto found = runs_.find(key); found != runs_.end()) {
    if (!request.true_normals || !found->second->truth_exact.empty() || found->second->found.empty()) {
      return found->second;
    }
  }
  observer_.checkStop();
  const auto start = Clock::now();
  const std::shared_ptr<const StoredScans> scans = scans_.get(request.scans);
  const double scans_s = secondsSince(start);
  if (scans->benchmark.scene.distance == nullptr) {
    throw UnusableInput("evaluate.no_truth", request.scans.scene,
                        "the ground truth of this scene is unknown: " + scans->benchmark.scene.distance_note,
                        "Use a scene with a closed surface");
  }
  FieldParams params = request.params;
  params.backend = backend_;
  params.threads = threads_;
  auto result = std::make_shared<EvaluatedRun>();
  result->returns = scans->returns();
  AccessibilityField field(ToolGeometry::builtin(request.tool), params);
  device_ = field.deviceName();
  fuse(*scans, request, observer_, field, *result);
  observer_.checkStop();
  judge(*scans, request, field, *result);

  char line[240];
  std::snprintf(line, sizeof line,
                "%s at %g mm, %zu frames, %.3g M returns: %zu points, F1 %.2f (scans %.1f s, fusing %.1f s = %.0f M "
                "updates/s, scoring %.1f s, truth %.1f s)",
                request.scans.scene.c_str(), 1000 * params.tsdf.voxel_size_m, scans->frames.size(),
                1e-6 * static_cast<double>(result->returns), result->found.size(), result->shared().f1(), scans_s,
                result->fuse_s, 1e-6 * static_cast<double>(result->distance_updates) / (result->fuse_s + 1e-9),
                result->update_s, result->truth_s);
  observer_.say(line);
  return runs_[key] = result;
}

}  // namespace accessvdb::eval
