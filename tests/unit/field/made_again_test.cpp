// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// A field with a device that writes nothing to the map, and says that it did: found out by what the host's map says,
// all of it is made again. Against a field without a device.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "field/field_stages.h"
#include "field/frame_loop.h"
#include "field/query/changed_points.h"
#include "launch/backend.h"
#include "support/map_hash.h"

namespace accessvdb::internal {
namespace {

class IdleFuser final : public kernels::ScanFuser {
 public:
  void begin(const kernels::GridSpace&, std::span<const kernels::GridGrowth::Origin>,
             std::span<const kernels::VotesRecord>) override {}
  kernels::FusedScan fuse(std::span<const kernels::ReturnRay>, std::uint32_t, const kernels::GridSpace&, const Reserve&,
                          kernels::FollowingMap&) override {
    kernels::FusedScan fused;
    fused.flips_hash = 1;
    return fused;
  }
  void readWeights(std::span<const kernels::GridGrowth::Origin>, int, std::span<std::uint16_t> weights,
                   kernels::FollowingMap&) override {
    std::ranges::fill(weights, std::uint16_t{0});
  }
  kernels::FlipsOnDevice flips() const override { return {}; }
  void takeFlips(std::vector<kernels::LeafFlips>&, std::vector<std::uint16_t>&) override {}
  void clearFlips() override {}
  std::uint64_t bytes() const override { return 0; }
};

FieldParams paramsOf(int budget_points) {
  FieldParams params;
  params.backend = BackendKind::Cpu;
  params.tsdf.voxel_size_m = 0.04;
  params.threads = 2;
  params.update.budget_points = budget_points;
  return params;
}

std::unique_ptr<FieldStages> makeStages(int budget_points = 0) {
  ToolSpec tool{ToolGeometry::builtin("builtin:pencil")};
  tool.name = "pencil";
  return std::make_unique<FieldStages>(std::vector<ToolSpec>{tool}, resolvedFor(tool, paramsOf(budget_points)),
                                       ChosenBackend{kernels::makeCpuBackend(), "", ""}, TableProgress(), nullptr);
}

/// From then on a device leads that does nothing.
void leadIdly(FieldStages& field) {
  field.lead = std::make_unique<LeadingMap>(std::make_unique<IdleFuser>(), field.map, field.integrator,
                                            field.mirrors.facts(), field.params);
}

/// Ground and a wall, seen from above. @return whether the device fused
bool integrate(FieldStages& field, std::uint32_t number) {
  std::mt19937 random(number);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random() % 65536) / 65536.0f;
  };
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  T_W_S.translation() = Eigen::Vector3d(-0.6 + 0.1 * (number % 4), 0.1, 1.2);
  std::vector<Eigen::Vector3f> points_S;
  for (int n = 0; n < 6000; ++n) {
    const Eigen::Vector3f p_W = n % 3 == 0 ? Eigen::Vector3f(0.9f, uniform(-1, 1), uniform(0, 1))
                                           : Eigen::Vector3f(uniform(-1, 0.9f), uniform(-1, 1), 0);
    points_S.push_back(p_W - T_W_S.translation().cast<float>());
  }
  const auto gate = [&](FrameStats& stats) -> const GatedScan& { return field.gate.gate(points_S, T_W_S, stats); };
  return integrateScan(field, gate).fused_on_device;
}

/// @return how many are accessible
std::size_t expectSameLabels(const FieldStages& a, const FieldStages& b) {
  EXPECT_EQ(a.points.size(), b.points.size());
  std::size_t accessible = 0;
  for (std::uint32_t id = 0; id < std::min(a.points.size(), b.points.size()); ++id) {
    const PointRecord &in_a = a.tools.front().scorer->record(id), &in_b = b.tools.front().scorer->record(id);
    EXPECT_EQ(in_a.label, in_b.label) << id;
    if (in_a.label != PointLabel::Accessible) continue;
    EXPECT_EQ(in_a.score, in_b.score) << id;
    EXPECT_EQ(in_a.direction, in_b.direction) << id;
    ++accessible;
  }
  return accessible;
}

void expectMadeAgain(bool updated, int budget_points) {
  const auto plain = makeStages(), led = makeStages(budget_points);
  std::uint32_t scans = 0;
  const auto both = [&] {
    EXPECT_FALSE(integrate(*plain, scans));
    const bool leads = led->leads();
    EXPECT_EQ(integrate(*led, scans++), leads);
  };
  both();
  leadIdly(*led);
  if (updated) updateLabels(*led);
  while (led->times_made_again == 0 && scans < 12) both();
  EXPECT_EQ(led->times_made_again, 1);
  EXPECT_LE(scans, 2 + MapFollower::kMostBehind);
  EXPECT_FALSE(led->diverged());
  EXPECT_EQ(led->chosen.note_id, "device.diverged");
  EXPECT_EQ(test::hashOf(led->map), test::hashOf(plain->map));
  EXPECT_EQ(led->mirrors.facts().leafCount(), plain->mirrors.facts().leafCount());
  EXPECT_EQ(led->labels.current, updated);
  updateLabels(*plain);
  if (updated) {
    EXPECT_EQ(led->labels.backlog, 0u);
    EXPECT_GT(expectSameLabels(*plain, *led), 100u);
  } else {
    EXPECT_FALSE(led->labels.updated);
  }
  led->budget_points = 0;
  both();
  updateLabels(*plain);
  updateLabels(*led);
  EXPECT_GT(expectSameLabels(*plain, *led), 100u);
}

TEST(MadeAgain, LabelsAreThoseOfAFieldThatNeverDiffered) { expectMadeAgain(true, 0); }
TEST(MadeAgain, WhateverTheBudget) { expectMadeAgain(true, 10); }
TEST(MadeAgain, WithoutLabelsThereAreNone) { expectMadeAgain(false, 0); }

/// As a live session tells labels: without waiting for the host's map, until there is time.
TEST(MadeAgain, WhatWasToldWrongIsToldAgain) {
  const auto plain = makeStages(), led = makeStages();
  led->changed_points = std::make_unique<ChangedPoints>(*led->backend, false);
  std::vector<PointLabel> told;
  std::size_t times_told = 0;
  const auto tell = [&] {
    for (const SurfacePoint& point : led->changed_points->take(*led)) {
      told.resize(std::max<std::size_t>(told.size(), point.id + std::size_t{1}));
      told[point.id] = point.label;
      ++times_told;
    }
  };
  for (std::uint32_t scan = 0; scan < 2; ++scan) {
    integrate(*plain, scan);
    integrate(*led, scan);
    updateLabels(*led);
    tell();
    if (scan == 0) leadIdly(*led);
  }
  if (led->times_made_again == 0) {  // else the scan noticed
    led->lead->catchUp();
    ASSERT_TRUE(led->diverged());
    makeDeviceAgain(*led);
  }
  EXPECT_EQ(led->times_made_again, 1);
  EXPECT_TRUE(led->changed_points->madeAnew());
  updateLabels(*plain);
  updateLabels(*led);
  const std::size_t before = times_told;
  tell();
  EXPECT_GT(times_told, before);
  EXPECT_FALSE(led->changed_points->madeAnew());
  ASSERT_EQ(told.size(), plain->points.size());
  for (std::uint32_t id = 0; id < told.size(); ++id)
    ASSERT_EQ(told[id], plain->tools.front().scorer->record(id).label) << id;
}

TEST(MadeAgain, ThreeTimesAtMost) {
  const auto field = makeStages();
  std::uint32_t scans = 0;
  integrate(*field, scans++);
  for (int time = 1; time <= 3; ++time) {
    leadIdly(*field);
    while (field->times_made_again < time && scans < 40) integrate(*field, scans++);
    EXPECT_EQ(field->times_made_again, time);
  }
  leadIdly(*field);
  std::string id;
  while (id.empty() && scans < 50) {
    try {
      integrate(*field, scans++);
    } catch (const DeviceError& error) {
      id = error.id();
    }
  }
  EXPECT_EQ(id, "device.diverged");
  EXPECT_NO_THROW(field->steps.requireHostWhole());
  EXPECT_THROW(field->steps.requireWhole(), Error);
  const auto plain = makeStages();
  for (std::uint32_t n = 0; n < scans; ++n) integrate(*plain, n);
  EXPECT_EQ(test::hashOf(field->map), test::hashOf(plain->map)) << "the host's map is whole";
}

}  // namespace
}  // namespace accessvdb::internal
