// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Source: ASPRS LAS specification 1.4 R15, "Point Data Record" and "Extra Bytes".
#include "io/clouds/las_fields.h"

#include <array>
#include <cmath>
#include <utility>

#include "accessvdb/survey_frame.h"

namespace accessvdb::io {
namespace {

void addColours(std::vector<RecordField>& fields, std::uint64_t at, bool infrared) {
  for (const char* name : {"red", "green", "blue"}) {
    fields.push_back({.name = name, .offset = at, .type = ScalarType::Uint16});
    at += 2;
  }
  if (infrared) fields.push_back({.name = "nir", .offset = at, .type = ScalarType::Uint16});
}

RecordField partOf(const char* name, std::uint64_t byte, unsigned shift, unsigned bits) {
  return {.name = name, .offset = byte, .type = ScalarType::Uint8, .shift = shift, .bits = bits};
}

void addExtraBytes(std::string_view records, std::uint64_t at, std::uint64_t end, std::vector<RecordField>& fields) {
  constexpr std::size_t kRecord = 192;
  /// By the type's number, from 1 on.
  constexpr std::array kTypes = {ScalarType::Uint8,   ScalarType::Int8,   ScalarType::Uint16, ScalarType::Int16,
                                 ScalarType::Uint32,  ScalarType::Int32,  ScalarType::Uint64, ScalarType::Int64,
                                 ScalarType::Float32, ScalarType::Float64};
  for (; records.size() >= kRecord; records.remove_prefix(kRecord)) {
    const auto type = static_cast<unsigned char>(records[2]), options = static_cast<unsigned char>(records[3]);
    if (type == 0) {  // bytes that nobody describes
      at += options;
      continue;
    }
    if (type > 3 * kTypes.size()) return;  // of unknown length
    const ScalarType scalar = kTypes[(type - 1) % kTypes.size()];
    const std::uint64_t bytes =
        scalarBytes(scalar) * ((type - 1) / kTypes.size() + 1);  // arrays of 2 and 3: deprecated
    if (at + bytes > end) return;
    const std::string_view name = records.substr(4, 32);
    RecordField field = {.name = std::string(name.substr(0, name.find('\0'))), .offset = at, .type = scalar};
    if ((options & 1) != 0) {
      const bool real = scalar == ScalarType::Float32 || scalar == ScalarType::Float64;
      const bool positive = scalar == ScalarType::Uint8 || scalar == ScalarType::Uint16 ||
                            scalar == ScalarType::Uint32 || scalar == ScalarType::Uint64;
      const ScalarType stored = real ? ScalarType::Float64 : positive ? ScalarType::Uint64 : ScalarType::Int64;
      field.no_data = loadScalar(&records[40], stored, false);
    }
    if ((options & 8) != 0) field.scale = loadScalar<double>(&records[112]);
    if ((options & 16) != 0) field.offset_of_value = loadScalar<double>(&records[136]);
    if (type <= kTypes.size() && std::isfinite(field.scale) && std::isfinite(field.offset_of_value)) {
      fields.push_back(std::move(field));
    }
    at += bytes;
  }
}

}  // namespace

std::vector<RecordField> lasFields(const LasFileHeader& header, std::string_view extra_bytes) {
  std::vector<RecordField> fields = {{.name = "intensity", .offset = 12, .type = ScalarType::Uint16}};
  if (header.format < 6) {
    for (const RecordField& field : {partOf("return_number", 14, 0, 3), partOf("number_of_returns", 14, 3, 3),
                                     partOf("scan_direction_flag", 14, 6, 1), partOf("edge_of_flight_line", 14, 7, 1),
                                     partOf("classification", 15, 0, 5), partOf("synthetic", 15, 5, 1),
                                     partOf("key_point", 15, 6, 1), partOf("withheld", 15, 7, 1)}) {
      fields.push_back(field);
    }
    fields.push_back({.name = "scan_angle_rank", .offset = 16, .type = ScalarType::Int8});
    fields.push_back({.name = "user_data", .offset = 17, .type = ScalarType::Uint8});
    fields.push_back({.name = "point_source_id", .offset = 18, .type = ScalarType::Uint16});
    if (header.format == 2) addColours(fields, 20, false);
    if (header.format == 3 || header.format == 5) addColours(fields, 28, false);
  } else {
    for (const RecordField& field :
         {partOf("return_number", 14, 0, 4), partOf("number_of_returns", 14, 4, 4), partOf("synthetic", 15, 0, 1),
          partOf("key_point", 15, 1, 1), partOf("withheld", 15, 2, 1), partOf("overlap", 15, 3, 1),
          partOf("scanner_channel", 15, 4, 2), partOf("scan_direction_flag", 15, 6, 1),
          partOf("edge_of_flight_line", 15, 7, 1)}) {
      fields.push_back(field);
    }
    fields.push_back({.name = "classification", .offset = 16, .type = ScalarType::Uint8});
    fields.push_back({.name = "user_data", .offset = 17, .type = ScalarType::Uint8});
    fields.push_back({.name = "scan_angle", .offset = 18, .type = ScalarType::Int16});
    fields.push_back({.name = "point_source_id", .offset = 20, .type = ScalarType::Uint16});
    if (header.format == 7 || header.format == 8 || header.format == 10) {
      addColours(fields, 30, header.format != 7);
    }
  }
  const std::uint64_t time = lasTimeOffset(header.format);
  if (time != 0) {
    fields.push_back({.name = kFirstReturnNames[0], .offset = time, .type = ScalarType::Int32});
    fields.push_back({.name = kFirstReturnNames[1], .offset = time + 4, .type = ScalarType::Int32});
  }
  RecordField point_class = header.format < 6
                                ? partOf(kFirstReturnNames[2], 15, 0, 5)
                                : RecordField{.name = kFirstReturnNames[2], .offset = 16, .type = ScalarType::Uint8};
  fields.push_back(std::move(point_class));
  addExtraBytes(extra_bytes, lasFormatBytes(header.format), header.record_bytes, fields);
  return fields;
}

}  // namespace accessvdb::io
