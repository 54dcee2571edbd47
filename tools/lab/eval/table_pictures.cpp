// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <map>

#include "accessvdb/field_io.h"
#include "eval/hidden_point_removal.h"
#include "eval/scene_picture.h"
#include "eval/table_context.h"
#include "sim/scene_catalogue.h"

namespace accessvdb::eval {
namespace {

/// Preferred voxel size, if a table has it: enough points to see, few enough to be quick.
constexpr double kBestVoxel_m = 0.002;
constexpr std::size_t kViewpoints = 25;

}  // namespace

std::vector<Eigen::Vector3d> someViewpoints(const std::vector<Eigen::Vector3d>& viewpoints_W, std::size_t count) {
  std::vector<Eigen::Vector3d> some;
  const std::size_t used = std::min(count, viewpoints_W.size());
  for (std::size_t n = 0; n < used; ++n) some.push_back(viewpoints_W[(2 * n + 1) * viewpoints_W.size() / (2 * used)]);
  return some;
}

void drawScenes(TableContext& context) {
  std::map<std::string, double> voxel_of_scene;
  const std::vector<std::string> benchmarks = sim::benchmarkSceneNames();
  for (const TableRow& row : context.rows) {
    const bool benchmark = std::ranges::find(benchmarks, row.scene) != benchmarks.end() && row.table != "change";
    if (row.method != "product" || !benchmark) continue;
    const auto [found, added] = voxel_of_scene.emplace(row.scene, row.voxel_m);
    if (!added && row.voxel_m == kBestVoxel_m) found->second = row.voxel_m;
  }
  if (voxel_of_scene.empty()) return;
  io::prepareOutputFolder(context.options.picture_folder);
  for (const auto& [scene, voxel_m] : voxel_of_scene) {
    context.options.observer.checkStop();
    const auto run = context.runner.run(productRun(scene, voxel_m));
    const auto visible = visibleFromAny(run->positions_W, someViewpoints(run->viewpoints_W, kViewpoints));
    ScenePicture picture;
    char title[160];
    std::snprintf(title, sizeof title, "%s, %g mm, product profile: F1 %.2f, HPR F1 %.2f", scene.c_str(),
                  1000 * voxel_m, run->shared().f1(), compare(run->truth_shared, visible).f1());
    picture.title = title;
    picture.voxel_size_m = voxel_m;
    picture.positions_W = run->positions_W;
    picture.normals_W = run->normals_W;
    picture.truth = run->truth_shared;
    picture.found = run->found;
    picture.visible = visible;
    picture.viewpoints_W = run->viewpoints_W;
    const auto path = context.options.picture_folder / (scene + ".png");
    drawScenePicture(path, picture);
    context.options.observer.say("wrote " + path.string());
  }
}

}  // namespace accessvdb::eval
