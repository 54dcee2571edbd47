// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Answers from files, summaries of our own and other .vdb files, and damaged ones.
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "accessvdb/error.h"
#include "io/results/field_grids.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using test::kOrigin_W;
using test::kVoxel_m;
using test::sampleField;
using test::ScratchFolder;

/// Distance and weight at (40,2,3) and around; cleared at (41,2,3).
internal::VolumeGrids storedVolume() {
  const auto grid = [](auto background, const openvdb::Coord& ijk, auto value) {
    auto made = openvdb::Grid<typename openvdb::tree::Tree4<decltype(value), 5, 4, 3>::Type>::create(background);
    made->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel_m));
    made->tree().setValueOn(ijk, value);
    return made;
  };
  return {[grid] {
            return grid(0.08f, {40, 2, 3}, 0.031f);
          },
          [grid] {
            return grid(0.0f, {40, 2, 3}, 17.0f);
          },
          [grid] {
            return grid(false, {41, 2, 3}, true);
          }};
}

void writeStored(const ScratchFolder& folder, const FieldSnapshot& field) {
  internal::writeFieldGrids(folder / "field.vdb", storedVolume(), SnapshotPoints(field), {});
  io::writePointsPly(folder / "points.ply", field, {});
}

std::string bytesOf(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(StoredField, AnswersWithThePointOfTheVoxelOrTheNearest) {
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  writeStored(folder, field);
  const io::StoredField stored = io::StoredField::open(folder.path());
  EXPECT_EQ(stored.points().points.size(), field.points.size());
  int beyond = 0, near = 0;
  for (int n = 0; n < 3000; ++n) {
    // A low-discrepancy walk through a box that is larger than the sheet.
    const Eigen::Vector3d p_W =
        kOrigin_W + Eigen::Vector3d(std::fmod(n * 0.618033, 1.0) - 0.5, std::fmod(n * 0.754877, 1.0) * 0.7 - 0.35,
                                    std::fmod(n * 0.569840, 1.0) * 0.4 - 0.2);
    const auto answer = stored.at(p_W);
    // Brute force over all points.
    const SurfacePoint* own = nullptr;
    const SurfacePoint* nearest = nullptr;
    for (const SurfacePoint& point : field.points) {
      const auto cell = [](const Eigen::Vector3d& q_W) -> Eigen::Vector3d {
        return ((q_W - kOrigin_W) / kVoxel_m).array().round();
      };
      if (cell(point.position_W) == cell(p_W)) own = &point;
      if (!nearest || (point.position_W - p_W).norm() < (nearest->position_W - p_W).norm()) nearest = &point;
    }
    const SurfacePoint* expected = own ? own : (nearest->position_W - p_W).norm() <= 3 * kVoxel_m ? nearest : nullptr;
    ASSERT_EQ(answer.point.has_value(), expected != nullptr) << n;
    if (!expected) {
      ++beyond;
      continue;
    }
    ++near;
    EXPECT_EQ(answer.point->id, expected->id);
    EXPECT_EQ(answer.point_distance_m, (expected->position_W - p_W).norm());
  }
  EXPECT_GT(beyond, 100);
  EXPECT_GT(near, 100);
}

TEST(StoredField, AnswersWithTheVolume) {
  const ScratchFolder folder;
  writeStored(folder, sampleField());
  const io::StoredField stored = io::StoredField::open(folder.path());
  const auto at = [&](double i, double j, double k) {
    return stored.at(kOrigin_W + kVoxel_m * Eigen::Vector3d(i, j, k));
  };
  EXPECT_TRUE(at(40.4, 1.6, 3).observed);
  EXPECT_EQ(at(40.4, 1.6, 3).distance_m, 0.031f);
  EXPECT_EQ(at(39.6, 2.4, 3).weight, 17.0f);
  EXPECT_FALSE(at(40, 2, 3).cleared);
  EXPECT_TRUE(at(41, 2, 3).cleared);
  EXPECT_FALSE(at(41, 2, 3).observed);
  EXPECT_EQ(at(41, 2, 3).distance_m, 0.08f);
  EXPECT_THROW(static_cast<void>(stored.at({std::nan(""), 0, 0})), InvalidArgument);
}

TEST(StoredField, RefusesWhatIsNoField) {
  const ScratchFolder folder;
  const auto refused = [&] { EXPECT_THROW(io::StoredField::open(folder.path()), InputError); };
  EXPECT_THROW(io::StoredField::open(folder / "missing"), InputError);
  refused();  // empty
  writeStored(folder, sampleField());
  const std::string vdb = bytesOf(folder / "field.vdb");
  io::StoredField::open(folder.path());
  std::ofstream(folder / "field.vdb", std::ios::binary) << "text";
  refused();
  std::ofstream(folder / "field.vdb", std::ios::binary) << vdb.substr(0, vdb.size() / 2);
  refused();
  openvdb::io::File(folder / "field.vdb").write({openvdb::FloatGrid::create()});
  refused();
  FieldSnapshot other = sampleField();
  other.origin_W.x() += kVoxel_m;
  internal::writeFieldGrids(folder / "field.vdb", storedVolume(), SnapshotPoints(other), {});
  refused();
}

TEST(VdbSummary, CountsOurGrids) {
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  internal::writeFieldGrids(folder / "field.vdb", storedVolume(), SnapshotPoints(field), {{"tool", "pruner"}});
  const io::VdbSummary summary = io::summarizeVdb(folder / "field.vdb");
  ASSERT_EQ(summary.grids.size(), 9u);
  EXPECT_EQ(summary.creator.rfind("AccessVDB", 0), 0u);
  const auto named = [&](const std::string& name) {
    return *std::find_if(summary.grids.begin(), summary.grids.end(), [&](const auto& g) { return g.name == name; });
  };
  EXPECT_EQ(named("density").active_voxels, field.points.size());
  EXPECT_EQ(named("density").type, "Tree_float_5_4_3");
  EXPECT_EQ(named("density").grid_class, "fog volume");
  EXPECT_EQ(named("density").min_ijk, (std::array<std::int32_t, 3>{-15, -10, -2}));
  EXPECT_EQ(named("density").max_ijk, (std::array<std::int32_t, 3>{14, 9, 2}));
  EXPECT_EQ(named("distance").leaves, 1u);
  EXPECT_GT(named("distance").bytes, 2000u);
  EXPECT_EQ(named("distance").voxel_size_m, Eigen::Vector3d(kVoxel_m, kVoxel_m, kVoxel_m));
  EXPECT_NE(std::find(summary.metadata.begin(), summary.metadata.end(),
                      std::make_pair(std::string("tool"), std::string("pruner"))),
            summary.metadata.end());
  io::writePointsVdb(folder / "points.vdb", field, {});
  EXPECT_EQ(io::summarizeVdb(folder / "points.vdb").grids.at(0).name, "points");
}

TEST(VdbSummary, ReadsAFileOfHoudini) {
  const char* configured = std::getenv("ACCESSVDB_TEST_DATA");
  const std::filesystem::path data =
      configured ? configured : std::filesystem::path(ACCESSVDB_SOURCE_DIR).parent_path() / "shared" / "data";
  const auto path = data / "vdb" / "smoke_houdini_half.vdb";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "missing " << path;
  const io::VdbSummary summary = io::summarizeVdb(path);
  ASSERT_EQ(summary.grids.size(), 1u);
  EXPECT_EQ(summary.grids[0].name, "density");
  EXPECT_EQ(summary.grids[0].active_voxels, 1049275u);  // from the data's README
  EXPECT_EQ(summary.creator, "Houdini/SOP_OpenVDB_Write");
  EXPECT_EQ(summary.grids[0].max_ijk, (std::array<std::int32_t, 3>{111, 223, 112}));
}

TEST(VdbSummary, DamagedFilesAreInputErrorsAndNoCrash) {
  const ScratchFolder folder;
  internal::writeFieldGrids(folder / "field.vdb", storedVolume(), SnapshotPoints(sampleField()), {});
  const std::string whole = bytesOf(folder / "field.vdb");
  const auto path = folder / "bad.vdb";
  for (int k = 0; k < 40; ++k) {
    std::ofstream(path, std::ios::binary | std::ios::trunc)
        << whole.substr(0, whole.size() * static_cast<std::size_t>(k) / 40);
    EXPECT_THROW(static_cast<void>(io::summarizeVdb(path)), InputError) << k;
  }
  std::ofstream(path, std::ios::trunc) << "solid tool\nfacet normal 0 0 1\n";
  EXPECT_THROW(static_cast<void>(io::summarizeVdb(path)), InputError);
  EXPECT_THROW(static_cast<void>(io::summarizeVdb(folder.path())), InputError);
  EXPECT_THROW(static_cast<void>(io::summarizeVdb(folder / "missing.vdb")), InputError);
  // Flipped bytes may or may not be noticed (.vdb has no checksum); they must never end this process.
  for (std::size_t n = 0; n < 40; ++n) {
    std::string bytes = whole;
    for (std::size_t i = 0; i < 4; ++i) bytes[(n * 7919 + i) % bytes.size()] ^= '\x80';
    std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
    try {
      static_cast<void>(io::summarizeVdb(path));
    } catch (const InputError& error) {
      EXPECT_LT(std::string(error.what()).size(), 600u);
    }
  }
}

}  // namespace
}  // namespace accessvdb
