// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// LAS 1.0 to 1.4, point formats 0 to 10: the coordinates, in double precision, and the GPS time. Variable length
/// records, waveforms and index files are ignored. LAZ is the same, out of the pipe of a command that decodes it.
#include <array>
#include <cmath>

#include "accessvdb/error.h"
#include "io/clouds/binary_records.h"
#include "io/clouds/decoder_pipe.h"
#include "io/clouds/point_cloud.h"
#include "io/clouds/scalar_type.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

constexpr std::uint64_t kHeaderBytes = 227;    ///< up to version 1.2
constexpr std::uint64_t kHeaderBytes14 = 375;  ///< version 1.4
/// Minimum bytes of a record, by point format.
constexpr std::array<std::uint16_t, 11> kFormatBytes = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
/// Where the GPS time is in a record, by point format; 0 = there is none.
constexpr std::array<std::uint8_t, 11> kTimeOffset = {0, 20, 0, 20, 20, 20, 22, 22, 22, 22, 22};

struct LasHeader {
  std::uint64_t points = 0, data_offset = 0, record_bytes = 0;
  int format = 0;
  Eigen::Vector3d scale, offset, min, max;
};

[[noreturn]] void malformed(const std::string& subject, const std::string& problem) {
  throw InputError("input.malformed", subject, problem, "Check the file, for example with lasinfo");
}

[[noreturn]] void cutInHeader(const std::string& subject, std::uint64_t bytes, std::uint64_t needed) {
  throw InputError("input.truncated", subject,
                   "has " + std::to_string(bytes) + " bytes, but its header alone needs " + std::to_string(needed),
                   "Copy the file again");
}

/// @param file  the beginning: kHeaderBytes14, or all of a shorter input
/// @param size  bytes of the whole input, if known
LasHeader parseHeader(std::string_view file, std::optional<std::uint64_t> size, const std::string& subject) {
  if (file.substr(0, 4) != "LASF") malformed(subject, "is not a LAS file: it does not begin with LASF");
  const auto cut = [&](std::uint64_t needed) { cutInHeader(subject, size.value_or(file.size()), needed); };
  if (file.size() < kHeaderBytes) cut(kHeaderBytes);
  const int major = loadScalar<std::uint8_t>(&file[24]), minor = loadScalar<std::uint8_t>(&file[25]);
  if (major != 1 || minor > 4)
    throw InputError("input.unsupported", subject,
                     "is LAS " + std::to_string(major) + "." + std::to_string(minor) + "; supported are 1.0 to 1.4",
                     "Convert it with las2las or pdal translate");
  const std::uint64_t header_bytes = loadScalar<std::uint16_t>(&file[94]);
  const int format = loadScalar<std::uint8_t>(&file[104]);
  LasHeader header;
  header.format = format;
  header.data_offset = loadScalar<std::uint32_t>(&file[96]);
  header.record_bytes = loadScalar<std::uint16_t>(&file[105]);
  header.points = loadScalar<std::uint32_t>(&file[107]);
  if ((format & 0xc0) != 0)
    throw InputError("input.unsupported", subject, "contains compressed points (LAZ)",
                     "Convert it: laszip -i IN.laz -o OUT.las, or pdal translate IN.laz OUT.las");
  if (format > 10)
    throw InputError("input.unsupported", subject,
                     "has point format " + std::to_string(format) + "; supported are 0 to 10",
                     "Convert it with las2las or pdal translate");
  if (header.record_bytes < kFormatBytes[format])
    malformed(subject, "declares that a point of format " + std::to_string(format) + " takes " +
                           std::to_string(header.record_bytes) + " bytes, but it needs " +
                           std::to_string(kFormatBytes[format]));
  const std::uint64_t needed = minor == 4 ? kHeaderBytes14 : kHeaderBytes;
  if (header_bytes < needed || header.data_offset < header_bytes)
    malformed(subject, "has a header of " + std::to_string(header_bytes) + " bytes and points from byte " +
                           std::to_string(header.data_offset) + ", which is impossible");
  if (file.size() < needed) cut(needed);
  if (minor == 4) {
    // Writers of 1.4 may fill only the old 32-bit count.
    const auto points = loadScalar<std::uint64_t>(&file[247]);
    if (points != 0) header.points = points;
  }
  for (int axis = 0; axis < 3; ++axis) {
    header.scale[axis] = loadScalar<double>(&file[131 + 8 * axis]);
    header.offset[axis] = loadScalar<double>(&file[155 + 8 * axis]);
    header.max[axis] = loadScalar<double>(&file[179 + 16 * axis]);
    header.min[axis] = loadScalar<double>(&file[187 + 16 * axis]);
    if (!(header.scale[axis] > 0 && std::isfinite(header.scale[axis])) || !std::isfinite(header.offset[axis]))
      malformed(subject, "has a scale or offset that is not a positive, finite number");
  }
  if (size && header.data_offset > *size) cut(header.data_offset);
  return header;
}

class LasReader final : public CloudReader {
 public:
  LasReader(std::unique_ptr<ByteSource> source, std::string subject, const ReadOptions& options)
      : source_(std::move(source)), subject_(std::move(subject)), options_(options) {
    const std::string_view beginning = source_->view(0, kHeaderBytes14);
    if (beginning.size() < kHeaderBytes14) source_->checkAtEnd();  // a decoder's own error says more
    header_ = parseHeader(beginning, source_->size(), subject_);
    if (options_.times && kTimeOffset[header_.format] == 0)
      throw UnusableInput("input.no_times", subject_,
                          "has point format " + std::to_string(header_.format) + ", whose points have no GPS time",
                          "Export it with GPS time: LAS point format 1, 3 or 6 to 10");
    const auto size = source_->size();
    const std::uint64_t points = size ? available(*size) : header_.points;
    records_ = {header_.data_offset, header_.record_bytes, points};
  }

  PointCloud next(std::size_t count) override {
    PointCloud part;
    const std::size_t wanted = records_.countFrom(at_, count);
    // The count in a pipe's header is a promise: memory grows with what arrives.
    part.points.reserve(source_->size() ? wanted : std::min<std::size_t>(wanted, kReserved));
    const std::size_t had =
        records_.forEach(*source_, at_, wanted, [&](std::uint64_t, const char* record) { addPoint(record, part); });
    at_ += had;
    if (had < count) {
      source_->checkAtEnd();
      if (had < wanted) records_.count = available(*source_->size());
      part.truncated_points = truncated_points_;
    }
    return part;
  }
  [[nodiscard]] Place place() const override { return {0, at_, 0}; }
  void seek(const Place& place) override { at_ = place.record; }
  [[nodiscard]] std::uint64_t expectedPoints() const override { return source_->size() ? records_.count - at_ : 0; }
  [[nodiscard]] std::vector<std::string> notices(const CloudTotals& totals) const override {
    if (totals.outside_points == 0) return {};
    return {subject_ + ": " + std::to_string(totals.outside_points) + " of " + std::to_string(totals.points) +
            " points are outside the header's bounding box; the file may be damaged"};
  }

 private:
  static constexpr std::size_t kReserved = 1 << 16;

  /// Complete records in an input of this size. @throws InputError if some are missing and this was not allowed
  std::uint64_t available(std::uint64_t size) {
    if (size < header_.data_offset) cutInHeader(subject_, size, header_.data_offset);
    return recordsAvailable(subject_, header_.points, header_.record_bytes, size - header_.data_offset,
                            options_.allow_truncated, truncated_points_);
  }

  void addPoint(const char* record, PointCloud& part) const {
    Eigen::Vector3d point;
    bool inside = true;
    for (int axis = 0; axis < 3; ++axis) {
      const double p = loadScalar<std::int32_t>(record + 4 * axis) * header_.scale[axis] + header_.offset[axis];
      point[axis] = p;
      // The box of the header is rounded to the grid of the coordinates: one step of slack.
      inside = inside && p >= header_.min[axis] - header_.scale[axis] && p <= header_.max[axis] + header_.scale[axis];
    }
    part.points.push_back(point);
    part.outside_points += inside ? 0 : 1;
    if (options_.times) part.stamps_s.push_back(loadScalar<double>(record + kTimeOffset[header_.format]));
  }

  std::unique_ptr<ByteSource> source_;
  std::string subject_;
  ReadOptions options_;
  LasHeader header_;
  BinaryRecords records_;
  std::uint64_t at_ = 0, truncated_points_ = 0;
};

}  // namespace

std::unique_ptr<CloudReader> openLas(const std::filesystem::path& path, const ReadOptions& options) {
  return std::make_unique<LasReader>(openFile(path), forMessage(path.native()), options);
}

std::unique_ptr<CloudReader> openLaz(const std::filesystem::path& path, const ReadOptions& options) {
  return std::make_unique<LasReader>(openDecoder(path, options.laz_command),
                                     forMessage(path.native()) + " (decoded by " + options.laz_command + ")", options);
}

}  // namespace accessvdb::io
