// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Differences between two lists of points. The oracle compares every point with every other.
#include <gtest/gtest.h>
#include <openvdb/io/File.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <tuple>

#include "accessvdb/error.h"
#include "accessvdb/program/points_diff.h"
#include "unit/io/parsed_ply.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using io::PointChange;
using io::PointsDiff;
using test::contentOf;
using test::ParsedPly;
using test::ScratchFolder;

constexpr double kVoxel = 0.25;  // a power of two, so that positions on the voxels' faces are exact

io::FieldMetadata metadataOf(const std::string& tool = "abc", const std::string& tau = "1") {
  return {{"tool_sha256", tool}, {"truncation_distance_m", tau}, {"device", tool + tau}};
}

struct World {
  std::mt19937 random;

  double number(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }

  /// Few voxels, so that many hold two points and many have neighbours. Some lie on faces between voxels.
  SurfacePoint point() {
    SurfacePoint point;
    for (int axis = 0; axis < 3; ++axis) {
      point.position_W[axis] = random() % 4 == 0 ? kVoxel * (static_cast<int>(random() % 9) - 4.5) : number(-1.1, 1.1);
    }
    point.label = static_cast<PointLabel>(random() % 3);
    point.reason =
        point.label == PointLabel::Accessible ? PointReason::None : static_cast<PointReason>(1 + random() % 6);
    point.yaw_rad = static_cast<float>(number(-3, 3));
    point.direction_W = {std::cos(point.yaw_rad), std::sin(point.yaw_rad), 0};
    if (point.label == PointLabel::Accessible) point.score = 0;
    return point;
  }

  FieldSnapshot field(int points, const Eigen::Vector3d& origin_W) {
    FieldSnapshot field;
    field.origin_W = origin_W;
    field.voxel_size_m = kVoxel;
    for (int n = 0; n < points; ++n) {
      field.points.push_back(point());
      field.points.back().id = static_cast<std::uint32_t>(n);
    }
    return field;
  }
};

/// What the oracle compares: place, kind, and both sides.
using Row = std::tuple<double, double, double, int, int, int, int, int>;

std::vector<Row> rowsOf(const PointsDiff& diff) {
  std::vector<Row> rows;
  for (const io::ChangedPoint& changed : diff.points) {
    const Eigen::Vector3d& p_W = changed.point.position_W;
    const bool was = changed.change != PointChange::Appeared;
    rows.emplace_back(p_W.x(), p_W.y(), p_W.z(), static_cast<int>(changed.change),
                      was ? static_cast<int>(changed.label_before) : -1,
                      was ? static_cast<int>(changed.reason_before) : -1, static_cast<int>(changed.point.label),
                      static_cast<int>(changed.point.reason));
  }
  std::sort(rows.begin(), rows.end());
  return rows;
}

std::vector<Row> bruteForce(const FieldSnapshot& before, const FieldSnapshot& after) {
  const bool same_origin = before.origin_W == after.origin_W;
  const auto matches = [&](const SurfacePoint& a, const SurfacePoint& b) {
    if (!same_origin) return (a.position_W - b.position_W).norm() <= kVoxel;
    for (int axis = 0; axis < 3; ++axis) {
      const auto voxel = [&](const SurfacePoint& point) {
        return std::floor((point.position_W[axis] - before.origin_W[axis]) / kVoxel + 0.5);
      };
      if (voxel(a) != voxel(b)) return false;
    }
    return true;
  };
  const auto place = [](const SurfacePoint& point) {
    return std::array{point.position_W.x(), point.position_W.y(), point.position_W.z()};
  };
  std::vector<Row> rows;
  std::set<const SurfacePoint*> met;
  for (const SurfacePoint& b : after.points) {
    const SurfacePoint* nearest = nullptr;
    for (const SurfacePoint& a : before.points) {
      if (!matches(a, b)) continue;
      met.insert(&a);
      const auto key = [&](const SurfacePoint& point) {
        return std::pair((point.position_W - b.position_W).squaredNorm(), place(point));
      };
      if (nearest == nullptr || key(a) < key(*nearest)) nearest = &a;
    }
    const int label = static_cast<int>(b.label), reason = static_cast<int>(b.reason);
    const auto [x, y, z] = place(b);
    if (nearest == nullptr) {
      rows.emplace_back(x, y, z, 3, -1, -1, label, reason);
    } else if (nearest->label != b.label) {
      const int kind = b.label == PointLabel::Accessible ? 0 : nearest->label == PointLabel::Accessible ? 1 : 2;
      rows.emplace_back(x, y, z, kind, static_cast<int>(nearest->label), static_cast<int>(nearest->reason), label,
                        reason);
    }
  }
  for (const SurfacePoint& a : before.points) {
    if (met.contains(&a)) continue;
    const auto [x, y, z] = place(a);
    rows.emplace_back(x, y, z, 4, static_cast<int>(a.label), static_cast<int>(a.reason), static_cast<int>(a.label),
                      static_cast<int>(a.reason));
  }
  std::sort(rows.begin(), rows.end());
  return rows;
}

TEST(PointsDiffRandom, EqualsEveryPointComparedWithEveryOther) {
  const ScratchFolder folder;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    SCOPED_TRACE(seed);
    World world{std::mt19937(seed)};
    const int most = static_cast<int>(1 + seed * 20);
    const Eigen::Vector3d other = seed % 2 == 0 ? Eigen::Vector3d(0, 0, 0) : Eigen::Vector3d(0.1, 0.25, -3);
    const FieldSnapshot before = world.field(static_cast<int>(world.random() % most), {0, 0, 0});
    const FieldSnapshot after = world.field(static_cast<int>(world.random() % most), other);
    io::writePointsPly(folder / "before.ply", before, metadataOf());
    io::writePointsPly(folder / "after.ply", after, metadataOf());
    const PointsDiff diff = io::diffPoints({folder / "before.ply"}, {folder / "after.ply"});
    EXPECT_EQ(rowsOf(diff), bruteForce(before, after));
    EXPECT_EQ(diff.points_before, before.points.size());
    EXPECT_EQ(diff.points_after, after.points.size());
    std::uint64_t changes = 0, transitions = 0;
    for (const std::uint64_t count : diff.changes) changes += count;
    for (const auto& transition : diff.transitions) transitions += transition.points;
    EXPECT_EQ(changes, diff.points.size());
    EXPECT_EQ(transitions, diff.changes[0] + diff.changes[1] + diff.changes[2]);
    EXPECT_EQ(diff.same + transitions + diff.changes[3], diff.points_after);
  }
}

TEST(PointsDiffFiles, OrderAndDivisionIntoFilesDoNotMatter) {
  const ScratchFolder folder;
  World world{std::mt19937(7)};
  const FieldSnapshot before = world.field(500, {0, 0, 0}), after = world.field(500, {0.5, 0, 0});
  io::writePointsPly(folder / "before.ply", before, metadataOf());
  io::writePointsPly(folder / "after.ply", after, metadataOf());
  const auto whole = io::diffPoints({folder / "before.ply"}, {folder / "after.ply"});
  const auto half = [&](const FieldSnapshot& field, bool second) {
    FieldSnapshot part = field;
    std::reverse(part.points.begin(), part.points.end());
    std::erase_if(part.points, [&](const SurfacePoint& point) { return (point.position_W.x() > 0.2) != second; });
    return part;
  };
  for (const bool second : {false, true}) {
    const std::string n = second ? "1" : "0";
    io::writePointsPly(folder / ("before" + n), half(before, second), metadataOf());
    io::writePointsPly(folder / ("after" + n), half(after, second), metadataOf());
  }
  const auto parts = io::diffPoints({folder / "before1", folder / "before0"}, {folder / "after0", folder / "after1"});
  io::writeDiffPly(folder / "whole.ply", whole);
  io::writeDiffPly(folder / "parts.ply", parts);
  io::writeDiffVdb(folder / "whole.vdb", whole);
  io::writeDiffVdb(folder / "parts.vdb", parts);
  EXPECT_FALSE(whole.points.empty());
  EXPECT_EQ(contentOf(folder / "whole.ply"), contentOf(folder / "parts.ply"));
  EXPECT_EQ(contentOf(folder / "whole.vdb"), contentOf(folder / "parts.vdb"));
}

TEST(PointsDiffFiles, HoldTheChangesByAnIndependentReader) {
  const ScratchFolder folder;
  World world{std::mt19937(11)};
  io::writePointsPly(folder / "before.ply", world.field(300, {1, 2, 3}), metadataOf());
  io::writePointsPly(folder / "after.ply", world.field(300, {0, 0, 0}), metadataOf());
  const PointsDiff diff = io::diffPoints({folder / "before.ply"}, {folder / "after.ply"});
  io::writeDiffPly(folder / "diff.ply", diff);
  io::writeDiffVdb(folder / "diff.vdb", diff);

  const ParsedPly ply(contentOf(folder / "diff.ply"));
  const std::vector<std::string> names = {
      "x",     "y",      "z",  "red", "green", "blue", "change", "label_before", "reason_before",
      "label", "reason", "dx", "dy",  "dz"};
  EXPECT_EQ(ply.names, names);
  ASSERT_EQ(ply.rows.size(), diff.points.size());
  std::map<int, std::set<std::array<double, 3>>> voxels;  // of each kind, around the earlier map's origin
  for (std::size_t n = 0; n < ply.rows.size(); ++n) {
    const auto& row = ply.rows[n];
    const io::ChangedPoint& changed = diff.points[n];
    const bool was = changed.change != PointChange::Appeared, is = changed.change != PointChange::Gone;
    EXPECT_EQ(row[0], changed.point.position_W.x());
    EXPECT_EQ(row[6], static_cast<double>(changed.change));
    EXPECT_EQ(row[7], was ? static_cast<double>(changed.label_before) : 255);
    EXPECT_EQ(row[8], was ? static_cast<double>(changed.reason_before) : 255);
    EXPECT_EQ(row[9], is ? static_cast<double>(changed.point.label) : 255);
    EXPECT_EQ(row[10], is ? static_cast<double>(changed.point.reason) : 255);
    EXPECT_EQ(row[11], changed.point.direction_W.x());
    std::array<double, 3> voxel;
    for (int axis = 0; axis < 3; ++axis) {
      voxel[static_cast<std::size_t>(axis)] =
          std::floor((changed.point.position_W[axis] - diff.origin_W[axis]) / kVoxel + 0.5);
    }
    voxels[static_cast<int>(changed.change)].insert(voxel);
  }

  openvdb::initialize();
  openvdb::io::File file(folder / "diff.vdb");
  file.open(false);
  for (int n = 0; n < io::kNumPointChanges; ++n) {
    const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid(name(static_cast<PointChange>(n))));
    ASSERT_TRUE(grid) << n;
    EXPECT_EQ(grid->activeVoxelCount(), voxels[n].size()) << n;
    for (const auto& voxel : voxels[n]) {
      const openvdb::Coord ijk(static_cast<int>(voxel[0]), static_cast<int>(voxel[1]), static_cast<int>(voxel[2]));
      EXPECT_EQ(grid->tree().getValue(ijk), 1.0f);
    }
  }
}

TEST(PointsDiffRefusal, OtherVoxelsToolsAndPartsOfOtherMaps) {
  const ScratchFolder folder;
  World world{std::mt19937(3)};
  FieldSnapshot field = world.field(20, {0, 0, 0});
  io::writePointsPly(folder / "a.ply", field, metadataOf());
  io::writePointsPly(folder / "tool.ply", field, metadataOf("def"));
  io::writePointsPly(folder / "no_tool.ply", field, {});
  io::writePointsPly(folder / "tau.ply", field, metadataOf("abc", "2"));
  field.origin_W = {1, 0, 0};
  io::writePointsPly(folder / "moved.ply", field, metadataOf());
  field.voxel_size_m = 0.5;
  io::writePointsPly(folder / "voxel.ply", field, metadataOf());
  const auto idOf = [&](const std::vector<std::filesystem::path>& before,
                        const std::vector<std::filesystem::path>& after) {
    try {
      static_cast<void>(io::diffPoints(before, after));
    } catch (const UnusableInput& error) {
      return error.id();
    }
    return std::string("none");
  };
  EXPECT_EQ(idOf({folder / "a.ply"}, {folder / "voxel.ply"}), "diff.voxel");
  EXPECT_EQ(idOf({folder / "a.ply"}, {folder / "tool.ply"}), "diff.tool");
  EXPECT_EQ(idOf({folder / "no_tool.ply"}, {folder / "no_tool.ply"}), "diff.tool");
  EXPECT_EQ(idOf({folder / "a.ply", folder / "moved.ply"}, {folder / "a.ply"}), "diff.parts");
  EXPECT_EQ(idOf({}, {folder / "a.ply"}), "diff.parts");
  EXPECT_EQ(idOf({folder / "a.ply"}, {folder / "a.ply"}), "none");
  const PointsDiff other = io::diffPoints({folder / "a.ply"}, {folder / "tau.ply"});
  EXPECT_EQ(other.other_parameters, std::vector<std::string>{"truncation_distance_m: 1, 2"});
}

}  // namespace
}  // namespace accessvdb
