// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// field.vdb and field_points.vdb, read back with OpenVDB only.
#include <gtest/gtest.h>
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>
#include <openvdb/points/PointGroup.h>

#include <fstream>
#include <map>
#include <set>

#include "accessvdb/error.h"
#include "accessvdb/orientations.h"
#include "accessvdb/tsdf_volume.h"
#include "io/results/field_grids.h"
#include "io/results/surface_voxels.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using test::kOrigin_W;
using test::kVoxel_m;
using test::sampleField;
using test::ScratchFolder;

const std::vector<std::string> kNames = {"density",        "accessible", "blocked", "confidence", "score",
                                         "best_direction", "distance",   "weight",  "cleared"};

/// Stand-in for the volume: three voxels, and a count of grids alive at once.
internal::VolumeGrids sampleVolume() {
  internal::VolumeGrids volume;
  volume.distance = [] {
    auto grid = openvdb::FloatGrid::create(0.08f);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel_m));
    grid->setGridClass(openvdb::GRID_LEVEL_SET);  // wrong on purpose: the writer must not let this through
    grid->tree().setValueOn({1, 2, 3}, 0.031f);
    grid->tree().setValueOn({-40, 2, 3}, 0.0f);
    return grid;
  };
  volume.weight = [] {
    auto grid = openvdb::FloatGrid::create(0.0f);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel_m));
    grid->tree().setValueOn({1, 2, 3}, 17.0f);
    grid->tree().setValueOn({-40, 2, 3}, 1.0f);
    return grid;
  };
  volume.cleared = [] {
    auto grid = openvdb::BoolGrid::create(false);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel_m));
    grid->tree().setValueOn({5, 5, 5}, true);
    return grid;
  };
  return volume;
}

std::filesystem::path writeSample(const ScratchFolder& folder, const FieldSnapshot& field) {
  internal::writeFieldGrids(folder / "field.vdb", sampleVolume(), SnapshotPoints(field),
                            {{"tool.sha256", "abc"}, {"voxel_size_m", "0.02"}});
  return folder / "field.vdb";
}

template <typename GridT>
typename GridT::Ptr readGrid(const std::filesystem::path& path, const std::string& name) {
  openvdb::io::File file(path.string());
  file.open(false);
  auto grid = openvdb::gridPtrCast<GridT>(file.readGrid(name));
  EXPECT_TRUE(grid) << name;
  return grid;
}

/// The voxel of a position from OpenVDB's own transform: an oracle independent of voxelAt().
openvdb::Coord voxelOf(const openvdb::GridBase& grid, const SurfacePoint& point) {
  const Eigen::Vector3d p_L = point.position_W - kOrigin_W;
  return grid.transform().worldToIndexCellCentered(openvdb::Vec3d(p_L.x(), p_L.y(), p_L.z()));
}

class FieldVdb : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { openvdb::initialize(); }
};

/// The roll as held, whatever yaw and pitch are, also straight up and down.
TEST_F(FieldVdb, HasTheRollWhereTheToolRolls) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  std::vector<float> rolls_deg;
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    const double roll_deg = static_cast<double>(i * 30 % 360), pitch_deg = i % 7 == 0   ? 90
                                                                           : i % 7 == 1 ? -90
                                                                                        : 11.0 * (i % 7) - 33;
    const ToolOrientation held =
        orientationOf(std::abs(pitch_deg) == 90 ? 0 : 17.0 * static_cast<double>(i), pitch_deg, roll_deg);
    Eigen::Quaterniond q(held.R_WT);
    if (q.w() < 0) q.coeffs() = -q.coeffs();
    field.points[i].orientation_WT = q.cast<float>();
    rolls_deg.push_back(static_cast<float>(roll_deg));
  }
  const io::WriteOptions options;
  internal::writeFieldGrids(folder / "yaw.vdb", sampleVolume(), SnapshotPoints(field), {}, options);
  internal::writeFieldGrids(folder / "field.vdb", sampleVolume(), SnapshotPoints(field), {{"rolls", "12"}}, options);
  EXPECT_THROW(static_cast<void>(readGrid<openvdb::FloatGrid>(folder / "yaw.vdb", "best_roll")), openvdb::KeyError);
  const auto grid = readGrid<openvdb::FloatGrid>(folder / "field.vdb", "best_roll");
  std::size_t compared = 0;
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    const openvdb::Coord ijk = voxelOf(*grid, field.points[i]);
    ASSERT_EQ(grid->tree().isValueOn(ijk), !field.points[i].direction_W.isZero());
    if (!grid->tree().isValueOn(ijk)) continue;
    const float found = grid->tree().getValue(ijk), difference = std::abs(found - rolls_deg[i]);
    EXPECT_GE(found, 0);
    EXPECT_LT(found, 360);
    EXPECT_LT(std::min(difference, 360 - difference), 1e-3f) << i;  // a quaternion in float32
    ++compared;
  }
  EXPECT_GT(compared, 100u);
}

TEST_F(FieldVdb, HoldsTheNamedGridsInOrderAndOfPlainTypes) {
  const ScratchFolder folder;
  const auto path = writeSample(folder, sampleField());
  std::ifstream bytes(path, std::ios::binary);
  openvdb::io::Stream file(bytes, false);  // io::File would sort by name
  const auto grids = file.getGrids();
  ASSERT_EQ(grids->size(), kNames.size());
  const std::set<std::string> fogs = {"density", "accessible", "blocked"};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const openvdb::GridBase& grid = *(*grids)[i];
    EXPECT_EQ(grid.getName(), kNames[i]);
    const std::string type = kNames[i] == "best_direction" ? openvdb::Vec3SGrid::gridType()
                             : kNames[i] == "cleared"      ? openvdb::BoolGrid::gridType()
                                                           : openvdb::FloatGrid::gridType();
    EXPECT_EQ(grid.type(), type) << kNames[i];
    EXPECT_EQ(grid.getGridClass(), fogs.contains(kNames[i]) ? openvdb::GRID_FOG_VOLUME : openvdb::GRID_UNKNOWN);
    EXPECT_FALSE(grid.saveFloatAsHalf());
    EXPECT_EQ(grid.transform(), *openvdb::math::Transform::createLinearTransform(kVoxel_m)) << kNames[i];
    EXPECT_EQ(grid.metaValue<double>("origin_W_y"), kOrigin_W.y());
    EXPECT_EQ(grid.getCreator().rfind("AccessVDB ", 0), 0u);
  }
  EXPECT_EQ(file.getMetadata()->metaValue<std::string>("tool.sha256"), "abc");
  EXPECT_EQ(file.getMetadata()->metaValue<double>("voxel_size_m"), kVoxel_m);
  EXPECT_EQ(file.getMetadata()->metaValue<double>("origin_W_x"), kOrigin_W.x());
  EXPECT_TRUE((*file.getMetadata())["accessvdb_version"]);
}

TEST_F(FieldVdb, OpensByNameByMetadataAndAsAStream) {
  const ScratchFolder folder;
  const auto path = writeSample(folder, sampleField());
  for (const bool delayed : {false, true}) {
    openvdb::io::File file(path.string());
    file.open(delayed);
    EXPECT_EQ(file.readAllGridMetadata()->size(), kNames.size());
    // In a different order: offsets must be right, not only the sequence.
    for (auto name = kNames.rbegin(); name != kNames.rend(); ++name) {
      EXPECT_TRUE(file.hasGrid(*name));
      EXPECT_GT(file.readGrid(*name)->activeVoxelCount(), 0u) << *name;
    }
  }
  std::ifstream stream(path, std::ios::binary);
  const auto grids = openvdb::io::Stream(stream, false).getGrids();
  ASSERT_EQ(grids->size(), kNames.size());
  EXPECT_EQ((*grids)[8]->activeVoxelCount(), 1u);
}

TEST_F(FieldVdb, SurfaceVoxelsLieWhereThePointsAre) {
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  const auto path = writeSample(folder, field);
  const auto density = readGrid<openvdb::FloatGrid>(path, "density");
  const auto accessible = readGrid<openvdb::FloatGrid>(path, "accessible");
  const auto blocked = readGrid<openvdb::FloatGrid>(path, "blocked");
  const auto confidence = readGrid<openvdb::FloatGrid>(path, "confidence");
  const auto score = readGrid<openvdb::FloatGrid>(path, "score");
  const auto direction = readGrid<openvdb::Vec3SGrid>(path, "best_direction");
  for (const SurfacePoint& point : field.points) {
    const openvdb::Coord ijk = voxelOf(*density, point);
    // The sample of the voxel is within half a voxel of the point on every axis (1e-9: UTM doubles end at 1e-9 m).
    const openvdb::Vec3d centre_L = density->indexToWorld(ijk);
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_LE(std::abs(centre_L[axis] + kOrigin_W[axis] - point.position_W[axis]), kVoxel_m / 2 + 1e-9);
    }
    EXPECT_EQ(density->tree().getValue(ijk), 1.0f);
    EXPECT_TRUE(density->tree().isValueOn(ijk));
    EXPECT_EQ(accessible->tree().isValueOn(ijk), point.label == PointLabel::Accessible);
    EXPECT_EQ(blocked->tree().isValueOn(ijk), point.label == PointLabel::Blocked);
    EXPECT_EQ(accessible->tree().getValue(ijk), point.label == PointLabel::Accessible ? 1.0f : 0.0f);
    EXPECT_EQ(confidence->tree().getValue(ijk), point.confidence);
    EXPECT_EQ(score->tree().getValue(ijk), point.score == kNoScore ? -1.0f : static_cast<float>(point.score));
    const openvdb::Vec3s best = direction->tree().getValue(ijk);
    for (int axis = 0; axis < 3; ++axis) EXPECT_EQ(best[axis], point.direction_W[axis]);
  }
  EXPECT_EQ(density->activeVoxelCount(), field.points.size());
  EXPECT_EQ(accessible->activeVoxelCount(), field.count(PointLabel::Accessible));
  EXPECT_EQ(blocked->activeVoxelCount(), field.count(PointLabel::Blocked));
  EXPECT_EQ(confidence->activeVoxelCount(), field.points.size());
  EXPECT_EQ(direction->getVectorType(), openvdb::VEC_CONTRAVARIANT_RELATIVE);
}

TEST_F(FieldVdb, VolumeGridsPassThrough) {
  const ScratchFolder folder;
  const auto path = writeSample(folder, sampleField());
  const auto distance = readGrid<openvdb::FloatGrid>(path, "distance");
  EXPECT_EQ(distance->background(), 0.08f);
  EXPECT_EQ(distance->tree().getValue({1, 2, 3}), 0.031f);
  EXPECT_EQ(distance->activeVoxelCount(), 2u);
  EXPECT_EQ(readGrid<openvdb::FloatGrid>(path, "weight")->tree().getValue({1, 2, 3}), 17.0f);
  EXPECT_TRUE(readGrid<openvdb::BoolGrid>(path, "cleared")->tree().getValue({5, 5, 5}));
}

TEST_F(FieldVdb, TakesTheGridsOfAVolume) {
  const ScratchFolder folder;
  const TsdfVolume volume({.voxel_size_m = kVoxel_m, .truncation_distance_m = 0.08});
  io::writeFieldVdb(folder / "field.vdb", volume, sampleField(), {});
  const auto distance = readGrid<openvdb::FloatGrid>(folder / "field.vdb", "distance");
  EXPECT_EQ(distance->background(), 0.08f);
  EXPECT_EQ(distance->activeVoxelCount(), 0u);
  EXPECT_EQ(readGrid<openvdb::BoolGrid>(folder / "field.vdb", "cleared")->activeVoxelCount(), 0u);
}

TEST_F(FieldVdb, GridsAreMadeOneAtATime) {
  const ScratchFolder folder;
  std::weak_ptr<openvdb::FloatGrid> distance;
  internal::VolumeGrids volume = sampleVolume();
  volume.distance = [&, make = volume.distance] {
    auto grid = make();
    distance = grid;
    return grid;
  };
  volume.weight = [&, make = volume.weight] {
    EXPECT_TRUE(distance.expired()) << "distance still in memory while weight is made";
    return make();
  };
  internal::writeFieldGrids(folder / "field.vdb", volume, SnapshotPoints(sampleField()), {});
}

TEST_F(FieldVdb, EmptyFieldIsAValidFile) {
  const ScratchFolder folder;
  FieldSnapshot field;
  field.voxel_size_m = kVoxel_m;
  const auto path = writeSample(folder, field);
  EXPECT_EQ(readGrid<openvdb::FloatGrid>(path, "density")->activeVoxelCount(), 0u);
  io::writePointsVdb(folder / "points.vdb", field, {});
  const auto points = readGrid<openvdb::points::PointDataGrid>(folder / "points.vdb", "points");
  EXPECT_EQ(openvdb::points::pointCount(points->tree()), 0u);
}

TEST_F(FieldVdb, PointWithoutAVoxelIsRefused) {
  const ScratchFolder folder;
  for (const double bad : {std::nan(""), HUGE_VAL, 1e12}) {
    FieldSnapshot field = sampleField();
    field.points[7].position_W.y() = bad;
    EXPECT_THROW(writeSample(folder, field), InvalidArgument);
    EXPECT_THROW(io::writePointsVdb(folder / "points.vdb", field, {}), InvalidArgument);
  }
  EXPECT_TRUE(folder.names().empty());
}

TEST_F(FieldVdb, FullDiskIsAnError) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  EXPECT_THROW(internal::writeFieldGrids("/dev/full", sampleVolume(), SnapshotPoints(sampleField()), {}), OutputError);
  EXPECT_THROW(io::writePointsVdb("/dev/full", sampleField(), {}), OutputError);
  EXPECT_THROW(io::writePointsPly("/dev/full", sampleField(), {}), OutputError);
}

TEST_F(FieldVdb, PointGridCarriesEveryPointWithItsAttributes) {
  namespace pts = openvdb::points;
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  io::writePointsVdb(folder / "points.vdb", field, {});
  const auto grid = readGrid<pts::PointDataGrid>(folder / "points.vdb", "points");
  ASSERT_EQ(pts::pointCount(grid->tree()), field.points.size());
  std::set<int> seen;
  for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf) {
    const auto vec3 = [&](const char* name) {
      return pts::AttributeHandle<openvdb::Vec3f>::create(leaf->constAttributeArray(name));
    };
    const auto ints = [&](const char* name) {
      return pts::AttributeHandle<int>::create(leaf->constAttributeArray(name));
    };
    const auto floats = [&](const char* name) {
      return pts::AttributeHandle<float>::create(leaf->constAttributeArray(name));
    };
    const auto position = vec3("P"), normal = vec3("N"), colour = vec3("Cd"), direction = vec3("direction");
    const auto id = ints("id"), label = ints("label"), reason = ints("reason"), score = ints("score");
    const auto confidence = floats("confidence"), pscale = floats("pscale");
    const pts::GroupHandle accessible = leaf->groupHandle("accessible"), blocked = leaf->groupHandle("blocked"),
                           unscored = leaf->groupHandle("unscored");
    for (auto index = leaf->beginIndexOn(); index; ++index) {
      const SurfacePoint& point = field.points.at(static_cast<std::size_t>(id->get(*index)));
      EXPECT_TRUE(seen.insert(id->get(*index)).second);
      const openvdb::Vec3d p_L = grid->indexToWorld(openvdb::Vec3d(position->get(*index)) + index.getCoord().asVec3d());
      for (int axis = 0; axis < 3; ++axis) {
        // Offsets in a voxel are floats: half an ulp of 0.5 voxel, and UTM doubles end at 1e-9 m.
        EXPECT_NEAR(p_L[axis], point.position_W[axis] - kOrigin_W[axis], kVoxel_m * 6e-8 + 1e-9);
        EXPECT_EQ(normal->get(*index)[axis], point.normal_W[axis]);
        EXPECT_EQ(direction->get(*index)[axis], point.direction_W[axis]);
      }
      EXPECT_EQ(label->get(*index), static_cast<int>(point.label));
      EXPECT_EQ(reason->get(*index), static_cast<int>(point.reason));
      EXPECT_EQ(score->get(*index), point.score == kNoScore ? -1 : point.score);
      EXPECT_EQ(confidence->get(*index), point.confidence);
      EXPECT_EQ(pscale->get(*index), static_cast<float>(kVoxel_m / 2));
      EXPECT_EQ(accessible.get(*index), point.label == PointLabel::Accessible);
      EXPECT_EQ(blocked.get(*index), point.label == PointLabel::Blocked);
      EXPECT_EQ(unscored.get(*index), point.label == PointLabel::Unscored);
      if (point.label == PointLabel::Accessible) {
        EXPECT_GT(colour->get(*index)[1], 1.5f * colour->get(*index)[0]);
      }
      if (point.label == PointLabel::Blocked) {
        EXPECT_GT(colour->get(*index)[0], 1.5f * colour->get(*index)[1]);
      }
    }
  }
  EXPECT_EQ(seen.size(), field.points.size());
}

TEST(VoxelAt, RoundsToTheNearestCentre) {
  EXPECT_EQ(internal::voxelAt({0.0, 0.0099, -0.0099}, 0.02), openvdb::Coord(0, 0, 0));
  EXPECT_EQ(internal::voxelAt({0.0101, -0.0101, 0.0299}, 0.02), openvdb::Coord(1, -1, 1));
  EXPECT_EQ(internal::voxelAt({0.5, -0.5, -1.5}, 1.0), openvdb::Coord(1, 0, -1));
}

/// Equal content gives equal files, the unique identifier included, and other content another identifier.
TEST_F(FieldVdb, EqualContentGivesEqualFiles) {
  const ScratchFolder folder;
  const auto tagOf = [](const std::filesystem::path& path) {
    openvdb::io::File file(path.string());
    file.open(false);
    return file.getUniqueTag();
  };
  const auto bytesOf = [](const std::filesystem::path& path) {
    std::ifstream stream(path, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  };
  const auto write = [&](const std::string& name, const FieldSnapshot& field, const std::string& note) {
    internal::writeFieldGrids(folder / name, sampleVolume(), SnapshotPoints(field), {{"note", note}});
    return folder / name;
  };
  const FieldSnapshot field = sampleField();
  const auto once = write("once.vdb", field, "a"), twice = write("twice.vdb", field, "a");
  EXPECT_EQ(bytesOf(once), bytesOf(twice));
  FieldSnapshot other_field = field;
  other_field.points.front().confidence += 0.125f;
  const std::set<std::string> tags = {tagOf(once), tagOf(write("metadata.vdb", field, "b")),
                                      tagOf(write("value.vdb", other_field, "a"))};
  EXPECT_EQ(tags.size(), 3u);
  for (const std::string& tag : tags) {
    ASSERT_EQ(tag.size(), 36u);
    EXPECT_EQ(tag[14], '8') << tag << ": RFC 9562, version 8";
    EXPECT_NE(std::string("89ab").find(tag[19]), std::string::npos) << tag;
  }
}

}  // namespace
}  // namespace accessvdb
