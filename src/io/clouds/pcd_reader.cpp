// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PCD point clouds in all three encodings. The body is read here, within checked bounds and in double precision;
/// liblzf decompresses. (PCL's own reader keeps float coordinates and crashes on some damaged files.)
#include <lzf.h>

#include <array>

#include "accessvdb/error.h"
#include "bags/messages.h"
#include "io/clouds/binary_records.h"
#include "io/clouds/pcd_header.h"
#include "io/clouds/point_cloud.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

/// LZF needs at least 3 bytes for a run of at most 264: data that claim a larger ratio are not LZF.
constexpr std::uint64_t kLzfMaxRatio = 88;

/// What the readers of all encodings share.
class PcdReader : public CloudReader {
 public:
  PcdReader(std::unique_ptr<ByteSource> source, PcdHeader header, const std::string& subject,
            const ReadOptions& options)
      : source_(std::move(source)), header_(std::move(header)), subject_(subject), options_(options) {
    for (const std::string_view name : bags::kPointTimeNames)
      for (std::size_t i = 0; options.point_times && !time_ && i < header_.fields.size(); ++i)
        if (header_.fields[i].name == name && header_.fields[i].count == 1) time_ = i;
    std::vector<RecordField> fields;
    for (const PcdField& field : header_.fields) {
      fields.push_back({.name = field.count == 1 ? field.name : "", .offset = field.offset_bytes, .type = field.type});
    }
    carried_ = CarriedFields(fields, options.carry, subject, options.scan);
  }
  [[nodiscard]] const CarriedFields* carried() const override { return &carried_; }
  [[nodiscard]] std::string timeField() const override { return time_ ? header_.fields[*time_].name : std::string(); }
  [[nodiscard]] Place place() const override { return {0, record_, 0}; }
  void seek(const Place& place) override { record_ = place.record; }

 protected:
  [[nodiscard]] std::uint64_t bodyBytes() const { return *source_->size() - header_.data_offset; }

  std::unique_ptr<ByteSource> source_;
  PcdHeader header_;
  std::string subject_;
  ReadOptions options_;
  std::optional<std::size_t> time_;  ///< index into the header's fields
  CarriedFields carried_;            ///< of the header's fields by their number
  std::uint64_t record_ = 0;
};

class TextPcdReader final : public PcdReader {
 public:
  TextPcdReader(std::unique_ptr<ByteSource> source, PcdHeader header, const std::string& subject,
                const ReadOptions& options)
      : PcdReader(std::move(source), std::move(header), subject, options),
        lines_(*source_, header_.data_offset, subject) {}

  PointCloud next(std::size_t count) override {
    PointCloud part;
    while (part.points.size() < count) {
      if (!nextPoint(part)) {
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
  [[nodiscard]] std::uint64_t expectedPoints() const override {
    // A record takes at least one digit and one separator per value.
    return std::min(header_.points - record_, bodyBytes() / (2 * header_.record_values) + 1);
  }

 private:
  bool nextPoint(PointCloud& part) {
    std::string_view line;
    do {
      if (record_ == header_.points || !lines_.next(line)) return false;
    } while (isBlankOrComment(line));
    lines_.splitNumbers(line, tokens_);
    // A truncated file's last line may end inside a number; for the last announced record this cannot be detected.
    const bool last_record = record_ + 1 == header_.points;
    if (!lines_.terminated() && (!last_record || tokens_.size() < header_.record_values)) return false;
    if (tokens_.size() != header_.record_values)
      lines_.fail("of the data has " + std::to_string(tokens_.size()) + " values where the header announces " +
                  std::to_string(header_.record_values));
    Eigen::Vector3d point;
    for (int axis = 0; axis < 3; ++axis)
      if (!parseNumber(tokens_[header_.fields[header_.xyz[axis]].first_value], point[axis]))
        lines_.fail("of the data has a coordinate that is not a number");
    double time = 0;
    if (time_ && !parseNumber(tokens_[header_.fields[*time_].first_value], time))
      lines_.fail("of the data has a time that is not a number");
    part.points.push_back(point);
    if (time_) part.times.push_back(time);
    carried_.appendNumbers(
        [this](std::size_t i) {
          double number = 0;
          if (!parseNumber(tokens_[header_.fields[i].first_value], number))
            lines_.fail("of the data has a value that is not a number");
          return number;
        },
        record_, part.attributes);
    ++record_;
    return true;
  }

  void finish(PointCloud& part) {
    source_->checkAtEnd();
    part.truncated_points = header_.points - record_;
    if (part.truncated_points != 0 && !options_.allow_truncated)
      throw InputError("input.truncated", subject_,
                       "the header announces " + std::to_string(header_.points) + " points but the " +
                           std::to_string(bodyBytes()) + " bytes of text after it contain " + std::to_string(record_) +
                           " complete points",
                       "Use allow_truncated to keep " + std::to_string(record_) + " points");
  }

  LineReader lines_;
  std::vector<std::string_view> tokens_;
};

struct Column {
  std::uint64_t begin = 0, step = 0;
  ScalarType type = ScalarType::Float32;
};

class BinaryPcdReader final : public PcdReader {
 public:
  BinaryPcdReader(std::unique_ptr<ByteSource> source, PcdHeader header, const std::string& subject,
                  const ReadOptions& options)
      : PcdReader(std::move(source), std::move(header), subject, options) {
    records_.begin = header_.data_offset;
    records_.record_bytes = header_.record_bytes;
    records_.count = recordsAvailable(subject_, header_.points, header_.record_bytes, bodyBytes(),
                                      options_.allow_truncated, truncated_points_);
  }

  PointCloud next(std::size_t count) override {
    PointCloud part;
    part.points.resize(records_.countFrom(record_, count));
    const std::uint64_t first = record_;
    std::array<Column, 3> columns;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const PcdField& field = header_.fields[header_.xyz[axis]];
      columns[axis] = {field.offset_bytes, header_.record_bytes, field.type};
    }
    Column time;
    if (time_) {
      time = {header_.fields[*time_].offset_bytes, header_.record_bytes, header_.fields[*time_].type};
      part.times.resize(part.points.size());
    }
    records_.forEach(*source_, record_, part.points.size(), [&](std::uint64_t i, const char* record) {
      for (int axis = 0; axis < 3; ++axis)
        part.points[i - first][axis] = loadScalar(record + columns[axis].begin, columns[axis].type, false);
      if (time_) part.times[i - first] = loadScalar(record + time.begin, time.type, false);
      if (carried_.size() > 0) carried_.append(record, false, i, part.attributes);
    });
    record_ += part.points.size();
    if (part.points.size() < count) {
      source_->checkAtEnd();
      part.truncated_points = truncated_points_;
    }
    return part;
  }
  [[nodiscard]] std::uint64_t expectedPoints() const override { return records_.count - record_; }
  [[nodiscard]] std::vector<std::string> notices(const CloudTotals& totals) const override {
    const std::uint64_t used = totals.points * header_.record_bytes;
    if (totals.truncated_points != 0 || bodyBytes() <= used) return {};
    return {subject_ + ": " + std::to_string(bodyBytes() - used) + " bytes after the last point are ignored"};
  }

 private:
  BinaryRecords records_;
  std::uint64_t truncated_points_ = 0;
};

/// Compressed bodies store field after field, so a part of one has no complete points.
std::string decompressed(const PcdHeader& header, std::string_view body, const std::string& subject) {
  constexpr std::size_t kSizesBytes = 2 * sizeof(std::uint32_t);
  const auto truncated = [&](std::uint64_t wanted) {
    throw InputError("input.truncated", subject,
                     "the compressed data need " + std::to_string(wanted) + " bytes but " +
                         std::to_string(body.size()) + " follow the header: no complete points",
                     "Copy the file again: a part of compressed data cannot be used");
  };
  if (header.points == 0) return {};
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
  return columns_of_all;
}

/// Keeps the decompressed body.
class CompressedPcdReader final : public PcdReader {
 public:
  CompressedPcdReader(std::unique_ptr<ByteSource> source, PcdHeader header, const std::string& subject,
                      const ReadOptions& options)
      : PcdReader(std::move(source), std::move(header), subject, options) {
    columns_of_all_ =
        decompressed(header_, source_->view(header_.data_offset, static_cast<std::size_t>(bodyBytes())), subject_);
    source_->checkAtEnd();
    source_.reset();
  }

  PointCloud next(std::size_t count) override {
    PointCloud part;
    part.points.resize(static_cast<std::size_t>(std::min<std::uint64_t>(count, header_.points - record_)));
    const auto value = [this](const PcdField& field, std::size_t i) {
      return loadScalar(columns_of_all_.data() + field.offset_bytes * header_.points +
                            (record_ + i) * field.count * scalarBytes(field.type),
                        field.type, false);
    };
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const PcdField& field = header_.fields[header_.xyz[axis]];
      for (std::size_t i = 0; i < part.points.size(); ++i)
        part.points[i][static_cast<Eigen::Index>(axis)] = value(field, i);
    }
    for (std::size_t i = 0; time_ && i < part.points.size(); ++i)
      part.times.push_back(value(header_.fields[*time_], i));
    for (std::size_t i = 0; carried_.size() > 0 && i < part.points.size(); ++i)
      carried_.appendNumbers([&](std::size_t field) { return value(header_.fields[field], i); }, record_ + i,
                             part.attributes);
    record_ += part.points.size();
    return part;
  }
  [[nodiscard]] std::uint64_t expectedPoints() const override { return header_.points - record_; }
  [[nodiscard]] std::uint64_t heldBytes() const override { return columns_of_all_.capacity(); }

 private:
  std::string columns_of_all_;
};

}  // namespace

std::unique_ptr<CloudReader> openPcd(const std::filesystem::path& path, const ReadOptions& options) {
  std::unique_ptr<ByteSource> source = openFile(path);
  const std::string subject = forMessage(path.native());
  PcdHeader header = parsePcdHeader(source->view(0, kMaxPcdHeaderBytes), subject);
  switch (header.data) {
    case PcdHeader::Data::Ascii:
      return std::make_unique<TextPcdReader>(std::move(source), std::move(header), subject, options);
    case PcdHeader::Data::Binary:
      return std::make_unique<BinaryPcdReader>(std::move(source), std::move(header), subject, options);
    case PcdHeader::Data::BinaryCompressed:
      return std::make_unique<CompressedPcdReader>(std::move(source), std::move(header), subject, options);
  }
  throw InternalError("internal.pcd_data", subject, "has an unknown encoding");
}

std::optional<std::array<double, 7>> readPcdViewpoint(const std::filesystem::path& path) {
  return parsePcdHeader(readInputFile(path, kMaxPcdHeaderBytes), forMessage(path.native())).viewpoint;
}

}  // namespace accessvdb::io
