// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// KITTI velodyne scans: float32 x y z reflectance, no header.
#include "accessvdb/error.h"
#include "io/clouds/binary_records.h"
#include "io/clouds/point_cloud.h"
#include "io/clouds/scalar_type.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

constexpr std::uint64_t kRecordBytes = 4 * sizeof(float);

class KittiBinReader final : public CloudReader {
 public:
  KittiBinReader(const std::filesystem::path& path, const ReadOptions& options) : source_(openFile(path)) {
    const std::uint64_t bytes = *source_->size();
    const std::uint64_t points = bytes / kRecordBytes;
    records_ = {0, kRecordBytes, points};
    if (bytes % kRecordBytes == 0) return;
    if (!options.allow_truncated)
      throw InputError("input.truncated", forMessage(path.native()),
                       std::to_string(bytes) + " bytes is not a multiple of 16 (record " + std::to_string(points) +
                           ", byte " + std::to_string(points * kRecordBytes) + ")",
                       "Use allow_truncated to keep " + std::to_string(points) + " complete points");
    truncated_points_ = 1;
  }

  PointCloud next(std::size_t count) override {
    PointCloud part;
    const std::uint64_t first = at_;
    part.points.resize(records_.countFrom(at_, count));
    records_.forEach(*source_, at_, part.points.size(), [&](std::uint64_t i, const char* record) {
      for (int axis = 0; axis < 3; ++axis)
        part.points[i - first][axis] = loadScalar<float>(record + axis * sizeof(float));
    });
    at_ += part.points.size();
    if (part.points.size() < count) {
      source_->checkAtEnd();
      part.truncated_points = truncated_points_;
    }
    return part;
  }
  [[nodiscard]] Place place() const override { return {0, at_, 0}; }
  void seek(const Place& place) override { at_ = place.record; }
  [[nodiscard]] std::uint64_t expectedPoints() const override { return records_.count - at_; }

 private:
  std::unique_ptr<ByteSource> source_;
  BinaryRecords records_;
  std::uint64_t at_ = 0, truncated_points_ = 0;
};

}  // namespace

std::unique_ptr<CloudReader> openKittiBin(const std::filesystem::path& path, const ReadOptions& options) {
  return std::make_unique<KittiBinReader>(path, options);
}

}  // namespace accessvdb::io
