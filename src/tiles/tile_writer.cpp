// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/tile_writer.h"

#include <limits>
#include <ostream>

#include "accessvdb/program/path_facts.h"
#include "accessvdb/surface_points.h"
#include "field/field_access.h"
#include "field/field_files.h"
#include "points/point_store.h"
#include "tiles/tile_files.h"

namespace accessvdb::tiles {
namespace {

void count(const SurfacePoints& points, Tile& tile) {
  tile.points = points.size();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(kInfinity), high = -low;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const SurfacePoint point = points.at(n);
    ++tile.labels[static_cast<std::size_t>(point.label)];
    ++tile.reasons[static_cast<std::size_t>(point.reason)];
    low = low.cwiseMin(point.position_W);
    high = high.cwiseMax(point.position_W);
  }
  if (points.size() == 0) low = high = Eigen::Vector3d::Zero();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    tile.min_W[axis] = low[static_cast<Eigen::Index>(axis)];
    tile.max_W[axis] = high[static_cast<Eigen::Index>(axis)];
  }
}

void writeFirsts(const SurfacePoints& points, const std::filesystem::path& file) {
  io::writeFileDurably(file, [&](std::ostream& stream) {
    for (std::size_t n = 0; n < points.size(); ++n) {
      const auto first = points.firstReturn(n).value_or(SurfacePoints::FirstReturn());
      const StoredFirst record = {first.gps_time, first.point_class};
      stream.write(reinterpret_cast<const char*>(&record), sizeof record);
    }
  });
}

void writeOrder(const internal::PointStore& store, const SurfacePoints& points, const StepOfPoint& stepOf,
                const std::filesystem::path& file) {
  io::writeFileDurably(file, [&](std::ostream& stream) {
    for (std::size_t n = 0; n < points.size(); ++n) {
      const std::uint32_t id = points.at(n).id;
      const PointOrder order = {stepOf(id), internal::placeOf(store.voxelOf(store.first_L(id)))};
      stream.write(reinterpret_cast<const char*>(&order), sizeof order);
    }
  });
}

}  // namespace

void writeTileFiles(const AccessibilityField& field, const std::filesystem::path& folder,
                    const io::WriteOptions& options, const StepOfPoint& stepOf, Tile& tile) {
  const auto points = field.points();
  count(*points, tile);
  tile.device = field.deviceName();
  tile.leaves = field.memoryUse().leaves;
  internal::writeFieldFiles(field, *points, folder, options);
  const bool firsts = options.points_las && options.frame.first_returns;
  if (firsts) writeFirsts(*points, folder / kFirstFile);
  writeOrder(internal::FieldAccess::points(field), *points, stepOf, folder / kOrderFile);
  for (const char* file : {kPointsFile, kLasFile, kGridsFile, kPointGridFile, kOrderFile}) {
    if (file == kLasFile && !options.points_las) continue;
    tile.sha256.emplace_back(file, io::sha256OfFile(folder / file));
  }
  if (firsts) tile.sha256.emplace_back(kFirstFile, io::sha256OfFile(folder / kFirstFile));
}

}  // namespace accessvdb::tiles
