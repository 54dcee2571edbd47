// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads a cloud at once, in parts, and part by part from the last to the first, and expects the same each time.
#pragma once

#include <algorithm>
#include <cstring>

#include "io/clouds/point_cloud.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io::test {

/// @param count  values that `part` should have, those of `whole` from `from` on
template <typename Value>
void expectSameBits(const std::vector<Value>& whole, const std::vector<Value>& part, std::size_t from,
                    std::size_t count) {
  ASSERT_EQ(part.size(), whole.empty() ? 0 : count);
  if (part.empty()) return;
  ASSERT_LE(from + count, whole.size());
  // Bits, because NaN is not equal to itself.
  EXPECT_EQ(std::memcmp(whole.data() + from, part.data(), count * sizeof(Value)), 0) << "from " << from;
}

inline void expectPart(const PointCloud& whole, const PointCloud& part, std::size_t from) {
  const std::size_t count = part.points.size();
  expectSameBits(whole.points, part.points, from, count);
  expectSameBits(whole.ray_vectors, part.ray_vectors, from, count);
  expectSameBits(whole.stamps_s, part.stamps_s, from, count);
}

inline PointCloud readInParts(const std::filesystem::path& path, ScanKind kind, const ReadOptions& options) {
  PointCloud whole = readCloud(path, kind, options);
  for (const std::size_t size : {std::size_t{1}, std::size_t{3}, std::size_t{4096}}) {
    if (whole.points.size() > 1000 * size) continue;
    const auto reader = openCloud(path, kind, options);
    std::vector<CloudReader::Place> places;
    CloudTotals totals;
    for (std::size_t read = size; read == size;) {
      places.push_back(reader->place());
      const PointCloud part = reader->next(size);
      expectPart(whole, part, totals.points);
      totals.add(part);
      read = part.points.size();
    }
    EXPECT_EQ(totals.points, whole.points.size());
    EXPECT_EQ(totals.truncated_points, whole.truncated_points);
    EXPECT_EQ(totals.unbounded_rays, whole.unbounded_rays);
    EXPECT_EQ(totals.outside_points, whole.outside_points);
    EXPECT_EQ(reader->notices(totals), whole.notices);
    for (std::size_t i = places.size(); i-- > 0;) {
      reader->seek(places[i]);
      const PointCloud part = reader->next(size);
      EXPECT_EQ(part.points.size(), std::min(size, whole.points.size() - i * size));
      expectPart(whole, part, i * size);
    }
  }
  return whole;
}

inline PointCloud readPcd(const std::filesystem::path& path, const ReadOptions& options) {
  return readInParts(path, ScanKind::Pcd, options);
}
inline PointCloud readPly(const std::filesystem::path& path, const ReadOptions& options) {
  return readInParts(path, ScanKind::Ply, options);
}
inline PointCloud readKittiBin(const std::filesystem::path& path, const ReadOptions& options) {
  return readInParts(path, ScanKind::KittiBin, options);
}
inline PointCloud readLas(const std::filesystem::path& path, const ReadOptions& options) {
  return readInParts(path, ScanKind::Las, options);
}

}  // namespace accessvdb::io::test
