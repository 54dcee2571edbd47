// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Returns on faces, edges and corners of voxels: the map, the files, the queries and the tiles must agree about their
/// voxels. The oracle counts in whole millimetres.
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/field_export.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/points_diff.h"
#include "accessvdb/region.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tsdf_volume.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

using Millimetres = std::array<std::int64_t, 3>;

constexpr std::int64_t kVoxel_mm = 50;

struct Place {
  const char* name;
  Millimetres origin_mm;  ///< multiples of the voxel
};

/// floor(x / v + 1/2): faces belong to the voxel above.
std::int64_t voxelOf(std::int64_t x_mm) {
  const std::int64_t twice = 2 * x_mm + kVoxel_mm, edge = 2 * kVoxel_mm;
  return twice / edge - (twice % edge < 0 ? 1 : 0);
}
Millimetres voxelOf(const Millimetres& p_mm) { return {voxelOf(p_mm[0]), voxelOf(p_mm[1]), voxelOf(p_mm[2])}; }

class OneVoxelOnePoint : public ::testing::TestWithParam<Place> {
 protected:
  OneVoxelOnePoint() : field_(ToolGeometry::builtin("builtin:pencil"), params()) {
    openvdb::initialize();
    std::mt19937_64 random(7);
    const auto step = [&random](int count) {
      return static_cast<std::int64_t>(random() % static_cast<unsigned>(count));
    };
    for (int n = 0; n < 1500; ++n) {
      // Up to 40 m away on both sides, many on a face, an edge or a corner, or a millimetre beside it.
      Millimetres p_mm;
      for (auto& x_mm : p_mm) x_mm = step(1600) * kVoxel_mm - 800 * kVoxel_mm + (n % 4 == 0 ? step(50) : 25);
      if (n % 5 == 0) p_mm[static_cast<std::size_t>(step(3))] -= 1;
      if (n % 7 == 0) p_mm[static_cast<std::size_t>(step(3))] += step(50);
      returns_[voxelOf(p_mm)].push_back(inWorld(p_mm));
    }
    std::vector<Eigen::Vector3d> points_W;
    for (const auto& [voxel, of_voxel] : returns_) points_W.insert(points_W.end(), of_voxel.begin(), of_voxel.end());
    const std::vector<Eigen::Vector3d> sensor_W = {inWorld({7, 3, 1})};
    field_.integrateRays(points_W, sensor_W);
    field_.update();
  }

  static FieldParams params() {
    FieldParams params;
    params.tsdf.voxel_size_m = 0.05;
    params.tsdf.range_noise_m = 0.01;
    params.backend = BackendKind::Cpu;
    params.threads = 2;
    params.mirror_distance = true;
    params.origin_W = {{inWorld({0, 0, 0}).x(), inWorld({0, 0, 0}).y(), inWorld({0, 0, 0}).z()}};
    return params;
  }
  static Eigen::Vector3d inWorld(const Millimetres& p_mm) {
    Eigen::Vector3d p_W;
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      p_W[axis] = static_cast<double>(GetParam().origin_mm[a] + p_mm[a]) / 1000;
    }
    return p_W;
  }

  AccessibilityField field_;
  std::map<Millimetres, std::vector<Eigen::Vector3d>> returns_;
};

TEST_P(OneVoxelOnePoint, InTheMapAndForQueries) {
  EXPECT_EQ(field_.points()->size(), returns_.size());
  const BatchQuery query = field_.batchQuery();
  const DeviceView view = field_.hostView();
  for (const auto& [voxel, of_voxel] : returns_) {
    std::optional<std::uint32_t> id;
    for (const Eigen::Vector3d& p_W : of_voxel) {
      const auto point = field_.pointAt(p_W);
      ASSERT_TRUE(point.has_value());
      if (!id) id = point->id;
      ASSERT_EQ(point->id, *id);
      // The position as stored and as given, by every way to ask.
      for (const Eigen::Vector3d& at_W : {p_W, point->position_W}) {
        ASSERT_EQ(field_.pointAt(at_W)->id, *id);
        PointAnswer answer;
        query.at({&at_W, 1}, {&answer, 1});
        ASSERT_EQ(answer.point_id, *id);
        const VoxelState state = field_.volume().at(
            openvdb::Coord(static_cast<int>(voxel[0]), static_cast<int>(voxel[1]), static_cast<int>(voxel[2])));
        ASSERT_EQ(answer.weight, state.weight);
        ASSERT_EQ(answer.distance_m, state.distance_m);
        ASSERT_EQ(view.distanceAt(at_W.data()), state.distance_m);
      }
      ASSERT_LT((point->position_W - of_voxel.front()).cwiseAbs().maxCoeff(), 0.05);
    }
  }
}

TEST_P(OneVoxelOnePoint, InTheFiles) {
  const ScratchFolder folder;
  writeField(field_, folder.path(), {});
  const FieldSnapshot stored = io::readPointsPly(folder / "points.ply");
  ASSERT_EQ(stored.points.size(), returns_.size());
  openvdb::io::File file((folder / "field.vdb").string());
  file.open(false);
  const auto density = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid("density"));
  EXPECT_EQ(density->activeVoxelCount(), returns_.size());
  for (const auto& [voxel, of_voxel] : returns_) {
    ASSERT_TRUE(density->tree().isValueOn(
        openvdb::Coord(static_cast<int>(voxel[0]), static_cast<int>(voxel[1]), static_cast<int>(voxel[2]))));
  }
  // Anybody's way to compute a voxel from a position that we wrote.
  for (const SurfacePoint& point : stored.points) {
    const Eigen::Vector3d p_L = point.position_W - stored.origin_W;
    const Eigen::Vector3d divided = (p_L / 0.05 + Eigen::Vector3d::Constant(0.5)).array().floor();
    const openvdb::Coord own = density->transform().worldToIndexCellCentered({p_L.x(), p_L.y(), p_L.z()});
    ASSERT_EQ(own, openvdb::Coord(int(divided.x()), int(divided.y()), int(divided.z())));
    ASSERT_TRUE(density->tree().isValueOn(own));
  }
  openvdb::io::File points_file((folder / "field_points.vdb").string());
  points_file.open(false);
  const auto points = openvdb::gridPtrCast<openvdb::points::PointDataGrid>(points_file.readGrid("points"));
  EXPECT_EQ(openvdb::points::pointCount(points->tree()), returns_.size());
  EXPECT_EQ(points->activeVoxelCount(), returns_.size());

  const io::StoredField map = io::StoredField::open(folder.path());
  for (const auto& [voxel, of_voxel] : returns_) {
    for (const Eigen::Vector3d& p_W : of_voxel) {
      const auto answer = map.at(p_W);
      ASSERT_TRUE(answer.point.has_value());
      ASSERT_EQ(answer.point->id, field_.pointAt(p_W)->id);
    }
  }
  const io::PointsDiff diff = io::diffPoints({folder / "points.ply"}, {folder / "points.ply"});
  EXPECT_EQ(diff.same, returns_.size());
}

/// A box whose faces pass through centres of voxels takes those voxels out.
TEST_P(OneVoxelOnePoint, BoxesThatAreRemovedIncludeTheirFaces) {
  std::map<Millimetres, bool> observed;  // by the centres
  const auto distances = field_.volume().distance();
  for (auto voxel = distances->cbeginValueOn(); voxel; ++voxel) {
    const openvdb::Coord ijk = voxel.getCoord();
    observed[{ijk.x() * kVoxel_mm, ijk.y() * kVoxel_mm, ijk.z() * kVoxel_mm}] = true;
  }
  std::size_t removed = 0;
  for (std::size_t n = 0; n < observed.size() && removed < 40; n += observed.size() / 40) {
    // From one observed voxel to a few further on.
    const Millimetres low = std::next(observed.begin(), static_cast<std::ptrdiff_t>(n))->first;
    const auto reach = static_cast<std::int64_t>(removed % 4) * kVoxel_mm;
    const Millimetres high = {low[0] + reach, low[1] + 2 * reach, low[2] + reach};
    std::size_t inside = 0;
    for (auto& [centre_mm, is_there] : observed) {
      bool in = is_there;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        in = in && centre_mm[axis] >= low[axis] && centre_mm[axis] <= high[axis];
      }
      inside += in ? 1 : 0;
      is_there = is_there && !in;
    }
    ASSERT_EQ(field_.removeRegion(Region::box(inWorld(low), inWorld(high))).voxels, inside) << n;
    ++removed;
  }
}

INSTANTIATE_TEST_SUITE_P(Places, OneVoxelOnePoint,
                         ::testing::Values(Place{"here", {0, 0, 0}},
                                           Place{"survey", {471'200'000, 3'810'250'000, 2'300'000}},
                                           Place{"south_west", {-471'200'000, -3'810'250'000, -50}}),
                         [](const auto& place) { return std::string(place.param.name); });

}  // namespace
}  // namespace accessvdb::test
