// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// C and C++ give the same points, field by field, for the same scans, rays, tools and parameters.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <tuple>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "accessvdb/tool_spec.h"
#include "package/beside_cpp.h"
#include "sample_scans/walk_generator.h"
#include "support/scratch_folder.h"

namespace {

using accessvdb::AccessibilityField;
using accessvdb::FieldParams;
using accessvdb::FieldSnapshot;
using accessvdb::OrientationSet;
using accessvdb::SurfacePoint;
using accessvdb::ToolGeometry;
using accessvdb::samples::WalkFrame;
using accessvdb::samples::WalkGenerator;
using accessvdb::test::defaults;
using accessvdb::test::expectSame;
using accessvdb::test::rowMajor;

struct CField {
  CField(const char* tool_name, const accessvdb_params* params) {
    accessvdb_error error = {};
    error.struct_size = sizeof error;
    accessvdb_tool* tool = nullptr;
    EXPECT_EQ(accessvdb_tool_builtin(tool_name, &tool, &error), ACCESSVDB_OK) << error.text;
    EXPECT_EQ(accessvdb_field_create(tool, params, &handle, &error), ACCESSVDB_OK) << error.text;
    accessvdb_tool_free(tool);
  }
  ~CField() { accessvdb_field_free(handle); }
  CField(const CField&) = delete;
  CField& operator=(const CField&) = delete;

  std::vector<accessvdb_point> points() const {
    std::size_t count = 0;
    EXPECT_EQ(accessvdb_field_take_snapshot(handle, &count), ACCESSVDB_OK);
    std::vector<accessvdb_point> out(count);
    // In two pieces, so that `first` matters.
    const std::size_t half = count / 2;
    EXPECT_EQ(accessvdb_field_copy_points(handle, 0, half, out.data(), sizeof out[0]), ACCESSVDB_OK);
    EXPECT_EQ(accessvdb_field_copy_points(handle, half, count - half, out.data() + half, sizeof out[0]), ACCESSVDB_OK);
    return out;
  }
  accessvdb_field* handle = nullptr;
};

TEST(CApiParity, OrientationsAreThoseOfTheText) {
  const WalkGenerator walk({.frames = 2, .rays_per_frame = 6000, .range_noise_m = 0.01, .seed = 13});
  accessvdb_params params = defaults();
  EXPECT_EQ(params.orientations, nullptr);
  params.voxel_size_m = 0.1;
  std::string text = "sphere:15";
  params.orientations = text.c_str();
  EXPECT_EQ(params.rolls, 0);  // the rule
  FieldParams cpp_params = {.tsdf = {.voxel_size_m = 0.1}};
  cpp_params.approach.orientations = OrientationSet::sphere(15);
  AccessibilityField cpp(ToolGeometry::builtin("builtin:pruner"), cpp_params);
  CField c("builtin:pruner", &params);
  text = "nothing that is read any more";
  for (int n = 0; n < 2; ++n) {
    const WalkFrame frame = walk.frame(n);
    cpp.integrateScan(frame.points_S, frame.T_W_S);
    ASSERT_EQ(accessvdb_field_integrate_scan(c.handle, frame.points_S[0].data(), frame.points_S.size(),
                                             rowMajor(frame.T_W_S).data(), nullptr),
              ACCESSVDB_OK);
  }
  cpp.update();
  ASSERT_EQ(accessvdb_field_update(c.handle, nullptr), ACCESSVDB_OK);
  expectSame(c.points(), cpp.snapshot());
  EXPECT_EQ(cpp.params().approach.rolls, 6);
  std::size_t rolled = 0;
  for (const accessvdb_point& point : c.points()) rolled += point.roll > 0 ? 1 : 0;
  EXPECT_GT(rolled, 10u);
  accessvdb_tool* tool = nullptr;
  accessvdb_field* field = nullptr;
  accessvdb_error error = {};
  error.struct_size = sizeof error;
  ASSERT_EQ(accessvdb_tool_builtin("builtin:pruner", &tool, &error), ACCESSVDB_OK);
  for (const auto& [bad, code, id] : {std::tuple{"all", ACCESSVDB_ERROR_USAGE, "orientations.text"},
                                      {"sphere:0", ACCESSVDB_ERROR_USAGE, "orientations.range"},
                                      {"sphere:3", ACCESSVDB_ERROR_RESOURCE, "orientations.count"},
                                      {"list:/nowhere/list.txt", ACCESSVDB_ERROR_INPUT, "input.missing"}}) {
    params.orientations = bad;
    EXPECT_EQ(accessvdb_field_create(tool, &params, &field, &error), static_cast<int>(code)) << bad;
    EXPECT_STREQ(error.id, id) << bad;
  }
  accessvdb_tool_free(tool);
}

TEST(CApiParity, ASavedStateGoesOnLikeTheFieldItself) {
  const WalkGenerator walk({.frames = 5, .rays_per_frame = 6000, .range_noise_m = 0.01, .seed = 12});
  accessvdb_params params = defaults();
  params.voxel_size_m = 0.1;
  const accessvdb::test::ScratchFolder folder;
  const std::string file = (folder / "state.avst").string();
  const auto integrate = [&](accessvdb_field* field, int n) {
    const WalkFrame frame = walk.frame(n);
    ASSERT_EQ(accessvdb_field_integrate_scan(field, frame.points_S[0].data(), frame.points_S.size(),
                                             rowMajor(frame.T_W_S).data(), nullptr),
              ACCESSVDB_OK);
  };
  AccessibilityField cpp(ToolGeometry::builtin("builtin:pruner"), {.tsdf = {.voxel_size_m = 0.1}});
  CField c("builtin:pruner", &params);
  for (int n = 0; n < walk.frames(); ++n) {
    const WalkFrame frame = walk.frame(n);
    cpp.integrateScan(frame.points_S, frame.T_W_S);
    integrate(c.handle, n);
    if (n != 2) continue;
    ASSERT_EQ(accessvdb_field_save_state(c.handle, file.c_str()), ACCESSVDB_OK) << accessvdb_field_error_text(c.handle);
    accessvdb_field_free(std::exchange(c.handle, nullptr));
    accessvdb_error error = {};
    error.struct_size = sizeof error;
    accessvdb_tool* tool = nullptr;
    ASSERT_EQ(accessvdb_tool_builtin("builtin:pruner", &tool, &error), ACCESSVDB_OK) << error.text;
    ASSERT_EQ(accessvdb_field_load_state(file.c_str(), tool, ACCESSVDB_BACKEND_AUTO, 1, &c.handle, &error),
              ACCESSVDB_OK)
        << error.text;
    accessvdb_tool_free(tool);
  }
  EXPECT_EQ(accessvdb_field_parameters(c.handle), cpp.params().describe());
  cpp.update();
  ASSERT_EQ(accessvdb_field_update(c.handle, nullptr), ACCESSVDB_OK);
  expectSame(c.points(), cpp.snapshot());
}

TEST(CApiParity, StampsAreTheFieldsTime) {
  accessvdb_params params = defaults();
  params.voxel_size_m = 0.1;
  const CField c("builtin:pencil", &params);
  const std::vector<float> points_S = {2, 0, 0, 2, 0.1f, 0};
  const std::vector<double> points_W = {2, 0, 0, 2, 0.1, 0}, origin_W = {0, 0, 0};
  const auto T_W_S = rowMajor(Eigen::Isometry3d::Identity());
  double latest_s = 0;
  ASSERT_EQ(accessvdb_field_latest_stamp(c.handle, &latest_s), ACCESSVDB_OK);
  EXPECT_TRUE(std::isnan(latest_s));
  accessvdb_frame_stats stats = {};
  stats.struct_size = sizeof stats;
  ASSERT_EQ(accessvdb_field_integrate_scan_at(c.handle, points_S.data(), 2, T_W_S.data(), 7.5, &stats), ACCESSVDB_OK);
  EXPECT_EQ(stats.points_used, 2u);
  ASSERT_EQ(accessvdb_field_integrate_rays_at(c.handle, points_W.data(), 2, origin_W.data(), 1, 8.25, &stats),
            ACCESSVDB_OK);
  EXPECT_EQ(stats.points_used, 2u);
  ASSERT_EQ(accessvdb_field_integrate_scan_at(c.handle, points_S.data(), 2, T_W_S.data(), 3, nullptr), ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_field_latest_stamp(c.handle, &latest_s), ACCESSVDB_OK);
  EXPECT_EQ(latest_s, 8.25);
  EXPECT_EQ(accessvdb_field_latest_stamp(c.handle, nullptr), ACCESSVDB_ERROR_USAGE);
}

TEST(CApiParity, ScansGiveTheSamePoints) {
  const WalkGenerator walk({.frames = 5, .rays_per_frame = 6000, .range_noise_m = 0.01, .seed = 11});
  accessvdb_params params = defaults();
  params.voxel_size_m = 0.1;
  const CField c("builtin:pruner", &params);
  AccessibilityField cpp(ToolGeometry::builtin("builtin:pruner"), {.tsdf = {.voxel_size_m = 0.1}});
  for (int n = 0; n < walk.frames(); ++n) {
    const WalkFrame frame = walk.frame(n);
    const auto stats = cpp.integrateScan(frame.points_S, frame.T_W_S);
    accessvdb_frame_stats c_stats = {};
    c_stats.struct_size = sizeof c_stats;
    ASSERT_EQ(accessvdb_field_integrate_scan(c.handle, frame.points_S[0].data(), frame.points_S.size(),
                                             rowMajor(frame.T_W_S).data(), &c_stats),
              ACCESSVDB_OK)
        << accessvdb_field_error_text(c.handle);
    EXPECT_EQ(c_stats.points_in, stats.points_in);
    EXPECT_EQ(c_stats.points_used, stats.points_used);
    EXPECT_EQ(c_stats.dropped[0], stats.dropped[0]);
    EXPECT_GT(c_stats.dropped[0], 0u);
    EXPECT_EQ(c_stats.touched_leaves, stats.touched_leaves);
    EXPECT_EQ(c_stats.new_leaves, stats.new_leaves);
    EXPECT_EQ(c_stats.distance_updates, stats.distance_updates);
    EXPECT_EQ(c_stats.cleared_updates, stats.cleared_updates);
    if (n == 2 || n == 4) {
      const auto update = cpp.update();
      accessvdb_update_stats c_update = {};
      c_update.struct_size = sizeof c_update;
      ASSERT_EQ(accessvdb_field_update(c.handle, &c_update), ACCESSVDB_OK);
      EXPECT_EQ(c_update.dirty_points, update.dirty_points);
      EXPECT_EQ(c_update.direction_tests, update.direction_tests);
      EXPECT_EQ(c_update.label_changes, update.label_changes);
    }
  }
  const FieldSnapshot snapshot = cpp.snapshot();
  expectSame(c.points(), snapshot);

  accessvdb_counts counts = {};
  counts.struct_size = sizeof counts;
  ASSERT_EQ(accessvdb_field_get_counts(c.handle, &counts), ACCESSVDB_OK);
  for (int label = 0; label < accessvdb::kNumPointLabels; ++label) {
    EXPECT_EQ(counts.labels[label], snapshot.count(static_cast<accessvdb::PointLabel>(label)));
  }
  const auto reasons = snapshot.reasons();
  for (std::size_t reason = 0; reason < ACCESSVDB_NUM_REASONS; ++reason) {
    EXPECT_EQ(counts.reasons[reason], reasons[reason]);
  }
  EXPECT_EQ(counts.changed, reasons[ACCESSVDB_REASON_CHANGED]);
  EXPECT_EQ(counts.beside_surface, reasons[ACCESSVDB_REASON_BESIDE_SURFACE]);
}

TEST(CApiParity, UpdatesThatDoNotBlockGiveTheSamePoints) {
  const WalkGenerator walk({.frames = 5, .rays_per_frame = 3000, .range_noise_m = 0.01, .seed = 12});
  accessvdb_params params = defaults();
  params.voxel_size_m = 0.1;
  accessvdb_update* update = nullptr;
  accessvdb_update_stats c_update = {};
  c_update.struct_size = sizeof c_update;
  std::uint64_t dirty = 0;
  {
    const CField c("builtin:pruner", &params);
    AccessibilityField cpp(ToolGeometry::builtin("builtin:pruner"), {.tsdf = {.voxel_size_m = 0.1}});
    for (int n = 0; n < walk.frames(); ++n) {
      const WalkFrame frame = walk.frame(n);
      cpp.integrateScan(frame.points_S, frame.T_W_S);
      ASSERT_EQ(accessvdb_field_integrate_scan(c.handle, frame.points_S[0].data(), frame.points_S.size(),
                                               rowMajor(frame.T_W_S).data(), nullptr),
                ACCESSVDB_OK);
      if (update != nullptr) {
        ASSERT_EQ(accessvdb_update_wait(update, &c_update), ACCESSVDB_OK) << accessvdb_update_error_text(update);
        EXPECT_EQ(c_update.dirty_points, dirty);
        accessvdb_update_free(update);
      }
      ASSERT_EQ(accessvdb_field_update_async(c.handle, &update), ACCESSVDB_OK) << accessvdb_field_error_text(c.handle);
      dirty = cpp.update().dirty_points;
    }
    expectSame(c.points(), cpp.snapshot());
    std::int32_t done = 0;  // the snapshot waited
    EXPECT_EQ(accessvdb_update_is_done(update, &done), ACCESSVDB_OK);
    EXPECT_EQ(done, 1);
  }  // the field goes first
  ASSERT_EQ(accessvdb_update_wait(update, &c_update), ACCESSVDB_OK);
  EXPECT_EQ(c_update.dirty_points, dirty);
  EXPECT_GT(dirty, 0u);
  accessvdb_update_free(update);
}

TEST(CApiParity, RaysGiveTheSamePoints) {
  const WalkGenerator walk({.frames = 4, .rays_per_frame = 5000, .seed = 5});
  accessvdb_params params = defaults();
  params.voxel_size_m = 0.1;
  params.max_range_m = 12;
  const CField c("builtin:pencil", &params);
  AccessibilityField cpp(ToolGeometry::builtin("builtin:pencil"), {.tsdf = {.voxel_size_m = 0.1, .max_range_m = 12}});
  for (int n = 0; n < walk.frames(); ++n) {
    const WalkFrame frame = walk.frame(n);
    std::vector<Eigen::Vector3d> points_W, origins_W;
    for (const Eigen::Vector3f& p_S : frame.points_S) {
      if (p_S == Eigen::Vector3f::Zero()) continue;
      points_W.push_back(frame.T_W_S * p_S.cast<double>());
      origins_W.push_back(frame.T_W_S.translation());
    }
    if (n % 2 == 1) origins_W.resize(1);
    cpp.integrateRays(points_W, origins_W);
    ASSERT_EQ(accessvdb_field_integrate_rays(c.handle, points_W[0].data(), points_W.size(), origins_W[0].data(),
                                             origins_W.size(), nullptr),
              ACCESSVDB_OK)
        << accessvdb_field_error_text(c.handle);
  }
  cpp.update();
  ASSERT_EQ(accessvdb_field_update(c.handle, nullptr), ACCESSVDB_OK);
  expectSame(c.points(), cpp.snapshot());
}

/// One field of the struct, set to the same value on both sides.
struct Setting {
  std::function<void(accessvdb_params&)> c;
  std::function<void(FieldParams&)> cpp;
};

std::map<std::string, std::string> lines(const std::string& description) {
  std::map<std::string, std::string> out;
  std::istringstream in(description);
  for (std::string line; std::getline(in, line);) out[line.substr(0, line.find(' '))] = line.substr(line.find(' ') + 1);
  return out;
}

TEST(CApiParity, EveryParameterArrives) {
#define SET(c_field, cpp_field, value)                                                          \
  Setting {                                                                                     \
    [](accessvdb_params& p) { p.c_field = value; }, [](FieldParams& p) { p.cpp_field = value; } \
  }
#define CHOOSE(c_field, cpp_field, c_value, cpp_value)                                                \
  Setting {                                                                                           \
    [](accessvdb_params& p) { p.c_field = c_value; }, [](FieldParams& p) { p.cpp_field = cpp_value; } \
  }
  const std::vector<Setting> settings = {
      SET(voxel_size_m, tsdf.voxel_size_m, 0.07),
      SET(truncation_distance_m, tsdf.truncation_distance_m, 0.37),
      SET(range_noise_m, tsdf.range_noise_m, 0.06),
      SET(min_range_m, tsdf.min_range_m, 0.3),
      SET(max_range_m, tsdf.max_range_m, 21),
      SET(cone_cos_min, tsdf.cone_cos_min, 0.93),
      SET(clamp_min_m, tsdf.clamp_min_m, -0.05),
      SET(cleared_radius_voxels, tsdf.cleared_radius_voxels, 1.5),
      SET(cleared_begin_tau, tsdf.cleared_begin_tau, 0.75),
      SET(cleared_end_tau, tsdf.cleared_end_tau, 3.5),
      SET(max_weight, tsdf.max_weight, 77),
      SET(clear_rays_m, tsdf.clear_rays_m, 12),
      SET(platform_radius_m, tsdf.platform_radius_m, 0.5),
      SET(num_directions, approach.num_directions, 90),
      SET(normal_cone_rad, approach.normal_cone_rad, 1.1),
      SET(observation_cos_min, approach.observation_cos_min, 0.3),
      SET(arm_tau[0], approach.arm_tau[0], 0.5),
      SET(arm_tau[1], approach.arm_tau[1], 1.5),
      SET(arm_tau[2], approach.arm_tau[2], 2.5),
      SET(corridor_length_m, approach.corridor_length_m, 1.75),
      SET(coarse_to_fine, approach.coarse_to_fine, true),
      SET(viewpoints, approach.viewpoints, true),
      SET(collision_distance_m, scoring.collision_distance_m, 0.012),
      SET(self_exclusion_voxels, scoring.self_exclusion_voxels, 2.5),
      SET(surface_samples, scoring.surface_samples, 500),
      SET(max_collisions, scoring.max_collisions, 3),
      SET(neighbours, scoring.neighbours, 12),
      SET(mean_positions, scoring.mean_positions, false),
      SET(join_neighbour_views, scoring.join_neighbour_views, false),
      SET(neighbourhood_weight, scoring.neighbourhood_weight, false),
      SET(confidence_half_weight, scoring.confidence_half_weight, 4),
      SET(confidence_min, scoring.confidence_min, 0.3),
      SET(point_spacing_m, scoring.point_spacing_m, 0.2),
      SET(budget_points, update.budget_points, 1000),
      SET(changed_voxel_sample, update.changed_voxel_sample, 128),
      SET(changed_voxel_radius_voxels, update.changed_voxel_radius_voxels, 2),
      SET(requeue_motion_m, update.requeue_motion_m, 0.2),
      SET(stability_min, update.stability_min, 0.6),
      SET(seed, update.seed, 9),
      CHOOSE(region, tsdf.region, ACCESSVDB_REGION_FULL_CUBE, accessvdb::UpdateRegion::FullCube),
      CHOOSE(tool_form, scoring.form, ACCESSVDB_FORM_SURFACE_SAMPLES, accessvdb::ToolForm::SurfaceSamples),
      CHOOSE(change, change.mode, ACCESSVDB_CHANGE_OFF, accessvdb::ChangeMode::Off),
      CHOOSE(policy, update.policy, ACCESSVDB_POLICY_PAPER, accessvdb::UpdatePolicy::Paper),
  };
#undef SET
#undef CHOOSE
  const auto plain = lines(FieldParams{}.resolved().describe());
  std::set<std::string> reached;
  for (std::size_t n = 0; n < settings.size(); ++n) {
    SCOPED_TRACE("setting " + std::to_string(n));
    accessvdb_params c = defaults();
    FieldParams cpp;
    // A voxel size and a number of directions that keep tool tables small; settings may change them.
    c.voxel_size_m = cpp.tsdf.voxel_size_m = 0.1;
    settings[n].c(c);
    settings[n].cpp(cpp);
    const CField field("builtin:pencil", &c);
    ASSERT_NE(field.handle, nullptr);
    EXPECT_EQ(accessvdb_field_parameters(field.handle), cpp.resolved().describe());
    const auto changed = lines(cpp.resolved().describe());
    for (const auto& [name, value] : changed) {
      if (!plain.contains(name) || plain.at(name) != value) reached.insert(name);
    }
    for (const auto& [name, value] : plain) {
      if (!changed.contains(name)) reached.insert(name);  // some have no line when off
    }
  }
  // Ensures that a parameter added to C++ is not forgotten in C.
  for (const auto& [name, value] : plain) EXPECT_TRUE(reached.contains(name)) << name << " cannot be set from C";
}

TEST(CApiParity, FreeSpaceAges) {
  accessvdb_params c = defaults();
  EXPECT_EQ(c.free_for_s, std::numeric_limits<double>::infinity());
  c.voxel_size_m = 0.1;
  c.change = ACCESSVDB_CHANGE_FULL;
  c.free_for_s = 45;
  const CField field("builtin:pencil", &c);
  ASSERT_NE(field.handle, nullptr);
  const auto found = lines(accessvdb_field_parameters(field.handle));
  EXPECT_EQ(found.at("change"), "full");
  EXPECT_EQ(found.at("free_for_s"), "45");
  for (const double bad : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
    c.free_for_s = bad;
    accessvdb_tool* tool = nullptr;
    accessvdb_field* refused = nullptr;
    accessvdb_error error = {};
    error.struct_size = sizeof error;
    ASSERT_EQ(accessvdb_tool_builtin("builtin:pencil", &tool, &error), ACCESSVDB_OK);
    EXPECT_EQ(accessvdb_field_create(tool, &c, &refused, &error), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(refused, nullptr);
    accessvdb_tool_free(tool);
  }
  EXPECT_STREQ(accessvdb_reason_name(ACCESSVDB_REASON_CHANGED), "changed");
  EXPECT_STREQ(accessvdb_reason_name(ACCESSVDB_REASON_BESIDE_SURFACE), "beside_surface");
}

TEST(CApiParity, PaperParameters) {
  accessvdb_params c = {};
  c.struct_size = sizeof c;
  ASSERT_EQ(accessvdb_params_paper(0.05, &c), ACCESSVDB_OK);
  EXPECT_EQ(c.struct_size, sizeof c);
  const CField field("builtin:pencil", &c);
  EXPECT_EQ(accessvdb_field_parameters(field.handle), FieldParams::paper(0.05).resolved().describe());
}

TEST(CApiParity, NoParametersAreTheDefaults) {
  const CField field("builtin:pencil", nullptr);
  EXPECT_EQ(accessvdb_field_parameters(field.handle), FieldParams{}.resolved().describe());
  EXPECT_EQ(accessvdb_field_device(field.handle),
            AccessibilityField(ToolGeometry::builtin("builtin:pencil")).deviceName());
}

}  // namespace
