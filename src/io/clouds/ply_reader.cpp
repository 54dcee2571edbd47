// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PLY point clouds, text and binary in both byte orders; also ray clouds, whose nx ny nz lead from the point back to
/// the sensor (CSIRO raycloudtools: start = point + normal; alpha 0 marks a ray that met nothing).
#include <array>
#include <cmath>
#include <limits>

#include "accessvdb/error.h"
#include "bags/messages.h"
#include "io/clouds/binary_records.h"
#include "io/clouds/ply_header.h"
#include "io/clouds/point_cloud.h"
#include "io/clouds/point_times.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

[[noreturn]] void truncated(const std::string& subject, const PlyElement& element, std::uint64_t complete) {
  const bool vertex = element.name == "vertex";
  throw InputError(
      "input.truncated", subject,
      "the header announces " + std::to_string(element.count) + " of '" + wordForMessage(element.name) +
          "' but the file ends after " + std::to_string(complete) + " complete ones",
      vertex ? "Use allow_truncated to keep " + std::to_string(complete) + " points" : "Copy the file again");
}

/// Names under which programs write the time of a point, the most specific first.
constexpr std::array<const char*, 6> kTimeNames = {"time", "gps_time", "gpstime", "GpsTime", "timestamp", "t"};

/// Where the values that we use are among a vertex's properties.
struct VertexColumns {
  static constexpr std::array<const char*, 8> kNames = {"x", "y", "z", "nx", "ny", "nz", "time", "alpha"};
  static constexpr std::size_t kTime = 6, kAlpha = 7;
  std::array<std::optional<std::size_t>, 8> property;

  VertexColumns(const PlyElement& vertex, const std::string& subject, const ReadOptions& options) {
    for (std::size_t i = 0; i < (options.rays ? kTime : 3); ++i) property[i] = vertex.findAlike(kNames[i]);
    for (std::size_t i = kTime; options.rays && i < kNames.size(); ++i) property[i] = vertex.find(kNames[i]);
    if (options.rays && !(property[3] && property[4] && property[5]))
      throw InputError("input.no_rays", subject, "is not a ray cloud: its points have no nx ny nz back to the sensor",
                       "Provide poses, or a single sensor position with sensor_at_W X,Y,Z");
    if (options.point_times)
      for (const std::string_view name : bags::kPointTimeNames)
        if (!property[kTime] && vertex.find(name) && !vertex.properties[*vertex.find(name)].list_length_type)
          property[kTime] = vertex.find(name);
    if (!options.times) return;
    for (const char* const name : kTimeNames)
      if (!property[kTime]) property[kTime] = vertex.findAlike(name);
    if (!property[kTime])
      throw UnusableInput("input.no_times", subject, "has no time for each point: none of its properties is named time",
                          "Export it with times, as a property 'time' of type double");
    // In float, the seconds of a week are 0.06 s apart and those since 1980 are minutes apart.
    if (vertex.properties[*property[kTime]].type == ScalarType::Float32)
      throw UnusableInput("input.coarse_times", subject,
                          "has times as 32-bit floats, too coarse to look up where the sensor was",
                          "Export it with times of type double");
  }
};

/// All properties but lists, whose values are nothing that a point carries. Their numbers stay those of the properties.
std::vector<RecordField> fieldsOf(const PlyElement& vertex) {
  std::vector<RecordField> fields;
  std::uint64_t offset = 0;
  for (const PlyProperty& property : vertex.properties) {
    fields.push_back(
        {.name = property.list_length_type ? std::string() : property.name, .offset = offset, .type = property.type});
    offset += scalarBytes(property.type);
  }
  return fields;
}

/// What the readers of text and of binary vertices share.
class PlyCloudReader : public CloudReader {
 public:
  PlyCloudReader(std::unique_ptr<ByteSource> source, PlyHeader header, const std::string& subject,
                 const ReadOptions& options)
      : source_(std::move(source)),
        header_(std::move(header)),
        subject_(subject),
        options_(options),
        columns_(vertex(), subject, options),
        carried_(fieldsOf(vertex()), options.carry, subject, options.scan) {}
  [[nodiscard]] const CarriedFields* carried() const override { return &carried_; }
  [[nodiscard]] Place place() const override { return {byte_, record_, 0}; }
  void seek(const Place& place) override {
    byte_ = place.byte;
    record_ = place.record;
  }
  [[nodiscard]] std::string timeField() const override {
    const auto& time = columns_.property[VertexColumns::kTime];
    return options_.point_times && time ? vertex().properties[*time].name : std::string();
  }
  [[nodiscard]] std::vector<std::string> notices(const CloudTotals&) const override {
    if (time_unit_s_.value_or(1) == 1) return {};
    return {subject_ + ": times are taken to be in " + inWords(*time_unit_s_)};
  }

 protected:
  using Values = std::array<double, 8>;  ///< of one vertex, in the order of VertexColumns::kNames

  [[nodiscard]] const PlyElement& vertex() const { return header_.elements[header_.vertex]; }

  /// @return whether it is a point
  bool addVertex(const Values& value, PointCloud& part) {
    if (columns_.property[VertexColumns::kAlpha] && value[VertexColumns::kAlpha] == 0) {
      ++part.unbounded_rays;
      return false;
    }
    part.points.emplace_back(value[0], value[1], value[2]);
    if (options_.rays) part.ray_vectors.emplace_back(value[3], value[4], value[5]);
    if (!columns_.property[VertexColumns::kTime]) return true;
    const double time = value[VertexColumns::kTime];
    if (options_.point_times) {
      part.times.push_back(time);
      return true;
    }
    if (!time_unit_s_ && std::isfinite(time) && time != 0) time_unit_s_ = unitOfDate_s(time);
    part.stamps_s.push_back(time_unit_s_.value_or(1) == 1 ? time : time * *time_unit_s_);
    return true;
  }
  /// The end after all vertices, or after those that there are.
  void finish(PointCloud& part) {
    source_->checkAtEnd();
    part.truncated_points = vertex().count - record_;
  }

  std::unique_ptr<ByteSource> source_;
  PlyHeader header_;
  std::string subject_;
  ReadOptions options_;
  VertexColumns columns_;
  CarriedFields carried_;                ///< of properties by their number, offsets only without lists
  std::uint64_t byte_ = 0, record_ = 0;  ///< where the next vertex is, and its index
  std::optional<double> time_unit_s_;    ///< of dates, by the first one
};

/// Moves over one record that has lists, within bounds. @param value  one per property, 0 for lists; may be null
/// @return the byte after it, or nothing if it is incomplete
std::optional<std::uint64_t> pastRecord(ByteSource& source, std::uint64_t at, const PlyElement& element,
                                        bool big_endian, std::vector<double>* value) {
  for (std::size_t i = 0; i < element.properties.size(); ++i) {
    const PlyProperty& property = element.properties[i];
    const ScalarType type = property.list_length_type.value_or(property.type);
    const std::string_view here = source.view(at, scalarBytes(type));
    if (here.size() < scalarBytes(type)) return std::nullopt;
    const double number = loadScalar(here.data(), type, big_endian);
    at += scalarBytes(type);
    if (!property.list_length_type) {
      if (value != nullptr) (*value)[i] = number;
      continue;
    }
    const auto room = static_cast<double>((*source.size() - at) / scalarBytes(property.type));
    if (!(number >= 0 && number <= room)) return std::nullopt;
    at += static_cast<std::uint64_t>(number) * scalarBytes(property.type);
  }
  return at;
}

class BinaryPlyReader final : public PlyCloudReader {
 public:
  BinaryPlyReader(std::unique_ptr<ByteSource> source, PlyHeader header, const std::string& subject,
                  const ReadOptions& options)
      : PlyCloudReader(std::move(source), std::move(header), subject, options),
        big_endian_(header_.format == PlyHeader::Format::BinaryBigEndian) {
    byte_ = header_.data_offset;
    for (std::size_t e = 0; e < header_.vertex; ++e) skip(header_.elements[e]);
    if (vertex().hasLists()) {
      values_.resize(vertex().properties.size());
      return;
    }
    std::uint64_t missing = 0;
    records_.begin = byte_;
    records_.record_bytes = vertex().recordBytes();
    records_.count = recordsAvailable(subject_, vertex().count, records_.record_bytes, *source_->size() - byte_,
                                      options_.allow_truncated, missing);
    for (std::size_t c = 0; c < offset_.size(); ++c)
      for (std::size_t i = 0; columns_.property[c] && i < *columns_.property[c]; ++i)
        offset_[c] += scalarBytes(vertex().properties[i].type);
  }

  PointCloud next(std::size_t count) override {
    PointCloud part;
    while (part.points.size() < count) {
      // Rays that hit nothing are skipped, so there may be fewer points than records.
      const std::size_t wanted = count - part.points.size();
      if (vertex().hasLists() ? !nextWithLists(part) : !nextRecords(wanted, part)) {
        finish(part);
        break;
      }
    }
    return part;
  }
  [[nodiscard]] std::uint64_t expectedPoints() const override {
    return records_.count - std::min(records_.count, record_);
  }

 private:
  void skip(const PlyElement& element) {
    if (!element.hasLists()) {
      const std::uint64_t left = *source_->size() - byte_, bytes_each = element.recordBytes();
      if (bytes_each != 0 && element.count > left / bytes_each) truncated(subject_, element, 0);
      byte_ += bytes_each * element.count;
      return;
    }
    for (std::uint64_t i = 0; i < element.count; ++i) {
      const auto past = pastRecord(*source_, byte_, element, big_endian_, nullptr);
      if (!past) truncated(subject_, element, i);
      byte_ = *past;
    }
  }

  bool nextRecords(std::size_t wanted, PointCloud& part) {
    const std::size_t here = records_.countFrom(record_, wanted);
    if (here == 0) return false;
    part.points.reserve(part.points.size() + here);
    if (options_.rays) part.ray_vectors.reserve(part.points.size() + here);
    Values value = {};
    records_.forEach(*source_, record_, here, [&](std::uint64_t row, const char* record) {
      for (std::size_t c = 0; c < value.size(); ++c)
        if (columns_.property[c])
          value[c] = loadScalar(record + offset_[c], vertex().properties[*columns_.property[c]].type, big_endian_);
      if (addVertex(value, part) && carried_.size() > 0) carried_.append(record, big_endian_, row, part.attributes);
    });
    record_ += here;
    return true;
  }

  bool nextWithLists(PointCloud& part) {
    if (record_ == vertex().count) return false;
    const auto past = pastRecord(*source_, byte_, vertex(), big_endian_, &values_);
    if (!past) {
      if (!options_.allow_truncated) truncated(subject_, vertex(), record_);
      return false;
    }
    byte_ = *past;
    ++record_;
    Values value;
    for (std::size_t c = 0; c < value.size(); ++c) value[c] = columns_.property[c] ? values_[*columns_.property[c]] : 0;
    if (addVertex(value, part))
      carried_.appendNumbers([this](std::size_t i) { return values_[i]; }, record_ - 1, part.attributes);
    return true;
  }

  bool big_endian_;
  BinaryRecords records_;
  std::array<std::uint64_t, 8> offset_ = {};
  std::vector<double> values_;  ///< of a vertex with lists
};

class TextPlyReader final : public PlyCloudReader {
 public:
  TextPlyReader(std::unique_ptr<ByteSource> source, PlyHeader header, const std::string& subject,
                const ReadOptions& options)
      : PlyCloudReader(std::move(source), std::move(header), subject, options),
        lines_(*source_, header_.data_offset, subject) {
    for (std::size_t e = 0; e < header_.vertex; ++e)
      for (std::uint64_t i = 0; i < header_.elements[e].count && !header_.elements[e].properties.empty(); ++i)
        if (!nextLine()) truncated(subject_, header_.elements[e], i);
    if (vertex().hasLists())
      throw InputError("input.unsupported", subject_, "is a text PLY whose vertices have list properties",
                       "Save it as binary PLY or without the lists");
  }

  PointCloud next(std::size_t count) override {
    PointCloud part;
    while (part.points.size() < count) {
      if (!nextVertex(part)) {
        finish(part);
        break;
      }
    }
    return part;
  }
  [[nodiscard]] Place place() const override { return {lines_.offset(), record_, lines_.number()}; }
  void seek(const Place& place) override {
    lines_.seek(place.byte, place.line);
    record_ = place.record;
  }

 private:
  bool nextLine() {
    while (lines_.next(line_))
      if (line_.find_first_not_of(" \t") != std::string_view::npos) return true;
    return false;
  }

  bool nextVertex(PointCloud& part) {
    if (record_ == vertex().count) return false;
    const std::size_t width = vertex().properties.size();
    bool complete = nextLine();
    if (complete) {
      lines_.splitNumbers(line_, tokens_);
      complete = lines_.terminated() || (record_ + 1 == vertex().count && tokens_.size() >= width);
    }
    if (!complete) {
      if (!options_.allow_truncated) truncated(subject_, vertex(), record_);
      return false;
    }
    if (tokens_.size() != width)
      lines_.fail("of the data has " + std::to_string(tokens_.size()) + " values where the header announces " +
                  std::to_string(width));
    Values value = {};
    for (std::size_t c = 0; c < value.size(); ++c)
      if (columns_.property[c] && !parseNumber(tokens_[*columns_.property[c]], value[c]))
        lines_.fail("of the data has a value that is not a number");
    if (addVertex(value, part)) {
      carried_.appendNumbers(
          [this](std::size_t i) {
            double number = 0;
            if (!parseNumber(tokens_[i], number)) lines_.fail("of the data has a value that is not a number");
            return number;
          },
          record_, part.attributes);
    }
    ++record_;
    return true;
  }

  LineReader lines_;
  std::string_view line_;
  std::vector<std::string_view> tokens_;
};

}  // namespace

std::unique_ptr<CloudReader> openPly(const std::filesystem::path& path, const ReadOptions& options) {
  std::unique_ptr<ByteSource> source = openFile(path);
  const std::string subject = forMessage(path.native());
  PlyHeader header = parsePlyHeader(*source, subject);
  if (header.format == PlyHeader::Format::Ascii)
    return std::make_unique<TextPlyReader>(std::move(source), std::move(header), subject, options);
  return std::make_unique<BinaryPlyReader>(std::move(source), std::move(header), subject, options);
}

}  // namespace accessvdb::io
