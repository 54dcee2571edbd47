// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Plain text clouds: x y z at the beginning of each line; what follows on the line is ignored.
#include "accessvdb/error.h"
#include "io/clouds/point_cloud.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

class XyzReader final : public CloudReader {
 public:
  XyzReader(const std::filesystem::path& path, const ReadOptions& options)
      : source_(openFile(path)),
        lines_(*source_, 0, forMessage(path.native())),
        allow_truncated_(options.allow_truncated) {}

  PointCloud next(std::size_t count) override {
    PointCloud part;
    std::string_view line;
    while (part.points.size() < count) {
      if (!lines_.next(line)) {
        source_->checkAtEnd();
        break;
      }
      if (isBlankOrComment(line)) continue;
      splitTokens(line, tokens_);
      if (tokens_.size() < 3 && !lines_.terminated() && points_ != 0) {
        if (!allow_truncated_)
          throw InputError("input.truncated", lines_.subject(),
                           "the last line (" + std::to_string(lines_.number()) + ") is incomplete",
                           "Use allow_truncated to keep " + std::to_string(points_) + " points");
        part.truncated_points = 1;
        break;
      }
      Eigen::Vector3d point;
      bool numbers = tokens_.size() >= 3;
      for (int axis = 0; numbers && axis < 3; ++axis) numbers = parseNumber(tokens_[axis], point[axis]);
      if (!numbers) lines_.fail("does not begin with three numbers");
      part.points.push_back(point);
      ++points_;
    }
    return part;
  }
  [[nodiscard]] Place place() const override { return {lines_.offset(), points_, lines_.number()}; }
  void seek(const Place& place) override {
    lines_.seek(place.byte, place.line);
    points_ = place.record;
  }

 private:
  std::unique_ptr<ByteSource> source_;
  LineReader lines_;
  std::vector<std::string_view> tokens_;
  bool allow_truncated_;
  std::uint64_t points_ = 0;
};

}  // namespace

std::unique_ptr<CloudReader> openXyz(const std::filesystem::path& path, const ReadOptions& options) {
  return std::make_unique<XyzReader>(path, options);
}

}  // namespace accessvdb::io
