// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb/params.h: the same structs, fields and defaults.
#include "accessvdb/params.h"

#include "bindings/parts.h"
#include "bindings/settings.h"

namespace py = pybind11;

namespace accessvdb::python {
namespace {

std::function<FieldParams(py::handle)>& fieldParamsConverter() {
  static std::function<FieldParams(py::handle)> converter;
  return converter;
}

auto projectiveClass(py::module_& m) {
  SettingsClass<ProjectiveParams> c(m, "ProjectiveParams", "The projective baseline, for evaluation only.");
  using P = ProjectiveParams;
  c.field("bin_rad", &P::bin_rad, "Edge of a bin; rounded to a whole number of bins per turn.")
      .field("in_front", &P::in_front, "Voxels more than tau in front of a range count as tau.")
      .field("empty_is_free", &P::empty_is_free, "Voxels in empty bins count as tau; else they are skipped.")
      .field("guarded", &P::guarded, "nvblox's interpolation with its two guards; else the nearest range of the bin.")
      .field("cleared_band", &P::cleared_band, "Also mark the cleared band of the scan-centric method.")
      .field("elevation_min_rad", &P::elevation_min_rad, "Empty bins below this elevation are outside the view.")
      .field("elevation_max_rad", &P::elevation_max_rad, "Empty bins above this elevation are outside the view.")
      .field("box_min_W_m", &P::box_min_W_m, "What in_front and empty_is_free may update, world frame: lowest corner.")
      .field("box_max_W_m", &P::box_max_W_m, "And its highest corner.")
      .finish();
  return c;
}

auto tsdfClass(py::module_& m) {
  const auto projective = projectiveClass(m);
  SettingsClass<TsdfParams> c(m, "TsdfParams", "How scans are fused into the truncated signed distance field.");
  using P = TsdfParams;
  c.field("voxel_size_m", &P::voxel_size_m, "[v] Edge length of a voxel; 0.0005 .. 10.")
      .field("truncation_distance_m", &P::truncation_distance_m, "[tau] 0 = rule: max(4 v, 5 range_noise_m).")
      .field("range_noise_m", &P::range_noise_m, "Sigma of the sensor's range noise.")
      .field("min_range_m", &P::min_range_m, "Returns nearer than this are dropped.")
      .field("max_range_m", &P::max_range_m, "Returns beyond this are dropped.")
      .field("region", &P::region, "Which voxels a return updates: \"double_cone\", \"full_cube\" or \"projective\".")
      .nested("projective", &P::projective, projective, "Only for region \"projective\".")
      .field("cone_cos_min", &P::cone_cos_min, "Cosine of the cone's half angle; (0, 1).")
      .field("clamp_min_m", &P::clamp_min_m, "Lower clamp of a distance sample: 0, or -tau for the unclamped variant.")
      .field("max_weight", &P::max_weight, "[w] Cap in observations; 1 .. 4095.")
      .field("cleared_radius_voxels", &P::cleared_radius_voxels, "Cleared band: distance from the ray.")
      .field("cleared_begin_tau", &P::cleared_begin_tau, "Cleared band: beginning, times tau, from the return.")
      .field("cleared_end_tau", &P::cleared_end_tau, "Cleared band: end, times tau.")
      .finish();
  return c;
}

auto approachClass(py::module_& m) {
  SettingsClass<ApproachParams> c(m, "ApproachParams", "Which approach directions are admissible.");
  using P = ApproachParams;
  c.field("num_directions", &P::num_directions, "[D] Yaw steps over 2 pi; 4 .. 256.")
      .field("normal_cone_rad", &P::normal_cone_rad, "Largest angle between a direction and the normal.")
      .field("observation_cos_min", &P::observation_cos_min,
             "A direction was observed if its dot product with the ray exceeds this.")
      .field("arm_tau", &P::arm_tau, "Distances of the arm samples, times tau.")
      .field("corridor_length_m", &P::corridor_length_m, "[L] Straight corridor kept free.")
      .field("coarse_to_fine", &P::coarse_to_fine, "The paper's 20 degree pass; policy \"paper\" only.")
      .field("viewpoints", &P::viewpoints, "Up to 8 stored viewpoints (paper) instead of the seen-direction mask.")
      .field("orientations", &P::orientations,
             "How the tool can be turned, degrees: \"yaw\", \"pitch:MIN:MAX:STEP\", \"sphere:STEP\", "
             "\"sphere:STEP+yaw\" or \"list:FILE\"; or rows of yaw, pitch, roll, or of a quaternion w, x, y, z.")
      .field("rolls", &P::rolls, "How many rolls about its body the tool may take in each; 0 = rule.")
      .finish();
  return c;
}

auto scoringClass(py::module_& m) {
  SettingsClass<ScoringParams> c(m, "ScoringParams", "How a direction is scored and a point labelled.");
  using P = ScoringParams;
  c.field("collision_distance_m", &P::collision_distance_m, "[r_c] 0 = rule: 0.5 v.")
      .field("self_exclusion_voxels", &P::self_exclusion_voxels, "[r_s] In voxels.")
      .field("form", &P::form, "How tool collisions are counted: \"voxels\" or \"surface_samples\".")
      .field("surface_samples", &P::surface_samples, "[M] Only for form \"surface_samples\".")
      .field("max_collisions", &P::max_collisions,
             "[n_c - 1] Most collisions of a free direction; 0 = rule, -1 = none.")
      .field("neighbours", &P::neighbours, "[k] Neighbours for the normal's PCA; 0 = rule.")
      .field("mean_positions", &P::mean_positions, "PCA on mean return positions; else on first returns.")
      .field("join_neighbour_views", &P::join_neighbour_views,
             "A point inherits the directions that its 10 nearest neighbours were seen from.")
      .field("neighbourhood_weight", &P::neighbourhood_weight, "Confidence from the largest weight of 3x3x3 voxels.")
      .field("confidence_half_weight", &P::confidence_half_weight, "[k_c] c = w / (w + k_c).")
      .field("confidence_min", &P::confidence_min, "[c_min] Points below are not scored.")
      .finish();
  return c;
}

auto updateClass(py::module_& m) {
  SettingsClass<UpdateParams> c(m, "UpdateParams", "When points are scored again.");
  using P = UpdateParams;
  c.field("policy", &P::policy, "\"exact\" or \"paper\".")
      .field("budget_points", &P::budget_points, "Most points scored per update(); 0 = no limit.")
      .field("changed_voxel_sample", &P::changed_voxel_sample, "Policy \"paper\", trigger (ii).")
      .field("changed_voxel_radius_voxels", &P::changed_voxel_radius_voxels, "[r_u] Policy \"paper\", trigger (ii).")
      .field("requeue_motion_m", &P::requeue_motion_m, "Policy \"paper\", trigger (iii).")
      .field("stability_min", &P::stability_min, "Bound on confidence times stability for `confident`.")
      .field("seed", &P::seed, "Seed of the sample of policy \"paper\".")
      .finish();
  return c;
}

auto changeClass(py::module_& m) {
  SettingsClass<ChangeParams> c(m, "ChangeParams", "How the map follows a world that changes.");
  c.field("mode", &ChangeParams::mode,
          "\"off\": the world is still; \"block\": new things block within a few scans; \"full\": what is gone opens "
          "by evidence, too. Off unless the region is \"double_cone\".")
      .field("free_for_s", &ChangeParams::free_for_s,
             "[T] seconds, by the stamps of the scans: free space that no ray has confirmed for T to 2 T is unknown "
             "again. inf: it stays free. Finite only with \"full\".")
      .finish();
  return c;
}

}  // namespace

FieldParams fieldParamsFrom(py::handle value) { return fieldParamsConverter()(value); }

void bindParams(py::module_& m) {
  const auto tsdf = tsdfClass(m);
  const auto approach = approachClass(m);
  const auto scoring = scoringClass(m);
  const auto update = updateClass(m);
  const auto change = changeClass(m);
  SettingsClass<FieldParams> c(m, "FieldParams", "Everything that an AccessibilityField needs besides the tool.");
  using P = FieldParams;
  c.nested("tsdf", &P::tsdf, tsdf, "How scans are fused.")
      .nested("approach", &P::approach, approach, "Which directions are admissible.")
      .nested("scoring", &P::scoring, scoring, "How a direction is scored.")
      .nested("update", &P::update, update, "When points are scored again.")
      .nested("change", &P::change, change, "How the map follows a world that changes.")
      .field("backend", &P::backend, "Where scoring runs: \"auto\", \"cpu\" or \"cuda\".")
      .field("threads", &P::threads, "0 = all.")
      .field("mirror_distance", &P::mirror_distance,
             "Keeps a second live mirror, of the map's distances, for kernels in C++ (DeviceView); no result depends "
             "on it.");
  c.finish()
      .def_static(
          "paper",
          [](const py::object& voxel_size_m) { return FieldParams::paper(numberFrom("voxel_size_m", voxel_size_m)); },
          py::arg("voxel_size_m"), "The paper's own constants, for its tables.")
      .def("resolved", &FieldParams::resolved, "Copy with every rule applied. Raises InvalidArgument for a bad value.")
      .def("describe", &FieldParams::describe, "Every effective value as \"name value\", one per line.");
  fieldParamsConverter() = c.converter();
}

}  // namespace accessvdb::python
