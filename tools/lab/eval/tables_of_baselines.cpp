// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tables of other methods: visibility alone (HPR), and projective fusion (docs/PAPER_MAP.md, "Baselines").
#include <Eigen/Geometry>

#include "eval/hidden_point_removal.h"
#include "eval/table_context.h"

namespace accessvdb::eval {
namespace {

using Figure = Requirement::Figure;

struct ProjectiveVariant {
  const char* name;
  bool in_front, empty_is_free, guarded, cleared_band;
};
constexpr ProjectiveVariant kVariants[] = {
    {"band only, no cleared band", false, false, false, false},
    {"band only, with cleared band", false, false, false, true},
    {"all in front, no cleared band", true, false, false, false},
    {"all in front, with cleared band", true, false, false, true},
    {"all in front, empty bins free", true, true, false, false},
    {"guarded as in nvblox, band only, no cleared band", false, false, true, false},
    {"guarded as in nvblox, band only, with cleared band", false, false, true, true},
    {"guarded as in nvblox, all in front, no cleared band", true, false, true, false},
};

/// The paper's profile with projective fusion. @param around_W  the region that carving variants may update
RunRequest projectiveRun(const std::string& scene, double voxel_m, const ProjectiveVariant& variant,
                         const sim::TriangleMesh& around_W) {
  RunRequest request = paperRun(scene, voxel_m);
  TsdfParams& tsdf = request.params.tsdf;
  const double tau = request.params.resolved().tsdf.truncation_distance_m;
  tsdf.region = UpdateRegion::Projective;
  tsdf.clamp_min_m = -tau;
  tsdf.projective.in_front = variant.in_front;
  tsdf.projective.empty_is_free = variant.empty_is_free;
  tsdf.projective.guarded = variant.guarded;
  tsdf.projective.cleared_band = variant.cleared_band;
  Eigen::AlignedBox3d box_W;
  for (const Eigen::Vector3f& v : around_W.vertices_W) box_W.extend(v.cast<double>());
  // The arm's last sample is 2.25 tau from a surface point; beyond it, free voxels are not used.
  const double margin_m = 2.5 * tau;
  for (int axis = 0; axis < 3; ++axis) {
    tsdf.projective.box_min_W_m[static_cast<std::size_t>(axis)] = box_W.min()[axis] - margin_m;
    tsdf.projective.box_max_W_m[static_cast<std::size_t>(axis)] = box_W.max()[axis] + margin_m;
  }
  return request;
}

}  // namespace

void makeHprTable(TableContext& context) {
  struct Printed {
    const char* scene;
    std::size_t viewpoints;
    PaperFigures figures;
    bool required;
  };
  const PaperFigures sphere{std::nullopt, 96.5, 96.5, 100.0, 98.2}, all{std::nullopt, 100.0, 100.0, 100.0, 100.0};
  const Printed printed[] = {{"torus", 50, {std::nullopt, 53.6, 53.6, 100.0, 69.8}, true},
                             {"sphere_a", 50, sphere, true},
                             {"sphere_b", 50, sphere, true},
                             {"box", 25, all, false},
                             {"wall", 25, all, false}};
  for (const Printed& expect : printed) {
    const RunRequest request = paperRun(expect.scene, 0.001);
    const auto run = context.runner.run(request);
    TableRow row = rowOf("hpr", request, *run, TableColumn::Paper);
    row.method = "hpr";
    row.variant = std::to_string(expect.viewpoints) + " viewpoints";
    row.figures = compare(run->truth_shared,
                          visibleFromAny(run->positions_W, someViewpoints(run->viewpoints_W, expect.viewpoints)));
    row.paper = expect.figures;
    if (expect.required) row.must = Requirement::near(Figure::Precision, *expect.figures.precision, 1);
    context.rows.push_back(row);
    context.options.observer.checkStop();
  }
}

void makeProjectiveTable(TableContext& context) {
  const auto add = [&context](const char* scene, double voxel_m, const ProjectiveVariant& variant,
                              const PaperFigures& printed) {
    const auto scans = context.scans.get({scene, voxel_m, 0, 0, 1});
    const RunRequest request = projectiveRun(scene, voxel_m, variant, scans->benchmark.scene.mesh);
    TableRow row = rowOf("projective", request, *context.runner.run(request), TableColumn::Paper);
    row.method = std::string("projective: ") + variant.name;
    row.paper = printed;
    context.rows.push_back(row);
  };
  for (const char* scene : {"torus", "sphere_a"}) {
    for (const ProjectiveVariant& variant : kVariants) add(scene, 0.002, variant, {});
  }
  add("torus", 0.001, kVariants[0], {42297, std::nullopt, 99.0, 20.4, 33.9});
  add("sphere_a", 0.001, kVariants[0], {5676, std::nullopt, 0.0, 0.0, 0.0});
}

}  // namespace accessvdb::eval
