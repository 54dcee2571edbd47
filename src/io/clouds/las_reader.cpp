// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// LAS 1.0 to 1.4, point formats 0 to 10: the coordinates, in double precision and in metres, and the GPS time, of the
/// points that are neither deleted nor noise. Waveforms and index files are ignored. LAZ is the same, out of the pipe
/// of a command that decodes it.
#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"
#include "accessvdb/survey_frame.h"
#include "io/clouds/binary_records.h"
#include "io/clouds/decoder_pipe.h"
#include "io/clouds/las_fields.h"
#include "io/clouds/las_header.h"
#include "io/clouds/point_cloud.h"
#include "io/clouds/point_times.h"
#include "io/clouds/scalar_type.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

/// What a record says about its point. Formats 0 to 5 have it in one byte, with the class in five bits.
struct LasPointKind {
  bool synthetic = false, withheld = false;
  int point_class = 0;

  LasPointKind(const char* record, int format) {
    const auto flags = static_cast<unsigned char>(record[15]);
    const bool legacy = format < 6;
    synthetic = (flags & (legacy ? 0x20 : 0x01)) != 0;
    withheld = (flags & (legacy ? 0x80 : 0x04)) != 0;
    point_class = legacy ? flags & 0x1f : static_cast<unsigned char>(record[16]);
  }
  /// 7 is low noise. 18, high noise, is of LAS 1.4, but writers use it in formats 0 to 5 too, where it means nothing.
  [[nodiscard]] bool noise() const { return point_class == 7 || point_class == 18; }
};

/// Longitude and latitude in a file that does not say so: degrees take 1e-7 or less a step, heights do not; and where
/// they do, a scene of metres is thousands of times as high as it is wide.
bool looksGeographic(const LasFileHeader& header) {
  const Eigen::Vector3d extent = header.max - header.min;
  const auto within = [&](int axis, double most) { return header.min[axis] >= -most && header.max[axis] <= most; };
  if (!within(0, 180) || !within(1, 90) || !(header.scale.head<2>().maxCoeff() <= 1e-6)) return false;
  const double wide = extent.head<2>().maxCoeff();
  return wide > 0 && (header.scale[2] >= 100 * header.scale.head<2>().maxCoeff() || extent[2] > 1000 * wide);
}

class LasReader final : public CloudReader {
 public:
  /// @param original  the file that a decoder reads; null if that is the source
  LasReader(std::unique_ptr<ByteSource> source, std::unique_ptr<ByteSource> original, std::string subject,
            const ReadOptions& options)
      : source_(std::move(source)), subject_(std::move(subject)), options_(options) {
    const std::string_view beginning = source_->view(0, kLasHeaderBytes14);
    if (beginning.size() < kLasHeaderBytes14) source_->checkAtEnd();  // a decoder's own error says more
    header_ = parseLasHeader(beginning, source_->size(), subject_);
    if (options_.times && lasTimeOffset(header_.format) == 0)
      throw UnusableInput("input.no_times", subject_,
                          "has point format " + std::to_string(header_.format) + ", whose points have no GPS time",
                          "Export it with GPS time: LAS point format 1, 3 or 6 to 10");
    const auto size = source_->size();
    const std::uint64_t points = size ? available(*size) : header_.points;
    records_ = {header_.data_offset, header_.record_bytes, points};
    const bool has_own = original && original->view(0, 4).substr(0, 4) == "LASF";
    LasProjection projection = readLasProjection(has_own ? *original : *source_);
    if (!options_.crs_wkt.empty()) {  // instead of what the file says
      projection.geo_keys = projection.geo_doubles = projection.geo_texts = std::nullopt;
      projection.wkt = options_.crs_wkt;
      projection.wkt_counts = true;
      projection.cut_off = false;
    }
    toMetres(projection);
    system_ = lasSystem(projection);
    frame_ = frameOf(projection);
    carried_ =
        CarriedFields(lasFields(header_, projection.extra_bytes.value_or("")), options_.carry, subject_, options_.scan);
  }

  PointCloud next(std::size_t count) override {
    PointCloud part;
    // The count in a pipe's header is a promise: memory grows with what arrives.
    const std::size_t expected = records_.countFrom(at_, count);
    part.points.reserve(source_->size() ? expected : std::min<std::size_t>(expected, kReserved));
    while (part.points.size() < count) {
      const std::size_t missing = count - part.points.size();  // some of what comes may be left out
      const std::size_t wanted = records_.countFrom(at_, missing);
      const std::size_t had = records_.forEach(
          *source_, at_, wanted, [&](std::uint64_t row, const char* record) { addPoint(record, row, part); });
      at_ += had;
      if (had == missing) continue;
      source_->checkAtEnd();
      if (had < wanted) records_.count = available(*source_->size());
      part.truncated_points = truncated_points_;
      break;
    }
    return part;
  }
  [[nodiscard]] Place place() const override { return {0, at_, 0}; }
  void seek(const Place& place) override { at_ = place.record; }
  [[nodiscard]] std::uint64_t expectedPoints() const override { return source_->size() ? records_.count - at_ : 0; }
  [[nodiscard]] const SurveyFrame* frame() const override { return &frame_; }
  [[nodiscard]] const CarriedFields* carried() const override { return &carried_; }
  [[nodiscard]] Eigen::Vector3d unit_m() const override { return units_.metres; }
  [[nodiscard]] double step_m() const override { return header_.scale.maxCoeff(); }
  [[nodiscard]] std::string unitDoubt() const override { return units_.doubt; }
  [[nodiscard]] std::string systemDoubt() const override { return system_.doubt; }
  [[nodiscard]] std::vector<std::string> notices(const CloudTotals& totals) const override {
    std::vector<std::string> notices;
    if (!units_.words.empty())
      notices.push_back(subject_ + ": coordinates are in " + units_.words +
                        " and are converted to metres; positions of the sensor given for it are taken to be in the "
                        "same unit");
    if (time_unit_s_.value_or(1) != 1)
      notices.push_back(subject_ + ": times are taken to be in " + inWords(*time_unit_s_));
    if (totals.left_out.all() != 0)
      notices.push_back(subject_ + ": " + totals.left_out.inWords() + " are left out; keep_noise keeps them");
    if (totals.outside_points != 0)
      notices.push_back(subject_ + ": " + std::to_string(totals.outside_points) + " of " +
                        std::to_string(totals.points) +
                        " points are outside the header's bounding box; the file may be damaged");
    return notices;
  }

 private:
  static constexpr std::size_t kReserved = 1 << 16;

  /// Complete records in an input of this size. @throws InputError if some are missing and this was not allowed
  std::uint64_t available(std::uint64_t size) {
    if (size < header_.data_offset) refuseCutHeader(subject_, size, header_.data_offset);
    return recordsAvailable(subject_, header_.points, header_.record_bytes, size - header_.data_offset,
                            options_.allow_truncated, truncated_points_);
  }

  void toMetres(const LasProjection& projection) {
    units_ = lasUnits(projection, subject_);
    if (!projection.geo_keys && !projection.wkt && looksGeographic(header_))
      throw InputError(
          "input.geographic", subject_,
          "does not say what its coordinates are, and they look like longitude and latitude in degrees",
          "Reproject it into metres, for example by pdal translate with filters.reprojection, in_srs EPSG:4326");
    if (units_.words.empty()) return;  // metres: bit for bit as in the file
    for (Eigen::Vector3d* const v : {&header_.scale, &header_.offset, &header_.min, &header_.max})
      *v = v->cwiseProduct(units_.metres);
  }

  [[nodiscard]] SurveyFrame frameOf(const LasProjection& projection) const {
    SurveyFrame frame;
    frame.unit_m = units_.metres;
    if (system_.wkt) frame.wkt = wktText(projection);
    if (system_.keys) {
      frame.geo_keys = projection.geo_keys.value_or("");
      frame.geo_doubles = projection.geo_doubles.value_or("");
      frame.geo_texts = projection.geo_texts.value_or("");
    }
    frame.wkt_counts = system_.wkt && (projection.wkt_counts || !system_.keys);
    frame.year = header_.year;
    frame.day = header_.day;
    frame.adjusted_gps_time = header_.adjusted_gps_time;
    return frame;
  }

  void addPoint(const char* record, std::uint64_t row, PointCloud& part) {
    if (!options_.keep_noise) {
      const LasPointKind kind(record, header_.format);
      if (kind.withheld || kind.synthetic || kind.noise()) {
        ++(kind.withheld ? part.left_out.withheld : kind.synthetic ? part.left_out.synthetic : part.left_out.noise);
        return;
      }
    }
    Eigen::Vector3d point;
    bool inside = true;
    for (int axis = 0; axis < 3; ++axis) {
      const double p = loadScalar<std::int32_t>(record + 4 * axis) * header_.scale[axis] + header_.offset[axis];
      point[axis] = p;
      // The box of the header is rounded to the grid of the coordinates: one step of slack.
      inside = inside && p >= header_.min[axis] - header_.scale[axis] && p <= header_.max[axis] + header_.scale[axis];
    }
    part.points.push_back(point);
    if (carried_.size() > 0) carried_.append(record, false, row, part.attributes);
    part.outside_points += inside ? 0 : 1;
    if (!options_.times) return;
    const auto time = loadScalar<double>(record + lasTimeOffset(header_.format));
    if (!time_unit_s_ && std::isfinite(time) && time != 0) time_unit_s_ = unitOfDate_s(time);
    part.stamps_s.push_back(time_unit_s_.value_or(1) == 1 ? time : time * *time_unit_s_);
  }

  std::unique_ptr<ByteSource> source_;
  std::string subject_;
  ReadOptions options_;
  LasFileHeader header_;
  LasUnits units_;
  LasSystem system_;
  SurveyFrame frame_;
  CarriedFields carried_;
  BinaryRecords records_;
  std::optional<double> time_unit_s_;  ///< by the first time
  std::uint64_t at_ = 0, truncated_points_ = 0;
};

}  // namespace

std::unique_ptr<CloudReader> openLas(const std::filesystem::path& path, const ReadOptions& options) {
  return std::make_unique<LasReader>(openFile(path), nullptr, forMessage(path.native()), options);
}

std::unique_ptr<CloudReader> openLaz(const std::filesystem::path& path, const ReadOptions& options) {
  auto decoded = openDecoder(path, options.laz_command);
  return std::make_unique<LasReader>(std::move(decoded), openFile(path),
                                     forMessage(path.native()) + " (decoded by " + options.laz_command + ")", options);
}

}  // namespace accessvdb::io
