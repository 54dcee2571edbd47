// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads our own points.ply back. Every count is checked against the bytes present before memory is allocated.
#include <cmath>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/tool_spec.h"
#include "io/results/points_ply.h"
#include "io/results/row_rules.h"
#include "io/streams/exact_text.h"

namespace accessvdb::io {
namespace {

constexpr std::size_t kMaxHeaderBytes = std::size_t{1} << 20;
constexpr const char* kAdvice = "Use a points.ply written by accessvdb map";

struct FieldPlyHeader {
  std::uint64_t count = 0;
  FieldMetadata metadata;  ///< of the comments, without version, origin and voxel size
  std::optional<Eigen::Vector3d> origin_W;
  std::optional<double> voxel_size_m;
  // Parameters from the comments, if present: they determine what the columns do not contain.
  std::optional<double> num_directions, confidence_half_weight, stability_min;
  internal::PointsPlyColumns columns;
  std::vector<std::string> carried;  ///< names of the last columns

  [[nodiscard]] std::size_t recordBytes() const { return columns.recordBytes(); }
};

std::vector<std::string> wordsOf(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

class PlyReader {
 public:
  explicit PlyReader(const std::filesystem::path& path) : path_(path.string()) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) fail("missing", "is not a readable file");
    size_ = std::filesystem::file_size(path, error);
    stream_.open(path, std::ios::binary);
    if (error || !stream_) fail("unreadable", "cannot be opened");
  }

  /// Its count is that of the records which follow.
  PointsHeader header() {
    header_ = readHeader();
    rules_ = internal::RowRules(header_.columns, header_.metadata);
    if (!header_.origin_W || !header_.voxel_size_m) fail("foreign", "has no origin_W and voxel_size_m of AccessVDB");
    if (!header_.origin_W->allFinite() || !(*header_.voxel_size_m > 0) || !std::isfinite(*header_.voxel_size_m)) {
      fail("malformed", "has an origin or a voxel size that is not a usable number");
    }
    const std::uint64_t rest = size_ - header_bytes_;
    if (header_.count > rest / header_.recordBytes() || header_.count * header_.recordBytes() != rest) {
      fail("truncated", "announces " + std::to_string(header_.count) + " points of " +
                            std::to_string(header_.recordBytes()) + " bytes, but " + std::to_string(rest) +
                            " bytes follow the header");
    }
    return {header_.count, *header_.origin_W, *header_.voxel_size_m, header_.metadata, header_.carried};
  }

  [[nodiscard]] const std::vector<std::string>& carried() const { return header_.carried; }
  [[nodiscard]] const internal::PointsPlyColumns& columns() const { return header_.columns; }

  /// After header(). @param every  points with other numbers than multiples of it are left out
  /// @param take  (point, its record)
  template <typename Take>
  void visit(std::uint64_t every, const Take& take) {
    std::vector<char> block(internal::kPointsPlyRecordsPerBlock * header_.recordBytes());
    for (std::uint64_t done = 0; done < header_.count;) {
      const std::uint64_t records = std::min<std::uint64_t>(internal::kPointsPlyRecordsPerBlock, header_.count - done);
      const auto bytes = static_cast<std::streamsize>(records * header_.recordBytes());
      if (!stream_.read(block.data(), bytes)) fail("truncated", "ends early");
      for (std::uint64_t i = (every - done % every) % every; i < records; i += every) {
        SurfacePoint point =
            parseRecord(block.data() + i * header_.recordBytes(), static_cast<std::uint32_t>(done + i));
        complete(point, header_);
        requireConsistent(point);
        take(point, block.data() + i * header_.recordBytes());
      }
      done += records;
    }
  }

 private:
  [[noreturn]] void fail(const std::string& kind, const std::string& problem) const {
    throw InputError("input." + kind, path_, problem, kAdvice);
  }

  std::string readLine() {
    std::string line;
    for (int c = stream_.get(); c != '\n'; c = stream_.get()) {
      if (c == std::char_traits<char>::eof() || ++header_bytes_ > kMaxHeaderBytes) {
        fail("malformed", "has no complete PLY header");
      }
      line.push_back(static_cast<char>(c));
    }
    ++header_bytes_;
    return line;
  }

  FieldPlyHeader readHeader() {
    FieldPlyHeader header;
    if (readLine() != "ply") fail("malformed", "is not a PLY file");
    if (readLine() != "format binary_little_endian 1.0") fail("foreign", "is not a binary little endian PLY file");
    bool vertices = false;
    std::vector<std::string> properties;
    for (std::string line = readLine(); line != "end_header"; line = readLine()) {
      const auto words = wordsOf(line);
      if (words.size() >= 3 && words[0] == "comment") {
        readComment(words, header);
        const std::size_t name = line.find(words[1]);
        if (words[1] != "AccessVDB" && words[1] != "origin_W" && words[1] != "voxel_size_m") {
          header.metadata.emplace_back(words[1], line.substr(line.find(words[2], name + words[1].size())));
        }
      } else if (words.size() == 3 && words[0] == "element" && words[1] == "vertex" && !vertices) {
        const auto count = internal::numberIn<std::uint64_t>(words[2]);
        if (!count || *count >= INT32_MAX) fail("malformed", "has no usable number of vertices");
        header.count = *count;
        vertices = true;
      } else if (words.size() == 3 && words[0] == "property" && properties.size() < kMostProperties) {
        properties.push_back(words[1] + " " + words[2]);
      } else if (words.empty() || words[0] != "comment") {
        fail("foreign", "has other elements or properties than the points of an accessibility field");
      }
    }
    constexpr std::string_view kCarried = std::string_view(internal::kPointsPlyCarried).substr(9);
    while (!properties.empty() && properties.back().starts_with(kCarried)) {
      header.carried.insert(header.carried.begin(), properties.back().substr(kCarried.size()));
      properties.pop_back();
    }
    const auto columns = columnsOf(properties);
    if (!vertices || !columns)
      fail("foreign", "lacks properties of the points of an accessibility field, or has others");
    header.columns = *columns;
    header.columns.carried = header.carried.size();
    return header;
  }

  static constexpr std::size_t kMostProperties = 64;
  /// @param properties  "type name" of each, in their order
  static std::optional<internal::PointsPlyColumns> columnsOf(const std::vector<std::string>& properties) {
    constexpr internal::PointsPlyColumns kKinds[] = {{},
                                                     {true},
                                                     {true, true},
                                                     {false, false, true},
                                                     {true, false, true},
                                                     {true, true, true},
                                                     {false, false, true, true},
                                                     {true, false, true, true},
                                                     {true, true, true, true}};
    const std::string last = properties.empty() ? "" : properties.back();
    const bool probability =
        last == std::string(internal::kPointsPlyProbability.type) + " " + internal::kPointsPlyProbability.name;
    for (internal::PointsPlyColumns columns : kKinds) {
      columns.probability = probability;
      std::vector<std::string> expected;
      const auto add = [&](const internal::PointProperty& property) {
        expected.push_back(std::string(property.type) + " " + property.name);
      };
      for (const auto& property : internal::kPointsPlyProperties) add(property);
      for (const auto& property : internal::kPointsPlyOrientation) {
        if (columns.orientation) add(property);
      }
      if (columns.roll) add(internal::kPointsPlyRoll);
      for (const auto& property : internal::kPointsPlyTools) {
        if (columns.tools) add(property);
      }
      for (const auto& property : internal::kPointsPlyMargin) {
        if (columns.margin) add(property);
      }
      if (columns.probability) add(internal::kPointsPlyProbability);
      if (properties == expected) return columns;
    }
    return std::nullopt;
  }

  /// Skips values that do not parse; required ones are checked later.
  static void readComment(const std::vector<std::string>& words, FieldPlyHeader& header) {
    // Parameter names begin with their stage: "scoring.confidence_half_weight".
    const std::string name = words[1].substr(words[1].rfind('.') + 1);
    const auto value = internal::numberIn<double>(words[2]);
    if (words[1] == "origin_W" && words.size() == 5) {
      const auto y = internal::numberIn<double>(words[3]), z = internal::numberIn<double>(words[4]);
      if (value && y && z) header.origin_W = Eigen::Vector3d(*value, *y, *z);
    } else if (words.size() != 3) {
      return;
    } else if (words[1] == "voxel_size_m") {
      header.voxel_size_m = value;
    } else if (name == "num_directions") {
      header.num_directions = value;
    } else if (name == "confidence_half_weight") {
      header.confidence_half_weight = value;
    } else if (name == "stability_min") {
      header.stability_min = value;
    }
  }

  SurfacePoint parseRecord(const char* from, std::uint32_t index) const {
    SurfacePoint point = internal::pointOfRecord(from, header_.columns);
    point.id = index;
    // A damaged file must not be taken for data.
    const bool finite = point.position_W.allFinite() && point.normal_W.allFinite() && point.direction_W.allFinite() &&
                        std::isfinite(point.confidence) && std::isfinite(point.stability) &&
                        std::isfinite(point.yaw_rad) && point.orientation_WT.coeffs().allFinite() &&
                        std::isfinite(point.margin_m) && std::isfinite(point.free_arc_deg) &&
                        std::isfinite(point.access_probability);
    if (!finite || static_cast<int>(point.label) >= kNumPointLabels ||
        static_cast<int>(point.reason) >= kNumPointReasons || point.tool >= kMostTools) {
      fail("malformed",
           "contains a non-finite value or an unknown label, reason or tool in point " + std::to_string(index));
    }
    return point;
  }

  void requireConsistent(const SurfacePoint& point) const {
    const char* const why = rules_.contradictionIn(point);
    if (why == nullptr) return;
    throw InputError("input.contradictory", path_,
                     "contradicts itself in point " + std::to_string(point.id) + " (" + name(point.label) + "): " + why,
                     "The file was damaged or changed: copy it again, or run accessvdb map again");
  }

  /// Derives direction index, weight and the confident flag, which are not columns, from the parameters.
  static void complete(SurfacePoint& point, const FieldPlyHeader& header) {
    if (!header.columns.orientation && !point.direction_W.isZero()) {
      // Level, about the vertical.
      const double half_rad = 0.5 * static_cast<double>(point.yaw_rad);
      Eigen::Quaternionf& q = point.orientation_WT;
      q = {static_cast<float>(std::cos(half_rad)), 0, 0, static_cast<float>(std::sin(half_rad))};
      if (q.w() < 0) q.coeffs() = -q.coeffs();
    }
    if (!header.columns.orientation && header.num_directions && !point.direction_W.isZero()) {
      const double step = std::round(point.yaw_rad * internal::kDegreesPerRadian * *header.num_directions / 360.0);
      if (step >= 0 && step < *header.num_directions && step < kNoDirection) {
        point.direction = static_cast<std::uint16_t>(step);
      }
    }
    if (header.confidence_half_weight && point.confidence < 1) {
      const double c = point.confidence;
      point.weight = static_cast<float>(std::round(c * *header.confidence_half_weight / (1 - c)));
    }
    if (header.stability_min) {
      point.confident =
          point.label == PointLabel::Accessible && point.confidence * point.stability > *header.stability_min;
    }
  }

  std::string path_;
  std::ifstream stream_;
  FieldPlyHeader header_;
  internal::RowRules rules_;
  std::uint64_t size_ = 0, header_bytes_ = 0;
};

template <typename T>
T take(const char*& from) {
  T value;
  std::memcpy(&value, from, sizeof(T));
  from += sizeof(T);
  return value;
}

}  // namespace

FieldSnapshot readPointsPly(const std::filesystem::path& path) { return readPointsPly(path, 1); }
FieldSnapshot readPointsPly(const std::filesystem::path& path, std::uint64_t every) {
  every = std::max<std::uint64_t>(every, 1);
  PlyReader reader(path);
  const PointsHeader header = reader.header();
  FieldSnapshot field;
  field.origin_W = header.origin_W;
  field.voxel_size_m = header.voxel_size_m;
  field.points.reserve(header.points / every + 1);
  for (const std::string& name : reader.carried()) field.attributes.push_back({name, {}});
  const internal::PointsPlyColumns columns = reader.columns();
  reader.visit(every, [&](const SurfacePoint& point, const char* record) {
    field.points.push_back(point);
    for (std::size_t c = 0; c < columns.carried; ++c) {
      field.attributes[c].values.push_back(internal::carriedOfRecord(record, columns, c));
    }
  });
  return field;
}

PointsHeader readPointsHeader(const std::filesystem::path& path) { return PlyReader(path).header(); }
PointsHeader visitPoints(const std::filesystem::path& path, const std::function<void(const SurfacePoint&)>& take) {
  return visitCarryingPoints(path, [&](const SurfacePoint& point, std::span<const std::int32_t>) { take(point); });
}
PointsHeader visitCarryingPoints(const std::filesystem::path& path, const TakeCarryingPoint& take) {
  PlyReader reader(path);
  PointsHeader header = reader.header();
  std::vector<std::int32_t> carried(header.attributes.size());
  reader.visit(1, [&](const SurfacePoint& point, const char* record) {
    for (std::size_t c = 0; c < carried.size(); ++c)
      carried[c] = internal::carriedOfRecord(record, reader.columns(), c);
    take(point, carried);
  });
  return header;
}

}  // namespace accessvdb::io

namespace accessvdb::internal {

std::int32_t carriedOfRecord(const char* record, const PointsPlyColumns& columns, std::size_t column) {
  const char* from = record + columns.carriedBegin() + 4 * column;
  return io::take<std::int32_t>(from);
}

SurfacePoint pointOfRecord(const char* from, const PointsPlyColumns& columns) {
  SurfacePoint point;
  for (int axis = 0; axis < 3; ++axis) point.position_W[axis] = io::take<double>(from);
  for (int axis = 0; axis < 3; ++axis) point.normal_W[axis] = io::take<float>(from);
  from += 3;  // the colour, which follows from the label
  point.label = static_cast<PointLabel>(io::take<std::uint8_t>(from));
  point.reason = static_cast<PointReason>(io::take<std::uint8_t>(from));
  point.score = io::take<std::uint16_t>(from);
  point.confidence = io::take<float>(from);
  point.stability = io::take<float>(from);
  for (int axis = 0; axis < 3; ++axis) point.direction_W[axis] = io::take<float>(from);
  point.yaw_rad = static_cast<float>(io::take<float>(from) / kDegreesPerRadian);
  if (columns.orientation) {
    float wxyz[4];
    for (float& part : wxyz) part = io::take<float>(from);
    point.orientation_WT = {wxyz[0], wxyz[1], wxyz[2], wxyz[3]};
    point.direction = io::take<std::uint16_t>(from);
  }
  if (columns.roll) point.roll = io::take<std::uint8_t>(from);
  if (columns.tools) {
    point.tool = io::take<std::uint8_t>(from);
    point.tools = io::take<std::uint32_t>(from);
  }
  if (columns.margin) {
    point.margin_m = io::take<float>(from);
    point.free_arc_deg = io::take<float>(from);
  }
  if (columns.probability) point.access_probability = io::take<float>(from);
  return point;
}

}  // namespace accessvdb::internal
