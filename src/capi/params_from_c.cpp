// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "capi/params_from_c.h"

#include <algorithm>

#include "capi/boundary.h"

namespace accessvdb::capi {

BackendKind backendFromC(std::int32_t backend) {
  return static_cast<BackendKind>(requireChoice("backend", backend, 0, ACCESSVDB_BACKEND_CUDA));
}

FieldParams paramsFromC(const accessvdb_params& c) {
  FieldParams p;
  p.threads = c.threads;
  p.backend = backendFromC(c.backend);
  TsdfParams& t = p.tsdf;
  t.region = static_cast<UpdateRegion>(requireChoice("region", c.region, 0, ACCESSVDB_REGION_FULL_CUBE));
  t.voxel_size_m = c.voxel_size_m;
  t.truncation_distance_m = c.truncation_distance_m;
  t.range_noise_m = c.range_noise_m;
  t.min_range_m = c.min_range_m;
  t.max_range_m = c.max_range_m;
  t.cone_cos_min = c.cone_cos_min;
  t.clamp_min_m = c.clamp_min_m;
  t.cleared_radius_voxels = c.cleared_radius_voxels;
  t.cleared_begin_tau = c.cleared_begin_tau;
  t.cleared_end_tau = c.cleared_end_tau;
  t.max_weight = c.max_weight;
  ApproachParams& a = p.approach;
  a.num_directions = c.num_directions;
  a.normal_cone_rad = c.normal_cone_rad;
  a.observation_cos_min = c.observation_cos_min;
  std::copy_n(c.arm_tau, 3, a.arm_tau.begin());
  a.corridor_length_m = c.corridor_length_m;
  a.coarse_to_fine = requireBool("coarse_to_fine", c.coarse_to_fine);
  a.viewpoints = requireBool("viewpoints", c.viewpoints);
  if (c.orientations != nullptr) a.orientations = OrientationSet::parse(c.orientations);
  a.rolls = c.rolls;
  ScoringParams& s = p.scoring;
  s.collision_distance_m = c.collision_distance_m;
  s.self_exclusion_voxels = c.self_exclusion_voxels;
  s.form = static_cast<ToolForm>(requireChoice("tool_form", c.tool_form, 0, ACCESSVDB_FORM_SURFACE_SAMPLES));
  s.surface_samples = c.surface_samples;
  s.max_collisions = c.max_collisions;
  s.neighbours = c.neighbours;
  s.mean_positions = requireBool("mean_positions", c.mean_positions);
  s.join_neighbour_views = requireBool("join_neighbour_views", c.join_neighbour_views);
  s.neighbourhood_weight = requireBool("neighbourhood_weight", c.neighbourhood_weight);
  s.confidence_half_weight = c.confidence_half_weight;
  s.confidence_min = c.confidence_min;
  UpdateParams& u = p.update;
  u.policy = static_cast<UpdatePolicy>(requireChoice("policy", c.policy, 0, ACCESSVDB_POLICY_PAPER));
  u.budget_points = c.budget_points;
  u.changed_voxel_sample = c.changed_voxel_sample;
  u.changed_voxel_radius_voxels = c.changed_voxel_radius_voxels;
  u.requeue_motion_m = c.requeue_motion_m;
  u.stability_min = c.stability_min;
  u.seed = c.seed;
  p.change.mode = static_cast<ChangeMode>(requireChoice("change", c.change, 0, ACCESSVDB_CHANGE_FULL));
  p.change.free_for_s = c.free_for_s;
  return p;
}

accessvdb_params paramsToC(const FieldParams& p) {
  accessvdb_params c = {};
  c.threads = p.threads;
  c.backend = static_cast<std::int32_t>(p.backend);
  const TsdfParams& t = p.tsdf;
  c.region = static_cast<std::int32_t>(t.region);
  c.voxel_size_m = t.voxel_size_m;
  c.truncation_distance_m = t.truncation_distance_m;
  c.range_noise_m = t.range_noise_m;
  c.min_range_m = t.min_range_m;
  c.max_range_m = t.max_range_m;
  c.cone_cos_min = t.cone_cos_min;
  c.clamp_min_m = t.clamp_min_m;
  c.cleared_radius_voxels = t.cleared_radius_voxels;
  c.cleared_begin_tau = t.cleared_begin_tau;
  c.cleared_end_tau = t.cleared_end_tau;
  c.max_weight = t.max_weight;
  const ApproachParams& a = p.approach;
  c.num_directions = a.num_directions;
  c.normal_cone_rad = a.normal_cone_rad;
  c.observation_cos_min = a.observation_cos_min;
  std::copy_n(a.arm_tau.begin(), 3, c.arm_tau);
  c.corridor_length_m = a.corridor_length_m;
  c.coarse_to_fine = a.coarse_to_fine;
  c.viewpoints = a.viewpoints;
  c.rolls = a.rolls;
  const ScoringParams& s = p.scoring;
  c.collision_distance_m = s.collision_distance_m;
  c.self_exclusion_voxels = s.self_exclusion_voxels;
  c.tool_form = static_cast<std::int32_t>(s.form);
  c.surface_samples = s.surface_samples;
  c.max_collisions = s.max_collisions;
  c.neighbours = s.neighbours;
  c.mean_positions = s.mean_positions;
  c.join_neighbour_views = s.join_neighbour_views;
  c.neighbourhood_weight = s.neighbourhood_weight;
  c.confidence_half_weight = s.confidence_half_weight;
  c.confidence_min = s.confidence_min;
  const UpdateParams& u = p.update;
  c.policy = static_cast<std::int32_t>(u.policy);
  c.budget_points = u.budget_points;
  c.changed_voxel_sample = u.changed_voxel_sample;
  c.changed_voxel_radius_voxels = u.changed_voxel_radius_voxels;
  c.requeue_motion_m = u.requeue_motion_m;
  c.stability_min = u.stability_min;
  c.seed = u.seed;
  c.change = static_cast<std::int32_t>(p.change.mode);
  c.free_for_s = p.change.free_for_s;
  return c;
}

}  // namespace accessvdb::capi
