// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writes a field to its files, with everything in their metadata that describes how it was made.
#include "accessvdb/field_export.h"

#include <tbb/task_arena.h>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/config.h"
#include "accessvdb/surface_points.h"

namespace accessvdb {
namespace {

/// Version, tool, device and every effective parameter, in a fixed order.
io::FieldMetadata metadataOf(const AccessibilityField& field) {
  io::FieldMetadata metadata = {{"accessvdb_version", ACCESSVDB_VERSION},
                                {"tool", field.tool().name()},
                                {"tool_sha256", field.tool().sha256()},
                                {"tool_reach_m", std::to_string(field.tool().reach_m())},
                                {"collision_limit", std::to_string(field.collisionLimit())},
                                {"device", field.deviceName()}};
  const std::string description = field.params().describe();
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

void writeAll(const AccessibilityField& field, const SurfacePoints& points, const std::filesystem::path& folder,
              const io::WriteOptions& options) {
  const io::FieldMetadata metadata = metadataOf(field);
  arenaOf(field).execute([&] {
    io::prepareOutputFolder(folder);
    io::writeFieldVdb(folder / "field.vdb", field.volume(), points, metadata, options);
    io::writePointsVdb(folder / "field_points.vdb", points, metadata, options);
    io::writePointsPly(folder / "points.ply", points, metadata);
  });
}

}  // namespace

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
  arenaOf(field).execute([&] { io::writeFieldVdb(file, field.volume(), *points, metadataOf(field), options); });
}

}  // namespace accessvdb
