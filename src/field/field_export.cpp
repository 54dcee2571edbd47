// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writes a field to its files, with everything in their metadata that describes how it was made.
#include "accessvdb/field_export.h"

#include <tbb/task_arena.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/access_probability.h"
#include "accessvdb/accessibility_field.h"
#include "accessvdb/config.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tsdf_volume.h"
#include "field/field_files.h"
#include "io/results/field_grids.h"

namespace accessvdb {
namespace {

/// With what only files have, because it takes the time of trying further directions.
class PointsWithArcs final : public SurfacePoints {
 public:
  PointsWithArcs(const AccessibilityField& field, const SurfacePoints& points)
      : points_(points), arcs_deg_(points.hasMargins() ? points.size() : 0, -1.0F) {
    std::vector<std::vector<std::uint32_t>> ids(field.tools().size());
    std::vector<std::vector<std::size_t>> places(ids.size());
    for (std::size_t n = 0; n < arcs_deg_.size(); ++n) {
      const SurfacePoint point = points.at(n);
      if (point.label != PointLabel::Accessible) continue;
      ids[point.tool].push_back(point.id);
      places[point.tool].push_back(n);
    }
    for (std::size_t k = 0; k < ids.size(); ++k) {
      if (ids[k].empty()) continue;
      const std::vector<float> arcs_deg = field.freeArcs_deg(ids[k], k);
      for (std::size_t n = 0; n < arcs_deg.size(); ++n) arcs_deg_[places[k][n]] = arcs_deg[n];
    }
  }

  [[nodiscard]] std::size_t size() const override { return points_.size(); }
  [[nodiscard]] SurfacePoint at(std::size_t index) const override {
    SurfacePoint point = points_.at(index);
    if (!arcs_deg_.empty()) point.free_arc_deg = arcs_deg_[index];
    return point;
  }
  [[nodiscard]] Eigen::Vector3d position_W(std::size_t index) const override { return points_.position_W(index); }
  [[nodiscard]] Eigen::Vector3d origin_W() const override { return points_.origin_W(); }
  [[nodiscard]] double voxel_size_m() const override { return points_.voxel_size_m(); }
  [[nodiscard]] bool hasMargins() const override { return points_.hasMargins(); }
  [[nodiscard]] bool hasProbability() const override { return points_.hasProbability(); }
  [[nodiscard]] std::vector<std::string> attributeNames() const override { return points_.attributeNames(); }
  [[nodiscard]] std::int32_t attribute(std::size_t index, std::size_t column) const override {
    return points_.attribute(index, column);
  }
  [[nodiscard]] std::optional<FirstReturn> firstReturn(std::size_t index) const override {
    return points_.firstReturn(index);
  }

 private:
  const SurfacePoints& points_;
  std::vector<float> arcs_deg_;  ///< none without margins
};

/// Version, tool, device and every effective parameter, in a fixed order.
io::FieldMetadata metadataOf(const AccessibilityField& field) {
  const std::vector<ToolSpec>& tools = field.tools();
  io::FieldMetadata metadata = {{"accessvdb_version", ACCESSVDB_VERSION}};
  if (tools.size() == 1) {
    metadata.insert(metadata.end(), {{"tool", field.tool().name()},
                                     {"tool_sha256", field.tool().sha256()},
                                     {"tool_reach_m", std::to_string(field.tool().reach_m())},
                                     {"collision_limit", std::to_string(field.collisionLimit())}});
  } else {
    metadata.emplace_back("tool_sha256", toolListSha256(tools));
  }
  for (std::size_t k = 0; k < tools.size() && tools.size() > 1; ++k) {
    const std::string prefix = std::string("tool_").append(tools[k].name);
    metadata.insert(metadata.end(), {{prefix, tools[k].tool.name()},
                                     {prefix + "_reach_m", std::to_string(tools[k].tool.reach_m())},
                                     {prefix + "_collision_limit", std::to_string(field.collisionLimit(k))}});
  }
  if (field.params().update.policy == UpdatePolicy::Exact) {
    metadata.emplace_back("access_probability", kProbabilityFit);
  }
  metadata.emplace_back("device", field.deviceName());
  const std::string description = describeTools(tools, field.params());
  for (std::size_t begin = 0; begin < description.size();) {
    const std::size_t end = description.find('\n', begin), blank = description.find(' ', begin);
    metadata.emplace_back(description.substr(begin, blank - begin), description.substr(blank + 1, end - blank - 1));
    begin = end + 1;
  }
  return metadata;
}

/// Writing uses as many threads as the field itself.
tbb::task_arena arenaOf(const AccessibilityField& field) {
  const int threads = field.params().threads;
  return tbb::task_arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
}

/// A tile's file holds the leaves of its core alone.
void writeFieldVdb(const std::filesystem::path& file, const AccessibilityField& field, const SurfacePoints& points,
                   const io::WriteOptions& options) {
  const TsdfVolume& volume = field.volume();
  const std::optional<FieldWindow>& tile = field.params().window;
  if (!tile) return io::writeFieldVdb(file, volume, points, metadataOf(field), options);
  const internal::VolumeGrids grids = {[&] { return volume.distance(*tile); }, [&] { return volume.weight(*tile); },
                                       [&] { return volume.cleared(*tile); }};
  internal::writeFieldGrids(file, grids, points, metadataOf(field), options);
}

void writeAll(const AccessibilityField& field, const SurfacePoints& points, const std::filesystem::path& folder,
              const io::WriteOptions& options) {
  io::prepareOutputFolder(folder);
  internal::writeFieldFiles(field, points, folder, options);
}

}  // namespace

void internal::writeFieldFiles(const AccessibilityField& field, const SurfacePoints& field_points,
                               const std::filesystem::path& folder, const io::WriteOptions& options) {
  const PointsWithArcs points(field, field_points);
  const io::FieldMetadata metadata = metadataOf(field);
  arenaOf(field).execute([&] {
    writeFieldVdb(folder / "field.vdb", field, points, options);
    io::writePointsVdb(folder / "field_points.vdb", points, metadata, options);
    io::writePointsPly(folder / "points.ply", points, metadata);
    if (options.points_las) io::writePointsLas(folder / "points.las", points, options.frame);
  });
}

void writeField(const AccessibilityField& field, const std::filesystem::path& folder, const io::WriteOptions& options) {
  io::checkWriteOptions(options);
  writeAll(field, *field.points(), folder, options);
}

void writeFieldUnscored(const AccessibilityField& field, const std::filesystem::path& folder,
                        const io::WriteOptions& options) {
  io::WriteOptions without_surface = options;  // it needs normals, which were on the device
  without_surface.surface = false;
  io::checkWriteOptions(without_surface);
  writeAll(field, *field.unscoredPoints(), folder, without_surface);
}

void writeFieldFrame(const AccessibilityField& field, const std::filesystem::path& file,
                     const io::WriteOptions& options) {
  io::checkWriteOptions(options);
  const auto points = field.points();
  arenaOf(field).execute([&] { writeFieldVdb(file, field, *points, options); });
}

}  // namespace accessvdb
