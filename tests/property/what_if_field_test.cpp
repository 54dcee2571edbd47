// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a cut would open, against really removing it from a copy of the field; and the order of cuts, against all
/// what-ifs by brute force.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/what_if.h"
#include "support/determinism_support.h"
#include "support/region_worlds.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

/// What a comparison met.
struct Compared {
  std::uint64_t opened = 0, tried = 0;
  std::uint64_t doubtful = 0;  ///< blocked before; afterwards too little is known of them
};
/// What a cut would open, against a copy of the field with the regions removed: the same points, directions and scores.
/// @return nothing if the regions hold nothing
std::optional<Compared> expectEqualsRemoving(const AccessibilityField& field, const std::vector<Region>& regions) {
  const ScratchFolder folder;
  const FieldSnapshot before = field.snapshot();
  AccessibilityField copy = copyOf(field, folder);
  WhatIf what_if;
  try {
    what_if = field.whatIf(regions);
  } catch (const UnusableInput& error) {
    EXPECT_EQ(error.id(), "region.outside");
    return std::nullopt;
  }
  for (const Region& region : regions) copy.removeRegion(region, RemovedAs::Free);
  const FieldSnapshot after = copy.evaluateFromScratch();
  Compared compared;
  std::vector<SurfacePoint> expected;
  for (std::size_t n = 0; n < before.points.size(); ++n) {
    if (before.points[n].label != PointLabel::Blocked) continue;
    if (after.points[n].label == PointLabel::Accessible) expected.push_back(after.points[n]);
    compared.doubtful += after.points[n].reason == PointReason::Confidence ? 1 : 0;
  }
  EXPECT_EQ(what_if.opens.size(), expected.size());
  for (std::size_t n = 0; n < std::min(expected.size(), what_if.opens.size()); ++n) {
    const SurfacePoint &a = what_if.opens[n], &b = expected[n];
    EXPECT_EQ(a.id, b.id);
    EXPECT_EQ(a.direction, b.direction);
    EXPECT_EQ(a.score, b.score);
    EXPECT_EQ(a.position_W, b.position_W);
    EXPECT_EQ(a.normal_W, b.normal_W);
    EXPECT_EQ(a.weight, b.weight);
    EXPECT_EQ(a.confidence, b.confidence);
    EXPECT_EQ(a.direction_W, b.direction_W);
    EXPECT_TRUE(a.orientation_WT.isApprox(b.orientation_WT, 0));
  }
  // It changed nothing.
  expectSame(before, field.snapshot());
  expectExact(field);
  EXPECT_LT(what_if.points_tried, before.points.size());
  compared.opened = expected.size();
  compared.tried = what_if.points_tried;
  return compared;
}

TEST(WhatIf, EqualsRemovingFromACopy) {
  Compared all;
  std::uint64_t cases = 0;
  for (std::uint64_t seed = 1; seed <= 48; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const AccessibilityField field = seed <= 24 ? wallField(seed) : doubtfulField(seed);
    const FieldSnapshot before = field.snapshot();
    std::vector<Region> regions = {randomRegion(seed, before)};
    if (seed % 5 == 0) regions.push_back(randomRegion(seed + 100, before));
    const std::optional<Compared> compared = expectEqualsRemoving(field, regions);
    if (HasFailure()) return;
    if (!compared) continue;
    ++cases;
    all.opened += compared->opened;
    all.tried += compared->tried;
    all.doubtful += compared->doubtful;
  }
  EXPECT_GT(cases, 30u);
  EXPECT_GT(all.opened, 100u);
  EXPECT_GT(all.tried, 2 * all.opened);
  EXPECT_GT(all.doubtful, 5u);
}

/// With more directions than a mask holds, leaves and cells only tell whether a point is to be tried.
TEST(WhatIf, OfAWideSetEqualsRemovingFromACopy) {
  Compared all;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    FieldParams params = paramsFor(seed);
    params.approach.orientations = seed % 2 == 0 ? OrientationSet::sphere(9) : OrientationSet::pitch(-40, 40, 16);
    params.approach.rolls = seed % 2 == 0 ? 2 : 1;
    params.backend = BackendKind::Cpu;
    ASSERT_GT(params.approach.directionCount(), 256);
    AccessibilityField field(toolFor(seed), params);
    for (const Scan& scan : wallScans(seed, 5, 900)) field.integrateScan(scan.points_S, scan.T_W_S);
    field.update();
    const auto compared = expectEqualsRemoving(field, {randomRegion(seed, field.snapshot())});
    if (HasFailure()) return;
    if (!compared) continue;
    all.opened += compared->opened;
    all.tried += compared->tried;
  }
  EXPECT_GT(all.opened, 10u);
  EXPECT_GT(all.tried, 2 * all.opened);
}

/// A level bar far before a wall, seen from above and below: only the corridor of a short tool reads it. Steep
/// directions pass it, but there the tool meets the wall.
TEST(WhatIf, OpensCorridors) {
  FieldParams params = paramsFor(2);
  params.tsdf.voxel_size_m = 0.02;
  params.approach.corridor_length_m = 0.9;
  AccessibilityField field(boxTool({0.0f, -0.035f, -0.035f}, {0.2f, 0.035f, 0.035f}), params);
  for (double sensor_z = -1.2; sensor_z < 1.25; sensor_z += 0.2) {
    std::vector<Eigen::Vector3f> points;
    for (double z = -0.3; z < 0.3; z += 0.01) {
      int column = 0;
      for (double y = -1.6; y < 1.6; y += 0.02) {
        const double bar = 0.54 + 0.03 * (++column % 3);  // deeper than samples of the corridor are apart
        const double share = std::abs(sensor_z + (z - sensor_z) * bar) < 0.06 ? bar : 1;
        points.emplace_back(float(2 * share), float(y * share), float((z - sensor_z) * share));
      }
    }
    field.integrateScan(points, Eigen::Isometry3d(Eigen::Translation3d(0, 0, sensor_z)));
  }
  field.update();
  const auto compared = expectEqualsRemoving(field, {Region::box({0.9, -2, -0.2}, {1.4, 2, 0.2})});
  ASSERT_TRUE(compared);
  EXPECT_GT(compared->opened, 20u);
}

/// A wall behind two gates, each of which hides its own part; between them a part that opens only if both go.
TEST(WhatIf, OrdersCutsGreedily) {
  const AccessibilityField field = wallField(2);
  const FieldSnapshot before = field.snapshot();
  std::vector<Segment> segments;
  for (int n = 0; n < 5; ++n) {
    const double y = -0.4 + 0.4 * n;
    segments.push_back({"part " + std::to_string(n), Region::box({0.9, y, 0.2}, {1.85, y + 0.4, 1.8})});
  }
  const CutOrder order = orderCuts(field, segments);
  ASSERT_GE(order.cuts.size(), 2u);
  EXPECT_EQ(order.cuts.size() + order.left.size(), segments.size());

  // Each step against all what-ifs by brute force.
  std::vector<Region> cut;
  std::vector<std::uint32_t> opened;
  std::vector<bool> used(segments.size(), false);
  const auto idsWith = [&](const Region* more) {
    std::vector<Region> regions = cut;
    if (more != nullptr) regions.push_back(*more);
    std::vector<std::uint32_t> ids;
    for (const SurfacePoint& point : field.whatIf(regions).opens) ids.push_back(point.id);
    return ids;
  };
  for (const Cut& step : order.cuts) {
    std::size_t best = segments.size();
    std::vector<std::uint32_t> best_ids;
    for (std::size_t n = 0; n < segments.size(); ++n) {
      if (used[n]) continue;
      const std::vector<std::uint32_t> ids = idsWith(&segments[n].region);
      if (best == segments.size() || ids.size() > best_ids.size()) best = n, best_ids = ids;
    }
    ASSERT_EQ(step.segment, best);
    ASSERT_GT(best_ids.size(), opened.size());
    std::vector<std::uint32_t> fresh;
    std::ranges::set_difference(best_ids, opened, std::back_inserter(fresh));
    EXPECT_EQ(step.opens, fresh);
    used[best] = true;
    cut.push_back(segments[best].region);
    opened = best_ids;
  }
  for (const std::size_t n : order.left) EXPECT_LE(idsWith(&segments[n].region).size(), opened.size());
  const CutOrder first = orderCuts(field, segments, 1);
  ASSERT_EQ(first.cuts.size(), 1u);
  EXPECT_EQ(first.cuts[0].segment, order.cuts[0].segment);
}

}  // namespace
}  // namespace accessvdb::test
