// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/results/points_las.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <ostream>
#include <string>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/surface_points.h"
#include "io/results/label_colours.h"
#include "io/results/points_ply.h"
#include "io/results/program_version.h"

namespace accessvdb::internal {
namespace {

static_assert(std::endian::native == std::endian::little, "records are copied directly from memory");

/// Types of the specification's table "Extra Bytes".
enum class ExtraType : std::uint8_t { U8 = 1, U16 = 3, I32 = 6, F32 = 9 };

#pragma pack(push, 1)
struct LasHeader {
  char magic[4] = {'L', 'A', 'S', 'F'};
  std::uint16_t source_id = 0;
  std::uint16_t global_encoding = 1 << 4;  ///< point formats from 6 on require that a frame, if any, is given as WKT
  char guid[16] = {};
  std::uint8_t major = 1, minor = 4;
  char system[32] = "AccessVDB";
  char software[32] = {};
  std::uint16_t day = 0, year = 0;  ///< of the scans, never of the run: the same input gives the same bytes
  std::uint16_t header_bytes = 375;
  std::uint32_t data_offset = 0;
  std::uint32_t records = 1;
  std::uint8_t format = 7;
  std::uint16_t point_bytes = 0;
  std::uint32_t legacy_points = 0, legacy_by_return[5] = {};
  double scale[3] = {};
  double offset[3] = {};
  double max_min[6] = {};  ///< max x, min x, max y ...
  std::uint64_t waveforms = 0, extended_records = 0;
  std::uint32_t extended_count = 0;
  std::uint64_t points = 0, by_return[15] = {};
};
struct RecordHead {
  std::uint16_t reserved = 0;
  char user[16] = "LASF_Spec";
  std::uint16_t id = 4;  ///< extra bytes
  std::uint16_t bytes = 0;
  char description[32] = "Columns of AccessVDB";
};
struct ExtraBytes {
  std::uint8_t reserved[2] = {};
  ExtraType type = ExtraType::U8;
  std::uint8_t options = 0;
  char name[32] = {};
  std::uint8_t unused[4] = {}, no_data[24] = {}, min[24] = {}, max[24] = {};
  double scale[3] = {}, offset[3] = {};
  char description[32] = {};
};
struct LasPoint {
  std::int32_t xyz[3] = {};
  std::uint16_t intensity = 0;
  std::uint8_t returns = 1 | 1 << 4;  ///< the first of one
  std::uint8_t flags = 0, classification = 0, user_data = 0;
  std::int16_t scan_angle = 0;
  std::uint16_t source_id = 0;
  double gps_time = 0;
  std::uint16_t rgb[3] = {};
  // Extra bytes.
  std::uint8_t label = 0, reason = 0;
  std::uint16_t score = 0;
  float confidence = 0, yaw_deg = 0;
};
#pragma pack(pop)
static_assert(sizeof(LasHeader) == 375 && sizeof(RecordHead) == 54 && sizeof(ExtraBytes) == 192);
static_assert(sizeof(LasPoint) == 36 + 12);

struct Column {
  ExtraType type;
  const char* name;
  const char* description;
};
constexpr std::array<Column, 5> kColumns = {{{ExtraType::U8, "label", "0 unscored 1 accessible 2 blocked"},
                                             {ExtraType::U8, "reason", "why it is not accessible"},
                                             {ExtraType::U16, "score", "fewest collisions, 65535 none"},
                                             {ExtraType::F32, "confidence", "0 up to below 1"},
                                             {ExtraType::F32, "yaw", "of the direction, degrees"}}};

/// Dimensions of the point itself: readers do not expect a column of extra bytes of such a name.
constexpr std::string_view kClass = "classification";
constexpr std::array<std::string_view, 22> kDimensions = {"x",
                                                          "y",
                                                          "z",
                                                          "intensity",
                                                          "return_number",
                                                          "number_of_returns",
                                                          "synthetic",
                                                          "key_point",
                                                          "withheld",
                                                          "overlap",
                                                          "scanner_channel",
                                                          "scan_direction_flag",
                                                          "edge_of_flight_line",
                                                          "user_data",
                                                          "scan_angle",
                                                          "scan_angle_rank",
                                                          "point_source_id",
                                                          "gps_time",
                                                          "red",
                                                          "green",
                                                          "blue",
                                                          "classification"};
constexpr std::uint8_t kHasNoData = 1;  // in the options of extra bytes

std::string lower(std::string text) {
  for (char& c : text) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return text;
}

std::string extraName(const std::string& carried) {
  const bool taken = std::find(kDimensions.begin(), kDimensions.end(), lower(carried)) != kDimensions.end();
  return taken ? "carried_" + carried : carried;
}

template <std::size_t kSize>
void copyText(char (&to)[kSize], const std::string& text) {
  std::memcpy(to, text.data(), std::min(kSize, text.size()));
}

template <typename T>
void write(std::ostream& stream, const T& value) {
  stream.write(reinterpret_cast<const char*>(&value), sizeof value);
}

/// A record in front of the points, of at most 65535 bytes.
struct LasRecord {
  const char* user;
  int id;
  const char* description;
  std::string bytes;
};
std::vector<LasRecord> recordsOf(const SurveyFrame& frame) {
  std::vector<LasRecord> records;
  const auto add = [&](int id, const char* description, const std::string& bytes) {
    if (!bytes.empty()) records.push_back({"LASF_Projection", id, description, bytes});
  };
  if (!frame.wkt.empty()) add(2112, "OGC WKT of the scans", frame.wkt + '\0');
  add(34735, "GeoKeys of the scans", frame.geo_keys);
  add(34736, "GeoKeys of the scans: doubles", frame.geo_doubles);
  add(34737, "GeoKeys of the scans: texts", frame.geo_texts);
  for (const LasRecord& record : records) {
    if (record.bytes.size() <= std::numeric_limits<std::uint16_t>::max()) continue;
    throw OutputError("las.crs", "points.las", "cannot hold a coordinate system of over 65535 bytes",
                      "Name it by a code, for example EPSG:32632");
  }
  return records;
}

/// Of extra bytes.
std::size_t columnsOf(const LasContent& content) {
  return kColumns.size() + (content.margins ? 2 : 0) + (content.probability ? 1 : 0) + content.carried.size();
}

LasHeader headerOf(const LasContent& content, const LasGrid& grid) {
  LasHeader header;
  copyText(header.software, std::string("AccessVDB ") + programVersion());
  const SurveyFrame& frame = content.frame;
  const bool keys = !frame.geo_keys.empty() && (frame.wkt.empty() || !frame.wkt_counts);
  header.global_encoding = static_cast<std::uint16_t>((frame.adjusted_gps_time ? 1 : 0) | (keys ? 0 : 1 << 4));
  header.year = frame.year;
  header.day = frame.day;
  const std::vector<LasRecord> records = recordsOf(frame);
  std::size_t bytes = sizeof(LasHeader) + sizeof(RecordHead) + columnsOf(content) * sizeof(ExtraBytes);
  for (const LasRecord& record : records) bytes += sizeof(RecordHead) + record.bytes.size();
  header.records = static_cast<std::uint32_t>(1 + records.size());
  header.data_offset = static_cast<std::uint32_t>(bytes);
  header.point_bytes = static_cast<std::uint16_t>(sizeof(LasPoint) + content.furtherBytes());
  header.points = header.by_return[0] = content.points;
  for (int axis = 0; axis < 3; ++axis) {
    header.scale[axis] = grid.scale[axis];
    header.offset[axis] = grid.origin[axis];
    if (content.points == 0) continue;
    header.max_min[2 * axis] = grid.steps(content.max_W[axis], axis) * grid.scale[axis] + grid.origin[axis];
    header.max_min[2 * axis + 1] = grid.steps(content.min_W[axis], axis) * grid.scale[axis] + grid.origin[axis];
  }
  return header;
}

}  // namespace

LasGrid::LasGrid(const Eigen::Vector3d& origin_W, const SurveyFrame& frame) : unit_m(frame.unit_m) {
  for (int axis = 0; axis < 3; ++axis) {
    // In metres the numbers stay as they are, to the last bit.
    origin[axis] = unit_m[axis] == 1 ? origin_W[axis] : origin_W[axis] / unit_m[axis];
    scale[axis] = unit_m[axis] < 0.5 ? 0.0003 : 0.0001;
  }
}

std::int32_t LasGrid::steps(double x_W, int axis) const {
  const double x = unit_m[axis] == 1 ? x_W : x_W / unit_m[axis];
  const double count = std::round((x - origin[axis]) / scale[axis]);
  if (!(std::abs(count) < std::numeric_limits<std::int32_t>::max())) {
    throw OutputError("output.las_range", "points.las", "cannot store a point farther than some 200 km from the origin",
                      "Use points_format ply");
  }
  return static_cast<std::int32_t>(count);
}

LasWriter::LasWriter(std::ostream& stream, const LasContent& content)
    : stream_(stream),
      grid_(content.origin_W, content.frame),
      margins_(content.margins),
      probability_(content.probability) {
  write(stream_, headerOf(content, grid_));
  for (const LasRecord& record : recordsOf(content.frame)) {
    RecordHead own;
    std::memset(own.user, 0, sizeof own.user);
    std::memset(own.description, 0, sizeof own.description);
    copyText(own.user, record.user);
    copyText(own.description, record.description);
    own.id = static_cast<std::uint16_t>(record.id);
    own.bytes = static_cast<std::uint16_t>(record.bytes.size());
    write(stream_, own);
    stream_.write(record.bytes.data(), static_cast<std::streamsize>(record.bytes.size()));
  }
  RecordHead head;
  head.bytes = static_cast<std::uint16_t>(columnsOf(content) * sizeof(ExtraBytes));
  write(stream_, head);
  const auto describe = [&](const Column& column) {
    ExtraBytes extra;
    extra.type = column.type;
    copyText(extra.name, column.name);
    copyText(extra.description, column.description);
    write(stream_, extra);
  };
  for (const Column& column : kColumns) describe(column);
  if (margins_) {
    describe({ExtraType::F32, "margin_m", "room around the tool, -1 none"});
    describe({ExtraType::F32, "free_arc_deg", "how far the tool can turn"});
  }
  if (probability_) describe({ExtraType::F32, "access_probability", "0 to 1, -1 nothing is said"});
  for (std::size_t n = 0; n < content.carried.size(); ++n) {
    if (lower(content.carried[n]) == kClass) class_ = n;
    ExtraBytes extra;
    extra.type = ExtraType::I32;
    extra.options = kHasNoData;
    copyText(extra.name, extraName(content.carried[n]));
    copyText(extra.description, "of most of the point's returns");
    const std::int64_t none = kNoAttribute;
    std::memcpy(extra.no_data, &none, sizeof none);
    write(stream_, extra);
  }
}

void LasWriter::add(const SurfacePoint& point, std::span<const std::int32_t> carried,
                    const std::optional<FirstReturn>& first) {
  LasPoint record;
  for (int axis = 0; axis < 3; ++axis) record.xyz[axis] = grid_.steps(point.position_W[axis], axis);
  const auto colour = colourOf(point.label);
  for (std::size_t n = 0; n < 3; ++n) record.rgb[n] = static_cast<std::uint16_t>(colour[n] * 257);
  record.label = static_cast<std::uint8_t>(point.label);
  record.reason = static_cast<std::uint8_t>(point.reason);
  record.score = point.score;
  record.confidence = point.confidence;
  record.yaw_deg = static_cast<float>(point.yaw_rad * kDegreesPerRadian);
  if (first) {
    record.gps_time = first->gps_time;
    record.classification = first->point_class;
  }
  if (class_ && carried[*class_] >= 0 && carried[*class_] <= std::numeric_limits<std::uint8_t>::max()) {
    record.classification = static_cast<std::uint8_t>(carried[*class_]);
  }
  write(stream_, record);
  if (margins_) {
    write(stream_, point.margin_m);
    write(stream_, point.free_arc_deg);
  }
  if (probability_) write(stream_, point.access_probability);
  for (const std::int32_t value : carried) write(stream_, value);
}

}  // namespace accessvdb::internal

namespace accessvdb::io {

void writePointsLas(const std::filesystem::path& path, const SurfacePoints& points, const SurveyFrame& frame) {
  internal::LasContent content = {
      points.origin_W(),      {}, {}, points.size(), points.attributeNames(), frame, points.hasMargins(),
      points.hasProbability()};
  Eigen::AlignedBox3d box;
  for (std::size_t n = 0; n < points.size(); ++n) box.extend(points.position_W(n));
  content.min_W = box.min();
  content.max_W = box.max();
  writeFileDurably(path, [&](std::ostream& stream) {
    internal::LasWriter writer(stream, content);
    std::vector<std::int32_t> carried(content.carried.size());
    for (std::size_t n = 0; n < points.size(); ++n) {
      for (std::size_t c = 0; c < carried.size(); ++c) carried[c] = points.attribute(n, c);
      writer.add(points.at(n), carried, points.firstReturn(n));
    }
  });
}

}  // namespace accessvdb::io
