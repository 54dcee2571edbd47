// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points that are put together when they are read, against copies of all of them.
#include "accessvdb/surface_points.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "accessvdb/field_export.h"
#include "accessvdb/render.h"
#include "support/query_world.h"
#include "support/scratch_folder.h"

namespace accessvdb {
namespace {

void expectEqual(const SurfacePoint& a, const SurfacePoint& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.position_W, b.position_W) << a.id;
  EXPECT_EQ(a.normal_W, b.normal_W) << a.id;
  EXPECT_EQ(a.direction_W, b.direction_W) << a.id;
  EXPECT_EQ(a.yaw_rad, b.yaw_rad) << a.id;
  EXPECT_EQ(a.direction, b.direction) << a.id;
  EXPECT_EQ(a.score, b.score) << a.id;
  EXPECT_EQ(a.weight, b.weight) << a.id;
  EXPECT_EQ(a.confidence, b.confidence) << a.id;
  EXPECT_EQ(a.stability, b.stability) << a.id;
  EXPECT_EQ(a.label, b.label) << a.id;
  EXPECT_EQ(a.reason, b.reason) << a.id;
  EXPECT_EQ(a.confident, b.confident) << a.id;
}

void expectEqual(const SurfacePoints& points, const FieldSnapshot& snapshot) {
  ASSERT_EQ(points.size(), snapshot.points.size());
  EXPECT_EQ(points.origin_W(), snapshot.origin_W);
  EXPECT_EQ(points.voxel_size_m(), snapshot.voxel_size_m);
  for (std::size_t n = 0; n < points.size(); ++n) {
    expectEqual(points.at(n), snapshot.points[n]);
    EXPECT_EQ(points.position_W(n), snapshot.points[n].position_W);
  }
}

std::string bytesOf(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  bytes << file.rdbuf();
  return bytes.str();
}

/// pointAt() builds one point by itself: it is the same as the list's.
TEST(SurfacePoints, EachIsTheOneThatPointAtAnswers) {
  test::QueryWorld world;
  world.integrate(5);  // points after the last update
  const auto points = world.field.points();
  std::size_t accessible = 0, newer = 0;
  for (std::size_t n = 0; n < points->size(); n += 7) {
    const SurfacePoint point = points->at(n);
    const auto answer = world.field.pointAt(point.position_W);
    ASSERT_TRUE(answer.has_value()) << n;
    expectEqual(point, *answer);
    accessible += point.label == PointLabel::Accessible;
    newer += point.normal_W.isZero();
  }
  EXPECT_GT(accessible, 100u);
  EXPECT_GT(newer, 10u);
}

TEST(SurfacePoints, AreThoseOfTheSnapshots) {
  test::QueryWorld world;
  world.integrate(5);
  expectEqual(*world.field.points(), world.field.snapshot());
  expectEqual(*world.field.unscoredPoints(), world.field.unscoredSnapshot());
  EXPECT_EQ(world.field.unscoredSnapshot().count(PointLabel::Unscored), world.field.points()->size());
  const FieldSnapshot snapshot = world.field.snapshot();
  expectEqual(SnapshotPoints(snapshot), snapshot);
}

TEST(SurfacePoints, FilesAndPicturesAreThoseOfTheSnapshot) {
  const test::ScratchFolder folder;
  test::QueryWorld world;
  const auto points = world.field.points();
  const FieldSnapshot snapshot = world.field.snapshot();
  io::WriteOptions options;
  options.surface = true;
  const auto write = [&](const std::string& name, const auto& from) {
    io::writeFieldVdb(folder / (name + "_field.vdb"), world.field.volume(), from, {}, options);
    io::writePointsVdb(folder / (name + "_points.vdb"), from, {}, options);
    io::writePointsPly(folder / (name + ".ply"), from, {});
    io::renderField(folder / (name + ".png"), from, {.width_px = 320, .height_px = 200});
  };
  write("a", *points);
  write("b", snapshot);
  for (const std::string end : {"_field.vdb", "_points.vdb", ".ply", ".png"}) {
    const std::string bytes = bytesOf(folder / ("a" + end));
    EXPECT_GT(bytes.size(), 1000u) << end;
    EXPECT_TRUE(bytes == bytesOf(folder / ("b" + end))) << end;
  }
}

}  // namespace
}  // namespace accessvdb
