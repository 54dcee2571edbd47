// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a plug-in can do wrong: NULL, sizes, values, the order of calls, handles of the wrong kind, two threads. Each
/// mistake returns its code and a text, nothing crashes, and the field still works afterwards.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "accessvdb/c_api.h"
#include "package/beside_cpp.h"
#include "support/scratch_folder.h"

namespace {

using accessvdb::test::sized;

constexpr std::array<double, 16> kIdentity = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

class CApiMisuse : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(accessvdb_tool_builtin("builtin:pencil", &tool_, nullptr), ACCESSVDB_OK);
    auto params = sized<accessvdb_params>();
    ASSERT_EQ(accessvdb_params_defaults(&params), ACCESSVDB_OK);
    params.voxel_size_m = 0.1;
    ASSERT_EQ(accessvdb_field_create(tool_, &params, &field_, nullptr), ACCESSVDB_OK);
    for (int y = -20; y <= 20; ++y) {
      for (int z = -20; z <= 20; ++z) wall_S_.insert(wall_S_.end(), {2.0f, 0.04f * float(y), 0.04f * float(z)});
    }
  }
  void TearDown() override {
    accessvdb_field_free(field_);
    accessvdb_tool_free(tool_);
  }
  std::size_t wallPoints() const { return wall_S_.size() / 3; }
  int integrate(const double* pose = kIdentity.data()) {
    return accessvdb_field_integrate_scan(field_, wall_S_.data(), wallPoints(), pose, nullptr);
  }
  void expectError(int code, int expected, const char* id) {
    EXPECT_EQ(code, expected);
    EXPECT_STREQ(accessvdb_field_error_id(field_), id);
    EXPECT_GT(std::strlen(accessvdb_field_error_text(field_)), 10u);
  }
  accessvdb_tool* tool_ = nullptr;
  accessvdb_field* field_ = nullptr;
  std::vector<float> wall_S_;
};

TEST_F(CApiMisuse, NullHandles) {
  auto counts = sized<accessvdb_counts>();
  accessvdb_point point = {};
  std::size_t n = 7;
  std::int32_t found = 7;
  EXPECT_EQ(accessvdb_field_integrate_scan(nullptr, wall_S_.data(), 1, kIdentity.data(), nullptr),
            ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_integrate_rays(nullptr, nullptr, 0, nullptr, 0, nullptr), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_update(nullptr, nullptr), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_take_snapshot(nullptr, &n), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(n, 0u);
  EXPECT_EQ(accessvdb_field_copy_points(nullptr, 0, 0, nullptr, sizeof point), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_get_counts(nullptr, &counts), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_drop_snapshot(nullptr), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_point_at(nullptr, kIdentity.data(), &point, sizeof point, &found), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(found, 0);
  EXPECT_EQ(accessvdb_field_write(nullptr, "out"), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_save_state(nullptr, "state"), ACCESSVDB_ERROR_USAGE);
  accessvdb_update* update = reinterpret_cast<accessvdb_update*>(&point);
  EXPECT_EQ(accessvdb_field_update_async(nullptr, &update), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(update, nullptr);
  EXPECT_EQ(accessvdb_update_wait(nullptr, nullptr), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_update_is_done(nullptr, &found), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(accessvdb_update_error_id(nullptr), "c_api.handle");
  EXPECT_GT(std::strlen(accessvdb_update_error_text(nullptr)), 10u);
  accessvdb_update_free(nullptr);
  EXPECT_STREQ(accessvdb_field_error_id(nullptr), "c_api.handle");
  EXPECT_GT(std::strlen(accessvdb_field_error_text(nullptr)), 10u);
  EXPECT_STREQ(accessvdb_field_device(nullptr), "");
  EXPECT_STREQ(accessvdb_field_parameters(nullptr), "");
  EXPECT_STREQ(accessvdb_tool_name(nullptr), "");
  EXPECT_STREQ(accessvdb_tool_sha256(nullptr), "");
  auto info = sized<accessvdb_tool_info>();
  EXPECT_EQ(accessvdb_tool_get_info(nullptr, &info), ACCESSVDB_ERROR_USAGE);
  accessvdb_field_free(nullptr);
  accessvdb_tool_free(nullptr);
}

TEST_F(CApiMisuse, NullArguments) {
  accessvdb_tool* tool = tool_;
  accessvdb_field* field = field_;
  auto error = sized<accessvdb_error>();
  EXPECT_EQ(accessvdb_tool_builtin("builtin:pencil", nullptr, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error.id, "c_api.null");
  EXPECT_EQ(accessvdb_tool_builtin(nullptr, &tool, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(tool, nullptr);  // not the value from before
  EXPECT_EQ(accessvdb_tool_from_mesh(nullptr, ACCESSVDB_METRE, nullptr, &tool, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_tool_from_triangles(nullptr, 3, nullptr, 1, nullptr, &tool, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_field_create(nullptr, nullptr, &field, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(field, nullptr);
  EXPECT_EQ(accessvdb_field_create(tool_, nullptr, nullptr, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_params_defaults(nullptr), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_params_paper(0.01, nullptr), ACCESSVDB_ERROR_USAGE);

  accessvdb_point point = {};
  std::int32_t found = 0;
  expectError(accessvdb_field_integrate_scan(field_, nullptr, 5, kIdentity.data(), nullptr), ACCESSVDB_ERROR_USAGE,
              "c_api.null");
  expectError(accessvdb_field_integrate_scan(field_, wall_S_.data(), 5, nullptr, nullptr), ACCESSVDB_ERROR_USAGE,
              "c_api.null");
  expectError(accessvdb_field_integrate_rays(field_, nullptr, 5, kIdentity.data(), 1, nullptr), ACCESSVDB_ERROR_USAGE,
              "c_api.null");
  expectError(accessvdb_field_integrate_rays(field_, kIdentity.data(), 5, nullptr, 1, nullptr), ACCESSVDB_ERROR_USAGE,
              "c_api.null");
  expectError(accessvdb_field_point_at(field_, nullptr, &point, sizeof point, &found), ACCESSVDB_ERROR_USAGE,
              "c_api.null");
  expectError(accessvdb_field_point_at(field_, kIdentity.data(), nullptr, sizeof point, &found), ACCESSVDB_ERROR_USAGE,
              "c_api.null");
  expectError(accessvdb_field_point_at(field_, kIdentity.data(), &point, sizeof point, nullptr), ACCESSVDB_ERROR_USAGE,
              "c_api.null");
  expectError(accessvdb_field_write(field_, nullptr), ACCESSVDB_ERROR_USAGE, "c_api.null");
  expectError(accessvdb_field_write(field_, ""), ACCESSVDB_ERROR_USAGE, "c_api.value");
  expectError(accessvdb_field_save_state(field_, nullptr), ACCESSVDB_ERROR_USAGE, "c_api.null");
  expectError(accessvdb_field_save_state(field_, ""), ACCESSVDB_ERROR_USAGE, "c_api.value");
  // An empty scan is a scan, too.
  EXPECT_EQ(accessvdb_field_integrate_scan(field_, nullptr, 0, kIdentity.data(), nullptr), ACCESSVDB_OK);
}

TEST_F(CApiMisuse, StructSizes) {
  auto counts = sized<accessvdb_counts>(0);  // forgotten
  ASSERT_EQ(accessvdb_field_take_snapshot(field_, nullptr), ACCESSVDB_OK);
  expectError(accessvdb_field_get_counts(field_, &counts), ACCESSVDB_ERROR_USAGE, "c_api.struct_size");
  counts.struct_size = offsetof(accessvdb_counts, changed) - 8;  // older than any version
  expectError(accessvdb_field_get_counts(field_, &counts), ACCESSVDB_ERROR_USAGE, "c_api.struct_size");
  counts.struct_size = 0xCCCCCCCC;  // uninitialised memory
  expectError(accessvdb_field_get_counts(field_, &counts), ACCESSVDB_ERROR_USAGE, "c_api.struct_size");
  expectError(accessvdb_field_copy_points(field_, 0, 0, nullptr, 8), ACCESSVDB_ERROR_USAGE, "c_api.struct_size");

  auto stats = sized<accessvdb_frame_stats>(4);
  expectError(accessvdb_field_integrate_scan(field_, wall_S_.data(), wallPoints(), kIdentity.data(), &stats),
              ACCESSVDB_ERROR_USAGE, "c_api.struct_size");
  std::size_t points = 1;
  ASSERT_EQ(accessvdb_field_take_snapshot(field_, &points), ACCESSVDB_OK);
  EXPECT_EQ(points, 0u);  // refused before anything happened

  auto error = sized<accessvdb_error>(12);
  accessvdb_tool* tool = nullptr;
  EXPECT_EQ(accessvdb_tool_builtin("builtin:pencil", &tool, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(tool, nullptr);
  EXPECT_EQ(error.text[0], '\0');  // and nothing written beyond its size
}

/// A struct of a later version.
template <typename Struct>
struct Later {
  Struct known;
  std::uint64_t field_of_tomorrow;
};

TEST_F(CApiMisuse, LargerStructs) {
  Later<accessvdb_params> params = {};
  params.known.struct_size = sizeof params;
  params.field_of_tomorrow = 5;
  ASSERT_EQ(accessvdb_params_defaults(&params.known), ACCESSVDB_OK);
  EXPECT_EQ(params.known.struct_size, sizeof params);
  EXPECT_EQ(params.field_of_tomorrow, 0u);
  accessvdb_field* field = nullptr;
  auto error = sized<accessvdb_error>();
  EXPECT_EQ(accessvdb_field_create(tool_, &params.known, &field, &error), ACCESSVDB_OK) << error.text;
  accessvdb_field_free(field);
  params.field_of_tomorrow = 1;  // requests something that this library cannot provide
  EXPECT_EQ(accessvdb_field_create(tool_, &params.known, &field, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error.id, "c_api.unknown_fields");

  ASSERT_EQ(integrate(), ACCESSVDB_OK);
  std::size_t count = 0;
  ASSERT_EQ(accessvdb_field_take_snapshot(field_, &count), ACCESSVDB_OK);
  ASSERT_GT(count, 3u);
  std::vector<accessvdb_point> plain(3);
  std::vector<Later<accessvdb_point>> later(3, Later<accessvdb_point>{{}, 9});
  ASSERT_EQ(accessvdb_field_copy_points(field_, 1, 3, plain.data(), sizeof plain[0]), ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_field_copy_points(field_, 1, 3, &later[0].known, sizeof later[0]), ACCESSVDB_OK);
  for (std::size_t n = 0; n < 3; ++n) {
    EXPECT_EQ(std::memcmp(&plain[n], &later[n].known, sizeof plain[n]), 0);
    EXPECT_EQ(later[n].field_of_tomorrow, 0u);
  }
}

TEST_F(CApiMisuse, Parameters) {
  const auto refused = [&](auto change, const char* name) {
    auto params = sized<accessvdb_params>();
    ASSERT_EQ(accessvdb_params_defaults(&params), ACCESSVDB_OK);
    change(params);
    auto error = sized<accessvdb_error>();
    accessvdb_field* field = field_;
    EXPECT_EQ(accessvdb_field_create(tool_, &params, &field, &error), ACCESSVDB_ERROR_USAGE) << name;
    EXPECT_EQ(field, nullptr) << name;
    EXPECT_NE(std::string(error.text).find(name), std::string::npos) << error.text;
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  refused([](auto& p) { p.voxel_size_m = 0; }, "voxel_size_m");
  refused([](auto& p) { p.voxel_size_m = -1; }, "voxel_size_m");
  refused([](auto& p) { p.voxel_size_m = kNan; }, "voxel_size_m");
  refused([](auto& p) { p.arm_tau[1] = kNan; }, "arm_tau");
  refused([](auto& p) { p.num_directions = -3; }, "num_directions");
  refused([](auto& p) { p.backend = 3; }, "backend");
  refused([](auto& p) { p.region = -1; }, "region");
  refused([](auto& p) { p.tool_form = 2; }, "tool_form");
  refused([](auto& p) { p.policy = 17; }, "policy");
  refused([](auto& p) { p.viewpoints = 2; }, "viewpoints");
  refused([](auto& p) { p.threads = -1; }, "threads");
  refused([](auto& p) { p.threads = 70000; }, "threads");
  refused([](auto& p) { p.fuse_on_host = 2; }, "fuse_on_host");
  refused([](auto& p) { p.device_cache_bytes = 1; }, "device_cache_bytes");
  auto params = sized<accessvdb_params>();
  EXPECT_EQ(accessvdb_params_paper(kNan, &params), ACCESSVDB_ERROR_USAGE);
}

TEST_F(CApiMisuse, Poses) {
  auto pose = kIdentity;
  pose[0] = 2;
  expectError(integrate(pose.data()), ACCESSVDB_ERROR_UNUSABLE, "pose.not_rigid");
  pose = kIdentity;
  pose[3] = std::numeric_limits<double>::infinity();
  expectError(integrate(pose.data()), ACCESSVDB_ERROR_UNUSABLE, "pose.not_rigid");
  pose = kIdentity;  // column by column
  pose[12] = 3;
  expectError(integrate(pose.data()), ACCESSVDB_ERROR_UNUSABLE, "pose.last_row");
  pose = kIdentity;
  pose[15] = std::numeric_limits<double>::quiet_NaN();
  expectError(integrate(pose.data()), ACCESSVDB_ERROR_UNUSABLE, "pose.last_row");
  EXPECT_NE(std::string(accessvdb_field_error_text(field_)).find("is not finite"), std::string::npos);
  std::size_t points = 1;
  ASSERT_EQ(accessvdb_field_take_snapshot(field_, &points), ACCESSVDB_OK);
  EXPECT_EQ(points, 0u);
  EXPECT_EQ(integrate(), ACCESSVDB_OK);  // and the field still works
}

TEST_F(CApiMisuse, Arrays) {
  expectError(
      accessvdb_field_integrate_scan(field_, wall_S_.data(), static_cast<std::size_t>(-1), kIdentity.data(), nullptr),
      ACCESSVDB_ERROR_USAGE, "c_api.count");
  const auto* crooked = reinterpret_cast<const float*>(reinterpret_cast<const char*>(wall_S_.data()) + 1);
  expectError(accessvdb_field_integrate_scan(field_, crooked, 1, kIdentity.data(), nullptr), ACCESSVDB_ERROR_USAGE,
              "c_api.alignment");
  const std::vector<double> rays(30, 1.0);
  expectError(accessvdb_field_integrate_rays(field_, rays.data(), 10, rays.data(), 3, nullptr), ACCESSVDB_ERROR_USAGE,
              "rays.sizes");
}

TEST_F(CApiMisuse, OrderOfCalls) {
  accessvdb_point point = {};
  auto counts = sized<accessvdb_counts>();
  expectError(accessvdb_field_copy_points(field_, 0, 1, &point, sizeof point), ACCESSVDB_ERROR_USAGE, "snapshot.none");
  expectError(accessvdb_field_get_counts(field_, &counts), ACCESSVDB_ERROR_USAGE, "snapshot.none");
  EXPECT_EQ(accessvdb_field_update(field_, nullptr), ACCESSVDB_OK);  // nothing to do, no harm
  ASSERT_EQ(integrate(), ACCESSVDB_OK);
  std::size_t count = 0;
  ASSERT_EQ(accessvdb_field_take_snapshot(field_, &count), ACCESSVDB_OK);  // before update(): all unscored
  ASSERT_GT(count, 0u);
  ASSERT_EQ(accessvdb_field_get_counts(field_, &counts), ACCESSVDB_OK);
  EXPECT_EQ(counts.labels[ACCESSVDB_UNSCORED], count);
  std::vector<accessvdb_point> points(count + 1);
  expectError(accessvdb_field_copy_points(field_, 0, count + 1, points.data(), sizeof point), ACCESSVDB_ERROR_USAGE,
              "snapshot.range");
  expectError(accessvdb_field_copy_points(field_, count + 1, 0, points.data(), sizeof point), ACCESSVDB_ERROR_USAGE,
              "snapshot.range");
  expectError(accessvdb_field_copy_points(field_, static_cast<std::size_t>(-1), 2, points.data(), sizeof point),
              ACCESSVDB_ERROR_USAGE, "snapshot.range");
  EXPECT_EQ(accessvdb_field_copy_points(field_, count, 0, nullptr, sizeof point), ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_field_drop_snapshot(field_), ACCESSVDB_OK);
  expectError(accessvdb_field_get_counts(field_, &counts), ACCESSVDB_ERROR_USAGE, "snapshot.none");
}

TEST_F(CApiMisuse, UpdatesThatDoNotBlock) {
  ASSERT_EQ(integrate(), ACCESSVDB_OK);
  expectError(accessvdb_field_update_async(field_, nullptr), ACCESSVDB_ERROR_USAGE, "c_api.null");
  accessvdb_update* update = nullptr;
  ASSERT_EQ(accessvdb_field_update_async(field_, &update), ACCESSVDB_OK);
  auto small = sized<accessvdb_update_stats>(8);
  EXPECT_EQ(accessvdb_update_wait(update, &small), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(accessvdb_update_error_id(update), "c_api.struct_size");
  EXPECT_EQ(accessvdb_update_is_done(update, nullptr), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(accessvdb_update_error_id(update), "c_api.null");
  auto stats = sized<accessvdb_update_stats>();
  EXPECT_EQ(accessvdb_update_wait(update, &stats), ACCESSVDB_OK);
  EXPECT_EQ(accessvdb_update_wait(update, nullptr), ACCESSVDB_OK);
  EXPECT_GT(stats.dirty_points, 0u);
  auto* update_as_field = reinterpret_cast<accessvdb_field*>(update);
  EXPECT_EQ(accessvdb_field_update(update_as_field, nullptr), ACCESSVDB_ERROR_USAGE);
  auto* field_as_update = reinterpret_cast<accessvdb_update*>(field_);
  EXPECT_EQ(accessvdb_update_wait(field_as_update, nullptr), ACCESSVDB_ERROR_USAGE);
  accessvdb_update_free(field_as_update);  // does nothing
  accessvdb_update_free(update);
}

TEST_F(CApiMisuse, HandlesOfTheOtherKind) {
  auto* tool_as_field = reinterpret_cast<accessvdb_field*>(tool_);
  EXPECT_EQ(accessvdb_field_update(tool_as_field, nullptr), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(accessvdb_field_error_id(tool_as_field), "c_api.handle");
  accessvdb_field_free(tool_as_field);  // does nothing
  auto* field_as_tool = reinterpret_cast<accessvdb_tool*>(field_);
  accessvdb_tool_free(field_as_tool);
  auto error = sized<accessvdb_error>();
  accessvdb_field* field = nullptr;
  EXPECT_EQ(accessvdb_field_create(field_as_tool, nullptr, &field, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error.id, "c_api.handle");
  EXPECT_EQ(integrate(), ACCESSVDB_OK);
}

TEST_F(CApiMisuse, Tools) {
  auto error = sized<accessvdb_error>();
  accessvdb_tool* tool = nullptr;
  EXPECT_EQ(accessvdb_tool_from_mesh("no/such/tool.stl", ACCESSVDB_METRE, nullptr, &tool, &error),
            ACCESSVDB_ERROR_INPUT);
  EXPECT_NE(std::string(error.text).find("no/such/tool.stl"), std::string::npos);
  EXPECT_EQ(accessvdb_tool_from_mesh("tool.stl", 9, nullptr, &tool, &error), ACCESSVDB_ERROR_USAGE);
  auto pose = sized<accessvdb_tool_pose>();
  pose.has_tip = -1;
  EXPECT_EQ(accessvdb_tool_from_mesh("tool.stl", ACCESSVDB_METRE, &pose, &tool, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_STREQ(error.id, "c_api.value");
  const float vertices[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const std::uint32_t outside[3] = {0, 1, 3};
  EXPECT_EQ(accessvdb_tool_from_triangles(vertices, 3, outside, 1, "t", &tool, &error), ACCESSVDB_ERROR_USAGE);
  EXPECT_EQ(accessvdb_tool_from_triangles(vertices, 3, nullptr, 0, "t", &tool, &error), ACCESSVDB_ERROR_UNUSABLE);
  EXPECT_EQ(error.code, ACCESSVDB_ERROR_UNUSABLE);
  EXPECT_EQ(tool, nullptr);
}

TEST_F(CApiMisuse, LongTextsAreCutBetweenCharacters) {
  auto error = sized<accessvdb_error>();
  accessvdb_tool* tool = nullptr;
  std::string name = "x";  // so that a cut at the last byte would split one
  for (int n = 0; n < 2000; ++n) name += "\u00e4";
  EXPECT_EQ(accessvdb_tool_builtin(name.c_str(), &tool, &error), ACCESSVDB_ERROR_USAGE);
  const std::size_t length = std::strlen(error.text);
  EXPECT_GE(length, sizeof error.text - 3);
  ASSERT_LT(length, sizeof error.text);
  std::size_t rest = 0;  // bytes missing from the last character
  for (std::size_t n = 0; n < length; ++n) {
    const auto byte = static_cast<unsigned char>(error.text[n]);
    if (rest > 0) {
      EXPECT_EQ(byte & 0xC0u, 0x80u) << n;
      --rest;
    } else if (byte >= 0x80) {
      EXPECT_EQ(byte & 0xE0u, 0xC0u) << n;
      rest = 1;
    }
  }
  EXPECT_EQ(rest, 0u);
}

TEST_F(CApiMisuse, OutputThatCannotBeWritten) {
  ASSERT_EQ(integrate(), ACCESSVDB_OK);
  EXPECT_EQ(accessvdb_field_write(field_, "/proc/no_such_folder"), ACCESSVDB_ERROR_OUTPUT);
  EXPECT_NE(std::string(accessvdb_field_error_text(field_)).find("/proc/no_such_folder"), std::string::npos);
}

TEST_F(CApiMisuse, StatesThatCannotBeSavedOrLoaded) {
  expectError(accessvdb_field_save_state(field_, "/proc/no_such_folder/state"), ACCESSVDB_ERROR_OUTPUT, "output.write");
  auto error = sized<accessvdb_error>();
  accessvdb_field* field = field_;
  const auto expectRefused = [&](int code, int expected, const char* id) {
    EXPECT_EQ(code, expected) << error.text;
    EXPECT_STREQ(error.id, id);
    EXPECT_EQ(field, nullptr);
    field = field_;
  };
  constexpr int kCpu = ACCESSVDB_BACKEND_CPU;
  EXPECT_EQ(accessvdb_field_load_state("state", tool_, kCpu, 0, nullptr, &error), ACCESSVDB_ERROR_USAGE);
  expectRefused(accessvdb_field_load_state(nullptr, tool_, kCpu, 0, &field, &error), ACCESSVDB_ERROR_USAGE,
                "c_api.null");
  expectRefused(accessvdb_field_load_state("", tool_, kCpu, 0, &field, &error), ACCESSVDB_ERROR_USAGE, "c_api.value");
  expectRefused(accessvdb_field_load_state("state", nullptr, kCpu, 0, &field, &error), ACCESSVDB_ERROR_USAGE,
                "c_api.handle");
  expectRefused(accessvdb_field_load_state("state", tool_, 7, 0, &field, &error), ACCESSVDB_ERROR_USAGE, "c_api.value");
  expectRefused(accessvdb_field_load_state("/no/such/state", tool_, kCpu, 0, &field, &error), ACCESSVDB_ERROR_INPUT,
                "input.missing");
  const accessvdb::test::ScratchFolder folder;
  const std::filesystem::path path = folder / "state.avst";
  const std::string file = path.string();
  ASSERT_EQ(integrate(), ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_field_save_state(field_, file.c_str()), ACCESSVDB_OK);
  expectRefused(accessvdb_field_load_state(file.c_str(), tool_, kCpu, -1, &field, &error), ACCESSVDB_ERROR_USAGE,
                "config.range");
  accessvdb_tool* other = nullptr;
  ASSERT_EQ(accessvdb_tool_builtin("builtin:pruner", &other, nullptr), ACCESSVDB_OK);
  expectRefused(accessvdb_field_load_state(file.c_str(), other, kCpu, 0, &field, &error), ACCESSVDB_ERROR_UNUSABLE,
                "state.tool");
  accessvdb_tool_free(other);
  std::filesystem::resize_file(path, 300);
  expectRefused(accessvdb_field_load_state(file.c_str(), tool_, kCpu, 0, &field, &error), ACCESSVDB_ERROR_INPUT,
                "state.damaged");
}

TEST_F(CApiMisuse, TwoThreadsOnOneField) {
  // One of them may find the field busy; then the call says so and does nothing else.
  constexpr int kCalls = 200;
  std::atomic<int> done = 0, busy = 0, other = 0;
  const auto work = [&] {
    const std::array<float, 6> few = {2, 0, 0, 2, 0.1f, 0};
    for (int n = 0; n < kCalls; ++n) {
      const int code = accessvdb_field_integrate_scan(field_, few.data(), 2, kIdentity.data(), nullptr);
      ++(code == ACCESSVDB_OK ? done : code == ACCESSVDB_ERROR_USAGE ? busy : other);
    }
  };
  std::thread first(work), second(work);
  first.join();
  second.join();
  EXPECT_EQ(other, 0);
  EXPECT_EQ(done + busy, 2 * kCalls);
  EXPECT_GT(done, 0);
  // Every scan reported as fused was fused: the weight of a voxel counts them.
  accessvdb_point point = {};
  std::int32_t found = 0;
  const double p_W[3] = {2, 0, 0};
  ASSERT_EQ(accessvdb_field_update(field_, nullptr), ACCESSVDB_OK);
  ASSERT_EQ(accessvdb_field_point_at(field_, p_W, &point, sizeof point, &found), ACCESSVDB_OK);
  ASSERT_EQ(found, 1);
  EXPECT_GE(point.weight, static_cast<float>(done.load()));
}

}  // namespace
