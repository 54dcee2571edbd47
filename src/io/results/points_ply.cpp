// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writing points.ply: binary, little endian, world positions as doubles, so that UTM coordinates keep their
/// millimetres.
#include "io/results/points_ply.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <ostream>
#include <vector>

#include "accessvdb/field_io.h"
#include "accessvdb/surface_points.h"
#include "io/results/label_colours.h"
#include "io/results/program_version.h"
#include "io/streams/exact_text.h"

namespace accessvdb::io {
namespace {

static_assert(std::endian::native == std::endian::little, "records are copied directly from memory");

/// A header comment is one line of printable text.
std::string oneLine(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return text;
}

void writeHeader(std::ostream& stream, const SurfacePoints& points, const FieldMetadata& metadata) {
  stream << "ply\nformat binary_little_endian 1.0\n";
  stream << "comment AccessVDB " << internal::programVersion() << "\n";
  stream << "comment origin_W " << internal::exactText(points.origin_W().x()) << " "
         << internal::exactText(points.origin_W().y()) << " " << internal::exactText(points.origin_W().z()) << "\n";
  stream << "comment voxel_size_m " << internal::exactText(points.voxel_size_m()) << "\n";
  for (const auto& [name, text] : metadata) {
    if (name.empty() || name == "origin_W" || name == "voxel_size_m") continue;
    stream << "comment " << oneLine(name) << " " << oneLine(text) << "\n";
  }
  stream << "element vertex " << std::to_string(points.size()) << "\n";
  for (const auto& property : internal::kPointsPlyProperties) {
    stream << "property " << property.type << " " << property.name << "\n";
  }
  const internal::PointsPlyColumns columns = internal::pointsPlyColumns(metadata);
  for (const auto& property : internal::kPointsPlyOrientation) {
    if (columns.orientation) stream << "property " << property.type << " " << property.name << "\n";
  }
  if (columns.roll) {
    stream << "property " << internal::kPointsPlyRoll.type << " " << internal::kPointsPlyRoll.name << "\n";
  }
  for (const auto& property : internal::kPointsPlyTools) {
    if (columns.tools) stream << "property " << property.type << " " << property.name << "\n";
  }
  for (const auto& property : internal::kPointsPlyMargin) {
    if (columns.margin) stream << "property " << property.type << " " << property.name << "\n";
  }
  if (columns.probability) {
    stream << "property " << internal::kPointsPlyProbability.type << " " << internal::kPointsPlyProbability.name
           << "\n";
  }
  for (const std::string& name : points.attributeNames()) stream << internal::kPointsPlyCarried << name << "\n";
  stream << "end_header\n";
}

template <typename T>
char* put(char* to, const T& value) {
  std::memcpy(to, &value, sizeof(T));
  return to + sizeof(T);
}

char* putRecord(char* to, const SurfacePoint& point, const internal::PointsPlyColumns& columns) {
  for (int axis = 0; axis < 3; ++axis) to = put(to, point.position_W[axis]);
  for (int axis = 0; axis < 3; ++axis) to = put(to, point.normal_W[axis]);
  to = put(to, internal::colourOf(point.label));
  to = put(to, static_cast<std::uint8_t>(point.label));
  to = put(to, static_cast<std::uint8_t>(point.reason));
  to = put(to, point.score);
  to = put(to, point.confidence);
  to = put(to, point.stability);
  for (int axis = 0; axis < 3; ++axis) to = put(to, point.direction_W[axis]);
  to = put(to, static_cast<float>(point.yaw_rad * internal::kDegreesPerRadian));
  if (columns.orientation) {
    const Eigen::Quaternionf& q = point.orientation_WT;
    for (const float part : {q.w(), q.x(), q.y(), q.z()}) to = put(to, part);
    to = put(to, point.direction);
  }
  if (columns.roll) to = put(to, point.roll);
  if (columns.tools) to = put(put(to, point.tool), point.tools);
  if (columns.margin) to = put(put(to, point.margin_m), point.free_arc_deg);
  return columns.probability ? put(to, point.access_probability) : to;
}

}  // namespace

void writePointsPly(const std::filesystem::path& path, const SurfacePoints& points, const FieldMetadata& metadata) {
  writeFileDurably(path, [&](std::ostream& stream) {
    writeHeader(stream, points, metadata);
    internal::PointsPlyColumns columns = internal::pointsPlyColumns(metadata);
    columns.carried = points.attributeNames().size();
    std::vector<char> block(internal::kPointsPlyRecordsPerBlock * columns.recordBytes());
    char* to = block.data();
    for (std::size_t n = 0; n < points.size(); ++n) {
      to = putRecord(to, points.at(n), columns);
      for (std::size_t c = 0; c < columns.carried; ++c) to = put(to, points.attribute(n, c));
      if (to == block.data() + block.size()) {
        stream.write(block.data(), static_cast<std::streamsize>(block.size()));
        to = block.data();
      }
    }
    stream.write(block.data(), to - block.data());
  });
}

void writePointsPly(const std::filesystem::path& path, const FieldSnapshot& field, const FieldMetadata& metadata) {
  writePointsPly(path, SnapshotPoints(field), metadata);
}

}  // namespace accessvdb::io

namespace accessvdb::internal {

PointsPlyColumns pointsPlyColumns(const io::FieldMetadata& metadata) {
  const auto has = [&](const char* name) {
    return std::any_of(metadata.begin(), metadata.end(), [&](const auto& entry) { return entry.first == name; });
  };
  return {has("orientations"),
          has("orientations") && has("rolls"),
          has("tools"),
          has("margins_m"),
          has(kProbabilityFitKey),
          0};
}

}  // namespace accessvdb::internal
