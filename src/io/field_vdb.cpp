// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// field.vdb: the surface as fogs and attributes, and the map itself. Float, bool and vec3s grids only.
#include <ostream>
#include <utility>

#include "accessvdb/config.h"
#include "accessvdb/tsdf_volume.h"
#include "io/field_grids.h"

namespace accessvdb::internal {
namespace {

constexpr float kScoreOfNone = -1.0f;

bool keepAll(const SurfacePoint&) { return true; }

/// Name, class, frame and meaning on the grid itself: Houdini shows these and drops what stands at file level.
template <typename GridPtr>
openvdb::GridBase::Ptr described(const GridPtr& grid, const FieldSnapshot& field, openvdb::GridClass grid_class,
                                 const std::string& description) {
  grid->setGridClass(grid_class);
  grid->insertMeta("description", openvdb::StringMetadata(description));
  grid->insertMeta("origin_W_x", openvdb::DoubleMetadata(field.origin_W.x()));
  grid->insertMeta("origin_W_y", openvdb::DoubleMetadata(field.origin_W.y()));
  grid->insertMeta("origin_W_z", openvdb::DoubleMetadata(field.origin_W.z()));
  grid->insertMeta("accessvdb_version", openvdb::StringMetadata(ACCESSVDB_VERSION));
  return grid;
}

std::vector<LazyGrid> fieldGrids(const VolumeGrids& volume, const FieldSnapshot& field, const SurfaceVoxels& surface) {
  using openvdb::FloatGrid;
  using openvdb::Vec3SGrid;
  const auto fog = [&](const std::string& name, const auto& keep, const std::string& description) {
    return LazyGrid{name, [&field, &surface, name, keep, description] {
                      const auto one = [](const SurfacePoint&, std::uint32_t) { return 1.0f; };
                      return described(surface.grid<FloatGrid>(name, 0.0f, keep, one), field, openvdb::GRID_FOG_VOLUME,
                                       description);
                    }};
  };
  const auto labelled = [](PointLabel label) {
    return [label](const SurfacePoint& point) { return point.label == label; };
  };

  std::vector<LazyGrid> grids;
  grids.push_back(fog("density", keepAll, "1 in every voxel that holds a surface point"));
  grids.push_back(fog("accessible", labelled(PointLabel::Accessible), "1 in surface voxels that the tool can reach"));
  grids.push_back(fog("blocked", labelled(PointLabel::Blocked), "1 in surface voxels that the tool cannot reach"));
  grids.push_back({"confidence", [&] {
                     const auto value = [](const SurfacePoint& point, std::uint32_t) { return point.confidence; };
                     return described(surface.grid<FloatGrid>("confidence", 0.0f, keepAll, value), field,
                                      openvdb::GRID_UNKNOWN, "confidence of each surface voxel, 0 up to below 1");
                   }});
  grids.push_back({"score", [&] {
                     const auto value = [](const SurfacePoint& point, std::uint32_t) {
                       return point.score == kNoScore ? kScoreOfNone : static_cast<float>(point.score);
                     };
                     return described(surface.grid<FloatGrid>("score", kScoreOfNone, keepAll, value), field,
                                      openvdb::GRID_UNKNOWN,
                                      "fewest collisions of the tool in any direction; -1 where none was scored");
                   }});
  grids.push_back({"best_direction", [&] {
                     const auto keep = [](const SurfacePoint& point) { return !point.direction_W.isZero(); };
                     const auto value = [](const SurfacePoint& point, std::uint32_t) {
                       return openvdb::Vec3s(point.direction_W.x(), point.direction_W.y(), point.direction_W.z());
                     };
                     auto grid = surface.grid<Vec3SGrid>("best_direction", openvdb::Vec3s(0.0f), keep, value);
                     grid->setVectorType(openvdb::VEC_CONTRAVARIANT_RELATIVE);
                     return described(grid, field, openvdb::GRID_UNKNOWN,
                                      "unit vector outwards along the tool's body; the tool travels against it");
                   }});
  grids.push_back({"distance", [&] {
                     return described(volume.distance(), field, openvdb::GRID_UNKNOWN,
                                      "mean of the clamped signed distances, metres; no level set: no zero crossing");
                   }});
  grids.push_back({"weight", [&] {
                     return described(volume.weight(), field, openvdb::GRID_UNKNOWN, "observations of each voxel");
                   }});
  grids.push_back({"cleared", [&] {
                     return described(volume.cleared(), field, openvdb::GRID_UNKNOWN,
                                      "true where a ray passed on its way to a return");
                   }});
  return grids;
}

}  // namespace

void writeFieldGrids(const std::filesystem::path& path, const VolumeGrids& volume, const FieldSnapshot& field,
                     const io::FieldMetadata& metadata) {
  openvdb::initialize();
  const SurfaceVoxels surface(field);
  const auto grids = fieldGrids(volume, field, surface);
  const auto file_metadata = fieldMetadata(field, metadata);
  io::writeFileDurably(path, [&](std::ostream& stream) { writeGrids(stream, grids, file_metadata); });
}

}  // namespace accessvdb::internal

namespace accessvdb::io {

void writeFieldVdb(const std::filesystem::path& path, const TsdfVolume& volume, const FieldSnapshot& field,
                   const FieldMetadata& metadata) {
  const internal::VolumeGrids grids = {[&] { return volume.distance(); }, [&] { return volume.weight(); },
                                       [&] { return volume.cleared(); }};
  internal::writeFieldGrids(path, grids, field, metadata);
}

}  // namespace accessvdb::io
