// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PLY point clouds, text and binary in both byte orders; also ray clouds, whose nx ny nz lead from the point back to
/// the sensor (CSIRO raycloudtools: start = point + normal; alpha 0 marks a ray that met nothing).
#include <array>
#include <cmath>

#include "accessvdb/error.h"
#include "io/input_file.h"
#include "io/ply_header.h"
#include "io/point_cloud.h"
#include "io/text_lines.h"

namespace accessvdb::io {
namespace {

/// Where the values that we use are among a vertex's properties.
struct VertexColumns {
  static constexpr std::array<const char*, 8> kNames = {"x", "y", "z", "nx", "ny", "nz", "time", "alpha"};
  std::array<std::optional<std::size_t>, 8> property;

  VertexColumns(const PlyElement& vertex, const std::string& subject, bool rays) {
    for (std::size_t i = 0; i < (rays ? kNames.size() : 3); ++i) property[i] = vertex.find(kNames[i]);
    if (rays && !(property[3] && property[4] && property[5]))
      throw InputError("input.no_rays", subject, "is not a ray cloud: its points have no nx ny nz back to the sensor",
                       "Provide poses, or a single sensor position with --sensor-at X,Y,Z");
  }
};

/// Takes the values of one vertex, in the order of VertexColumns::kNames.
void addVertex(const std::array<double, 8>& value, const VertexColumns& columns, bool rays, PointCloud& cloud) {
  if (columns.property[7] && value[7] == 0) {
    ++cloud.unbounded_rays;
    return;
  }
  cloud.points.emplace_back(value[0], value[1], value[2]);
  if (!rays) return;
  cloud.ray_vectors.emplace_back(value[3], value[4], value[5]);
  if (columns.property[6]) cloud.stamps_s.push_back(value[6]);
}

[[noreturn]] void truncated(const std::string& subject, const PlyElement& element, std::uint64_t complete) {
  const bool vertex = element.name == "vertex";
  throw InputError(
      "input.truncated", subject,
      "the header announces " + std::to_string(element.count) + " of '" + wordForMessage(element.name) +
          "' but the file ends after " + std::to_string(complete) + " complete ones",
      vertex ? "Use --allow-truncated to keep " + std::to_string(complete) + " points" : "Copy the file again");
}

/// Reads values of a record that has lists, within bounds.
class BinaryCursor {
 public:
  BinaryCursor(std::string_view body, bool big_endian) : body_(body), big_endian_(big_endian) {}
  /// Moves over one record; false if it is incomplete. @param value  one per property, 0 for lists
  bool next(const PlyElement& element, std::vector<double>* value) {
    std::size_t at = position_;
    for (std::size_t i = 0; i < element.properties.size(); ++i) {
      const PlyProperty& property = element.properties[i];
      const std::size_t bytes = scalarBytes(property.list_length_type.value_or(property.type));
      if (bytes > body_.size() - at) return false;
      const double number =
          loadScalar(body_.data() + at, property.list_length_type.value_or(property.type), big_endian_);
      at += bytes;
      if (!property.list_length_type) {
        if (value != nullptr) (*value)[i] = number;
        continue;
      }
      const auto room = static_cast<double>((body_.size() - at) / scalarBytes(property.type));
      if (!(number >= 0 && number <= room)) return false;
      at += static_cast<std::size_t>(number) * scalarBytes(property.type);
    }
    position_ = at;
    return true;
  }
  bool skip(std::uint64_t bytes_each, std::uint64_t count) {
    const std::size_t left = body_.size() - position_;
    if (bytes_each != 0 && count > left / bytes_each) return false;
    position_ += bytes_each * count;
    return true;
  }
  [[nodiscard]] const char* here() const { return body_.data() + position_; }
  [[nodiscard]] std::size_t left() const { return body_.size() - position_; }

 private:
  std::string_view body_;
  bool big_endian_;
  std::size_t position_ = 0;
};

void readBinary(const PlyHeader& header, std::string_view body, const std::string& subject, const ReadOptions& options,
                const VertexColumns& columns, PointCloud& cloud) {
  const bool big_endian = header.format == PlyHeader::Format::BinaryBigEndian;
  BinaryCursor cursor(body, big_endian);
  for (std::size_t e = 0; e < header.vertex; ++e) {
    const PlyElement& element = header.elements[e];
    if (!element.hasLists()) {
      if (!cursor.skip(element.recordBytes(), element.count)) truncated(subject, element, 0);
      continue;
    }
    for (std::uint64_t i = 0; i < element.count; ++i)
      if (!cursor.next(element, nullptr)) truncated(subject, element, i);
  }
  const PlyElement& vertex = header.elements[header.vertex];
  std::array<double, 8> value = {};
  if (vertex.hasLists()) {
    std::vector<double> values(vertex.properties.size());
    for (std::uint64_t i = 0; i < vertex.count; ++i) {
      if (!cursor.next(vertex, &values)) {
        if (!options.allow_truncated) truncated(subject, vertex, i);
        cloud.truncated_points = vertex.count - i;
        return;
      }
      for (std::size_t c = 0; c < value.size(); ++c) value[c] = columns.property[c] ? values[*columns.property[c]] : 0;
      addVertex(value, columns, options.rays, cloud);
    }
    return;
  }
  const std::uint64_t step = vertex.recordBytes();
  const std::uint64_t points =
      recordsAvailable(subject, vertex.count, step, cursor.left(), options.allow_truncated, cloud.truncated_points);
  std::array<std::uint64_t, 8> offset = {};
  for (std::size_t c = 0; c < offset.size(); ++c)
    for (std::size_t i = 0; columns.property[c] && i < *columns.property[c]; ++i)
      offset[c] += scalarBytes(vertex.properties[i].type);
  cloud.points.reserve(points);
  if (options.rays) cloud.ray_vectors.reserve(points);
  for (std::uint64_t i = 0; i < points; ++i) {
    for (std::size_t c = 0; c < value.size(); ++c)
      if (columns.property[c])
        value[c] =
            loadScalar(cursor.here() + i * step + offset[c], vertex.properties[*columns.property[c]].type, big_endian);
    addVertex(value, columns, options.rays, cloud);
  }
}

void readAscii(const PlyHeader& header, std::string_view body, const std::string& subject, const ReadOptions& options,
               const VertexColumns& columns, PointCloud& cloud) {
  LineReader lines(body, subject);
  std::string_view line;
  std::vector<std::string_view> tokens;
  const auto nextLine = [&] {
    while (lines.next(line))
      if (line.find_first_not_of(" \t") != std::string_view::npos) return true;
    return false;
  };
  for (std::size_t e = 0; e < header.vertex; ++e)
    for (std::uint64_t i = 0; i < header.elements[e].count && !header.elements[e].properties.empty(); ++i)
      if (!nextLine()) truncated(subject, header.elements[e], i);
  const PlyElement& vertex = header.elements[header.vertex];
  if (vertex.hasLists())
    throw InputError("input.unsupported", subject, "is a text PLY whose vertices have list properties",
                     "Save it as binary PLY or without the lists");
  const std::size_t width = vertex.properties.size();
  for (std::uint64_t i = 0; i < vertex.count; ++i) {
    bool complete = nextLine();
    if (complete) {
      splitTokens(line, tokens);
      complete = lines.terminated() || (i + 1 == vertex.count && tokens.size() >= width);
    }
    if (!complete) {
      if (!options.allow_truncated) truncated(subject, vertex, i);
      cloud.truncated_points = vertex.count - i;
      return;
    }
    if (tokens.size() != width)
      lines.fail("of the data has " + std::to_string(tokens.size()) + " values where the header announces " +
                 std::to_string(width));
    std::array<double, 8> value = {};
    for (std::size_t c = 0; c < value.size(); ++c)
      if (columns.property[c] && !parseNumber(tokens[*columns.property[c]], value[c]))
        lines.fail("of the data has a value that is not a number");
    addVertex(value, columns, options.rays, cloud);
  }
}

}  // namespace

PointCloud readPly(const std::filesystem::path& path, const ReadOptions& options) {
  const std::string file = readInputFile(path);
  const std::string subject = forMessage(path.native());
  const PlyHeader header = parsePlyHeader(file, subject);
  const VertexColumns columns(header.elements[header.vertex], subject, options.rays);
  const std::string_view body = std::string_view(file).substr(header.data_offset);
  PointCloud cloud;
  if (header.format == PlyHeader::Format::Ascii) {
    readAscii(header, body, subject, options, columns, cloud);
  } else {
    readBinary(header, body, subject, options, columns, cloud);
  }
  return cloud;
}

}  // namespace accessvdb::io
