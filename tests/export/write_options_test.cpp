// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Half floats, compression, up axis, reading back bit for bit, and counts of field_points.vdb against points.ply.
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>
#include <openvdb/points/PointGroup.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <functional>
#include <map>

#include "accessvdb/error.h"
#include "accessvdb/field_export.h"
#include "export/bit_equal.h"
#include "io/results/field_grids.h"
#include "io/results/surface_voxels.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using io::Compression;
using io::UpAxis;
using io::WriteOptions;
using test::kOrigin_W;
using test::kVoxel_m;
using test::named;
using test::readVdb;
using test::sampleField;
using test::ScratchFolder;

/// A volume of a few thousand voxels with values that no half represents exactly.
internal::VolumeGrids sampleVolume() {
  const auto fill = [](auto background, const auto& value) {
    using Value = decltype(background);
    auto grid = openvdb::Grid<typename openvdb::tree::Tree4<Value, 5, 4, 3>::Type>::create(background);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel_m));
    for (int i = -20; i < 20; ++i) {
      for (int j = -20; j < 20; ++j) {
        for (int k = -3; k < 3; ++k) grid->tree().setValueOn({i, j, k}, static_cast<Value>(value(i, j, k)));
      }
    }
    grid->tree().addTile(2, {4096, 0, 0}, background, false);
    return grid;
  };
  internal::VolumeGrids volume;
  volume.distance = [fill] {
    return fill(0.1f, [](int i, int j, int k) { return 0.1 * std::abs(std::sin(i * 1.7 + j * 0.3 + k)); });
  };
  volume.weight = [fill] {
    return fill(0.0f, [](int i, int j, int k) { return 1 + (i * 97 + j * 13 + k + 4000) % 4095; });
  };
  volume.cleared = [fill] { return fill(false, [](int, int, int) { return true; }); };
  return volume;
}

std::filesystem::path write(const ScratchFolder& folder, const std::string& name, const WriteOptions& options,
                            const FieldSnapshot& field = sampleField()) {
  internal::writeFieldGrids(folder / name, sampleVolume(), SnapshotPoints(field), {{"tool_sha256", "abc"}}, options);
  return folder / name;
}

openvdb::FloatGrid::Ptr floats(const openvdb::GridPtrVec& grids, const std::string& name) {
  return openvdb::gridPtrCast<openvdb::FloatGrid>(named(grids, name));
}

const std::vector<std::string> kNames = {"density",        "accessible", "blocked", "confidence", "score",
                                         "best_direction", "distance",   "weight",  "cleared"};

TEST(WriteOptions, EveryCompressionReadsBackBitForBit) {
  const ScratchFolder folder;
  std::map<Compression, std::uint64_t> bytes;
  const FieldSnapshot field = sampleField();
  for (const Compression compression : {Compression::Auto, Compression::Blosc, Compression::Zip, Compression::None}) {
    WriteOptions options;
    options.compression = compression;
    options.surface = true;
    const auto path = write(folder, "field.vdb", options);
    bytes[compression] = std::filesystem::file_size(path);
    // The input, made again here or taken from the volume.
    const auto grids = readVdb(path);
    ASSERT_EQ(grids->size(), kNames.size() + 1);
    const internal::VolumeGrids volume = sampleVolume();
    test::expectBitEqual(*named(*grids, "distance"), *volume.distance());
    test::expectBitEqual(*named(*grids, "weight"), *volume.weight());
    test::expectBitEqual(*named(*grids, "cleared"), *volume.cleared());
    const SnapshotPoints points(field);
    const internal::SurfaceVoxels surface(points);
    const auto all = [](const SurfacePoint&) { return true; };
    const auto confidence = [](const SurfacePoint& point, std::uint32_t) { return point.confidence; };
    test::expectBitEqual(*named(*grids, "confidence"),
                         *surface.grid<openvdb::FloatGrid>("confidence", 0.0f, all, confidence));
    openvdb::io::File file(path.string());
    file.open(false);
    for (const auto& grid : *grids) {
      EXPECT_FALSE(grid->saveFloatAsHalf()) << grid->getName();
      // OpenVDB never zips fogs and level sets. The file's notes on a grid are removed when the grid is read.
      const auto grid_class = grid->getGridClass();
      const bool bare = grid_class == openvdb::GRID_FOG_VOLUME || grid_class == openvdb::GRID_LEVEL_SET;
      const std::uint32_t flags = internal::compressionFlags(compression) & (bare ? ~openvdb::io::COMPRESS_ZIP : ~0u);
      EXPECT_EQ(file.readGridMetadata(grid->getName())->metaValue<std::string>("file_compression"),
                openvdb::io::compressionToString(flags))
          << grid->getName();
    }
  }
  EXPECT_LT(bytes[Compression::Zip], bytes[Compression::None]);
  EXPECT_LT(bytes[Compression::Blosc], bytes[Compression::None]);
}

TEST(WriteOptions, ACodecThatIsMissingIsAClearError) {
  using internal::compressionFlags;
  using openvdb::io::COMPRESS_ACTIVE_MASK, openvdb::io::COMPRESS_BLOSC, openvdb::io::COMPRESS_ZIP;
  for (const auto& [compression, word] : {std::pair{Compression::Blosc, "blosc"}, std::pair{Compression::Zip, "zip"}}) {
    try {
      static_cast<void>(compressionFlags(compression, false, false));
      ADD_FAILURE() << "no error for " << word;
    } catch (const InvalidArgument& error) {
      EXPECT_EQ(error.id(), "write.compression");
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  }
  const std::uint32_t mask = COMPRESS_ACTIVE_MASK;
  EXPECT_EQ(compressionFlags(Compression::Auto, true, true), mask | COMPRESS_BLOSC);
  EXPECT_EQ(compressionFlags(Compression::Auto, false, true), mask | COMPRESS_ZIP);
  EXPECT_EQ(compressionFlags(Compression::Auto, false, false), mask);
  EXPECT_EQ(compressionFlags(Compression::None, true, true), mask);
}

TEST(WriteOptions, HalfFloatsAreTheNearestHalvesAndCountsStayExact) {
  const ScratchFolder folder;
  const auto full = readVdb(write(folder, "full.vdb", {}));
  WriteOptions options;
  options.half_float = true;
  options.surface = true;
  const auto half = readVdb(write(folder, "half.vdb", options));
  for (const char* name : {"score", "weight", "cleared"}) {
    EXPECT_FALSE(named(*half, name)->saveFloatAsHalf()) << name;
    test::expectBitEqual(*named(*half, name), *named(*full, name));
  }
  for (const char* name : {"density", "accessible", "blocked"}) {
    EXPECT_TRUE(named(*half, name)->saveFloatAsHalf()) << name;
    test::expectBitEqual(*named(*half, name), *named(*full, name));  // 0 and 1 are halves
  }
  int rounded = 0;
  for (const char* name : {"confidence", "distance"}) {
    const auto exact = floats(*full, name);
    const auto read = floats(*half, name)->getConstAccessor();
    EXPECT_TRUE(named(*half, name)->saveFloatAsHalf());
    EXPECT_EQ(named(*half, name)->activeVoxelCount(), exact->activeVoxelCount());
    for (auto value = exact->cbeginValueOn(); value; ++value) {
      const float got = read.getValue(value.getCoord());
      // Ten stored bits: half an ulp is 2^-11 of the value; below 2^-14, where halves are denormal, 2^-25.
      EXPECT_NEAR(got, *value, std::max(std::ldexp(std::abs(*value), -11), std::ldexp(1.0f, -25)));
      rounded += got != *value;
    }
  }
  EXPECT_GT(rounded, 1000) << "nothing was rounded: no halves were written";
  EXPECT_TRUE(named(*half, "surface")->saveFloatAsHalf());
  EXPECT_TRUE(named(*half, "best_direction")->saveFloatAsHalf());
  options.surface = false;
  std::uint64_t full_bytes = 0;
  options.full_bytes = &full_bytes;
  EXPECT_LT(std::filesystem::file_size(write(folder, "half.vdb", options)),
            std::filesystem::file_size(folder / "full.vdb"));
  EXPECT_EQ(full_bytes, std::filesystem::file_size(folder / "full.vdb"));
}

TEST(WriteOptions, YUpTurnsTransformsAndVectorsAndNothingElse) {
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  WriteOptions options;
  options.surface = true;
  const auto z_up = readVdb(write(folder, "z.vdb", options));
  options.up_axis = UpAxis::Y;
  const auto y_up = readVdb(write(folder, "y.vdb", options));
  for (const auto& grid : *z_up) {
    const std::string name = grid->getName();
    const auto turned = named(*y_up, name);
    EXPECT_EQ(grid->metaValue<std::string>("up_axis"), "z");
    EXPECT_EQ(turned->metaValue<std::string>("up_axis"), "y");
    if (name != "best_direction") test::expectBitEqual(*grid, *turned);
    EXPECT_TRUE(turned->hasUniformVoxels()) << name;
    for (const openvdb::Coord& ijk : {openvdb::Coord(3, 5, 7), openvdb::Coord(-40, 0, 900)}) {
      const openvdb::Vec3d z = grid->indexToWorld(ijk), y = turned->indexToWorld(ijk);
      EXPECT_EQ(y, openvdb::Vec3d(z.x(), z.z(), -z.y())) << name;
    }
  }
  const auto z_direction = openvdb::gridPtrCast<openvdb::Vec3SGrid>(named(*z_up, "best_direction"));
  const auto y_direction = openvdb::gridPtrCast<openvdb::Vec3SGrid>(named(*y_up, "best_direction"));
  EXPECT_TRUE(z_direction->tree().hasSameTopology(y_direction->tree()));
  for (auto value = z_direction->cbeginValueOn(); value; ++value) {
    const openvdb::Vec3s got = y_direction->tree().getValue(value.getCoord());
    EXPECT_EQ(got, openvdb::Vec3s(value->x(), value->z(), -value->y()));
  }

  // A point is in its voxel, and its vectors are rotated too.
  namespace pts = openvdb::points;
  io::writePointsVdb(folder / "points.vdb", field, {}, options);
  const auto points = openvdb::gridPtrCast<pts::PointDataGrid>(named(*readVdb(folder / "points.vdb"), "points"));
  EXPECT_EQ(points->metaValue<std::string>("up_axis"), "y");
  for (auto leaf = points->tree().cbeginLeaf(); leaf; ++leaf) {
    const auto p = pts::AttributeHandle<openvdb::Vec3f>::create(leaf->constAttributeArray("P"));
    const auto n = pts::AttributeHandle<openvdb::Vec3f>::create(leaf->constAttributeArray("N"));
    const auto d = pts::AttributeHandle<openvdb::Vec3f>::create(leaf->constAttributeArray("direction"));
    const auto id = pts::AttributeHandle<int>::create(leaf->constAttributeArray("id"));
    for (auto index = leaf->beginIndexOn(); index; ++index) {
      const SurfacePoint& point = field.points.at(static_cast<std::size_t>(id->get(*index)));
      const Eigen::Vector3d at = point.position_W - kOrigin_W;
      const openvdb::Vec3d got = points->indexToWorld(openvdb::Vec3d(p->get(*index)) + index.getCoord().asVec3d());
      EXPECT_NEAR(got.x(), at.x(), kVoxel_m * 6e-8 + 1e-9);  // as in field_vdb_test
      EXPECT_NEAR(got.y(), at.z(), kVoxel_m * 6e-8 + 1e-9);
      EXPECT_NEAR(got.z(), -at.y(), kVoxel_m * 6e-8 + 1e-9);
      EXPECT_EQ(n->get(*index), openvdb::Vec3f(point.normal_W.x(), point.normal_W.z(), -point.normal_W.y()));
      EXPECT_EQ(d->get(*index), openvdb::Vec3f(point.direction_W.x(), point.direction_W.z(), -point.direction_W.y()));
    }
  }
}

TEST(WriteOptions, AnswersFromAYUpOrHalfMapAreTheSame) {
  const ScratchFolder z_folder, y_folder;
  const FieldSnapshot field = sampleField();
  WriteOptions turned;
  turned.up_axis = UpAxis::Y;
  write(z_folder, "field.vdb", {});
  write(y_folder, "field.vdb", turned);
  for (const auto* folder : {&z_folder, &y_folder}) io::writePointsPly(*folder / "points.ply", field, {});
  const auto z = io::StoredField::open(z_folder.path()), y = io::StoredField::open(y_folder.path());
  int observed = 0;
  for (const SurfacePoint& point : field.points) {
    const auto a = z.at(point.position_W), b = y.at(point.position_W);
    ASSERT_TRUE(a.point && b.point);
    EXPECT_EQ(a.point->id, b.point->id);
    EXPECT_EQ(a.point->label, b.point->label);
    EXPECT_EQ(a.distance_m, b.distance_m);
    EXPECT_EQ(a.weight, b.weight);
    EXPECT_EQ(a.observed, b.observed);
    observed += a.observed;
  }
  EXPECT_GT(observed, 100);
}

TEST(WriteOptions, AnUpAxisThatDoesNotFitTheTransformsIsRefused) {
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  io::writePointsPly(folder / "points.ply", field, {});
  const auto rewrite = [&](const std::string& up) {
    openvdb::io::File in(write(folder, "field.vdb", {}).string());
    in.open(false);
    const auto grids = in.getGrids();
    openvdb::MetaMap metadata = *in.getMetadata();
    in.close();
    metadata.insertMeta("up_axis", openvdb::StringMetadata(up));
    openvdb::io::File(folder / "field.vdb").write(*grids, metadata);
  };
  rewrite("z");
  EXPECT_NO_THROW(io::StoredField::open(folder.path()));
  for (const char* up : {"x", "y", ""}) {
    rewrite(up);
    EXPECT_THROW(io::StoredField::open(folder.path()), InputError) << up;
  }
}

TEST(WriteOptions, PointGroupsAndReasonsCountAsThePlyDoes) {
  namespace pts = openvdb::points;
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  io::writePointsPly(folder / "points.ply", field, {});
  const FieldSnapshot ply = io::readPointsPly(folder / "points.ply");
  for (const bool half : {false, true}) {
    WriteOptions options;
    options.half_float = half;
    io::writePointsVdb(folder / "points.vdb", field, {}, options);
    const auto points = openvdb::gridPtrCast<pts::PointDataGrid>(named(*readVdb(folder / "points.vdb"), "points"));
    EXPECT_EQ(pts::pointCount(points->tree()), ply.points.size());
    const auto& attributes = points->tree().cbeginLeaf()->attributeSet();
    for (const char* name : {"P", "N", "Cd", "pscale", "id", "label", "reason", "score", "confidence", "direction"}) {
      EXPECT_NE(attributes.find(name), pts::AttributeSet::INVALID_POS) << name;
    }
    for (const PointLabel label : {PointLabel::Accessible, PointLabel::Blocked, PointLabel::Unscored}) {
      const pts::GroupFilter filter(name(label), attributes);
      EXPECT_EQ(pts::pointCount(points->tree(), filter), ply.count(label)) << name(label);
      EXPECT_GT(ply.count(label), 0u);
    }
    std::array<std::uint64_t, kNumPointReasons> reasons = {};
    for (auto leaf = points->tree().cbeginLeaf(); leaf; ++leaf) {
      const auto reason = pts::AttributeHandle<int>::create(leaf->constAttributeArray("reason"));
      const auto normal = pts::AttributeHandle<openvdb::Vec3f>::create(leaf->constAttributeArray("N"));
      const auto id = pts::AttributeHandle<int>::create(leaf->constAttributeArray("id"));
      for (auto index = leaf->beginIndexOn(); index; ++index) {
        ++reasons.at(static_cast<std::size_t>(reason->get(*index)));
        const Eigen::Vector3f& exact = field.points[static_cast<std::size_t>(id->get(*index))].normal_W;
        for (int axis = 0; axis < 3; ++axis) {
          EXPECT_NEAR(normal->get(*index)[axis], exact[axis], half ? std::ldexp(1.0, -12) : 0.0);
        }
      }
    }
    EXPECT_EQ(reasons, ply.reasons());
  }
}

TEST(WriteOptions, AnEmptyFieldIsReadableByEveryReaderOfOurs) {
  const ScratchFolder folder;
  FieldSnapshot field;
  field.voxel_size_m = kVoxel_m;
  const auto nothing = [](auto background) {
    return openvdb::Grid<typename openvdb::tree::Tree4<decltype(background), 5, 4, 3>::Type>::create(background);
  };
  for (const UpAxis up : {UpAxis::Z, UpAxis::Y}) {
    WriteOptions options;
    options.surface = true;
    options.half_float = true;
    options.up_axis = up;
    internal::writeFieldGrids(
        folder / "field.vdb",
        {[&] { return nothing(0.1f); }, [&] { return nothing(0.0f); }, [&] { return nothing(false); }},
        SnapshotPoints(field), {}, options);
    io::writePointsVdb(folder / "field_points.vdb", field, {}, options);
    io::writePointsPly(folder / "points.ply", field, {});
    EXPECT_EQ(io::summarizeVdb(folder / "field.vdb").grids.size(), kNames.size() + 1);
    EXPECT_EQ(io::summarizeVdb(folder / "field_points.vdb").grids.size(), 1u);
    const io::StoredField stored = io::StoredField::open(folder.path());
    EXPECT_TRUE(stored.points().points.empty());
    const auto answer = stored.at({1, 2, 3});
    EXPECT_FALSE(answer.point || answer.observed || answer.cleared);
  }
}

/// A read-only folder gives one error of ours. Uses another user if the tests run as root, who may write anywhere.
TEST(WriteOptions, AReadOnlyFolderIsAPermissionError) {
  const ScratchFolder folder;
  const auto locked = folder / "locked";
  std::filesystem::create_directory(locked);
  ASSERT_EQ(::chmod(folder.path().c_str(), 0755), 0);
  ASSERT_EQ(::chmod(locked.c_str(), 0555), 0);
  const FieldSnapshot field = sampleField();
  const auto points = [&] { io::writePointsVdb(locked / "points.vdb", field, {}, {}); };
  const auto prepare = [&] { io::prepareOutputFolder(locked); };
  const auto below = [&] { io::prepareOutputFolder(locked / "below"); };
  int n = 0;
  for (const std::function<void()>& job : {std::function<void()>(points), {prepare}, {below}}) {
    SCOPED_TRACE(n++);
    const pid_t child = ::fork();
    if (child == 0) {
      constexpr uid_t kNobody = 65534;
      if (::geteuid() == 0 && ::setuid(kNobody) != 0) ::_exit(9);
      try {
        job();
        ::_exit(1);
      } catch (const OutputError& error) {
        ::_exit(error.id() == "output.permission" && !error.advice().empty() ? 0 : 2);
      } catch (...) {
        ::_exit(3);
      }
    }
    int status = -1;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), 0);
  }
  EXPECT_TRUE(std::filesystem::is_empty(locked));
}

}  // namespace
}  // namespace accessvdb
