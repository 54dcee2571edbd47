// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// field_points.vdb: the surface points with their attributes as one PointDataGrid, the form that Houdini unpacks.
#include <openvdb/points/PointConversion.h>
#include <openvdb/points/PointCount.h>
#include <openvdb/points/PointGroup.h>
#include <tbb/parallel_for.h>

#include <ostream>
#include <vector>

#include "accessvdb/error.h"
#include "io/results/field_grids.h"
#include "io/results/label_colours.h"
#include "io/results/points_ply.h"
#include "io/results/surface_voxels.h"
#include "vdb/point_grids.h"

namespace accessvdb::internal {
namespace {

using openvdb::points::NullCodec;
using openvdb::points::PointDataGrid;
using openvdb::points::TruncateCodec;

/// One value of each point, in the frame of the file.
template <typename ValueT>
using ValueOf = ValueT (*)(const SurfacePoint& point, io::UpAxis up);

/// What a column of points.vdb looks like to OpenVDB: values are made when it asks for them, not kept.
template <typename ValueT>
class Column {
 public:
  using value_type = ValueT;
  Column(const SurfacePoints& points, io::UpAxis up, ValueOf<ValueT> value) : points_(points), up_(up), value_(value) {}
  void get(ValueT& value, std::size_t n, openvdb::Index) const { value = value_(points_.at(n), up_); }

 private:
  const SurfacePoints& points_;
  io::UpAxis up_;
  ValueOf<ValueT> value_;
};

/// The same for an attribute that the returns carried.
class CarriedColumn {
 public:
  using value_type = int;
  CarriedColumn(const SurfacePoints& points, std::size_t column) : points_(points), column_(column) {}
  void get(int& value, std::size_t n, openvdb::Index) const { value = points_.attribute(n, column_); }

 private:
  const SurfacePoints& points_;
  std::size_t column_;
};

/// The same for positions. In doubles, so that a position far from the local origin keeps its place inside its voxel.
class PositionColumn {
 public:
  using value_type = openvdb::Vec3d;
  using PosType = openvdb::Vec3d;
  explicit PositionColumn(const SurfacePoints& points) : points_(points) {}
  [[nodiscard]] std::size_t size() const { return points_.size(); }
  void getPos(std::size_t n, openvdb::Vec3d& position_L) const {
    const Eigen::Vector3d p_L = points_.position_W(n) - points_.origin_W();
    position_L = {p_L.x(), p_L.y(), p_L.z()};
  }

 private:
  const SurfacePoints& points_;
};

/// Makes the grid column by column.
class PointGridMaker {
 public:
  PointGridMaker(const SurfacePoints& points, const io::WriteOptions& options, const PointsPlyColumns& columns)
      : points_(points), options_(options), columns_(columns) {}
  [[nodiscard]] PointDataGrid::Ptr make();

 private:
  /// Distributes the values over the leaves by the point index grid.
  template <typename ValueT, typename Codec = NullCodec>
  void addColumn(const std::string& name, ValueOf<ValueT> value) {
    openvdb::points::appendAttribute<ValueT, Codec>(grid_->tree(), name);
    openvdb::points::populateAttribute<PointDataGrid::TreeType, openvdb::tools::PointIndexTree, Column<ValueT>>(
        grid_->tree(), index_->tree(), name, Column<ValueT>(points_, options_.up_axis, value));
  }
  template <typename Codec>
  void addFloatColumns();
  void addGroup(PointLabel label);

  const SurfacePoints& points_;
  const io::WriteOptions& options_;
  PointsPlyColumns columns_;
  openvdb::tools::PointIndexGrid::Ptr index_;
  PointDataGrid::Ptr grid_;
};

/// The columns that are neither counts nor positions; as halves with TruncateCodec.
template <typename Codec>
void PointGridMaker::addFloatColumns() {
  addColumn<openvdb::Vec3f, Codec>("N",
                                   [](const SurfacePoint& p, io::UpAxis up) { return toFileFrame(p.normal_W, up); });
  addColumn<openvdb::Vec3f, Codec>("Cd", [](const SurfacePoint& p, io::UpAxis) {
    const Rgb colour = colourOf(p.label);
    return openvdb::Vec3f(colour[0], colour[1], colour[2]) / 255.0f;
  });
  addColumn<openvdb::Vec3f, Codec>("direction",
                                   [](const SurfacePoint& p, io::UpAxis up) { return toFileFrame(p.direction_W, up); });
  addColumn<float, Codec>("confidence", [](const SurfacePoint& p, io::UpAxis) { return p.confidence; });
}

void PointGridMaker::addGroup(PointLabel label) {
  std::vector<short> member(points_.size());
  tbb::parallel_for(std::size_t{0}, member.size(), [&](std::size_t n) { member[n] = points_.at(n).label == label; });
  openvdb::points::appendGroup(grid_->tree(), name(label));
  openvdb::points::setGroup(grid_->tree(), index_->tree(), member, name(label));
}

PointDataGrid::Ptr PointGridMaker::make() {
  const double voxel_size_m = points_.voxel_size_m();
  const auto transform = fieldTransform(voxel_size_m);
  const PositionColumn positions(points_);
  for (std::size_t n = 0; n < points_.size(); ++n) {  // throws if there is no voxel
    static_cast<void>(voxelAt(points_.position_W(n) - points_.origin_W(), voxel_size_m));
  }
  index_ = openvdb::tools::createPointIndexGrid<openvdb::tools::PointIndexGrid>(positions, *transform);
  grid_ = openvdb::points::createPointDataGrid<NullCodec, PointDataGrid>(*index_, positions, *transform);
  grid_->setTransform(fieldTransform(voxel_size_m, options_.up_axis));  // positions are offsets within their voxels
  if (points_.size() == 0) return grid_;

  if (options_.half_float) {
    addFloatColumns<TruncateCodec>();
  } else {
    addFloatColumns<NullCodec>();
  }
  addColumn<int>("id", [](const SurfacePoint& p, io::UpAxis) { return static_cast<int>(p.id); });
  addColumn<int>("label", [](const SurfacePoint& p, io::UpAxis) { return static_cast<int>(p.label); });
  addColumn<int>("reason", [](const SurfacePoint& p, io::UpAxis) { return static_cast<int>(p.reason); });
  addColumn<int>(
      "score", [](const SurfacePoint& p, io::UpAxis) { return p.score == kNoScore ? -1 : static_cast<int>(p.score); });
  if (columns_.margin) {
    addColumn<float>("margin_m", [](const SurfacePoint& p, io::UpAxis) { return p.margin_m; });
    addColumn<float>("free_arc_deg", [](const SurfacePoint& p, io::UpAxis) { return p.free_arc_deg; });
  }
  if (columns_.probability) {
    addColumn<float>("access_probability", [](const SurfacePoint& p, io::UpAxis) { return p.access_probability; });
  }
  const std::vector<std::string> carried = points_.attributeNames();
  for (std::size_t c = 0; c < carried.size(); ++c) {
    openvdb::points::appendAttribute<int, NullCodec>(grid_->tree(), carried[c]);
    openvdb::points::populateAttribute<PointDataGrid::TreeType, openvdb::tools::PointIndexTree, CarriedColumn>(
        grid_->tree(), index_->tree(), carried[c], CarriedColumn(points_, c));
  }
  openvdb::points::appendAttribute<float, NullCodec>(grid_->tree(), "pscale", static_cast<float>(voxel_size_m / 2));
  for (const PointLabel label : {PointLabel::Accessible, PointLabel::Blocked, PointLabel::Unscored}) addGroup(label);
  return grid_;
}

}  // namespace
}  // namespace accessvdb::internal

namespace accessvdb::io {

void writePointsVdb(const std::filesystem::path& path, const SurfacePoints& points, const FieldMetadata& metadata,
                    const WriteOptions& options) {
  openvdb::initialize();
  const auto file_metadata = internal::fieldMetadata(points, metadata, options);
  const internal::PointsPlyColumns columns = internal::pointsPlyColumns(metadata);
  const auto make = [&]() -> openvdb::GridBase::Ptr {
    const auto grid = internal::PointGridMaker(points, options, columns).make();
    for (const char* name : {"origin_W_x", "origin_W_y", "origin_W_z", "length_unit", "up_axis", "accessvdb_version"}) {
      grid->insertMeta(name, *file_metadata[name]);
    }
    return grid;
  };
  const std::vector<internal::LazyGrid> grids = {{"points", make}};
  writeFileDurably(
      path, [&](std::ostream& stream) { internal::writeGrids(stream, grids, file_metadata, options.compression); });
}

void writePointsVdb(const std::filesystem::path& path, const FieldSnapshot& field, const FieldMetadata& metadata,
                    const WriteOptions& options) {
  writePointsVdb(path, SnapshotPoints(field), metadata, options);
}

void writePointsVdb(const std::filesystem::path& path, const FieldSnapshot& field, const FieldMetadata& metadata) {
  writePointsVdb(path, field, metadata, {});
}

}  // namespace accessvdb::io
