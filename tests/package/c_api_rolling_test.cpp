// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fields of any extent in C: the same as in C++, also where tiles leave memory and after a stop; bad calls are
/// refused.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "accessvdb/c_api.h"
#include "accessvdb/rolling_field.h"
#include "package/beside_cpp.h"
#include "sample_scans/walk_generator.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

constexpr std::int32_t kTile_voxels = 128;
constexpr int kSteps = 16;
constexpr std::array<double, 16> kAtOrigin = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

/// A walk of 60 m there and back, seen up to 5 m.
samples::WalkFrame walked(int step) {
  static const samples::WalkGenerator walk(
      {.frames = kSteps / 2, .rays_per_frame = 4000, .seed = 5, .length_m = 60, .max_range_m = 5});
  return walk.frame(step < kSteps / 2 ? step : kSteps - 1 - step);
}

std::vector<ToolSpec> toolsInCpp() {
  return {{ToolGeometry::builtin("builtin:pencil"), OrientationSet::yaw(), 0, "level", 0},
          {ToolGeometry::builtin("builtin:pencil"), OrientationSet::sphere(45), 0, "any", 0}};
}

FieldParams paramsInCpp() {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.1;
  params.backend = BackendKind::Cpu;
  return params;
}

void step(RollingField& field, int n) {
  const samples::WalkFrame frame = walked(n);
  field.integrateScan(frame.points_S, frame.T_W_S, 0.1 * n);
}
void step(accessvdb_rolling* field, int n) {
  const samples::WalkFrame frame = walked(n);
  auto stats = sized<accessvdb_frame_stats>();
  ASSERT_EQ(accessvdb_rolling_integrate_scan_at(field, frame.points_S[0].data(), frame.points_S.size(),
                                                rowMajor(frame.T_W_S).data(), 0.1 * n, &stats),
            ACCESSVDB_OK)
      << accessvdb_rolling_error_text(field);
  EXPECT_EQ(stats.points_in, frame.points_S.size());
  EXPECT_GT(stats.points_used, 0u);
}

using CopyInC = int (*)(accessvdb_rolling*, std::size_t, std::size_t, accessvdb_point*, std::size_t) noexcept;
std::vector<accessvdb_point> copied(accessvdb_rolling* field, CopyInC copy, std::size_t count) {
  std::vector<accessvdb_point> points(count);
  const std::size_t half = count / 2;  // in two pieces, so that `first` matters
  EXPECT_EQ(copy(field, 0, half, points.data(), sizeof points[0]), ACCESSVDB_OK);
  EXPECT_EQ(copy(field, half, count - half, points.data() + half, sizeof points[0]), ACCESSVDB_OK);
  return points;
}

accessvdb_rolling_status statusOf(accessvdb_rolling* field) {
  auto status = sized<accessvdb_rolling_status>();
  EXPECT_EQ(accessvdb_rolling_get_status(field, &status), ACCESSVDB_OK);
  return status;
}

/// Without what depends on how far the thread for the disk has come: which tiles it has begun, and what waits for it.
void expectSameStatus(const accessvdb_rolling_status& c, const RollingStatus& cpp) {
  EXPECT_EQ(c.struct_size, sizeof c);
  EXPECT_EQ(c.memory_short != 0, cpp.memory_short);
  EXPECT_EQ(c.tile_voxels, cpp.tile_voxels);
  EXPECT_EQ(c.margin_voxels, cpp.margin_voxels);
  EXPECT_EQ(c.steps, cpp.steps);
  EXPECT_EQ(c.points, cpp.points);
  EXPECT_EQ(c.tiles, cpp.tiles);
  EXPECT_EQ(c.tiles_in_memory, cpp.tiles_in_memory);
  EXPECT_EQ(c.saved, cpp.saved);
  EXPECT_EQ(c.loaded, cpp.loaded);
  EXPECT_LE(c.saved_ahead, c.saved);
  EXPECT_LE(c.loaded_ahead, c.loaded);
  EXPECT_EQ(c.memory_bytes, cpp.memory_bytes);
  EXPECT_EQ(c.device_bytes, cpp.device_bytes);
  EXPECT_EQ(c.peak_memory_bytes, cpp.peak_memory_bytes);
  EXPECT_EQ(c.left_out_returns, cpp.left_out_returns);
  EXPECT_EQ(c.lost_tile_count, cpp.lost_tiles.size());
  EXPECT_EQ(c.fitting_range_m, cpp.fitting_range_m);
}

class CApiRolling : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(accessvdb_tool_builtin("builtin:pencil", &tool_, nullptr), ACCESSVDB_OK);
    specs_[0] = {tool_, "level", nullptr, 0, 0, 0};
    specs_[1] = {tool_, "any", "sphere:45", 0, 0, 0};
    params_ = defaults();
    params_.voxel_size_m = 0.1;
    params_.backend = ACCESSVDB_BACKEND_CPU;
    options_.folder = in_c_.c_str();
    options_.tile_voxels = kTile_voxels;
  }
  void TearDown() override {
    accessvdb_rolling_free(field_);
    accessvdb_tool_free(tool_);
  }
  int make() {
    accessvdb_rolling_free(std::exchange(field_, nullptr));
    return accessvdb_rolling_create(specs_.data(), sizeof specs_[0], specs_.size(), &params_, &options_, &field_,
                                    &error_);
  }
  void expectRefused(int code, int expected, const char* id) {
    EXPECT_EQ(code, expected);
    EXPECT_STREQ(accessvdb_rolling_error_id(field_), id);
    expectLine(accessvdb_rolling_error_text(field_));
  }
  void expectNotMade(int expected, const char* id) {
    EXPECT_EQ(make(), expected) << error_.text;
    EXPECT_EQ(field_, nullptr);
    EXPECT_STREQ(error_.id, id);
    expectLine(error_.text);
  }
  static void expectLine(const std::string& text) {
    EXPECT_GT(text.size(), 10u);
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
  }
  [[nodiscard]] RollingOptions optionsInCpp(const char* name = "cpp") const {
    return {.folder = scratch_ / name,
            .memory_limit_bytes = options_.memory_limit_bytes,
            .device_limit_bytes = options_.device_limit_bytes,
            .tile_voxels = options_.tile_voxels,
            .notes_changes = options_.notes_changes != 0};
  }
  /// So that tiles have to leave: this share of what all take.
  void limitTo(double share) {
    RollingField all(toolsInCpp(), paramsInCpp(), optionsInCpp("all"));
    for (int n = 0; n < kSteps; ++n) step(all, n);
    all.update();
    ASSERT_EQ(all.status().saved, 0u);
    options_.memory_limit_bytes = static_cast<std::uint64_t>(share * static_cast<double>(all.status().memory_bytes));
  }
  std::vector<accessvdb_point> points() {
    std::size_t count = 0;
    EXPECT_EQ(accessvdb_rolling_take_snapshot(field_, &count), ACCESSVDB_OK);
    return copied(field_, accessvdb_rolling_copy_points, count);
  }

  const ScratchFolder scratch_;
  const std::string in_c_ = scratch_ / "c";
  accessvdb_tool* tool_ = nullptr;
  std::array<accessvdb_tool_spec, 2> specs_ = {};
  accessvdb_params params_ = {};
  accessvdb_rolling_options options_ = sized<accessvdb_rolling_options>();
  accessvdb_error error_ = sized<accessvdb_error>();
  accessvdb_rolling* field_ = nullptr;
};

TEST_F(CApiRolling, HasThePointsOfCpp) {
  options_.notes_changes = 1;
  limitTo(0.5);
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  RollingField cpp(toolsInCpp(), paramsInCpp(), optionsInCpp());
  for (int n = 0; n < kSteps; ++n) {
    step(cpp, n);
    ASSERT_NO_FATAL_FAILURE(step(field_, n));
    if (n % 3 != 2) continue;
    const UpdateStats expected = cpp.update();
    auto stats = sized<accessvdb_update_stats>();
    ASSERT_EQ(accessvdb_rolling_update(field_, &stats), ACCESSVDB_OK);
    EXPECT_EQ(stats.dirty_points, expected.dirty_points);
    EXPECT_EQ(stats.scored_points, expected.scored_points);
    std::size_t count = 0;
    ASSERT_EQ(accessvdb_rolling_take_changed(field_, &count), ACCESSVDB_OK);
    const auto changed = copied(field_, accessvdb_rolling_copy_changed, count);
    const std::vector<SurfacePoint> changed_in_cpp = cpp.takeChanged();
    ASSERT_EQ(count, changed_in_cpp.size());
    ASSERT_GT(count, 0u);
    for (std::size_t p = 0; p < count; ++p) ASSERT_NO_FATAL_FAILURE(expectSame(changed[p], changed_in_cpp[p]));
    if (n != 2) continue;
    const std::vector<SurfacePoint> reached = cpp.snapshot().accessible();
    ASSERT_GT(reached.size(), 50u);
    const std::vector<Eigen::Vector3d> closed_W = {reached.front().position_W, reached.back().position_W};
    cpp.leaveOut(closed_W, 2);
    ASSERT_EQ(accessvdb_rolling_leave_out(field_, closed_W[0].data(), closed_W.size(), 2), ACCESSVDB_OK);
  }
  cpp.update();
  ASSERT_EQ(accessvdb_rolling_update(field_, nullptr), ACCESSVDB_OK);
  expectSameStatus(statusOf(field_), cpp.status());
  EXPECT_GT(cpp.status().saved, 0u);
  EXPECT_GT(cpp.status().loaded, 0u);
  EXPECT_LT(cpp.status().tiles_in_memory, cpp.status().tiles);

  std::size_t near = 0;
  ASSERT_EQ(accessvdb_rolling_take_snapshot_in_memory(field_, &near), ACCESSVDB_OK);
  const FieldSnapshot near_in_cpp = cpp.snapshotInMemory();
  expectSame(copied(field_, accessvdb_rolling_copy_points, near), near_in_cpp);
  const auto all = points();
  expectSame(all, cpp.snapshot());
  EXPECT_GT(all.size(), near);
  EXPECT_EQ(accessvdb_rolling_drop_snapshot(field_), ACCESSVDB_OK);
  expectRefused(accessvdb_rolling_copy_points(field_, 0, 0, nullptr, sizeof(accessvdb_point)), ACCESSVDB_ERROR_USAGE,
                "snapshot.none");

  // The same folder of tiles.
  const std::string out = scratch_ / "out_c", out_in_cpp = scratch_ / "out_cpp";
  ASSERT_EQ(accessvdb_rolling_write(field_, out.c_str()), ACCESSVDB_OK) << accessvdb_rolling_error_text(field_);
  ASSERT_EQ(cpp.write(out_in_cpp).size(), cpp.status().tiles);
  const tiles::Plan plan = tiles::readPlan(out), plan_in_cpp = tiles::readPlan(out_in_cpp);
  EXPECT_EQ(plan.id(), plan_in_cpp.id());
  ASSERT_EQ(plan.flights.size(), 1u);
  EXPECT_EQ(plan.flights[0].stamps_s, plan_in_cpp.flights[0].stamps_s);
  EXPECT_GT(plan.flights[0].stamps_s.back(), 1);
  const tiles::Index index = tiles::readIndex(out), expected = tiles::readIndex(out_in_cpp);
  ASSERT_EQ(index.tiles.size(), expected.tiles.size());
  for (std::size_t n = 0; n < index.tiles.size(); ++n) EXPECT_EQ(index.tiles[n].points, expected.tiles[n].points);
}

/// Rays of several origins are those of C++, and with less room the tiles leave earlier, with the same points.
TEST_F(CApiRolling, TakesRaysAndTightens) {
  limitTo(1);
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  RollingField cpp(toolsInCpp(), paramsInCpp(), optionsInCpp());
  ASSERT_EQ(accessvdb_rolling_tighten(field_, 0.5), ACCESSVDB_OK);
  for (int n = 0; n < kSteps; ++n) {
    const samples::WalkFrame frame = walked(n);
    std::vector<Eigen::Vector3d> points_W, origins_W;
    for (const Eigen::Vector3f& p_S : frame.points_S) {
      if (p_S.isZero()) continue;
      points_W.push_back(frame.T_W_S * p_S.cast<double>());
      origins_W.push_back(frame.T_W_S.translation() + Eigen::Vector3d(1e-3 * double(origins_W.size() % 7), 0, 0));
    }
    cpp.integrateRays(points_W, origins_W, std::nullopt);
    ASSERT_EQ(accessvdb_rolling_integrate_rays_at(field_, points_W[0].data(), points_W.size(), origins_W[0].data(),
                                                  origins_W.size(), NAN, nullptr),
              ACCESSVDB_OK)
        << accessvdb_rolling_error_text(field_);
  }
  cpp.update();
  ASSERT_EQ(accessvdb_rolling_update(field_, nullptr), ACCESSVDB_OK);
  EXPECT_GT(statusOf(field_).saved, cpp.status().saved);
  expectSame(points(), cpp.snapshot());
}

TEST_F(CApiRolling, SaysWhatDidNotFit) {
  limitTo(0.02);
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  RollingField cpp(toolsInCpp(), paramsInCpp(), optionsInCpp());
  for (int n = 0; n < 3; ++n) {
    step(cpp, n);
    ASSERT_NO_FATAL_FAILURE(step(field_, n));
  }
  EXPECT_TRUE(cpp.status().memory_short);
  EXPECT_GT(cpp.status().left_out_returns, 0u);
  EXPECT_GT(cpp.status().fitting_range_m, 0);
  expectSameStatus(statusOf(field_), cpp.status());
}

/// What is free()d without a checkpoint is as good as killed.
TEST_F(CApiRolling, GoesOnAfterTheLastCheckpoint) {
  limitTo(0.5);
  std::int32_t found = 7;
  EXPECT_EQ(accessvdb_rolling_has_checkpoint(in_c_.c_str(), &found, nullptr), ACCESSVDB_OK);
  EXPECT_EQ(found, 0);
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  EXPECT_STREQ(accessvdb_rolling_note(field_), "");
  for (int n = 0; n < kSteps; ++n) {
    ASSERT_NO_FATAL_FAILURE(step(field_, n));
    ASSERT_EQ(accessvdb_rolling_update(field_, nullptr), ACCESSVDB_OK);
    if (n == 2) {
      ASSERT_EQ(accessvdb_rolling_checkpoint(field_, nullptr), ACCESSVDB_OK);
    }
    if (n == kSteps / 2) {
      ASSERT_EQ(accessvdb_rolling_checkpoint(field_, "after step 8, \xc3\xa4"), ACCESSVDB_OK);
    }
  }
  EXPECT_STREQ(accessvdb_rolling_note(field_), "after step 8, \xc3\xa4");
  EXPECT_EQ(accessvdb_rolling_has_checkpoint(in_c_.c_str(), &found, nullptr), ACCESSVDB_OK);
  EXPECT_EQ(found, 1);
  const auto all = points();
  expectNotMade(ACCESSVDB_ERROR_OUTPUT, "output.foreign");  // its own folder, but nobody said resume
  options_.resume = 1;
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  EXPECT_STREQ(accessvdb_rolling_note(field_), "after step 8, \xc3\xa4");
  EXPECT_EQ(statusOf(field_).steps, std::uint64_t{kSteps / 2 + 1});
  for (int n = kSteps / 2 + 1; n < kSteps; ++n) {
    ASSERT_NO_FATAL_FAILURE(step(field_, n));
    ASSERT_EQ(accessvdb_rolling_update(field_, nullptr), ACCESSVDB_OK);
  }
  RollingField cpp(toolsInCpp(), paramsInCpp(), optionsInCpp());
  for (int n = 0; n < kSteps; ++n) {
    step(cpp, n);
    cpp.update();
  }
  const FieldSnapshot expected = cpp.snapshot();
  expectSame(all, expected);
  // Score and direction of accessible points are promised; of others they depend on when a point was looked at.
  const auto again = points();
  ASSERT_EQ(again.size(), expected.points.size());
  for (std::size_t n = 0; n < again.size(); ++n) {
    const SurfacePoint& point = expected.points[n];
    ASSERT_EQ(again[n].id, point.id);
    ASSERT_EQ(Eigen::Vector3d(again[n].position_W), point.position_W);
    ASSERT_EQ(again[n].label, static_cast<std::uint8_t>(point.label));
    ASSERT_EQ(again[n].tools, point.tools);
    if (point.label != PointLabel::Accessible) continue;
    ASSERT_EQ(again[n].score, point.score);
    ASSERT_EQ(again[n].direction, point.direction);
  }

  specs_[1].orientations = "sphere:40";
  expectNotMade(ACCESSVDB_ERROR_UNUSABLE, "rolling.changed");
  specs_[1].orientations = "sphere:45";
  std::ofstream(scratch_ / "c/rolling.json") << "{";
  expectNotMade(ACCESSVDB_ERROR_INPUT, "rolling.damaged");
}

TEST_F(CApiRolling, NamesTilesThatAreLost) {
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  for (int n = 0; n < kSteps / 2; ++n) ASSERT_NO_FATAL_FAILURE(step(field_, n));
  ASSERT_EQ(accessvdb_rolling_checkpoint(field_, "whole"), ACCESSVDB_OK);
  accessvdb_rolling_free(std::exchange(field_, nullptr));
  std::string name;
  for (const auto& entry : std::filesystem::directory_iterator(in_c_)) {
    if (entry.path().extension() != ".state" || !name.empty()) continue;
    name = entry.path().filename();
    name.resize(name.find('.'));  // X_Y.SERIAL.state
    std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
    const auto middle = static_cast<std::streamoff>(std::filesystem::file_size(entry.path()) / 2);
    file.seekg(middle);
    const char flipped = static_cast<char>(file.get() ^ 1);
    file.seekp(middle);
    file.put(flipped);
  }
  ASSERT_FALSE(name.empty());
  options_.resume = 1;
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  ASSERT_EQ(accessvdb_rolling_update(field_, nullptr), ACCESSVDB_OK);
  EXPECT_FALSE(points().empty());
  EXPECT_EQ(statusOf(field_).lost_tile_count, 1u);
  EXPECT_STREQ(accessvdb_rolling_lost_tile(field_, 0), name.c_str());
  EXPECT_STREQ(accessvdb_rolling_lost_tile(field_, 1), "");
}

TEST_F(CApiRolling, BadHandles) {
  alignas(accessvdb_point) unsigned char freed[4096] = {};  // what free() leaves of a handle begins with 0
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  for (auto* bad : {static_cast<accessvdb_rolling*>(nullptr), reinterpret_cast<accessvdb_rolling*>(freed),
                    reinterpret_cast<accessvdb_rolling*>(tool_)}) {
    auto status = sized<accessvdb_rolling_status>();
    const float point_S[3] = {1, 0, 0};
    std::size_t count = 7;
    EXPECT_EQ(accessvdb_rolling_integrate_scan_at(bad, point_S, 1, kAtOrigin.data(), 0, nullptr),
              ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(accessvdb_rolling_integrate_rays_at(bad, nullptr, 0, nullptr, 0, 0, nullptr), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(accessvdb_rolling_leave_out(bad, nullptr, 0, 1), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(accessvdb_rolling_update(bad, nullptr), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(accessvdb_rolling_take_snapshot(bad, &count), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(std::exchange(count, 7), 0u);
    EXPECT_EQ(accessvdb_rolling_take_snapshot_in_memory(bad, &count), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(std::exchange(count, 7), 0u);
    EXPECT_EQ(accessvdb_rolling_copy_points(bad, 0, 0, nullptr, sizeof(accessvdb_point)), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(accessvdb_rolling_drop_snapshot(bad), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(accessvdb_rolling_take_changed(bad, &count), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(count, 0u);
    EXPECT_EQ(accessvdb_rolling_copy_changed(bad, 0, 0, nullptr, sizeof(accessvdb_point)), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(accessvdb_rolling_get_status(bad, &status), ACCESSVDB_ERROR_USAGE);
    EXPECT_STREQ(accessvdb_rolling_lost_tile(bad, 0), "");
    EXPECT_EQ(accessvdb_rolling_checkpoint(bad, "note"), ACCESSVDB_ERROR_USAGE);
    EXPECT_STREQ(accessvdb_rolling_note(bad), "");
    EXPECT_EQ(accessvdb_rolling_tighten(bad, 1), ACCESSVDB_ERROR_USAGE);
    EXPECT_EQ(accessvdb_rolling_write(bad, "out"), ACCESSVDB_ERROR_USAGE);
    EXPECT_STREQ(accessvdb_rolling_error_id(bad), "c_api.handle");
    expectLine(accessvdb_rolling_error_text(bad));
    accessvdb_rolling_free(bad);  // does nothing
  }
  // Nor is it a field or a tool.
  EXPECT_EQ(accessvdb_field_update(reinterpret_cast<accessvdb_field*>(field_), nullptr), ACCESSVDB_ERROR_USAGE);
  accessvdb_field_free(reinterpret_cast<accessvdb_field*>(field_));
  accessvdb_tool_free(reinterpret_cast<accessvdb_tool*>(field_));
  EXPECT_EQ(statusOf(field_).steps, 0u);
}

TEST_F(CApiRolling, WhatCannotBeMade) {
  const accessvdb_rolling_options good = options_;
  accessvdb_rolling* field = reinterpret_cast<accessvdb_rolling*>(tool_);
  EXPECT_EQ(accessvdb_rolling_create(specs_.data(), sizeof specs_[0], 2, &params_, nullptr, &field, &error_),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(field, nullptr);
  EXPECT_STREQ(error_.id, "c_api.null");
  EXPECT_EQ(accessvdb_rolling_create(specs_.data(), sizeof specs_[0], 2, &params_, &options_, nullptr, &error_),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_rolling_create(specs_.data(), 8, 2, &params_, &options_, &field, &error_), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error_.id, "c_api.struct_size");
  EXPECT_EQ(accessvdb_rolling_create(nullptr, sizeof specs_[0], 2, &params_, &options_, &field, nullptr),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_rolling_create(specs_.data(), sizeof specs_[0], 0, &params_, &options_, &field, &error_),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error_.id, "tool.count");

  const auto refused = [&](auto change, int code, const char* id) {
    change(options_);
    expectNotMade(code, id);
    options_ = good;
  };
  refused([](auto& o) { o.struct_size = 0; }, ACCESSVDB_ERROR_USAGE, "c_api.struct_size");
  refused([](auto& o) { o.struct_size = sizeof o - 8; }, ACCESSVDB_ERROR_USAGE, "c_api.struct_size");
  refused([](auto& o) { o.folder = nullptr; }, ACCESSVDB_ERROR_USAGE, "c_api.null");
  refused([](auto& o) { o.folder = ""; }, ACCESSVDB_ERROR_USAGE, "c_api.value");
  refused([](auto& o) { o.resume = 2; }, ACCESSVDB_ERROR_USAGE, "c_api.value");
  refused([](auto& o) { o.notes_changes = -1; }, ACCESSVDB_ERROR_USAGE, "c_api.value");
  refused([](auto& o) { o.resume = 1; }, ACCESSVDB_ERROR_INPUT, "rolling.missing");
  for (const std::int32_t edge : {100, 8, -64, std::numeric_limits<std::int32_t>::max()})
    refused([edge](auto& o) { o.tile_voxels = edge; }, ACCESSVDB_ERROR_USAGE, "rolling.tile");
  refused([](auto& o) { o.folder = "/proc/no_such_folder"; }, ACCESSVDB_ERROR_OUTPUT, error_.id);
  struct {
    accessvdb_rolling_options known;
    std::uint64_t field_of_tomorrow;
  } later = {good, 1};
  later.known.struct_size = sizeof later;
  EXPECT_EQ(accessvdb_rolling_create(specs_.data(), sizeof specs_[0], 2, &params_, &later.known, &field, &error_),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error_.id, "c_api.unknown_fields");

  const std::string others = scratch_ / "others";
  std::filesystem::create_directory(others);
  std::ofstream(others + "/thesis.txt") << "not ours";
  refused([&](auto& o) { o.folder = others.c_str(); }, ACCESSVDB_ERROR_OUTPUT, "output.foreign");
  EXPECT_TRUE(std::filesystem::exists(others + "/thesis.txt"));
  params_.budget_points = 100;
  expectNotMade(ACCESSVDB_ERROR_USAGE, "rolling.params");
  params_.budget_points = 0;
  params_.carry = "class";
  expectNotMade(ACCESSVDB_ERROR_USAGE, "rolling.params");

  std::int32_t found = 7;
  EXPECT_EQ(accessvdb_rolling_has_checkpoint(nullptr, &found, &error_), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(found, 0);
  EXPECT_EQ(accessvdb_rolling_has_checkpoint("", &found, &error_), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_rolling_has_checkpoint(others.c_str(), nullptr, &error_), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_rolling_has_checkpoint(others.c_str(), &found, &error_), ACCESSVDB_OK);
  EXPECT_EQ(found, 0);
}

TEST_F(CApiRolling, BadCalls) {
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  constexpr int kUsage = ACCESSVDB_ERROR_USAGE;
  const float points_S[6] = {2, 0, 0, 2, 0.1f, 0};
  const double rays_W[6] = {2, 0, 0, 2, 0.1, 0};
  accessvdb_point point = {};
  auto small = sized<accessvdb_frame_stats>(8);
  expectRefused(accessvdb_rolling_integrate_scan_at(field_, nullptr, 2, kAtOrigin.data(), 0, nullptr), kUsage,
                "c_api.null");
  expectRefused(accessvdb_rolling_integrate_scan_at(field_, points_S, 2, nullptr, 0, nullptr), kUsage, "c_api.null");
  expectRefused(accessvdb_rolling_integrate_scan_at(field_, points_S, 2, kAtOrigin.data(), 0, &small), kUsage,
                "c_api.struct_size");
  expectRefused(accessvdb_rolling_integrate_scan_at(field_, points_S, SIZE_MAX, kAtOrigin.data(), 0, nullptr), kUsage,
                "c_api.count");
  auto pose = kAtOrigin;
  pose[12] = 3;  // column by column
  expectRefused(accessvdb_rolling_integrate_scan_at(field_, points_S, 2, pose.data(), 0, nullptr),
                ACCESSVDB_ERROR_UNUSABLE, "pose.last_row");
  expectRefused(accessvdb_rolling_integrate_rays_at(field_, rays_W, 2, nullptr, 1, 0, nullptr), kUsage, "c_api.null");
  expectRefused(accessvdb_rolling_integrate_rays_at(field_, rays_W, 1, rays_W, 2, 0, nullptr), kUsage, "rays.sizes");
  expectRefused(accessvdb_rolling_leave_out(field_, nullptr, 1, 1), kUsage, "c_api.null");
  expectRefused(accessvdb_rolling_leave_out(field_, rays_W, 1, -1), kUsage, "left_out.radius");
  expectRefused(accessvdb_rolling_leave_out(field_, rays_W, 1, NAN), kUsage, "left_out.radius");
  auto small_update = sized<accessvdb_update_stats>(8);
  expectRefused(accessvdb_rolling_update(field_, &small_update), kUsage, "c_api.struct_size");
  expectRefused(accessvdb_rolling_copy_points(field_, 0, 1, &point, sizeof point), kUsage, "snapshot.none");
  EXPECT_NE(std::strstr(accessvdb_rolling_error_text(field_), "accessvdb_rolling_take_snapshot"), nullptr);
  expectRefused(accessvdb_rolling_take_changed(field_, nullptr), kUsage, "rolling.changes");
  expectRefused(accessvdb_rolling_copy_changed(field_, 0, 1, &point, sizeof point), kUsage, "snapshot.range");
  expectRefused(accessvdb_rolling_get_status(field_, nullptr), kUsage, "c_api.null");
  auto status = sized<accessvdb_rolling_status>(sizeof(accessvdb_rolling_status) - 8);
  expectRefused(accessvdb_rolling_get_status(field_, &status), kUsage, "c_api.struct_size");
  for (const double share : {-0.1, 1.1, std::numeric_limits<double>::quiet_NaN()})
    expectRefused(accessvdb_rolling_tighten(field_, share), kUsage, "c_api.value");
  expectRefused(accessvdb_rolling_write(field_, nullptr), kUsage, "c_api.null");
  expectRefused(accessvdb_rolling_write(field_, ""), kUsage, "c_api.value");
  EXPECT_EQ(statusOf(field_).steps, 0u);  // nothing of all that has changed anything

  ASSERT_EQ(accessvdb_rolling_integrate_scan_at(field_, points_S, 2, kAtOrigin.data(), 0, nullptr), ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_rolling_take_snapshot(field_, nullptr), ACCESSVDB_OK);
  expectRefused(accessvdb_rolling_copy_points(field_, 0, 1, &point, 8), kUsage, "c_api.struct_size");
  expectRefused(accessvdb_rolling_copy_points(field_, 0, 1000, &point, sizeof point), kUsage, "snapshot.range");
  EXPECT_EQ(accessvdb_rolling_copy_points(field_, 0, 1, &point, sizeof point), ACCESSVDB_OK);
  const std::string others = scratch_ / "others";
  std::filesystem::create_directories(others + "/tiles");
  std::ofstream(others + "/tiles/thesis.txt") << "not ours";
  EXPECT_EQ(accessvdb_rolling_write(field_, others.c_str()), ACCESSVDB_ERROR_OUTPUT);
  EXPECT_TRUE(std::filesystem::exists(others + "/tiles/thesis.txt"));
  EXPECT_EQ(accessvdb_rolling_write(field_, "/proc/no_such_folder"), ACCESSVDB_ERROR_OUTPUT);
  EXPECT_EQ(accessvdb_rolling_update(field_, nullptr), ACCESSVDB_OK);  // and it still works
}

TEST_F(CApiRolling, TwoThreadsOnOneHandle) {
  ASSERT_EQ(make(), ACCESSVDB_OK) << error_.text;
  constexpr int kCalls = 50;
  std::atomic<std::uint64_t> done = 0, busy = 0, other = 0;
  const auto work = [&] {
    const std::array<float, 6> few = {2, 0, 0, 2, 0.1f, 0};
    for (int n = 0; n < kCalls; ++n) {
      const int code = accessvdb_rolling_integrate_scan_at(field_, few.data(), 2, kAtOrigin.data(), NAN, nullptr);
      ++(code == ACCESSVDB_OK ? done : code == ACCESSVDB_ERROR_USAGE ? busy : other);
    }
  };
  std::thread first(work), second(work);
  first.join();
  second.join();
  EXPECT_EQ(other, 0u);
  EXPECT_EQ(done + busy, 2u * kCalls);
  EXPECT_EQ(statusOf(field_).steps, done);
}

}  // namespace
}  // namespace accessvdb::test
