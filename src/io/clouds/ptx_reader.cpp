// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PTX, the text format of terrestrial scanners: one station behind the other, each a header and a grid of points.
///
///   columns, rows                            a line each
///   scanner's position, then its three axes  a line of three numbers each
///   transform of the points into the world   four lines; for row vectors, so the last one is the translation
///   x y z intensity [r g b]                  columns x rows lines; 0 0 0 is "no return"
///
/// The points are in the frame of the station, or in the world already, with the identity as transform.
#include <Eigen/Geometry>

#include "accessvdb/error.h"
#include "io/clouds/point_cloud.h"
#include "io/poses/pose_checks.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

/// Position and transform are written with millimetres or more; beyond this they say different things.
constexpr double kSamePlace_m = 0.01;

class PtxReader final : public CloudReader {
 public:
  PtxReader(const std::filesystem::path& path, const ReadOptions& options)
      : source_(openFile(path)),
        lines_(*source_, 0, forMessage(path.native())),
        allow_truncated_(options.allow_truncated) {
    if (!readHeader()) throw InputError("input.malformed", lines_.subject(), "has no station", "Check the file");
  }

  PointCloud next(std::size_t count) override {
    PointCloud part;
    while (part.points.size() < count) {
      if (left_ == 0 && !readHeader()) {
        source_->checkAtEnd();
        break;
      }
      if (left_ > 0 && !readPoint(part)) {
        part.truncated_points = left_;
        left_ = 0;
        break;
      }
    }
    return part;
  }
  [[nodiscard]] Place place() const override {
    return {lines_.offset(), left_, lines_.number(), header_byte_, header_line_};
  }
  void seek(const Place& place) override {
    lines_.seek(place.section, place.section_line);
    (void)readHeader();
    lines_.seek(place.byte, place.line);
    left_ = place.record;
  }

 private:
  /// @return false at the end of the file
  bool readHeader() {
    header_byte_ = lines_.offset();
    header_line_ = lines_.number();
    std::string_view line;
    do {
      if (!lines_.next(line)) return false;
      splitTokens(line, tokens_);
    } while (tokens_.empty());
    const std::uint64_t columns = size(), rows = (nextLine("rows"), size());
    if (columns != 0 && rows > UINT64_MAX / columns) lines_.fail("announces more points than there can be");
    Eigen::Matrix3d axes;
    const Eigen::Vector3d position = vector("the scanner's position");
    for (int i = 0; i < 3; ++i) axes.row(i) = vector("an axis of the scanner");
    PoseChecker checker(lines_.subject() + " line " + std::to_string(lines_.number() + 1));
    Eigen::Matrix4d transform;
    for (int i = 0; i < 4; ++i) {
      nextLine("the transform");
      if (tokens_.size() != 4) lines_.fail("does not have the four numbers of the transform");
      for (int k = 0; k < 4; ++k) transform(i, k) = number(static_cast<std::size_t>(k));
    }
    if (!transform.col(3).isApprox(Eigen::Vector4d::UnitW(), 1e-6))
      lines_.fail("ends a transform that is not one of row vectors, with the translation below");
    T_W_P_ = checker.fromMatrix(transform.transpose().topRows<3>(), 0);
    placeScanner(position);
    left_ = columns * rows;
    return true;
  }

  /// Two things say where the scanner was. Points that are in the world already have a transform that says nothing.
  void placeScanner(const Eigen::Vector3d& position) {
    const Eigen::Vector3d by_transform = T_W_P_.translation();
    sensor_W_ = by_transform;
    if (position.isZero(0) || (position - by_transform).norm() <= kSamePlace_m) return;
    if (!T_W_P_.matrix().isIdentity(1e-9))
      throw UnusableInput("ptx.scanner", lines_.subject(),
                          "the station before line " + std::to_string(lines_.number() + 1) +
                              " has its scanner in another place than its transform puts it",
                          "Export it again, with registered stations");
    sensor_W_ = position;
  }

  void nextLine(const char* what) {
    std::string_view line;
    if (!lines_.next(line))
      throw InputError("input.truncated", lines_.subject(),
                       "ends within the header of a station, before " + std::string(what), "Copy the file again");
    lines_.splitNumbers(line, tokens_);
  }
  [[nodiscard]] std::uint64_t size() const {
    std::uint64_t value = 0;
    if (tokens_.size() != 1 || !parseCount(tokens_[0], value) || value > UINT32_MAX)
      lines_.fail("is not the number of columns or rows of a station");
    return value;
  }
  [[nodiscard]] double number(std::size_t i) const {
    double value = 0;
    if (!parseNumber(tokens_[i], value)) lines_.fail("has a value that is not a number");
    return value;
  }
  Eigen::Vector3d vector(const char* what) {
    nextLine(what);
    if (tokens_.size() != 3) lines_.fail("does not have the three numbers of " + std::string(what));
    const Eigen::Vector3d v(number(0), number(1), number(2));
    if (!v.allFinite()) lines_.fail("has a value that is not finite");
    return v;
  }

  /// @return false where the file ends before
  bool readPoint(PointCloud& part) {
    std::string_view line;
    const bool there = lines_.next(line);
    if (there) lines_.splitNumbers(line, tokens_);
    // The last line of a file that was cut off may end inside a number.
    if (!there || (!lines_.terminated() && (left_ > 1 || tokens_.size() < 4))) {
      if (allow_truncated_) return false;
      throw InputError("input.truncated", lines_.subject(),
                       "ends " + std::to_string(left_) + " points before the end of its last station",
                       "Use allow_truncated to keep what there is");
    }
    if (tokens_.size() != 4 && tokens_.size() != 7)
      lines_.fail("has " + std::to_string(tokens_.size()) + " values instead of x y z intensity or these and r g b");
    const Eigen::Vector3d p(number(0), number(1), number(2));
    --left_;
    // No return stays none: a ray without length.
    part.points.push_back(p.isZero(0) ? sensor_W_ : Eigen::Vector3d(T_W_P_ * p));
    part.sensors.push_back(sensor_W_);
    return true;
  }

  std::unique_ptr<ByteSource> source_;
  LineReader lines_;
  std::vector<std::string_view> tokens_;
  bool allow_truncated_;
  std::uint64_t header_byte_ = 0, header_line_ = 0;
  std::uint64_t left_ = 0;  ///< points of the station to come
  Eigen::Isometry3d T_W_P_ = Eigen::Isometry3d::Identity();
  Eigen::Vector3d sensor_W_ = Eigen::Vector3d::Zero();
};

}  // namespace

std::unique_ptr<CloudReader> openPtx(const std::filesystem::path& path, const ReadOptions& options) {
  return std::make_unique<PtxReader>(path, options);
}

}  // namespace accessvdb::io
