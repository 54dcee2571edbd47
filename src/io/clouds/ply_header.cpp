// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/ply_header.h"

#include <algorithm>
#include <map>

#include "accessvdb/error.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

constexpr std::size_t kMaxProperties = 1024;

ScalarType scalarOf(const LineReader& lines, std::string_view name) {
  static const std::map<std::string_view, ScalarType> kTypes = {
      {"char", ScalarType::Int8},      {"int8", ScalarType::Int8},       {"uchar", ScalarType::Uint8},
      {"uint8", ScalarType::Uint8},    {"short", ScalarType::Int16},     {"int16", ScalarType::Int16},
      {"ushort", ScalarType::Uint16},  {"uint16", ScalarType::Uint16},   {"int", ScalarType::Int32},
      {"int32", ScalarType::Int32},    {"uint", ScalarType::Uint32},     {"uint32", ScalarType::Uint32},
      {"float", ScalarType::Float32},  {"float32", ScalarType::Float32}, {"double", ScalarType::Float64},
      {"float64", ScalarType::Float64}};
  const auto found = kTypes.find(name);
  if (found == kTypes.end()) lines.fail("has the unknown type '" + wordForMessage(name) + "'");
  return found->second;
}

void addProperty(const LineReader& lines, const std::vector<std::string_view>& tokens, PlyHeader& header) {
  if (header.elements.empty()) lines.fail("has a property before any element");
  PlyProperty property;
  if (tokens.size() == 5 && tokens[1] == "list") {
    property.list_length_type = scalarOf(lines, tokens[2]);
    if (*property.list_length_type >= ScalarType::Float32) lines.fail("has a list whose length is not a whole number");
    property.type = scalarOf(lines, tokens[3]);
  } else if (tokens.size() == 3) {
    property.type = scalarOf(lines, tokens[1]);
  } else {
    lines.fail("is not a valid property");
  }
  property.name = tokens.back();
  auto& properties = header.elements.back().properties;
  if (properties.size() == kMaxProperties) lines.fail("exceeds the limit on properties");
  properties.push_back(std::move(property));
}

void checkVertex(const LineReader& lines, PlyHeader& header) {
  const auto found = std::find_if(header.elements.begin(), header.elements.end(),
                                  [](const PlyElement& element) { return element.name == "vertex"; });
  if (found == header.elements.end()) lines.fail("ends a header without an element vertex");
  header.vertex = static_cast<std::size_t>(found - header.elements.begin());
  for (const char* axis : {"x", "y", "z"})
    if (!found->findAlike(axis)) lines.fail(std::string("ends a header whose vertices have no property ") + axis);
}

PlyHeader parseLines(LineReader lines) {
  std::string_view line;
  std::vector<std::string_view> tokens;
  if (!lines.next(line) || inLowerCase(line) != "ply")
    throw InputError("input.malformed", lines.subject(), "is not a PLY file: the first line is not 'ply'",
                     "Check the file");
  PlyHeader header;
  bool has_format = false;
  while (lines.next(line)) {
    splitTokens(line, tokens);
    if (tokens.empty() || tokens[0] == "comment" || tokens[0] == "obj_info") continue;
    if (tokens[0] == "format") {
      static const std::map<std::string_view, PlyHeader::Format> kFormats = {
          {"ascii", PlyHeader::Format::Ascii},
          {"binary_little_endian", PlyHeader::Format::BinaryLittleEndian},
          {"binary_big_endian", PlyHeader::Format::BinaryBigEndian}};
      const auto found = tokens.size() >= 2 ? kFormats.find(tokens[1]) : kFormats.end();
      if (found == kFormats.end()) lines.fail("has an unknown format");
      header.format = found->second;
      has_format = true;
    } else if (tokens[0] == "element") {
      PlyElement element;
      if (tokens.size() != 3 || !parseCount(tokens[2], element.count)) lines.fail("is not an element with a count");
      element.name = tokens[1];
      header.elements.push_back(std::move(element));
    } else if (tokens[0] == "property") {
      addProperty(lines, tokens, header);
    } else if (tokens[0] == "end_header" && lines.terminated()) {
      if (!has_format) lines.fail("ends a header without a format");
      checkVertex(lines, header);
      header.data_offset = lines.offset();
      return header;
    } else {
      lines.fail("begins with '" + wordForMessage(tokens[0]) + "', which is not part of a PLY header");
    }
  }
  throw InputError("input.malformed", lines.subject(), "ends inside the header", "Copy the file again");
}

}  // namespace

bool PlyElement::hasLists() const {
  return std::any_of(properties.begin(), properties.end(),
                     [](const auto& p) { return p.list_length_type.has_value(); });
}

std::uint64_t PlyElement::recordBytes() const {
  std::uint64_t bytes = 0;
  for (const PlyProperty& property : properties) bytes += scalarBytes(property.type);
  return bytes;
}

std::optional<std::size_t> PlyElement::find(std::string_view property) const {
  for (std::size_t i = 0; i < properties.size(); ++i)
    if (properties[i].name == property && !properties[i].list_length_type) return i;
  return std::nullopt;
}

std::optional<std::size_t> PlyElement::findAlike(std::string_view property) const {
  if (const auto same = find(property)) return same;
  const std::string wanted = inLowerCase(property);
  for (std::size_t i = 0; i < properties.size(); ++i) {
    const std::string there = inLowerCase(properties[i].name);
    if ((there == wanted || there == "scalar_" + wanted) && !properties[i].list_length_type) return i;
  }
  return std::nullopt;
}

PlyHeader parsePlyHeader(std::string_view file, const std::string& subject) { return parseLines({file, subject}); }

PlyHeader parsePlyHeader(ByteSource& file, const std::string& subject) { return parseLines({file, 0, subject}); }

}  // namespace accessvdb::io
