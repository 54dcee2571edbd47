// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How much room a tool has: labels of a tool that is grown by a margin against exact ground truth with that room.
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/tool_spec.h"
#include "eval/ground_truth.h"
#include "eval/table_context.h"

namespace accessvdb::eval {
namespace {

constexpr double kMargins_m[] = {0, 0.02, 0.05};

/// Whether the points of a field with margins have one of the larger ones, and not the one below it.
std::uint64_t notNested(const std::vector<SurfacePoint>& points) {
  std::uint64_t count = 0;
  for (const SurfacePoint& point : points) count += (point.tools & (point.tools + 1)) != 0 ? 1 : 0;
  return count;
}

void makeRows(TableContext& context, const std::string& scene, double voxel_m, const ToolGeometry& tool) {
  ScanRequest request;
  request.scene = scene;
  request.voxel_size_m = voxel_m;
  const std::shared_ptr<const StoredScans> scans = context.scans.get(request);
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.tsdf.range_noise_m = 0;
  params.backend = context.options.backend;
  params.threads = context.options.threads;
  AccessibilityField field(withMargins({{tool}}, {std::begin(kMargins_m), std::end(kMargins_m)}), params);
  context.device = field.deviceName();
  for (const StoredFrame& frame : scans->frames) {
    context.options.observer.checkStop();
    (void)field.integrateScan(frame.hits_S, frame.T_W_S);
  }
  (void)field.update();
  std::vector<SurfacePoint> points = field.snapshot().points;
  std::erase_if(points, [&](const SurfacePoint& point) {
    return point.confidence < static_cast<float>(field.params().scoring.confidence_min);
  });
  std::vector<Eigen::Vector3d> positions_W, normals_W;
  for (const SurfacePoint& point : points) {
    positions_W.push_back(point.position_W);
    normals_W.emplace_back(point.normal_W.cast<double>());
  }
  TruthOptions options = truthOptions(field.params());
  for (std::size_t k = 0; k < std::size(kMargins_m); ++k) {
    options.margin_m = kMargins_m[k];
    const std::vector<std::uint8_t> truth =
        GroundTruth(scans->benchmark.scene.distance, tool, options).accessible(positions_W, normals_W);
    std::vector<std::uint8_t> found;
    for (const SurfacePoint& point : points) found.push_back((point.tools >> k & 1) != 0 ? 1 : 0);
    TableRow row;
    row.table = "margins";
    row.scene = scene;
    row.method = "product";
    char words[60];
    std::snprintf(words, sizeof words, "%s, %g mm of room", tool.name().c_str(), 1000 * kMargins_m[k]);
    row.variant = words;
    row.voxel_m = voxel_m;
    row.figures = compare(truth, found);
    row.must = Requirement::atLeast(99);
    row.more.emplace_back("not_nested", static_cast<double>(notNested(points)));
    row.must_hold = notNested(points) == 0;
    context.rows.push_back(row);
    char line[200];
    std::snprintf(line, sizeof line, "%s at %g mm, %s: %zu points, F1 %.2f", scene.c_str(), 1000 * voxel_m, words,
                  points.size(), row.figures.f1());
    context.options.observer.say(line);
  }
}

}  // namespace

void makeMarginsTable(TableContext& context) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  for (const double voxel_m : {0.005, 0.002}) {
    for (const char* scene : {"torus", "sphere_a", "table_underside", "open_box", "branch_below", "cone_well"})
      makeRows(context, scene, voxel_m, pencil);
  }
}

}  // namespace accessvdb::eval
