// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the host tells an updater on a device (update/exact_on_device.cpp), against plain rules on the map and the
/// points. No GPU is needed; the updater only listens.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "field/point_weights.h"
#include "field/tools/scoring_setup.h"
#include "support/listening_backend.h"
#include "tsdf/scan_integrator.h"
#include "unit/points/random_points.h"
#include "update/make_scheduler.h"

namespace accessvdb::internal {
namespace {

using test::Random;

/// Flips of a leaf since the last update.
struct LeafFacts {
  std::uint32_t kinds = 0;
  std::array<std::uint32_t, 8> freed = {};  ///< voxels that stopped colliding, by cells of 4 x 4 x 4, x slowest
  std::uint64_t freed_columns = 0;          ///< with voxels that became free for the arm, bit 8 x + y
  std::uint32_t freed_heights = 0;          ///< bit z
  std::uint64_t blocked_columns = 0;        ///< with voxels that ceased to be free for the arm
  std::uint32_t blocked_heights = 0;
  std::array<int, 512> began = {};  ///< by voxel, how often it began to collide, less how often it ceased to
  bool operator==(const LeafFacts&) const = default;
};

/// What the updater was told since the last update, and the index of blocks as on a device.
struct Told {
  std::vector<kernels::PointDelta> deltas;
  std::vector<std::uint32_t> returns;  ///< of the deltas
  std::vector<kernels::PointWeight> weights, crossed;
  bool neighbours_begun = false;
  bool begun_before_update = false;
  int delta_calls = 0, block_parts = 0;  ///< hand-overs so far
  int begins = 0;                        ///< so far, and how many leaves a device had flips of the last time
  std::uint32_t on_device = 0;
  std::map<Index3, LeafFacts> flips;
  std::vector<std::uint32_t> slots;  ///< ids
  struct Block {
    Index3 leaf;
    std::uint32_t first, count;
  };
  std::map<std::uint32_t, Block> blocks;
};

class Listener final : public kernels::ExactUpdater {
 public:
  explicit Listener(Told& told) : told_(told) {}
  void begin(const kernels::ScoringInput&, const kernels::FlipLists& lists) override {
    ++told_.begins;
    told_.on_device = lists.on_device.count;
    told_.flips.clear();
    std::vector<std::uint16_t> voxels;
    for (const std::span<const std::uint16_t>& part : lists.voxels)
      voxels.insert(voxels.end(), part.begin(), part.end());
    for (const std::span<const kernels::LeafFlips>& part : lists.leaves) {
      for (const kernels::LeafFlips& flips : part) {
        LeafFacts& facts = told_.flips[{flips.leaf[0], flips.leaf[1], flips.leaf[2]}];
        facts.kinds |= flips.kinds;
        facts.freed_columns |= flips.freed_columns;
        facts.freed_heights |= flips.freed_heights;
        facts.blocked_columns |= flips.blocked_columns;
        facts.blocked_heights |= flips.blocked_heights;
        for (std::uint32_t n = 0; n < flips.voxels; ++n) {
          const std::uint16_t code = voxels.at(flips.first_voxel + n);
          facts.began.at(code >> 1) += (code & 1) != 0 ? 1 : -1;
        }
        for (std::size_t cell = 0; cell < 8; ++cell) facts.freed[cell] += flips.freed >> (8 * cell) & 0xff;
      }
    }
  }
  [[nodiscard]] bool takesVoxels() const override { return true; }
  void findNeighbours() override {
    EXPECT_FALSE(told_.neighbours_begun);
    told_.neighbours_begun = true;
  }
  void admit(const kernels::AdmitInput& input) override {
    if (std::exchange(told_.neighbours_begun, false)) told_.deltas.clear(), told_.returns.clear();
    told_.deltas.insert(told_.deltas.end(), input.deltas.begin(), input.deltas.end());
    told_.returns.insert(told_.returns.end(), input.returns.begin(), input.returns.end());
    told_.delta_calls += input.deltas.empty() ? 0 : 1;
    told_.block_parts += input.blocks.empty() ? 0 : 1;
    told_.slots.resize(std::max<std::size_t>(told_.slots.size(), input.num_slots), kNone);
    for (const kernels::BlockDelta& block : input.blocks) {
      EXPECT_EQ(told_.blocks.contains(block.block) ? 0u : 1u, block.is_new);
      EXPECT_LT(block.block, input.num_blocks);
      EXPECT_LT(block.group, input.num_groups);
      ASSERT_LE(block.first + block.count, input.num_slots);
      ASSERT_LE(block.source + block.count, input.block_ids.size());
      std::copy_n(input.block_ids.begin() + block.source, block.count, told_.slots.begin() + block.first);
      told_.blocks[block.block] = {{block.leaf[0], block.leaf[1], block.leaf[2]}, block.first, block.count};
    }
  }
  void choose(const kernels::ScoringInput&) override {}
  kernels::UpdateOutcome update(const kernels::ScoringInput&, const kernels::ConfidenceDelta& confidence) override {
    told_.weights.assign(confidence.weights.begin(), confidence.weights.end());
    told_.crossed.assign(confidence.crossed.begin(), confidence.crossed.end());
    told_.begun_before_update = std::exchange(told_.neighbours_begun, false);
    kernels::UpdateOutcome outcome;
    outcome.evaluated = 1;
    return outcome;
  }
  std::uint64_t bytes() const override { return 0; }

 private:
  Told& told_;
};

struct HostCase {
  const char* name;
  UpdateRegion region = UpdateRegion::DoubleCone;
  bool neighbourhood_weight = true;
  double confidence_min = 0.2;
  int scans_an_update = 1;
  bool rays = false;
  bool ahead = true;  ///< prepare() comes before the update
  int updates = 14, returns = 220;
  float spread_m = 1;    ///< of a scan's returns
  double spacing_m = 0;  ///< of the points that are scored
};
void PrintTo(const HostCase& c, std::ostream* out) { *out << c.name; }

class DeviceHost : public testing::TestWithParam<HostCase> {};

FieldParams fieldParams(const HostCase& c) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.tsdf.range_noise_m = 0;
  params.tsdf.region = c.region;
  params.approach.num_directions = 36;
  params.scoring.neighbourhood_weight = c.neighbourhood_weight;
  params.scoring.confidence_min = c.confidence_min;
  params.scoring.point_spacing_m = c.spacing_m;
  return params.resolved();
}

/// Oracle: the definition, voxel by voxel.
std::uint32_t weightAt(const PackedMap& map, const Index3& c, int reach) {
  std::uint32_t most = 0;
  for (int x = -reach; x <= reach; ++x) {
    for (int y = -reach; y <= reach; ++y) {
      for (int z = -reach; z <= reach; ++z) {
        most = std::max(most, map.at(openvdb::Coord(c[0] + x, c[1] + y, c[2] + z)).weight);
      }
    }
  }
  return most;
}

void expectDeviceIndex(const SurfaceIndex& index, const Told& told) {
  ASSERT_EQ(told.blocks.size(), index.blocks().size());
  std::set<std::uint32_t> slots;
  for (const auto& [number, block] : told.blocks) {
    const PointBlock& expected = index.blocks()[number];
    ASSERT_EQ(block.leaf, expected.leaf);
    ASSERT_TRUE(std::ranges::equal(std::span(told.slots).subspan(block.first, block.count), expected.ids));
    for (std::uint32_t slot = block.first; slot < block.first + block.count; ++slot) {
      ASSERT_TRUE(slots.insert(slot).second) << "two blocks share a slot";
    }
  }
}

TEST_P(DeviceHost, TellsWhatPlainRulesFind) {
  const HostCase& c = GetParam();
  const FieldParams params = fieldParams(c);
  PackedMap map(params.tsdf);
  map.setCollisionDistance(static_cast<float>(params.scoring.collision_distance_m));
  ScanIntegrator integrator(map);
  Told told;
  test::ListeningBackend backend([&](const kernels::ExactTables& tables) {
    EXPECT_EQ(tables.neighbours.choice.isMade(), c.spacing_m > 0);
    return std::make_unique<Listener>(told);
  });
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  const ScoringSetup setup(tool, params, backend);
  PointStore points(params, setup.directions());
  PointScorer scorer(points, params, backend, makeMapReads(map, points, c.neighbourhood_weight));
  const auto scheduler = makeScheduler(std::array{setup.scheduledFor(scorer)});
  ASSERT_NE(scheduler, nullptr);
  ASSERT_TRUE(scheduler->needs().changes);
  integrator.visitChanges([&](std::size_t part, const LeafChange& change) { scheduler->noteChange(part, change); });

  Random random(5);
  std::set<std::uint32_t> confident;               // as told
  std::map<std::uint32_t, Eigen::Vector3f> means;  // at the last update
  std::map<Index3, std::uint32_t> returns_of;      // voxels
  std::size_t late = 0, waiting = 0, touched_known = 0;
  for (int update = 0; update < c.updates; ++update) {
    told.deltas.clear();
    told.returns.clear();
    std::set<std::uint32_t> touched_ids;
    std::map<Index3, LeafFacts> flips;
    for (int scan = 0; scan < c.scans_an_update; ++scan) {
      std::vector<Eigen::Vector3f> p, q;
      const Eigen::Vector3f patch = random.point(1.5);
      for (int n = 0; n < c.returns; ++n) {
        Eigen::Vector3f x = patch + random.point(c.spread_m);
        x.z() = 0.3f * std::sin(2 * x.x()) + 0.03f * x.z();
        p.push_back(x);
        if (c.rays || n == 0) q.push_back(random.point(2) + Eigen::Vector3f(0, 0, 4));
      }
      const IntegrationResult result = integrator.integrate(p, q);
      points.describeTouched(scheduler->needs().deltas);
      const TouchedPoints& touched = points.placeReturns(p, q);
      points.indexNew();
      if (c.ahead && scheduler->needs().deltas) scheduler->noteBlocks(touched.changed_blocks);
      points.sumReturns(p, q);
      points.endReturns();
      for (const Eigen::Vector3f& return_L : p) ++returns_of[points.voxelOf(return_L)];
      touched_ids.insert(touched.all.begin(), touched.all.end());
      scheduler->noteReturns(touched, p, q);
      scheduler->noteChanges(p, q, {result.changes, {}});
      if (c.ahead) scheduler->prepare(nullptr);
      for (const auto& part : result.changes) {
        for (const LeafChange& change : part) {
          LeafFacts& facts = flips[parentOf(change.origin_ijk)];
          const LeafBits* all[] = {&change.collides_on, &change.collides_off, &change.arm_free_on,
                                   &change.arm_free_off};
          for (std::uint32_t bit = 0; bit < 512; ++bit) {
            for (std::uint32_t kind = 0; kind < 4; ++kind) {
              if (((*all[kind])[bit >> 6] >> (bit & 63) & 1) == 0) continue;
              facts.kinds |= 1u << kind;
              const std::uint32_t x = bit >> 6, y = bit >> 3 & 7, z = bit & 7;
              if (kind < 2) facts.began[bit] += kind == 0 ? 1 : -1;
              if (kind == 3) {
                facts.blocked_columns |= std::uint64_t{1} << (8 * x + y);
                facts.blocked_heights |= 1u << z;
              }
              if (kind == 1) ++facts.freed[(x / 4) * 4 + (y / 4) * 2 + z / 4];
              if (kind == 2) {
                facts.freed_columns |= std::uint64_t{1} << (8 * x + y);
                facts.freed_heights |= 1u << z;
              }
            }
          }
        }
      }
    }
    scheduler->update(nullptr, 0);

    // Confident: exactly those whose weight is now sufficient and was not before.
    std::set<std::uint32_t> crossed;
    for (const kernels::PointWeight& point : told.crossed) {
      ASSERT_TRUE(crossed.insert(point.id).second) << "told twice";
      ASSERT_FALSE(confident.contains(point.id)) << "told before";
      late += means.contains(point.id) ? 1 : 0;
    }
    for (std::uint32_t id = 0; id < points.size(); ++id) {
      const std::uint32_t weight = weightAt(map, points.voxelOf(points.first_L(id)), c.neighbourhood_weight ? 1 : 0);
      const bool enough = weight / (weight + params.scoring.confidence_half_weight) >= c.confidence_min - 1e-6;
      ASSERT_EQ(crossed.contains(id) || confident.contains(id), enough) << "update " << update << " point " << id;
      waiting += enough ? 0 : 1;
    }
    for (const kernels::PointWeight& point : told.crossed) {
      ASSERT_EQ(point.weight, weightAt(map, points.voxelOf(points.first_L(point.id)), c.neighbourhood_weight ? 1 : 0));
    }
    confident.insert(crossed.begin(), crossed.end());

    // News: the touched points, each once, with their current state and previous position.
    std::set<std::uint32_t> told_ids;
    for (const kernels::PointDelta& delta : told.deltas) {
      ASSERT_TRUE(told_ids.insert(delta.id).second);
      ASSERT_EQ(delta.block, points.blockOf(delta.id));
      const auto vector = [](const float* x) { return Eigen::Vector3f(x[0], x[1], x[2]); };
      ASSERT_EQ(vector(delta.position_L), points.first_L(delta.id));
      ASSERT_EQ(vector(delta.mean_L), points.pca_L(delta.id));
      ASSERT_EQ(vector(delta.to_sensor_L), points.toSensor_L(delta.id));
      ASSERT_TRUE(delta.seen == points.seen(delta.id));
      const auto old = means.find(delta.id);
      if (old == means.end()) {
        ASSERT_TRUE(std::isnan(delta.before_L[0]));
      } else {
        ASSERT_EQ(vector(delta.before_L), old->second);
        ++touched_known;
      }
    }
    ASSERT_EQ(told_ids, touched_ids);
    // How many returns they have, only if points compete.
    ASSERT_EQ(told.returns.size(), c.spacing_m > 0 ? told.deltas.size() : 0);
    for (std::size_t n = 0; n < told.returns.size(); ++n) {
      ASSERT_EQ(told.returns[n], returns_of[points.voxelOf(points.first_L(told.deltas[n].id))]);
    }
    // Neighbours are only worth finding before the update if all points came with one scan.
    ASSERT_EQ(told.begun_before_update, c.scans_an_update == 1);
    std::set<std::uint32_t> weighed;
    for (const kernels::PointWeight& point : told.weights) {
      ASSERT_TRUE(weighed.insert(point.id).second);
      ASSERT_EQ(point.weight, weightAt(map, points.voxelOf(points.first_L(point.id)), c.neighbourhood_weight ? 1 : 0));
    }
    ASSERT_EQ(weighed, touched_ids);
    for (std::uint32_t id = 0; id < points.size(); ++id) means[id] = points.pca_L(id);
    expectDeviceIndex(points.index(), told);
    if (HasFatalFailure()) return;

    // Flips: known from the first evaluation on.
    if (update == 0) {
      ASSERT_TRUE(told.flips.empty());
    } else {
      ASSERT_TRUE(told.flips == flips);
    }
  }
  EXPECT_GT(points.size(), 800u);
  EXPECT_GT(late, 50u);
  EXPECT_GT(waiting, 500u);
  EXPECT_GT(touched_known, 50u);
  if (c.spread_m > 1) {
    EXPECT_GE(told.delta_calls, 2 * c.updates);
    EXPECT_GT(told.block_parts, c.updates);
  }
}

/// Has fused something, nobody needs to know what.
class FlippedElsewhere final : public kernels::ScanFuser {
 public:
  void begin(const kernels::GridSpace&, std::span<const kernels::GridGrowth::Origin>,
             std::span<const kernels::VotesRecord>) override {}
  kernels::FusedScan fuse(std::span<const kernels::ReturnRay>, std::uint32_t, const kernels::GridSpace&, const Reserve&,
                          kernels::FollowingMap&) override {
    return {};
  }
  void readWeights(std::span<const kernels::GridGrowth::Origin>, int, std::span<std::uint16_t>,
                   kernels::FollowingMap&) override {}
  kernels::FlipsOnDevice flips() const override { return {nullptr, leaves, nullptr, 0}; }
  void takeFlips(std::vector<kernels::LeafFlips>&, std::vector<std::uint16_t>&) override { clearFlips(); }
  void clearFlips() override { leaves = 0; }
  std::uint64_t bytes() const override { return 0; }

  std::uint32_t leaves = 0;
};

/// A device that leads has fused a scan before its returns are in the store.
class HostBehind {
 public:
  HostBehind() {
    map_.setCollisionDistance(static_cast<float>(params_.scoring.collision_distance_m));
    scheduler_ = makeScheduler(std::array{setup_.scheduledFor(scorer_)});
    scheduler_->takeFlipsOf(&fuser_);
    scan();
    scheduler_->update(nullptr, 0);
    told_.begins = 0;
  }
  /// A scan of the map alone.
  void fuse() {
    p_.clear();
    for (int n = 0; n < 200; ++n) p_.push_back(random_.point(0.5));
    q_ = {random_.point(0.5) + Eigen::Vector3f(0, 0, 4)};
    integrator_.integrate(p_, q_);
    fuser_.leaves += 7;
  }
  void scan() {
    fuse();
    scanAgain();
  }
  /// The same returns once more, which need no new points.
  void scanAgain() {
    scheduler_->prepareFlips(nullptr);
    const bool describes = scheduler_->needs().deltas;
    points_.describeTouched(describes);
    const TouchedPoints& touched = points_.placeReturns(p_, q_);
    points_.indexNew();
    if (describes) scheduler_->noteBlocks(touched.changed_blocks);
    points_.sumReturns(p_, q_);
    points_.endReturns();
    scheduler_->noteReturns(touched, p_, q_);
    scheduler_->noteChanges(p_, q_, {});
    scheduler_->prepare(nullptr);
  }
  [[nodiscard]] int begins() const { return told_.begins; }
  [[nodiscard]] UpdateScheduler& scheduler() { return *scheduler_; }
  /// @param begins  since the last update
  void expectAfterUpdate(int begins, std::uint32_t on_device) {
    scheduler_->update(nullptr, 0);
    EXPECT_EQ(std::exchange(told_.begins, 0), begins);
    EXPECT_EQ(told_.on_device, on_device);
    EXPECT_EQ(fuser_.leaves, 0u);
    EXPECT_GT(told_.weights.size(), 100u);
    for (const kernels::PointWeight& point : told_.weights) {
      EXPECT_EQ(point.weight, weightAt(map_, points_.voxelOf(points_.first_L(point.id)), 1));
    }
    expectDeviceIndex(points_.index(), told_);
  }

 private:
  FieldParams params_ = fieldParams(HostCase{.name = "led"});
  PackedMap map_{params_.tsdf};
  ScanIntegrator integrator_{map_};
  Told told_;
  test::ListeningBackend backend_{[this](const kernels::ExactTables&) { return std::make_unique<Listener>(told_); }};
  ToolGeometry tool_ = ToolGeometry::builtin("builtin:pencil");
  ScoringSetup setup_{tool_, params_, backend_};
  PointStore points_{params_, setup_.directions()};
  PointScorer scorer_{points_, params_, backend_, makeMapReads(map_, points_, true)};
  FlippedElsewhere fuser_;
  std::unique_ptr<UpdateScheduler> scheduler_;
  Random random_{9};
  std::vector<Eigen::Vector3f> p_, q_;
};

TEST(DeviceAheadOfHost, BeginsOnceWithTheFlipsOfAScan) {
  HostBehind host;
  for (int n = 0; n < 3; ++n) {
    host.scan();
    EXPECT_EQ(host.begins(), 1);
    host.expectAfterUpdate(1, 7);
  }
}

TEST(DeviceAheadOfHost, BeginsAgainWithThoseOfSeveralScans) {
  HostBehind host;
  host.scan();
  host.scan();
  EXPECT_EQ(host.begins(), 1);
  host.expectAfterUpdate(2, 14);
}

/// What was described of the first one, nothing, is not taken for what the second one brought.
TEST(DeviceAheadOfHost, DescribesBlocksOfAScanThatFollowsOneWithoutAny) {
  HostBehind host;
  host.scan();
  host.expectAfterUpdate(1, 7);
  host.scanAgain();
  host.scan();
  host.expectAfterUpdate(2, 7);
}

/// Weights that were read ahead are not those of the map any more.
TEST(DeviceAheadOfHost, ReadsWeightsAgainWhereTheMapChangesAlone) {
  HostBehind host;
  host.scan();
  host.fuse();
  host.scheduler().noteChangesAlone({});
  host.expectAfterUpdate(2, 14);
}

TEST(DeviceAheadOfHost, TakesItsFlipsWhereItLeadsNoLonger) {
  HostBehind host;
  host.scan();
  host.scheduler().takeFlipsOf(nullptr);
  host.expectAfterUpdate(2, 0);
}

INSTANTIATE_TEST_SUITE_P(
    Streams, DeviceHost,
    testing::Values(HostCase{.name = "product"}, HostCase{.name = "several scans an update", .scans_an_update = 3},
                    HostCase{.name = "a higher bound", .confidence_min = 0.5, .scans_an_update = 2, .rays = true},
                    HostCase{.name = "own voxel only",
                             .region = UpdateRegion::FullCube,
                             .neighbourhood_weight = false,
                             .confidence_min = 0.6},
                    HostCase{.name = "projective", .region = UpdateRegion::Projective},
                    HostCase{.name = "nothing ahead", .ahead = false},
                    HostCase{.name = "points of the surface", .spacing_m = 0.1},
                    HostCase{.name = "points of the surface, several scans", .scans_an_update = 2, .spacing_m = 0.1},
                    // More points, and more blocks, than are passed at a time.
                    HostCase{.name = "a large scan", .updates = 2, .returns = 75000, .spread_m = 34, .spacing_m = 0.1},
                    HostCase{
                        .name = "large scans", .scans_an_update = 2, .updates = 2, .returns = 40000, .spread_m = 26}));

}  // namespace
}  // namespace accessvdb::internal
