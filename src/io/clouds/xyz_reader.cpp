// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Text with x y z in each line, and more columns that are not used: .xyz, .pts and .asc.
#include "accessvdb/error.h"
#include "io/clouds/point_cloud.h"
#include "io/streams/input_file.h"
#include "io/streams/point_lines.h"

namespace accessvdb::io {
namespace {

class XyzReader final : public CloudReader {
 public:
  XyzReader(const std::filesystem::path& path, const ReadOptions& options)
      : source_(openFile(path)),
        lines_(*source_, 0, forMessage(path.native())),
        points_(lines_),
        allow_truncated_(options.allow_truncated) {}

  PointCloud next(std::size_t count) override {
    PointCloud part;
    Eigen::Vector3d point;
    while (part.points.size() < count) {
      if (!points_.next(point)) {
        finish(part);
        break;
      }
      part.points.push_back(point);
    }
    return part;
  }
  [[nodiscard]] Place place() const override {
    const PointLines::Place at = points_.place();
    return {at.byte, at.points, at.line, at.announced};
  }
  void seek(const Place& place) override { points_.seek({place.byte, place.line, place.record, place.section}); }
  [[nodiscard]] std::vector<std::string> notices(const CloudTotals&) const override {
    if (points_.heading().empty()) return {};
    return {lines_.subject() + ": " + points_.heading()};
  }

 private:
  void finish(PointCloud& part) {
    if (!points_.cutOff()) source_->checkAtEnd();
    points_.refuseDegrees();
    const std::uint64_t announced = points_.announced().value_or(points_.points());
    part.truncated_points = std::max<std::uint64_t>(announced - points_.points(), points_.cutOff() ? 1 : 0);
    if (part.truncated_points == 0 || allow_truncated_) return;
    throw InputError("input.truncated", lines_.subject(),
                     points_.cutOff() ? "the last line (" + std::to_string(lines_.number()) + ") is incomplete"
                                      : "announces " + std::to_string(announced) + " points and has " +
                                            std::to_string(points_.points()),
                     "Use allow_truncated to keep " + std::to_string(points_.points()) + " points");
  }

  std::unique_ptr<ByteSource> source_;
  LineReader lines_;
  PointLines points_;
  bool allow_truncated_;
};

}  // namespace

std::unique_ptr<CloudReader> openXyz(const std::filesystem::path& path, const ReadOptions& options) {
  return std::make_unique<XyzReader>(path, options);
}

}  // namespace accessvdb::io
