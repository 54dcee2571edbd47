// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What points read from the map, against the map voxel by voxel: weights, and where a scan may have raised them.
#include <gtest/gtest.h>

#include <map>
#include <mutex>
#include <set>

#include "field/point_weights.h"
#include "field/reached_leaves.h"
#include "tsdf/scan_integrator.h"
#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::Random;

/// Returns of a rough floor and of a post, from one sensor or one per return.
struct Scan {
  std::vector<Eigen::Vector3f> p, q;
};
Scan randomScan(Random& random, const Eigen::Vector3f& centre, double v, bool rays) {
  Scan scan;
  for (int n = 0; n < 250; ++n) {
    const auto step = static_cast<float>(v);
    Eigen::Vector3f p = random.point(30 * v);
    if (n % 4 == 0) {
      p.head<2>() = Eigen::Vector2f(3 * step, -2 * step) + 0.1f * p.head<2>();
    } else {
      p.z() = 0.1f * p.z();
    }
    scan.p.push_back(centre + p);
    if (rays || n == 0) scan.q.push_back(centre + random.point(60 * v) + Eigen::Vector3f(0, 0, 80 * step));
  }
  return scan;
}

TsdfParams tsdfParams(double v, UpdateRegion region = UpdateRegion::DoubleCone, double cone_cos_min = 0.95,
                      double tau_voxels = 6) {
  TsdfParams params;
  params.voxel_size_m = v;
  params.truncation_distance_m = tau_voxels * v;
  params.region = region;
  params.cone_cos_min = cone_cos_min;
  return params;
}

std::map<Index3, std::uint32_t> weightsOf(const PackedMap& map) {
  std::map<Index3, std::uint32_t> weights;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    LeafValues::Room room;
    const std::uint32_t* packed = LeafValues(*leaf).all(room);
    for (openvdb::Index n = 0; packed != nullptr && n < PackedLeaf::SIZE; ++n) {
      const openvdb::Coord ijk = leaf->offsetToGlobalCoord(n);
      if (weightOf(packed[n]) > 0) weights[{ijk.x(), ijk.y(), ijk.z()}] = weightOf(packed[n]);
    }
  }
  return weights;
}

TEST(PointReads, WeightsAreThoseOfTheVoxelsAround) {
  const double v = 0.1;
  PackedMap map(tsdfParams(v));
  ScanIntegrator integrator(map);
  Random random(3);
  FieldParams params = test::pointParams(v);
  PointStore points(params, directionTable(36));
  for (int n = 0; n < 6; ++n) {
    const Scan scan = randomScan(random, {0, 0, 0}, v, false);
    integrator.integrate(scan.p, scan.q);
    points.addReturns(scan.p, scan.q);
  }
  const std::map<Index3, std::uint32_t> weights = weightsOf(map);
  const auto largest = [&](const Index3& c, int reach) {
    std::uint32_t most = 0;
    if (!weights.contains(c)) return most;  // a point there would be gone: its return observes its voxel
    for (int x = -reach; x <= reach; ++x) {
      for (int y = -reach; y <= reach; ++y) {
        for (int z = -reach; z <= reach; ++z) {
          const auto found = weights.find({c[0] + x, c[1] + y, c[2] + z});
          if (found != weights.end()) most = std::max(most, found->second);
        }
      }
    }
    return most;
  };
  std::set<std::uint32_t> seen;
  for (const bool neighbourhood : {true, false}) {
    const MapReads reads = makeMapReads(map, points, neighbourhood);
    // Voxels everywhere: on both sides of leaf borders, in missing leaves or leaves without values. In any number.
    for (const std::size_t count : {0, 1, 7, 8, 15, 16, 17, 40, 1024, 1025, 5000}) {
      std::vector<Index3> voxels(count);
      for (Index3& voxel : voxels) {
        voxel = {random.between(-40, 40), random.between(-40, 40), random.between(-12, 12)};
      }
      std::vector<std::uint16_t> found(count, 4321);
      reads.weights_at(voxels, found);
      for (std::size_t n = 0; n < count; ++n) {
        ASSERT_EQ(found[n], largest(voxels[n], neighbourhood ? 1 : 0));
        seen.insert(found[n]);
      }
    }
    std::vector<std::uint32_t> ids(points.size());
    for (std::uint32_t id = 0; id < points.size(); ++id) ids[id] = points.size() - 1 - id;
    std::vector<std::uint16_t> found(ids.size());
    reads.weights(ids, found);
    for (std::size_t n = 0; n < ids.size(); ++n) {
      ASSERT_EQ(found[n], largest(points.voxelOf(points.first_L(ids[n])), neighbourhood ? 1 : 0));
    }
  }
  EXPECT_GT(seen.size(), 4u);
  EXPECT_TRUE(seen.contains(0));
}

struct RegionCase {
  const char* name;
  TsdfParams params;
  Eigen::Vector3f centre;
  bool rays;
};
void PrintTo(const RegionCase& c, std::ostream* out) { *out << c.name; }

class ReachedLeaves : public testing::TestWithParam<RegionCase> {};

/// A voxel whose weight grew has its leaf, and its neighbours' leaves, among the reached ones; and not all are reached.
TEST_P(ReachedLeaves, HoldEveryWeightThatGrew) {
  const RegionCase& c = GetParam();
  const double v = c.params.voxel_size_m;
  for (const int reach : {0, 1}) {
    PackedMap map(c.params);
    ScanIntegrator integrator(map);
    Random random(11);
    std::map<Index3, std::uint32_t> before;
    std::size_t grown = 0, beside = 0, needed_leaves = 0, reached_leaves = 0;
    for (int n = 0; n < 4; ++n) {
      const Scan scan = randomScan(random, c.centre, v, c.rays);
      integrator.integrate(scan.p, scan.q);
      std::set<Index3> reached;
      std::mutex mutex;
      ASSERT_TRUE(forEachReachedLeaf(c.params, scan.p, scan.q, reach, [&](std::span<const Index3> leaves) {
        const std::lock_guard lock(mutex);
        reached.insert(leaves.begin(), leaves.end());
      }));
      std::set<Index3> needed;
      const std::map<Index3, std::uint32_t> after = weightsOf(map);
      for (const auto& [voxel, weight] : after) {
        const auto old = before.find(voxel);
        if (old != before.end() && old->second == weight) continue;
        ++grown;
        for (int x = -reach; x <= reach; ++x) {
          for (int y = -reach; y <= reach; ++y) {
            for (int z = -reach; z <= reach; ++z) needed.insert(parentOf({voxel[0] + x, voxel[1] + y, voxel[2] + z}));
          }
        }
        beside += needed.contains(parentOf(voxel)) ? 0 : 1;
      }
      for (const Index3& leaf : needed)
        ASSERT_TRUE(reached.contains(leaf)) << leaf[0] << ' ' << leaf[1] << ' ' << leaf[2];
      needed_leaves += needed.size();
      reached_leaves += reached.size();
      before = after;
    }
    EXPECT_EQ(beside, 0u);
    EXPECT_GT(grown, 5000u);
    EXPECT_LT(reached_leaves, needed_leaves * 3 / 2);  // a superset, not everything
  }
}

INSTANTIATE_TEST_SUITE_P(
    Regions, ReachedLeaves,
    testing::Values(RegionCase{"double cone", tsdfParams(0.1), {0, 0, 0}, false},
                    RegionCase{"rays", tsdfParams(0.05), {-3, 2, 1}, true},
                    RegionCase{
                        "long cone", tsdfParams(0.02, UpdateRegion::DoubleCone, 0.95, 14), {0.3f, -0.2f, 0}, true},
                    RegionCase{"wide cone", tsdfParams(0.1, UpdateRegion::DoubleCone, 0.6), {0, 0, 0}, true},
                    RegionCase{"narrow cone", tsdfParams(0.1, UpdateRegion::DoubleCone, 0.999), {0, 0, 0}, true},
                    RegionCase{"full cube", tsdfParams(0.1, UpdateRegion::FullCube), {0, 0, 0}, false},
                    RegionCase{"far from the origin", tsdfParams(0.01), {-5000, 5100, 4900}, true}));

/// The baseline's region is the sensor's view: the returns say nothing about it.
TEST(ReachedLeavesOfABaseline, AreNotKnown) {
  const Eigen::Vector3f p(1, 0, 0), q(0, 0, 0);
  const bool known = forEachReachedLeaf(tsdfParams(0.1, UpdateRegion::Projective), {&p, 1}, {&q, 1}, 1,
                                        [](std::span<const Index3>) { FAIL(); });
  EXPECT_FALSE(known);
}

}  // namespace
}  // namespace accessvdb::internal
