// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// field_points.vdb: the surface points with their attributes as one PointDataGrid, the form that Houdini unpacks.
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>
#include <openvdb/points/PointGroup.h>

#include <cmath>
#include <ostream>

#include "accessvdb/error.h"
#include "io/field_grids.h"
#include "io/label_colours.h"
#include "io/surface_voxels.h"
#include "vdb/point_grids.h"

namespace accessvdb::internal {
namespace {

using openvdb::points::NullCodec;
using openvdb::points::PointAttributeVector;
using openvdb::points::PointDataGrid;
using openvdb::points::TruncateCodec;
using openvdb::points::TypedAttributeArray;

/// Adds a column: collects all values, then distributes them over the leaves by the point index grid.
template <typename ValueT, typename Codec = NullCodec, typename Value>
void addAttribute(PointDataGrid& grid, const openvdb::tools::PointIndexGrid& index, const FieldSnapshot& field,
                  const std::string& name, const Value& value) {
  std::vector<ValueT> values;
  values.reserve(field.points.size());
  for (const SurfacePoint& point : field.points) values.push_back(value(point));
  openvdb::points::appendAttribute<ValueT, Codec>(grid.tree(), name);
  openvdb::points::populateAttribute<PointDataGrid::TreeType, openvdb::tools::PointIndexTree,
                                     PointAttributeVector<ValueT>>(grid.tree(), index.tree(), name,
                                                                   PointAttributeVector<ValueT>(values));
}

void addGroup(PointDataGrid& grid, const openvdb::tools::PointIndexGrid& index, const FieldSnapshot& field,
              PointLabel label) {
  std::vector<short> member;
  member.reserve(field.points.size());
  for (const SurfacePoint& point : field.points) member.push_back(point.label == label ? 1 : 0);
  openvdb::points::appendGroup(grid.tree(), name(label));
  openvdb::points::setGroup(grid.tree(), index.tree(), member, name(label));
}

/// Adds the columns that are neither counts nor positions; as halves with TruncateCodec.
template <typename Codec>
void addFloatColumns(PointDataGrid& grid, const openvdb::tools::PointIndexGrid& index, const FieldSnapshot& field,
                     io::UpAxis up) {
  const auto add = [&](const std::string& name, const auto& value) {
    addAttribute<openvdb::Vec3f, Codec>(grid, index, field, name, value);
  };
  add("N", [up](const SurfacePoint& p) { return toFileFrame(p.normal_W, up); });
  add("Cd", [](const SurfacePoint& p) {
    const Rgb colour = colourOf(p.label);
    return openvdb::Vec3f(colour[0], colour[1], colour[2]) / 255.0f;
  });
  add("direction", [up](const SurfacePoint& p) { return toFileFrame(p.direction_W, up); });
  addAttribute<float, Codec>(grid, index, field, "confidence", [](const SurfacePoint& p) { return p.confidence; });
}

PointDataGrid::Ptr pointGrid(const FieldSnapshot& field, const io::WriteOptions& options) {
  const auto transform = fieldTransform(field.voxel_size_m);
  // Uses doubles, so that a position far from the local origin keeps its place inside its voxel.
  std::vector<openvdb::Vec3d> positions_L;
  positions_L.reserve(field.points.size());
  for (const SurfacePoint& point : field.points) {
    const Eigen::Vector3d p_L = point.position_W - field.origin_W;
    static_cast<void>(voxelAt(p_L, field.voxel_size_m));  // throws if there is no voxel
    positions_L.emplace_back(p_L.x(), p_L.y(), p_L.z());
  }
  const PointAttributeVector<openvdb::Vec3d> wrapped(positions_L);
  const auto index = openvdb::tools::createPointIndexGrid<openvdb::tools::PointIndexGrid>(wrapped, *transform);
  const auto grid = openvdb::points::createPointDataGrid<NullCodec, PointDataGrid>(*index, wrapped, *transform);
  grid->setTransform(fieldTransform(field.voxel_size_m, options.up_axis));  // positions are offsets within their voxels
  if (field.points.empty()) return grid;

  if (options.half_float) {
    addFloatColumns<TruncateCodec>(*grid, *index, field, options.up_axis);
  } else {
    addFloatColumns<NullCodec>(*grid, *index, field, options.up_axis);
  }
  addAttribute<int>(*grid, *index, field, "id", [](const SurfacePoint& p) { return static_cast<int>(p.id); });
  addAttribute<int>(*grid, *index, field, "label", [](const SurfacePoint& p) { return static_cast<int>(p.label); });
  addAttribute<int>(*grid, *index, field, "reason", [](const SurfacePoint& p) { return static_cast<int>(p.reason); });
  addAttribute<int>(*grid, *index, field, "score",
                    [](const SurfacePoint& p) { return p.score == kNoScore ? -1 : static_cast<int>(p.score); });
  openvdb::points::appendAttribute<float, NullCodec>(grid->tree(), "pscale",
                                                     static_cast<float>(field.voxel_size_m / 2));
  for (const PointLabel label : {PointLabel::Accessible, PointLabel::Blocked, PointLabel::Unscored}) {
    addGroup(*grid, *index, field, label);
  }
  return grid;
}

}  // namespace
}  // namespace accessvdb::internal

namespace accessvdb::io {

void writePointsVdb(const std::filesystem::path& path, const FieldSnapshot& field, const FieldMetadata& metadata,
                    const WriteOptions& options) {
  openvdb::initialize();
  const auto file_metadata = internal::fieldMetadata(field, metadata, options);
  const auto make = [&]() -> openvdb::GridBase::Ptr {
    const auto grid = internal::pointGrid(field, options);
    for (const char* name : {"origin_W_x", "origin_W_y", "origin_W_z", "length_unit", "up_axis", "accessvdb_version"}) {
      grid->insertMeta(name, *file_metadata[name]);
    }
    return grid;
  };
  const std::vector<internal::LazyGrid> grids = {{"points", make}};
  writeFileDurably(
      path, [&](std::ostream& stream) { internal::writeGrids(stream, grids, file_metadata, options.compression); });
}

void writePointsVdb(const std::filesystem::path& path, const FieldSnapshot& field, const FieldMetadata& metadata) {
  writePointsVdb(path, field, metadata, {});
}

}  // namespace accessvdb::io
