// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/pcd_header.h"

#include <algorithm>
#include <map>

#include "accessvdb/error.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

using Tokens = std::vector<std::string_view>;

std::uint64_t countOf(const LineReader& lines, std::string_view token) {
  std::uint64_t value = 0;
  if (!parseCount(token, value)) lines.fail("has '" + wordForMessage(token) + "' where a count is needed");
  return value;
}

ScalarType scalarOf(const LineReader& lines, std::string_view type, std::uint64_t size) {
  static const std::map<std::pair<std::string_view, std::uint64_t>, ScalarType> kTypes = {
      {{"I", 1}, ScalarType::Int8},    {{"U", 1}, ScalarType::Uint8},  {{"I", 2}, ScalarType::Int16},
      {{"U", 2}, ScalarType::Uint16},  {{"I", 4}, ScalarType::Int32},  {{"U", 4}, ScalarType::Uint32},
      {{"I", 8}, ScalarType::Int64},   {{"U", 8}, ScalarType::Uint64}, {{"F", 4}, ScalarType::Float32},
      {{"F", 8}, ScalarType::Float64},
  };
  const char letter = type.size() == 1 ? static_cast<char>(type[0] & ~0x20) : '\0';  // in capitals
  const auto found = kTypes.find({std::string_view(&letter, 1), size});
  if (found == kTypes.end())
    lines.fail("makes a field of TYPE '" + wordForMessage(type) + "' and SIZE " + std::to_string(size));
  return found->second;
}

/// Values of each keyword, kept until all are known, because their order varies.
struct RawHeader {
  std::vector<std::string> names, types;
  std::vector<std::uint64_t> sizes, counts;
  std::optional<std::uint64_t> width, height, points;
};

void layOutRecord(const LineReader& lines, const RawHeader& raw, PcdHeader& header) {
  const std::size_t n = raw.names.size();
  if (n == 0 || raw.sizes.size() != n || raw.types.size() != n || (!raw.counts.empty() && raw.counts.size() != n))
    lines.fail("ends a header whose FIELDS, SIZE, TYPE and COUNT do not have the same number of entries");
  for (std::size_t i = 0; i < n; ++i) {
    PcdField field;
    field.name = raw.names[i];
    field.type = scalarOf(lines, raw.types[i], raw.sizes[i]);
    field.count = raw.counts.empty() ? 1 : raw.counts[i];
    field.first_value = header.record_values;
    field.offset_bytes = header.record_bytes;
    // Drivers of sensors announce padding of COUNT 0: no value.
    if (field.count > kMaxPcdRecordBytes)
      lines.fail("ends a header with COUNT " + std::to_string(field.count) + " for field " +
                 wordForMessage(field.name));
    header.record_values += field.count;
    header.record_bytes += field.count * scalarBytes(field.type);
    if (header.record_bytes > kMaxPcdRecordBytes)
      lines.fail("ends a header whose points take more than " + std::to_string(kMaxPcdRecordBytes) + " bytes each");
    header.fields.push_back(std::move(field));
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string small(1, "xyz"[axis]), capital(1, "XYZ"[axis]);
    auto found = header.fields.end();
    for (const std::string& name : {small, capital})
      if (found == header.fields.end())
        found = std::find_if(header.fields.begin(), header.fields.end(),
                             [&](const PcdField& field) { return field.name == name && field.count > 0; });
    if (found == header.fields.end()) lines.fail("ends a header without a field " + small);
    header.xyz[axis] = static_cast<std::size_t>(found - header.fields.begin());
  }
}

void countPoints(const LineReader& lines, const RawHeader& raw, PcdHeader& header) {
  const std::uint64_t width = raw.width.value_or(0);
  const std::uint64_t height = raw.height.value_or(raw.width ? 1 : 0);
  // Livox recordings of the MLCC project write 0 x 0 and a correct POINTS line.
  const bool has_area = width != 0 && height != 0;
  const bool fits = !has_area || width <= UINT64_MAX / height;
  if (!fits || (has_area && raw.points && *raw.points != width * height))
    lines.fail("ends a header where POINTS " + (raw.points ? std::to_string(*raw.points) : std::string("is missing")) +
                   " is not WIDTH " + std::to_string(width) + " times HEIGHT " + std::to_string(height),
               "Correct the header: one of them counts other points than there are");
  if (!raw.points && !raw.width) lines.fail("ends a header without POINTS and WIDTH");
  header.points = raw.points ? *raw.points : width * height;
}

}  // namespace

PcdHeader parsePcdHeader(std::string_view file, const std::string& subject) {
  LineReader lines(file.substr(0, kMaxPcdHeaderBytes), subject);
  PcdHeader header;
  RawHeader raw;
  std::string_view line;
  Tokens tokens;
  while (lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    std::string key(tokens.front());
    for (char& c : key)
      if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
    const auto single = [&] {
      if (tokens.size() != 2) lines.fail("needs one value after " + wordForMessage(key));
      return tokens[1];
    };
    const auto counts = [&] {
      std::vector<std::uint64_t> values;
      for (std::size_t i = 1; i < tokens.size(); ++i) values.push_back(countOf(lines, tokens[i]));
      return values;
    };
    if (key == "VERSION") {
      continue;
    } else if (key == "FIELDS" || key == "COLUMNS") {
      raw.names.assign(tokens.begin() + 1, tokens.end());
    } else if (key == "SIZE") {
      raw.sizes = counts();
    } else if (key == "TYPE") {
      raw.types.assign(tokens.begin() + 1, tokens.end());
    } else if (key == "COUNT") {
      raw.counts = counts();
    } else if (key == "WIDTH") {
      raw.width = countOf(lines, single());
    } else if (key == "HEIGHT") {
      raw.height = countOf(lines, single());
    } else if (key == "POINTS") {
      raw.points = countOf(lines, single());
    } else if (key == "VIEWPOINT") {
      header.viewpoint.emplace();
      if (tokens.size() != 8) lines.fail("needs 7 numbers after VIEWPOINT");
      for (std::size_t i = 0; i < 7; ++i)
        if (!parseNumber(tokens[i + 1], (*header.viewpoint)[i])) lines.fail("has a VIEWPOINT that is not all numbers");
    } else if (key == "DATA") {
      const std::string kind = inLowerCase(single());
      if (kind == "ascii") {
        header.data = PcdHeader::Data::Ascii;
      } else if (kind == "binary") {
        header.data = PcdHeader::Data::Binary;
      } else if (kind == "binary_compressed") {
        header.data = PcdHeader::Data::BinaryCompressed;
      } else {
        lines.fail("has DATA '" + wordForMessage(kind) + "'", "Supported are ascii, binary and binary_compressed");
      }
      layOutRecord(lines, raw, header);
      countPoints(lines, raw, header);
      if (!lines.terminated()) lines.fail("ends inside the header", "Copy the file again");
      header.data_offset = lines.offset();
      return header;
    } else {
      lines.fail("begins with '" + wordForMessage(tokens.front()) + "', which is not part of a PCD header",
                 "Check that this is a PCD file and not text or a link to the data");
    }
  }
  throw InputError("input.malformed", subject, "is not a PCD file: it has no DATA line",
                   "Check that the file is complete");
}

}  // namespace accessvdb::io
