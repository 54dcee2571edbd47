// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a field refuses before anything is made of it.
#include <gtest/gtest.h>

#include <limits>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/tool_geometry.h"
#include "accessvdb/tool_spec.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

struct Refusal {
  std::string id, subject, text;
};

template <typename Call>
Refusal refusalOf(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return {error.id(), error.subject(), error.what()};
  }
  return {};
}

ToolGeometry pencil() { return ToolGeometry::builtin("builtin:pencil"); }

/// What cannot leave points out says so, whatever else is asked for.
TEST(FieldRefusals, FewerPointsWhereEveryOneIsScored) {
  FieldParams params;
  params.scoring.point_spacing_m = 0.02;
  const auto refused = [](const FieldParams& given) { return refusalOf([&] { AccessibilityField(pencil(), given); }); };
  FieldParams full = params, paper = params, profile = FieldParams::paper(0.01);
  full.change.mode = ChangeMode::Full;
  paper.update.policy = UpdatePolicy::Paper;
  profile.scoring.point_spacing_m = 0.02;
  for (const FieldParams& given : {full, paper, profile}) {
    EXPECT_EQ(refused(given).id, "config.points");
    EXPECT_EQ(refused(given).subject, "points of the surface");
  }
  params.scoring.point_spacing_m = 1;
  EXPECT_EQ(refused(params).subject, "point_spacing_m");
  // However wide the band around a surface is.
  params.tsdf.truncation_distance_m = 1;
  EXPECT_EQ(refused(params).subject, "point_spacing_m");
  params.scoring.point_spacing_m = 0.33;
  EXPECT_EQ(refused(params).subject, "point_spacing_m");
  params.scoring.point_spacing_m = 0.32;
  params.tsdf.range_noise_m = 0.33;
  EXPECT_EQ(refused(params).subject, "range_noise_m");
  params.tsdf = {};
  params.scoring.point_spacing_m = 0.001;  // below a voxel
  const AccessibilityField field(pencil(), params);
  EXPECT_EQ(field.params().scoring.point_spacing_m, 0.01);
}

/// TBB has a slot for each thread that an arena may have, and 70 000 slots crash it.
TEST(FieldRefusals, MoreThreadsThanAnyMachineHas) {
  const ScratchFolder folder;
  FieldParams params;
  params.threads = 1;
  AccessibilityField(pencil(), params).saveState(folder / "state");
  for (const int threads : {-1, 4097, 65535, 65536, 70'000, std::numeric_limits<int>::max()}) {
    SCOPED_TRACE(threads);
    params.threads = threads;
    const Refusal made = refusalOf([&] { AccessibilityField(pencil(), params); });
    EXPECT_EQ(made.id, "config.range");
    EXPECT_EQ(made.subject, "threads");
    const Refusal loaded = refusalOf([&] {
      static_cast<void>(AccessibilityField::loadState(folder / "state", pencil(), BackendKind::Cpu, threads));
    });
    EXPECT_EQ(loaded.id, "config.range");
  }
  params.threads = 4096;
  EXPECT_EQ(refusalOf([&] { AccessibilityField(pencil(), params); }).id, "");
}

/// Where a field runs is not what a state is of: it goes on elsewhere, and only there.
TEST(FieldRefusals, NotAStateThatGoesOnElsewhere) {
  const ScratchFolder folder;
  FieldParams params, place;
  params.backend = place.backend = BackendKind::Cpu;
  params.update.seed = 9;
  params.fuse_on_host = true;
  params.device_cache_bytes = 100'000'000;
  AccessibilityField(pencil(), params).saveState(folder / "state");
  place.threads = 1;
  place.update.seed = 7;
  const auto at = [&] {
    return AccessibilityField::loadState(folder / "state", onlyTool(pencil(), params), place).params();
  };
  EXPECT_FALSE(at().fuse_on_host);
  EXPECT_EQ(at().device_cache_bytes, 4'000'000'000u);  // what 10 mm need
  place.fuse_on_host = true;
  place.device_cache_bytes = 200'000'000;
  EXPECT_TRUE(at().fuse_on_host);
  EXPECT_EQ(at().device_cache_bytes, 200'000'000u);
  EXPECT_EQ(at().threads, 1);
  EXPECT_EQ(at().update.seed, 9u);
  place.device_cache_bytes = 1;
  EXPECT_EQ(refusalOf([&] { static_cast<void>(at()); }).subject, "device_cache_bytes");
}

TEST(FieldRefusals, PosesSayWhatIsWrongWithThem) {
  AccessibilityField field(pencil(), {});
  const Eigen::Vector3f point_S(1, 0, 0);
  const auto with = [&](int row, int column, double value) {
    Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.matrix()(row, column) = value;
    return refusalOf([&] { field.integrateScan({&point_S, 1}, T_W_S); });
  };
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column) {
        const Refusal refusal = with(row, column, bad);
        EXPECT_EQ(refusal.id, "pose.not_rigid");
        EXPECT_NE(refusal.text.find("is not finite"), std::string::npos) << refusal.text;
      }
    }
  }
  EXPECT_NE(with(0, 0, 2).text.find("is not rigid"), std::string::npos);
  EXPECT_NE(with(0, 3, 2e8).text.find("beyond 1e8 m"), std::string::npos);
}

/// Flags are the program's: a library knows parameters.
TEST(FieldRefusals, MessagesNameParameters) {
  const ScratchFolder folder;
  const auto of = [](const auto& change) {
    FieldParams params;
    change(params);
    return refusalOf([&] { AccessibilityField(pencil(), params); });
  };
  const Refusal refusals[] = {of([](FieldParams& p) { p.tsdf.voxel_size_m = 20; }),
                              of([](FieldParams& p) { p.tsdf.truncation_distance_m = 100; }),
                              of([](FieldParams& p) { p.approach.num_directions = 1000; }),
                              of([](FieldParams& p) { p.change.free_for_s = 1; }), of([](FieldParams& p) {
                                p.change.mode = ChangeMode::Full;
                                p.update.policy = UpdatePolicy::Paper;
                              })};
  for (const Refusal& refusal : refusals) {
    EXPECT_NE(refusal.id, "");
    EXPECT_EQ(refusal.text.find("--"), std::string::npos) << refusal.text;
  }
}

}  // namespace
}  // namespace accessvdb::test
