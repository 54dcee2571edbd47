// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// KITTI velodyne scans: float32 x y z reflectance, no header. Files of the same name with other records are told by
/// their values.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "accessvdb/error.h"
#include "io/clouds/binary_records.h"
#include "io/clouds/point_cloud.h"
#include "io/clouds/scalar_type.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

constexpr std::uint64_t kRecordBytes = 4 * sizeof(float);
constexpr std::size_t kLookedFloats = 20160;  ///< a multiple of 3 to 8
constexpr std::size_t kLeastFloats = 120;     ///< of fewer nothing is concluded

/// How much of the spread of magnitudes is explained by the place within a record of `width` floats: x y z and
/// reflectance differ in size, so it is most for the true width (0.4 or more), and near 0 for one that shares no factor
/// with it.
double explainedBy(const std::vector<double>& magnitudes, std::size_t width) {
  const std::size_t rows = magnitudes.size() / width;
  if (rows == 0) return 0;
  const auto count = static_cast<double>(rows * width);
  std::vector<double> mean(width, 0.0);
  double all = 0, spread = 0, between = 0;
  for (std::size_t i = 0; i < rows * width; ++i) {
    mean[i % width] += magnitudes[i] / static_cast<double>(rows);
    all += magnitudes[i] / count;
  }
  for (std::size_t i = 0; i < rows * width; ++i) spread += (magnitudes[i] - all) * (magnitudes[i] - all) / count;
  for (const double column : mean) between += (column - all) * (column - all) / static_cast<double>(width);
  return spread > 0 ? between / spread : 0;
}

/// Halves of doubles: the lower one is any number at all, or nothing, the upper one is not.
bool looksLikeDoubles(const std::vector<float>& values) {
  std::array<std::size_t, 2> wild = {}, zero = {};
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float size = std::abs(values[i]);
    if (size == 0) ++zero[i % 2];
    if (!(size == 0 || (size > 1e-12F && size < 1e9F))) ++wild[i % 2];
  }
  const auto share = [&](std::size_t count) {
    return 2 * static_cast<double>(count) / static_cast<double>(values.size());
  };
  return (share(wild[0]) > 0.2 && share(wild[1]) < 0.05) || (share(zero[0]) > 0.99 && share(zero[1]) < 0.6);
}

/// Without records of zeros only, "no return", which may come in a rhythm of their own.
std::vector<double> withoutEmpty(const std::vector<double>& magnitudes, std::size_t width, double of_zero) {
  std::vector<double> kept;
  for (std::size_t i = 0; i + width <= magnitudes.size(); i += width) {
    const auto begin = magnitudes.begin() + static_cast<std::ptrdiff_t>(i);
    const auto end = begin + static_cast<std::ptrdiff_t>(width);
    if (std::any_of(begin, end, [of_zero](double size) { return size != of_zero; }))
      kept.insert(kept.end(), begin, end);
  }
  return kept;
}

/// What the records look like if they are not four floats; empty if they may be.
std::string otherLayout(std::string_view bytes) {
  std::vector<float> values(std::min(bytes.size() / sizeof(float), kLookedFloats));
  if (values.size() < kLeastFloats) return {};
  std::vector<double> magnitudes;
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = loadScalar<float>(bytes.data() + i * sizeof(float));
    const double size = std::abs(double{values[i]});
    magnitudes.push_back(std::isfinite(size) ? std::log(std::clamp(size, 1e-4, 1e4)) : 0.0);
  }
  if (looksLikeDoubles(values)) return "64-bit floats";
  constexpr double kLeast = 0.2, kTimesAsMuch = 1.5;
  const auto explained = [&](std::size_t width) {
    return explainedBy(withoutEmpty(magnitudes, width == 8 ? 4 : width, std::log(1e-4)), width);
  };
  std::size_t best = 4;
  double most = std::max(kLeast, kTimesAsMuch * explained(4));
  for (const std::size_t width : {3, 5, 6, 7, 8}) {
    const double share = explained(width);
    // The multiple of a width explains as much as the width itself.
    if (share <= most || (best != 4 && width % best == 0 && share < 1.1 * most)) continue;
    best = width;
    most = share;
  }
  if (best == 4) return {};
  return std::to_string(best) + " floats a point (" + std::to_string(4 * best) + " bytes)";
}

class KittiBinReader final : public CloudReader {
 public:
  KittiBinReader(const std::filesystem::path& path, const ReadOptions& options) : source_(openFile(path)) {
    const std::uint64_t bytes = *source_->size();
    const std::uint64_t points = bytes / kRecordBytes;
    if (const std::string other = otherLayout(source_->view(0, kLookedFloats * sizeof(float))); !other.empty())
      throw InputError("input.bin_layout", forMessage(path.native()),
                       "looks like " + other + ", not like the 4 floats x y z reflectance of KITTI (16 bytes)",
                       "Write x y z reflectance as 32-bit floats, or convert it to .pcd or .ply");
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
