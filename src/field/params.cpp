// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The rules behind parameters left at 0, and their checks (docs/PAPER_MAP.md).
#include "accessvdb/params.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <utility>

#include "accessvdb/error.h"
#include "field/thread_count.h"

namespace accessvdb {
namespace {

constexpr std::int32_t kMostWindow_voxels = 1 << 20;
constexpr int kMostRolls = 64;

std::string text(double value) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
  return {buffer, end};
}

/// @throws InvalidArgument unless value is in [low, high]; NaN never is.
void require(const char* field, double value, double low, double high, const char* advice = "") {
  if (value >= low && value <= high) return;
  throw InvalidArgument("config.range", field, text(value) + " is outside " + text(low) + " .. " + text(high), advice);
}

/// PCA neighbours: noise comparable to the voxel needs more of them.
int neighboursFor(double range_noise_m, double voxel_size_m) {
  if (range_noise_m >= 2 * voxel_size_m) return 100;
  if (range_noise_m >= voxel_size_m) return 60;
  return range_noise_m >= 0.5 * voxel_size_m ? 30 : 10;
}

const char* nameOf(UpdateRegion region) {
  switch (region) {
    case UpdateRegion::DoubleCone:
      return "double_cone";
    case UpdateRegion::FullCube:
      return "full_cube";
    case UpdateRegion::Projective:
      break;
  }
  return "projective";
}

void requireProjective(const ProjectiveParams& p, double voxel_size_m) {
  require("projective.bin_rad", p.bin_rad, 0.0005, 0.2);
  require("projective.elevation_min_rad", p.elevation_min_rad, -std::numbers::pi / 2, std::numbers::pi / 2);
  require("projective.elevation_max_rad", p.elevation_max_rad, p.elevation_min_rad, std::numbers::pi / 2);
  if (!p.in_front && !p.empty_is_free) return;
  constexpr double kMostLeaves = 1 << 22;  // 8 GiB of voxels
  double leaves = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    require("projective.box_min_W_m", p.box_min_W_m[axis], -1e8, 1e8);
    require("projective.box_max_W_m", p.box_max_W_m[axis], p.box_min_W_m[axis] + voxel_size_m, 1e8,
            "Set the box around the scene that in_front and empty_is_free may update");
    leaves *= (p.box_max_W_m[axis] - p.box_min_W_m[axis]) / (8 * voxel_size_m) + 2;
  }
  require("projective box, in leaves", leaves, 0, kMostLeaves, "Choose a smaller box or a larger voxel");
}

/// What the paper's policy cannot do, whose directions are a window around a yaw, and whose scores are kept.
void requireOrientations(const FieldParams& p) {
  static_cast<void>(p.approach.directionCount());  // throws for a set that is none
  const bool paper = p.update.policy == UpdatePolicy::Paper || p.approach.coarse_to_fine || p.approach.viewpoints;
  if (paper && !p.approach.orientations.isYaw()) {
    throw InvalidArgument("orientations.policy", "orientations " + p.approach.orientations.text(),
                          "the paper's policy, its coarse pass and its viewpoints support only yaw directions",
                          "Use the exact policy and the product profile, or orientations yaw");
  }
  if (paper && p.approach.rolls > 1) {
    throw InvalidArgument("orientations.policy", "rolls " + std::to_string(p.approach.rolls),
                          "the paper's policy, its coarse pass and its viewpoints do not support rolls",
                          "Use the exact policy and the product profile, or rolls 1");
  }
}

void requireChange(const ChangeParams& change) {
  if (change.free_for_s == std::numeric_limits<double>::infinity()) return;
  require("free_for_s", change.free_for_s, 0.001, 1e9, "Give the seconds for which free space stays free, or infinity");
  if (change.mode != ChangeMode::Full) {
    throw InvalidArgument("config.change", "free_for_s", "is finite, which needs ChangeMode::Full",
                          "Use ChangeMode::Full, or leave free_for_s at infinity");
  }
}

void requireWindow(const FieldParams& p) {
  const auto refuse = [](const std::string& problem, const std::string& advice) {
    throw InvalidArgument("config.window", "window", problem, advice);
  };
  if (!p.origin_W) refuse("needs origin_W", "Set the origin that all tiles share");
  if (p.update.policy == UpdatePolicy::Paper) {
    refuse("cannot be combined with the paper's update policy, which depends on the whole map",
           "Use UpdatePolicy::Exact");
  }
  if (p.change.mode == ChangeMode::Full) {
    refuse("cannot be combined with ChangeMode::Full, whose rays reach beyond a tile", "Use ChangeMode::Block");
  }
  if (p.tsdf.region == UpdateRegion::Projective) {
    refuse("cannot be combined with projective fusion, which depends on whole scans", "Use another UpdateRegion");
  }
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const std::int32_t low = p.window->core_low[axis], high = p.window->core_high[axis];
    if (low % FieldWindow::kEdge != 0 || high % FieldWindow::kEdge != 0 || low >= high || low < -kMostWindow_voxels ||
        high > kMostWindow_voxels) {
      refuse("has a core from " + std::to_string(low) + " to " + std::to_string(high) + " voxels",
             "Use multiples of " + std::to_string(FieldWindow::kEdge) + " within +-2^20, the lower one first");
    }
  }
}

}  // namespace

int internal::requireThreads(int threads) {
  require("threads", threads, 0, kMostThreads, "0 uses all");
  return threads;
}

FieldParams FieldParams::paper(double voxel_size_m) {
  FieldParams p;
  p.tsdf.voxel_size_m = voxel_size_m;
  p.tsdf.range_noise_m = 0;
  p.tsdf.region = UpdateRegion::FullCube;
  p.change = {ChangeMode::Off};
  p.tsdf.truncation_distance_m = std::max(4 * voxel_size_m, 0.02);
  p.tsdf.cleared_radius_voxels = 0;
  p.tsdf.cleared_begin_tau = 1;
  p.approach.coarse_to_fine = true;
  p.approach.viewpoints = true;
  p.scoring.collision_distance_m = 0.0005;
  p.scoring.form = ToolForm::SurfaceSamples;
  p.scoring.neighbours = 10;
  p.scoring.mean_positions = false;
  p.scoring.join_neighbour_views = false;
  p.scoring.neighbourhood_weight = false;
  p.update.policy = UpdatePolicy::Paper;
  return p;
}

FieldParams FieldParams::resolved() const {
  FieldParams p = *this;
  TsdfParams& t = p.tsdf;
  require("voxel_size_m", t.voxel_size_m, 0.0005, 10, "Choose a voxel between 0.5 mm and 10 m");
  require("range_noise_m", t.range_noise_m, 0, 10);
  if (t.truncation_distance_m == 0) t.truncation_distance_m = std::max(4 * t.voxel_size_m, 5 * t.range_noise_m);
  require("truncation_distance_m", t.truncation_distance_m, t.voxel_size_m, 100 * t.voxel_size_m,
          "tau must be between 1 and 100 voxels; choose a larger voxel or a smaller tau");
  require("min_range_m", t.min_range_m, 0, 1e6);
  require("max_range_m", t.max_range_m, t.min_range_m, std::numeric_limits<double>::infinity());
  require("cone_cos_min", t.cone_cos_min, 0.85, 0.9999);
  require("clamp_min_m", t.clamp_min_m, -t.truncation_distance_m, 0);
  require("max_weight", t.max_weight, 1, 4095);
  require("cleared_radius_voxels", t.cleared_radius_voxels, 0, 16);
  require("cleared_begin_tau", t.cleared_begin_tau, 0, 10);
  require("cleared_end_tau", t.cleared_end_tau, t.cleared_begin_tau, 100);
  if (t.region == UpdateRegion::Projective) requireProjective(t.projective, t.voxel_size_m);

  ApproachParams& a = p.approach;
  require("num_directions", a.num_directions, 4, 256, "Up to 256 directions are supported");
  require("normal_cone_rad", a.normal_cone_rad, 0.01, std::numbers::pi / 2);
  require("observation_cos_min", a.observation_cos_min, -1, 1);
  for (const double f : a.arm_tau) require("arm_tau", f, 0, 100);
  require("rolls", a.rolls, 0, kMostRolls, "Up to 64 rolls are supported; 0 chooses by rule");
  // For a sphere the rule asks what the tool looks like.
  if (a.rolls == 0 && a.orientations.kind != OrientationKind::Sphere) a.rolls = 1;
  require("corridor_length_m", a.corridor_length_m, 0, 50 * t.truncation_distance_m,
          "A corridor is at most 50 tau long");
  // Only space that rays passed counts as free, so the cleared band reaches as far as the corridor.
  t.cleared_end_tau = std::max(t.cleared_end_tau, a.corridor_length_m / t.truncation_distance_m);

  ScoringParams& s = p.scoring;
  if (s.collision_distance_m == 0) s.collision_distance_m = 0.5 * t.voxel_size_m;
  require("collision_distance_m", s.collision_distance_m, 1e-6, t.truncation_distance_m);
  require("self_exclusion_voxels", s.self_exclusion_voxels, 0, 100);
  require("surface_samples", s.surface_samples, 10, 1'000'000);
  require("max_collisions", s.max_collisions, -1, 65000, "0 is the rule, -1 is none");
  if (s.neighbours == 0) s.neighbours = neighboursFor(t.range_noise_m, t.voxel_size_m);
  require("neighbours", s.neighbours, 3, 500);
  require("confidence_half_weight", s.confidence_half_weight, 0.01, 1000);
  require("confidence_min", s.confidence_min, 0, 0.99);

  require("budget_points", p.update.budget_points, 0, 2'000'000'000);
  require("changed_voxel_sample", p.update.changed_voxel_sample, 0, 1'000'000);
  require("changed_voxel_radius_voxels", p.update.changed_voxel_radius_voxels, 0, 100);
  require("requeue_motion_m", p.update.requeue_motion_m, 0, 1000);
  require("stability_min", p.update.stability_min, 0, 1);
  requireChange(p.change);
  if (t.region != UpdateRegion::DoubleCone) p.change = {ChangeMode::Off};
  if (p.change.mode == ChangeMode::Full && p.update.policy == UpdatePolicy::Paper) {
    throw InvalidArgument("config.change", "change full", "needs updates that follow the map in both directions",
                          "Use UpdatePolicy::Exact");
  }
  internal::requireThreads(p.threads);
  for (std::size_t axis = 0; p.origin_W && axis < 3; ++axis) require("origin_W", (*p.origin_W)[axis], -1e8, 1e8);
  if (p.window) requireWindow(p);
  requireOrientations(p);
  return p;
}

std::string FieldParams::describe() const {
  std::string out;
  const auto put = [&](const char* name, const std::string& value) { out += std::string(name) + " " + value + "\n"; };
  put("voxel_size_m", text(tsdf.voxel_size_m));
  put("truncation_distance_m", text(tsdf.truncation_distance_m));
  put("range_noise_m", text(tsdf.range_noise_m));
  put("min_range_m", text(tsdf.min_range_m));
  put("max_range_m", text(tsdf.max_range_m));
  put("region", nameOf(tsdf.region));
  if (tsdf.region == UpdateRegion::Projective) {
    const ProjectiveParams& p = tsdf.projective;
    put("projective_bin_rad", text(p.bin_rad));
    put("projective_in_front", p.in_front ? "true" : "false");
    put("projective_empty_is_free", p.empty_is_free ? "true" : "false");
    put("projective_guarded", p.guarded ? "true" : "false");
    put("projective_cleared_band", p.cleared_band ? "true" : "false");
    put("projective_elevation_rad", text(p.elevation_min_rad) + " " + text(p.elevation_max_rad));
    for (const auto& [name, corner] :
         {std::pair{"projective_box_min_W_m", p.box_min_W_m}, std::pair{"projective_box_max_W_m", p.box_max_W_m}}) {
      put(name, text(corner[0]) + " " + text(corner[1]) + " " + text(corner[2]));
    }
  }
  put("cone_cos_min", text(tsdf.cone_cos_min));
  put("clamp_min_m", text(tsdf.clamp_min_m));
  put("max_weight", std::to_string(tsdf.max_weight));
  put("cleared_radius_voxels", text(tsdf.cleared_radius_voxels));
  put("cleared_begin_tau", text(tsdf.cleared_begin_tau));
  put("cleared_end_tau", text(tsdf.cleared_end_tau));
  put("num_directions", std::to_string(approach.num_directions));
  // Only where they say something: files of yaw are those from before there was a choice.
  const bool by_rule = approach.rolls == 0 && approach.orientations.kind == OrientationKind::Sphere;
  const bool rolls = approach.rolls > 1 || by_rule;
  if (!approach.orientations.isYaw() || rolls) put("orientations", approach.orientations.text());
  if (rolls) put("rolls", std::to_string(approach.rolls));
  put("normal_cone_rad", text(approach.normal_cone_rad));
  put("observation_cos_min", text(approach.observation_cos_min));
  put("arm_tau", text(approach.arm_tau[0]) + " " + text(approach.arm_tau[1]) + " " + text(approach.arm_tau[2]));
  put("corridor_length_m", text(approach.corridor_length_m));
  put("coarse_to_fine", approach.coarse_to_fine ? "true" : "false");
  put("viewpoints", approach.viewpoints ? "true" : "false");
  put("collision_distance_m", text(scoring.collision_distance_m));
  put("self_exclusion_voxels", text(scoring.self_exclusion_voxels));
  put("tool_form", scoring.form == ToolForm::Voxels ? "voxels" : "surface_samples");
  put("surface_samples", std::to_string(scoring.surface_samples));
  put("max_collisions", std::to_string(scoring.max_collisions));
  put("neighbours", std::to_string(scoring.neighbours));
  put("mean_positions", scoring.mean_positions ? "true" : "false");
  put("join_neighbour_views", scoring.join_neighbour_views ? "true" : "false");
  put("neighbourhood_weight", scoring.neighbourhood_weight ? "true" : "false");
  put("confidence_half_weight", text(scoring.confidence_half_weight));
  put("confidence_min", text(scoring.confidence_min));
  put("policy", update.policy == UpdatePolicy::Exact ? "exact" : "paper");
  put("budget_points", std::to_string(update.budget_points));
  put("changed_voxel_sample", std::to_string(update.changed_voxel_sample));
  put("changed_voxel_radius_voxels", text(update.changed_voxel_radius_voxels));
  put("requeue_motion_m", text(update.requeue_motion_m));
  put("stability_min", text(update.stability_min));
  put("seed", std::to_string(update.seed));
  // Left out when off: files are then those that were written before there was a choice, to the last byte.
  if (change.mode != ChangeMode::Off) put("change", change.mode == ChangeMode::Block ? "block" : "full");
  if (change.mode == ChangeMode::Full) put("free_for_s", text(change.free_for_s));
  return out;
}

}  // namespace accessvdb
