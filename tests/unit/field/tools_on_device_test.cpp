// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Several tools on a backend that decides itself what is due: those tried in the same directions are one updater's,
/// are told of points and flips once, and keep only once what no tool decides. No GPU is needed; the updater only
/// listens.
#include <gtest/gtest.h>

#include <memory>
#include <utility>
#include <vector>

#include "field/point_weights.h"
#include "field/tools/tools_of_field.h"
#include "support/listening_backend.h"
#include "tsdf/scan_integrator.h"
#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

/// One updater, and what it was told last.
struct ToldOfTools {
  std::size_t tools = 0;
  int directions = 0;
  std::size_t points = 0, flips = 0;
  std::vector<kernels::PointStateView> admitted;  ///< of each tool
  std::vector<kernels::ToolInput> begun, chosen, updated;
};

class ToolsListener final : public kernels::ExactUpdater {
 public:
  explicit ToolsListener(ToldOfTools& told) : told_(told) {}
  void admit(const kernels::AdmitInput& input) override {
    told_.points += input.deltas.size();
    told_.admitted.assign(input.states.begin(), input.states.end());
  }
  void findNeighbours() override {}
  [[nodiscard]] bool takesVoxels() const override { return false; }
  void begin(const kernels::ScoringInput& input, const kernels::FlipLists& flips) override {
    for (const auto& part : flips.leaves) told_.flips += part.size();
    told_.begun = toolsOf(input);
  }
  void choose(const kernels::ScoringInput& input) override { told_.chosen = toolsOf(input); }
  kernels::UpdateOutcome update(const kernels::ScoringInput& input, const kernels::ConfidenceDelta&) override {
    told_.updated = toolsOf(input);
    kernels::UpdateOutcome outcome;
    outcome.evaluated = 1;
    return outcome;
  }
  std::uint64_t bytes() const override { return 1000; }

 private:
  static std::vector<kernels::ToolInput> toolsOf(const kernels::ScoringInput& input) {
    return {input.tools.begin(), input.tools.end()};
  }
  ToldOfTools& told_;
};

ToolSpec spec(const char* name, OrientationSet orientations) {
  return {ToolGeometry::builtin(std::string("builtin:") + name), std::move(orientations), 0, name, 0};
}

/// A field's tools with the updaters that they asked for, without the field.
class ToolsOnDevice : public testing::Test {
 protected:
  ToolsOnDevice() {
    FieldParams params;
    params.tsdf.voxel_size_m = 0.05;
    params.tsdf.range_noise_m = 0;
    const FieldParams resolved = resolvedFor(specs_.front(), params);
    map_ = std::make_unique<PackedMap>(resolved.tsdf);
    map_->setCollisionDistance(static_cast<float>(resolved.scoring.collision_distance_m));
    tools_ =
        std::make_unique<ToolsOfField>(specs_, resolved, ToolsOfField::Shared{*map_, backend_, std::nullopt, nullptr});
    points_ = tools_->front().points;
    scheduler_ = tools_->makeScheduler();
  }

  UpdateStats scanAndUpdate() {
    ScanIntegrator integrator(*map_);
    integrator.visitChanges([&](std::size_t part, const LeafChange& change) { scheduler_->noteChange(part, change); });
    test::Random random(++seed_);
    std::vector<Eigen::Vector3f> p;
    for (int n = 0; n < 400; ++n) p.push_back(random.point(1));
    const std::vector<Eigen::Vector3f> q = {{0, static_cast<float>(seed_), 4}};
    points_->describeTouched(scheduler_->needs().deltas);
    scheduler_->noteReturns(points_->addReturns(p, q), p, q);
    const IntegrationResult result = integrator.integrate(p, q);
    scheduler_->noteChanges(p, q, {result.changes, {}});
    scheduler_->prepare(nullptr);
    return scheduler_->update(nullptr, 0);
  }

  std::vector<ToolSpec> specs_ = {spec("pencil", OrientationSet::yaw()), spec("pruner", OrientationSet::sphere(30)),
                                  spec("pruner", OrientationSet::yaw()), spec("pencil", OrientationSet::sphere(30))};
  std::vector<std::unique_ptr<ToldOfTools>> told_;
  test::ListeningBackend backend_{[this](const kernels::ExactTables& tables) {
    told_.push_back(std::make_unique<ToldOfTools>());
    told_.back()->tools = tables.tools.size();
    told_.back()->directions = tables.neighbours.num_directions;
    for (const kernels::ToolTables& tool : tables.tools) {
      EXPECT_EQ(tool.any_directions, tables.tools.front().any_directions);
      EXPECT_FALSE(tool.tool_columns.empty());
    }
    return std::make_unique<ToolsListener>(*told_.back());
  }};
  std::uint32_t seed_ = 0;  ///< of the scan before
  std::unique_ptr<PackedMap> map_;
  std::unique_ptr<ToolsOfField> tools_;
  PointStore* points_ = nullptr;  ///< the first tool's
  std::unique_ptr<UpdateScheduler> scheduler_;
};

TEST_F(ToolsOnDevice, OfTheSameDirectionsAreOneUpdaters) {
  ASSERT_EQ(told_.size(), 2u);
  EXPECT_EQ(told_[0]->directions, 180);
  EXPECT_EQ(told_[1]->directions, tools_->at(1).setup.tool().num_directions);
  for (const auto& told : told_) EXPECT_EQ(told->tools, 2u);
  EXPECT_EQ(scheduler_->deviceBytes(), 2000u);
}

TEST_F(ToolsOnDevice, AreToldOnceAndEachWithItsOwnTables) {
  const UpdateStats stats = scanAndUpdate();
  EXPECT_EQ(stats.dirty_points, 2u);  // one of each updater
  for (const auto& told : told_) {
    EXPECT_EQ(told->points, points_->size());
    EXPECT_EQ(told->flips, 0u);  // nothing was scored before
  }
  static_cast<void>(scanAndUpdate());
  EXPECT_GT(told_[0]->flips, 0u);
  EXPECT_EQ(told_[0]->flips, told_[1]->flips);

  const ToolScoring* const of_updater[2][2] = {{&tools_->at(0), &tools_->at(2)}, {&tools_->at(1), &tools_->at(3)}};
  for (std::size_t n = 0; n < 2; ++n) {
    for (const auto* inputs : {&told_[n]->begun, &told_[n]->chosen, &told_[n]->updated}) {
      ASSERT_EQ(inputs->size(), 2u);
      for (std::size_t k = 0; k < 2; ++k) {
        const ScoringTables expected = of_updater[n][k]->setup.tables(nullptr);
        EXPECT_EQ((*inputs)[k].tool.columns, expected.tool.columns);
        EXPECT_EQ((*inputs)[k].tool.collision_limit, expected.tool.collision_limit);
        EXPECT_EQ((*inputs)[k].approach.arm_offsets, expected.approach.arm_offsets);
        EXPECT_EQ((*inputs)[k].points.label, of_updater[n][k]->scorer->device().view().label);
      }
    }
    EXPECT_NE(told_[n]->updated[0].tool.columns, told_[n]->updated[1].tool.columns);
  }
}

TEST_F(ToolsOnDevice, ShareWhatNoToolDecidesAndNothingElse) {
  static_cast<void>(scanAndUpdate());
  for (const auto& told : told_) {
    ASSERT_EQ(told->admitted.size(), 2u);
    const kernels::PointStateView &first = told->admitted[0], &second = told->admitted[1];
    EXPECT_EQ(first.position_L, second.position_L);
    EXPECT_EQ(first.normal_L, second.normal_L);
    EXPECT_EQ(first.seen, second.seen);
    EXPECT_EQ(first.weight, second.weight);
    EXPECT_NE(first.score, second.score);
    EXPECT_NE(first.direction, second.direction);
    EXPECT_NE(first.stability, second.stability);
    EXPECT_NE(first.label, second.label);
    EXPECT_NE(first.reason, second.reason);
  }
  EXPECT_NE(told_[0]->admitted[0].position_L, told_[1]->admitted[0].position_L);
  EXPECT_NE(told_[0]->admitted[0].seen, told_[1]->admitted[0].seen);
  // The scorers are as large as their points, and say what they hold themselves.
  const PointsOnDevice &owner = tools_->at(0).scorer->device(), &sharing = tools_->at(2).scorer->device();
  EXPECT_EQ(sharing.size(), points_->size());
  EXPECT_EQ(owner.bytes() - sharing.bytes(), sharing.bytes() / 10 * (12 + 12 + 24 + 2));
}

}  // namespace
}  // namespace accessvdb::internal
