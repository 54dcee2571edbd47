// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Three pictures per scene: truth, labels and errors before something goes, while it goes, and afterwards.
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/field_io.h"
#include "eval/ground_truth.h"
#include "eval/scene_picture.h"
#include "eval/table_context.h"
#include "sim/changing_scene.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

constexpr double kVoxel_m = 0.02, kTau_m = 0.1, kNoise_m = 0.005;

AccessibilityField makeField(const TableContext& context) {
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxel_m;
  params.tsdf.truncation_distance_m = kTau_m;
  params.tsdf.range_noise_m = kNoise_m;
  params.scoring.max_collisions = 1;  // as in the table of change
  params.backend = context.options.backend;
  params.threads = context.options.threads;
  return AccessibilityField(ToolGeometry::builtin("builtin:pruner"), params);
}

void drawMoment(const std::filesystem::path& png, const std::string& title, const AccessibilityField& field,
                const sim::ChangingScene& scene, double stamp_s) {
  std::vector<Eigen::Vector3d> positions_W, normals_W;
  std::vector<Eigen::Vector3f> shading_W;
  std::vector<std::uint8_t> found;
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.label == PointLabel::Unscored) continue;
    positions_W.push_back(point.position_W);
    normals_W.emplace_back(point.normal_W.cast<double>());
    shading_W.push_back(point.normal_W);
    found.push_back(point.label == PointLabel::Accessible ? 1 : 0);
  }
  const GroundTruth truth(scene.distanceAt(stamp_s), field.tool(), truthOptions(field.params()));
  const std::vector<std::uint8_t> accessible = truth.accessible(positions_W, normals_W);
  const std::array sensor_W = {Eigen::Vector3d(0, 0, 0)};
  ScenePicture picture;
  picture.title = title;
  picture.voxel_size_m = kVoxel_m;
  picture.positions_W = positions_W;
  picture.normals_W = shading_W;
  picture.truth = accessible;
  picture.found = found;
  picture.viewpoints_W = sensor_W;
  drawScenePicture(png, picture);
}

void drawFilm(TableContext& context, const std::string& name) {
  const sim::ChangingScene scene = sim::changingScene(name, kVoxel_m);
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = kNoise_m;
  const sim::Simulator simulator(scene, model, 1);
  AccessibilityField field = makeField(context);
  const std::array<std::pair<const char*, double>, 3> moments = {
      std::pair{"before", scene.change_s}, {"during", scene.change_s + 1.5}, {"after", scene.change_s + 10}};
  int next = 0;
  for (std::size_t n = 0; n < moments.size(); ++n) {
    const auto& [moment, stamp_s] = moments[n];
    for (; next < static_cast<int>(std::lround(stamp_s / model.frame_period_s)); ++next) {
      context.options.observer.checkStop();
      const sim::SimulatedFrame frame = simulator.frame(next);
      field.integrateScan(frame.points_S, frame.T_W_S, frame.stamp_s);
    }
    field.update();
    char title[160];
    std::snprintf(title, sizeof title, "%s, %s: after %.1f s", scene.description.c_str(), moment, stamp_s);
    const auto png =
        context.options.picture_folder / ("change_" + name + "_" + std::to_string(n + 1) + "_" + moment + ".png");
    drawMoment(png, title, field, scene, (next - 1) * model.frame_period_s);
    context.options.observer.say("wrote " + png.string());
  }
}

}  // namespace

void drawFilms(TableContext& context) {
  if (context.options.picture_folder.empty()) return;
  io::prepareOutputFolder(context.options.picture_folder);
  for (const std::string name : {"person", "car"}) drawFilm(context, name);
}

}  // namespace accessvdb::eval
