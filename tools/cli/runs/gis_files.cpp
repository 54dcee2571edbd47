// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/gis_files.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <memory>
#include <ostream>
#include <span>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/point_table.h"
#include "gis/availability.h"
#include "gis/geopackage.h"
#include "gis/geotiff.h"

namespace accessvdb::tools {
namespace {

/// Two bands of 4 bytes and two sums of 8 for each.
constexpr double kMostCells = 2e8;
constexpr double kDegrees = 57.295779513082320876798;

std::string software() { return "AccessVDB " ACCESSVDB_VERSION; }

}  // namespace

void requireGis(const std::string&) { gis::requireGdal(); }

PreparedFile shareRaster(const std::filesystem::path& file, const std::vector<std::filesystem::path>& points,
                         const SurveyFrame& frame, double cell_m) {
  // Whole multiples of a cell from the frame's origin, so that rasters of several dates lie on each other.
  const Eigen::Vector2d cell = {cell_m / frame.unit_m.x(), cell_m / frame.unit_m.y()};
  const auto cellOf = [&](const Eigen::Vector3d& p_W, int axis) {
    return std::floor(p_W[axis] / frame.unit_m[axis] / cell[axis]);
  };
  Eigen::AlignedBox2d cells;
  Eigen::Vector3d origin_W = Eigen::Vector3d::Zero();
  double voxel_size_m = 0, point_cell_m = 0;
  for (const std::filesystem::path& ply : points) {
    const auto header = io::visitPoints(ply, [&](const SurfacePoint& point) {
      cells.extend(Eigen::Vector2d(cellOf(point.position_W, 0), cellOf(point.position_W, 1)));
    });
    origin_W = header.origin_W;
    voxel_size_m = header.voxel_size_m;
    point_cell_m = io::pointCell_m(header.metadata, voxel_size_m);
  }
  if (cells.isEmpty()) {
    throw UnusableInput("field.empty", file.string(), "would have no cells: the map holds no points",
                        "Map scans that have returns");
  }
  const Eigen::Vector2d size = cells.sizes() + Eigen::Vector2d(1, 1);
  if (!(size.x() * size.y() <= kMostCells)) {
    throw InvalidArgument("usage.cell", "--cell", "would make more than 200 million cells", "Use larger cells");
  }
  const auto columns = static_cast<std::size_t>(size.x()), rows = static_cast<std::size_t>(size.y());
  // Whole numbers, so that the order of points changes no digit.
  std::vector<std::uint64_t> all(columns * rows), accessible(columns * rows);
  for (const std::filesystem::path& ply : points) {
    io::visitPoints(ply, [&](const SurfacePoint& point) {
      const auto x = static_cast<std::size_t>(cellOf(point.position_W, 0) - cells.min().x());
      const auto y = static_cast<std::size_t>(cells.max().y() - cellOf(point.position_W, 1));
      const std::uint64_t steps = io::areaOf(point, origin_W, voxel_size_m, point_cell_m).steps;
      all[y * columns + x] += steps;
      if (point.label == PointLabel::Accessible) accessible[y * columns + x] += steps;
    });
  }
  const auto made = std::make_shared<gis::Raster>();
  gis::Raster& raster = *made;
  raster.columns = static_cast<int>(columns);
  raster.rows = static_cast<int>(rows);
  raster.cell_x = cell.x();
  raster.cell_y = cell.y();
  raster.west = cells.min().x() * cell.x();
  raster.north = (cells.max().y() + 1) * cell.y();
  raster.bands = {{"accessible share of the surface", {}}, {"square metres of surface", {}}};
  for (std::size_t n = 0; n < all.size(); ++n) {
    const bool empty = all[n] == 0;
    const double share = empty ? 0 : static_cast<double>(accessible[n]) / static_cast<double>(all[n]);
    raster.bands[0].values.push_back(empty ? gis::Raster::kNone : static_cast<float>(share));
    raster.bands[1].values.push_back(empty ? gis::Raster::kNone
                                           : static_cast<float>(io::ExactArea{all[n]}.m2(voxel_size_m)));
  }
  return {file, std::to_string(columns) + " x " + std::to_string(rows) + " cells",
          [made, frame](std::ostream& out) { gis::writeGeoTiff(*made, frame, software(), out); }};
}

PreparedFile targetLayer(const std::filesystem::path& file, const std::vector<std::filesystem::path>& points,
                         const SurveyFrame& frame) {
  using Type = gis::LayerColumn::Type;
  const bool in_tiles = points.size() > 1;
  std::vector<gis::LayerColumn> columns = {
      {"point", Type::Whole}, {"score", Type::Whole}, {"confidence", Type::Real}, {"access_probability", Type::Real},
      {"dx", Type::Real},     {"dy", Type::Real},     {"dz", Type::Real},         {"yaw", Type::Real}};
  if (in_tiles) columns.push_back({"tile", Type::Text});
  if (!points.empty()) {
    for (const std::string& name : io::readPointsHeader(points.front()).attributes)
      columns.push_back({name, Type::Whole});
  }
  const auto package =
      std::make_shared<gis::GeoPackage>("targets", "accessible points, written by " + software(), columns, frame);
  std::uint64_t targets = 0;
  for (const std::filesystem::path& ply : points) {
    const std::string tile = ply.parent_path().filename().string();
    io::visitCarryingPoints(ply, [&](const SurfacePoint& point, std::span<const std::int32_t> carried) {
      if (point.label != PointLabel::Accessible) return;
      const auto real = [](float value) { return gis::Value(static_cast<double>(value)); };
      const Eigen::Vector3f& back = point.direction_W;
      std::vector<gis::Value> values = {static_cast<std::int32_t>(point.id),
                                        static_cast<std::int32_t>(point.score),
                                        real(point.confidence),
                                        point.access_probability < 0 ? gis::Value() : real(point.access_probability),
                                        real(back.x()),
                                        real(back.y()),
                                        real(back.z()),
                                        static_cast<double>(point.yaw_rad) * kDegrees};
      if (in_tiles) values.emplace_back(tile);
      for (const std::int32_t value : carried)
        values.push_back(value == kNoAttribute ? gis::Value() : gis::Value(value));
      package->add(static_cast<std::int64_t>(++targets), point.position_W.cwiseQuotient(frame.unit_m), values);
    });
  }
  return {file, std::to_string(targets) + " targets", [package](std::ostream& out) { package->write(out); }};
}

}  // namespace accessvdb::tools
