// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/program/segment_file.h"

#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "accessvdb/error.h"
#include "io/clouds/ply_header.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

constexpr std::array<const char*, 4> kSegmentNames = {"segment", "segment_id", "instance", "tree_id"};
constexpr double kMostSegment = 9007199254740992.0;  // 2^53: beyond that, a double does not hold every whole number

/// Where the four values are among a vertex's properties.
struct Columns {
  std::array<std::size_t, 4> property = {};  ///< x y z segment
};

Columns columnsOf(const PlyElement& vertex, const std::string& subject) {
  if (vertex.hasLists()) {
    throw InputError("input.unsupported", subject, "has vertices with list properties", "Save it without the lists");
  }
  Columns columns;
  constexpr std::array<const char*, 3> kPlace = {"x", "y", "z"};
  for (std::size_t axis = 0; axis < kPlace.size(); ++axis) {
    const auto found = vertex.find(kPlace[axis]);
    if (!found) throw InputError("input.malformed", subject, "has vertices without x, y and z", "Save it as points");
    columns.property[axis] = *found;
  }
  for (const char* name : kSegmentNames) {
    if (const auto found = vertex.find(name)) {
      columns.property[3] = *found;
      return columns;
    }
  }
  throw InputError("input.no_segments", subject,
                   "has no segment of each point: none of its properties is named segment, segment_id, instance or "
                   "tree_id",
                   "Export it with whole numbers, 0 for points of no segment");
}

void add(LabelledCloud& cloud, const std::array<double, 4>& value, const std::string& subject) {
  const double segment = value[3];
  if (!(segment >= -kMostSegment && segment <= kMostSegment) || segment != std::floor(segment)) {
    throw InputError("input.malformed", subject,
                     "has a segment that is no whole number, at point " + std::to_string(cloud.segments.size()),
                     "Export segments as whole numbers, 0 for points of no segment");
  }
  cloud.positions_W.emplace_back(value[0], value[1], value[2]);
  cloud.segments.push_back(static_cast<std::int64_t>(segment));
}

[[noreturn]] void endsEarly(const std::string& subject, std::uint64_t announced, std::size_t complete) {
  throw InputError("input.truncated", subject,
                   "announces " + std::to_string(announced) + " points, but ends after " + std::to_string(complete),
                   "Copy the file again");
}

void readText(ByteSource& source, const PlyHeader& header, const Columns& columns, const std::string& subject,
              LabelledCloud& cloud) {
  LineReader lines(source, header.data_offset, subject);
  const PlyElement& vertex = header.elements[header.vertex];
  std::string_view line;
  std::vector<std::string_view> tokens;
  while (cloud.segments.size() < vertex.count) {
    if (!lines.next(line)) endsEarly(subject, vertex.count, cloud.segments.size());
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    std::array<double, 4> value = {};
    bool good = tokens.size() == vertex.properties.size();
    for (std::size_t n = 0; good && n < value.size(); ++n) good = parseNumber(tokens[columns.property[n]], value[n]);
    if (!good) lines.fail("is not the numbers of a vertex");
    add(cloud, value, subject);
  }
}

void readBinary(ByteSource& source, const PlyHeader& header, const Columns& columns, const std::string& subject,
                LabelledCloud& cloud) {
  const PlyElement& vertex = header.elements[header.vertex];
  const std::uint64_t each = vertex.recordBytes(), left = *source.size() - header.data_offset;
  if (vertex.count > left / each) endsEarly(subject, vertex.count, static_cast<std::size_t>(left / each));
  std::array<std::size_t, 4> offset = {};
  for (std::size_t n = 0; n < offset.size(); ++n) {
    for (std::size_t i = 0; i < columns.property[n]; ++i) offset[n] += scalarBytes(vertex.properties[i].type);
  }
  const bool big_endian = header.format == PlyHeader::Format::BinaryBigEndian;
  cloud.positions_W.reserve(vertex.count);
  cloud.segments.reserve(vertex.count);
  for (std::uint64_t record = 0; record < vertex.count; ++record) {
    const std::string_view bytes = source.view(header.data_offset + record * each, each);
    if (bytes.size() < each) endsEarly(subject, vertex.count, record);
    std::array<double, 4> value;
    for (std::size_t n = 0; n < value.size(); ++n) {
      value[n] = loadScalar(bytes.data() + offset[n], vertex.properties[columns.property[n]].type, big_endian);
    }
    add(cloud, value, subject);
  }
}

}  // namespace

std::vector<NamedBox> readBoxes(const std::filesystem::path& path) {
  const std::string file = readInputFile(path);
  LineReader lines(file, forMessage(path.native()));
  std::vector<NamedBox> boxes;
  std::string_view line;
  std::vector<std::string_view> tokens;
  while (lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    std::array<double, 6> value = {};
    bool good = tokens.size() == 7;
    for (std::size_t n = 0; good && n < value.size(); ++n) {
      good = parseNumber(tokens[n + 1], value[n]) && std::isfinite(value[n]);
    }
    for (std::size_t axis = 0; good && axis < 3; ++axis) good = value[axis] <= value[axis + 3];
    if (!good) {
      lines.fail("is not a name and the two corners of a box", "Write 'name xmin ymin zmin xmax ymax zmax', in metres");
    }
    boxes.push_back({std::string(tokens[0]), {value[0], value[1], value[2]}, {value[3], value[4], value[5]}});
  }
  if (boxes.empty()) {
    throw InputError("input.malformed", forMessage(path.native()), "names no box",
                     "Write 'name xmin ymin zmin xmax ymax zmax' on each line, in metres");
  }
  return boxes;
}

LabelledCloud readLabelledCloud(const std::filesystem::path& path) {
  const std::unique_ptr<ByteSource> source = openFile(path);
  const std::string subject = forMessage(path.native());
  const PlyHeader header = parsePlyHeader(*source, subject);
  if (header.vertex != 0) {
    throw InputError("input.unsupported", subject, "has other elements before its vertices", "Save it as points");
  }
  const Columns columns = columnsOf(header.elements[header.vertex], subject);
  LabelledCloud cloud;
  if (header.format == PlyHeader::Format::Ascii) {
    readText(*source, header, columns, subject, cloud);
  } else {
    readBinary(*source, header, columns, subject, cloud);
  }
  return cloud;
}

}  // namespace accessvdb::io
