// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a cut would open, asked of a map with a branch, against a map of the same scans of the scene without it.
///
/// Truth are the points that are blocked in the one map and accessible in the other. What the branch hid was never
/// seen: no removal can open it, so what is missed is divided by the reason that remains.
#include <algorithm>
#include <string>
#include <unordered_set>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/what_if.h"
#include "eval/table_context.h"
#include "sim/changing_scene.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

constexpr double kVoxel_m = 0.02, kTau_m = 0.1, kNoise_m = 0.005;
constexpr int kScans = 150;
/// Of the points whose label differs between the maps with and without the branch.
constexpr double kLeastPrecision_percent = 99, kLeastRecall_percent = 90;

AccessibilityField mapOf(const TableContext& context, const sim::ChangingScene& scene) {
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxel_m;
  params.tsdf.truncation_distance_m = kTau_m;
  params.tsdf.range_noise_m = kNoise_m;
  params.scoring.max_collisions = 1;  // as in the table of change
  params.origin_W = {{0, 0, 0}};      // the same voxels in every map
  params.backend = context.options.backend;
  params.threads = context.options.threads;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = kNoise_m;
  const sim::Simulator simulator(scene, model, 1);
  for (int n = 0; n < kScans; ++n) {
    context.options.observer.checkStop();
    const sim::SimulatedFrame frame = simulator.frame(n);
    field.integrateScan(frame.points_S, frame.T_W_S, frame.stamp_s);
  }
  field.update();
  return field;
}

/// As a person would mark it: a box with a margin, or the points on it.
Region regionOf(const std::string& marked, const sim::ScenePart& branch, const FieldSnapshot& with) {
  if (marked == "box") {
    const std::vector<Eigen::Vector3f>& corners_W = branch.scene.mesh.vertices_W;
    Eigen::Vector3f min_W = corners_W[0], max_W = corners_W[0];
    for (const Eigen::Vector3f& corner_W : corners_W) {
      min_W = min_W.cwiseMin(corner_W);
      max_W = max_W.cwiseMax(corner_W);
    }
    const Eigen::Vector3d margin = Eigen::Vector3d::Constant(kTau_m);
    return Region::box(min_W.cast<double>() - margin, max_W.cast<double>() + margin);
  }
  std::vector<std::uint32_t> ids;
  for (const SurfacePoint& point : with.points) {
    if (branch.scene.distance->at(point.position_W) <= 2 * kVoxel_m) ids.push_back(point.id);
  }
  return Region::points(std::move(ids));
}

double percent(std::size_t part, std::size_t whole) {
  return whole > 0 ? 100 * static_cast<double>(part) / static_cast<double>(whole) : 0;
}

TableRow cutRow(TableContext& context, const std::string& marked) {
  const sim::ChangingScene scene = sim::changingScene("branch", kVoxel_m);
  sim::ChangingScene without = scene;
  without.parts.pop_back();  // the branch
  AccessibilityField with = mapOf(context, scene);
  const AccessibilityField after = mapOf(context, without);
  context.device = with.deviceName();
  const FieldSnapshot before = with.snapshot();
  const Region region = regionOf(marked, scene.parts.back(), before);
  const std::vector<Region> regions = {region};
  const WhatIf what_if = with.whatIf(regions);

  std::unordered_set<std::uint32_t> truth, found;
  std::size_t never_seen = 0;
  for (const SurfacePoint& point : after.snapshot().points) {
    if (point.label != PointLabel::Accessible) continue;
    const auto here = with.pointAt(point.position_W);
    if (!here || here->label == PointLabel::Unscored) {
      ++never_seen;
    } else if (here->label == PointLabel::Blocked) {
      truth.insert(here->id);
    }
  }
  std::size_t right = 0;
  for (const SurfacePoint& point : what_if.opens) {
    found.insert(point.id);
    const auto there = after.pointAt(point.position_W);
    right += there && there->label == PointLabel::Accessible ? 1 : 0;
  }
  const auto hits = static_cast<std::size_t>(
      std::count_if(truth.begin(), truth.end(), [&](std::uint32_t id) { return found.contains(id); }));

  with.removeRegion(region, RemovedAs::Free);
  with.update();
  std::size_t missed_unknown = 0, missed_unseen = 0;
  for (const SurfacePoint& point : with.snapshot().points) {
    if (!truth.contains(point.id) || found.contains(point.id)) continue;
    missed_unknown += point.reason == PointReason::Unknown ? 1 : 0;
    missed_unseen += point.reason == PointReason::Unseen || point.reason == PointReason::Normal ? 1 : 0;
  }
  TableRow row;
  row.table = "change";
  row.scene = "branch";
  row.method = "what-if";
  row.variant = marked;
  row.voxel_m = kVoxel_m;
  const double precision = percent(right, what_if.opens.size()), recall = percent(hits, truth.size());
  row.more = {{"points_that_open", static_cast<double>(truth.size())},
              {"found", static_cast<double>(found.size())},
              {"precision_percent", precision},
              {"recall_percent", recall},
              {"missed_behind_the_unknown_percent", percent(missed_unknown, truth.size())},
              {"missed_not_seen_from_a_good_side_percent", percent(missed_unseen, truth.size())},
              {"points_never_seen", static_cast<double>(never_seen)}};
  row.must_hold = precision >= kLeastPrecision_percent && recall >= kLeastRecall_percent;
  return row;
}

}  // namespace

void makeCutRows(TableContext& context) {
  for (const std::string marked : {"points", "box"}) {
    context.options.observer.say("change: what cutting the branch would open, marked by " + marked);
    context.rows.push_back(cutRow(context, marked));
  }
}

}  // namespace accessvdb::eval
