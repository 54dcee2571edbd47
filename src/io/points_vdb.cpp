// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// field_points.vdb: the surface points with their attributes as one PointDataGrid, the form that Houdini unpacks.
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>
#include <openvdb/points/PointGroup.h>
#include <openvdb/tools/PointIndexGrid.h>

#include <cmath>
#include <ostream>

#include "accessvdb/error.h"
#include "io/field_grids.h"
#include "io/label_colours.h"

namespace accessvdb::internal {
namespace {

using openvdb::points::NullCodec;
using openvdb::points::PointAttributeVector;
using openvdb::points::PointDataGrid;
using openvdb::points::TypedAttributeArray;

/// One column: all values first, then spread over the leaves by the point index grid.
template <typename ValueT, typename Value>
void addAttribute(PointDataGrid& grid, const openvdb::tools::PointIndexGrid& index, const FieldSnapshot& field,
                  const std::string& name, const Value& value) {
  std::vector<ValueT> values;
  values.reserve(field.points.size());
  for (const SurfacePoint& point : field.points) values.push_back(value(point));
  openvdb::points::appendAttribute<ValueT, NullCodec>(grid.tree(), name);
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

openvdb::Vec3f toVec3f(const Eigen::Vector3f& v) { return {v.x(), v.y(), v.z()}; }

PointDataGrid::Ptr pointGrid(const FieldSnapshot& field) {
  const auto transform = fieldTransform(field.voxel_size_m);
  // Doubles in, so that a position far from the local origin keeps its place inside its voxel.
  std::vector<openvdb::Vec3d> positions_L;
  positions_L.reserve(field.points.size());
  for (const SurfacePoint& point : field.points) {
    const Eigen::Vector3d p_L = point.position_W - field.origin_W;
    static_cast<void>(voxelAt(p_L, field.voxel_size_m));  // throws where there is no voxel
    positions_L.emplace_back(p_L.x(), p_L.y(), p_L.z());
  }
  const PointAttributeVector<openvdb::Vec3d> wrapped(positions_L);
  const auto index = openvdb::tools::createPointIndexGrid<openvdb::tools::PointIndexGrid>(wrapped, *transform);
  const auto grid = openvdb::points::createPointDataGrid<NullCodec, PointDataGrid>(*index, wrapped, *transform);
  if (field.points.empty()) return grid;

  addAttribute<openvdb::Vec3f>(*grid, *index, field, "N", [](const SurfacePoint& p) { return toVec3f(p.normal_W); });
  addAttribute<openvdb::Vec3f>(*grid, *index, field, "Cd", [](const SurfacePoint& p) {
    const Rgb colour = colourOf(p.label);
    return openvdb::Vec3f(colour[0], colour[1], colour[2]) / 255.0f;
  });
  addAttribute<openvdb::Vec3f>(*grid, *index, field, "direction",
                               [](const SurfacePoint& p) { return toVec3f(p.direction_W); });
  addAttribute<float>(*grid, *index, field, "confidence", [](const SurfacePoint& p) { return p.confidence; });
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

void writePointsVdb(const std::filesystem::path& path, const FieldSnapshot& field, const FieldMetadata& metadata) {
  openvdb::initialize();
  const auto file_metadata = internal::fieldMetadata(field, metadata);
  const auto make = [&]() -> openvdb::GridBase::Ptr {
    const auto grid = internal::pointGrid(field);
    for (const char* name : {"origin_W_x", "origin_W_y", "origin_W_z"}) grid->insertMeta(name, *file_metadata[name]);
    return grid;
  };
  const std::vector<internal::LazyGrid> grids = {{"points", make}};
  writeFileDurably(path, [&](std::ostream& stream) { internal::writeGrids(stream, grids, file_metadata); });
}

}  // namespace accessvdb::io
