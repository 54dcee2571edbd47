// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PCD point clouds in all three encodings. The body is read here, within checked bounds and in double precision;
/// liblzf decompresses. (PCL's own reader keeps float coordinates and crashes on some damaged files.)
#include <lzf.h>

#include <array>

#include "accessvdb/error.h"
#include "io/input_file.h"
#include "io/pcd_header.h"
#include "io/point_cloud.h"
#include "io/text_lines.h"

namespace accessvdb::io {
namespace {

/// LZF needs at least 3 bytes for a run of at most 264: data that claim a larger ratio are not LZF.
constexpr std::uint64_t kLzfMaxRatio = 88;

void readAscii(const PcdHeader& header, std::string_view body, const std::string& subject, const ReadOptions& options,
               PointCloud& cloud) {
  // A record takes at least one digit and one separator per value.
  cloud.points.reserve(std::min(header.points, body.size() / (2 * header.record_values) + 1));
  LineReader lines(body, subject);
  std::string_view line;
  std::vector<std::string_view> tokens;
  bool cut = false;
  while (cloud.points.size() < header.points && !cut && lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    // A truncated file's last line may end inside a number; for the last announced record this cannot be detected.
    const bool last_record = cloud.points.size() + 1 == header.points;
    cut = !lines.terminated() && (!last_record || tokens.size() < header.record_values);
    if (cut) break;
    if (tokens.size() != header.record_values)
      lines.fail("of the data has " + std::to_string(tokens.size()) + " values where the header announces " +
                 std::to_string(header.record_values));
    Eigen::Vector3d point;
    for (int axis = 0; axis < 3; ++axis)
      if (!parseNumber(tokens[header.fields[header.xyz[axis]].first_value], point[axis]))
        lines.fail("of the data has a coordinate that is not a number");
    cloud.points.push_back(point);
  }
  cloud.truncated_points = header.points - cloud.points.size();
  if (cloud.truncated_points != 0 && !options.allow_truncated)
    throw InputError("input.truncated", subject,
                     "the header announces " + std::to_string(header.points) + " points but the " +
                         std::to_string(body.size()) + " bytes of text after it contain " +
                         std::to_string(cloud.points.size()) + " complete points",
                     "Use --allow-truncated to keep " + std::to_string(cloud.points.size()) + " points");
}

struct Column {
  std::uint64_t begin, step;
  ScalarType type;
};

void readColumns(const char* body, std::uint64_t points, const std::array<Column, 3>& columns, PointCloud& cloud) {
  cloud.points.resize(points);
  for (std::uint64_t i = 0; i < points; ++i)
    for (int axis = 0; axis < 3; ++axis)
      cloud.points[i][axis] =
          loadScalar(body + columns[axis].begin + i * columns[axis].step, columns[axis].type, false);
}

void readBinary(const PcdHeader& header, std::string_view body, const std::string& subject, const ReadOptions& options,
                PointCloud& cloud) {
  const std::uint64_t points = recordsAvailable(subject, header.points, header.record_bytes, body.size(),
                                                options.allow_truncated, cloud.truncated_points);
  std::array<Column, 3> columns;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const PcdField& field = header.fields[header.xyz[axis]];
    columns[axis] = {field.offset_bytes, header.record_bytes, field.type};
  }
  readColumns(body.data(), points, columns, cloud);
  if (cloud.truncated_points == 0 && body.size() > points * header.record_bytes)
    cloud.notices.push_back(subject + ": " + std::to_string(body.size() - points * header.record_bytes) +
                            " bytes after the last point are ignored");
}

/// Compressed bodies store field after field, so a part of one has no complete points.
void readCompressed(const PcdHeader& header, std::string_view body, const std::string& subject, PointCloud& cloud) {
  constexpr std::size_t kSizesBytes = 2 * sizeof(std::uint32_t);
  const auto truncated = [&](std::uint64_t wanted) {
    throw InputError("input.truncated", subject,
                     "the compressed data need " + std::to_string(wanted) + " bytes but " +
                         std::to_string(body.size()) + " follow the header: no complete points",
                     "Copy the file again: a part of compressed data cannot be used");
  };
  if (header.points == 0) return;
  if (body.size() < kSizesBytes) truncated(kSizesBytes);
  const std::uint64_t packed = loadScalar<std::uint32_t>(body.data());
  const std::uint64_t unpacked = loadScalar<std::uint32_t>(body.data() + sizeof(std::uint32_t));
  if (packed > body.size() - kSizesBytes) truncated(packed + kSizesBytes);
  if (header.points > unpacked || header.points * header.record_bytes != unpacked || packed == 0 ||
      unpacked > packed * kLzfMaxRatio)
    throw InputError("input.malformed", subject,
                     "the header announces " + std::to_string(header.points) + " points of " +
                         std::to_string(header.record_bytes) + " bytes but the compressed data claim to be " +
                         std::to_string(unpacked) + " bytes from " + std::to_string(packed),
                     "Copy the file again");
  std::string columns_of_all(unpacked, '\0');
  if (lzf_decompress(body.data() + kSizesBytes, static_cast<unsigned>(packed), columns_of_all.data(),
                     static_cast<unsigned>(unpacked)) != unpacked)
    throw InputError("input.malformed", subject, "the compressed data are damaged", "Copy the file again");
  std::array<Column, 3> columns;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const PcdField& field = header.fields[header.xyz[axis]];
    columns[axis] = {field.offset_bytes * header.points, field.count * scalarBytes(field.type), field.type};
  }
  readColumns(columns_of_all.data(), header.points, columns, cloud);
}

}  // namespace

PointCloud readPcd(const std::filesystem::path& path, const ReadOptions& options) {
  const std::string file = readInputFile(path);
  const std::string subject = forMessage(path.native());
  const PcdHeader header = parsePcdHeader(file, subject);
  const std::string_view body = std::string_view(file).substr(header.data_offset);
  PointCloud cloud;
  switch (header.data) {
    case PcdHeader::Data::Ascii:
      readAscii(header, body, subject, options, cloud);
      break;
    case PcdHeader::Data::Binary:
      readBinary(header, body, subject, options, cloud);
      break;
    case PcdHeader::Data::BinaryCompressed:
      readCompressed(header, body, subject, cloud);
      break;
  }
  return cloud;
}

std::optional<std::array<double, 7>> readPcdViewpoint(const std::filesystem::path& path) {
  return parsePcdHeader(readInputFile(path, kMaxPcdHeaderBytes), forMessage(path.native())).viewpoint;
}

}  // namespace accessvdb::io
