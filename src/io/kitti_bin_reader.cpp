// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// KITTI velodyne scans: float32 x y z reflectance, no header.
#include "accessvdb/error.h"
#include "io/input_file.h"
#include "io/point_cloud.h"
#include "io/scalar_type.h"

namespace accessvdb::io {

PointCloud readKittiBin(const std::filesystem::path& path, const ReadOptions& options) {
  constexpr std::uint64_t kRecordBytes = 4 * sizeof(float);
  const std::string file = readInputFile(path);
  const std::uint64_t points = file.size() / kRecordBytes;
  PointCloud cloud;
  if (file.size() % kRecordBytes != 0) {
    if (!options.allow_truncated)
      throw InputError("input.truncated", forMessage(path.native()),
                       std::to_string(file.size()) + " bytes is not a multiple of 16 (record " +
                           std::to_string(points) + ", byte " + std::to_string(points * kRecordBytes) + ")",
                       "Use --allow-truncated to keep " + std::to_string(points) + " complete points");
    cloud.truncated_points = 1;
  }
  cloud.points.resize(points);
  for (std::uint64_t i = 0; i < points; ++i)
    for (int axis = 0; axis < 3; ++axis)
      cloud.points[i][axis] = loadScalar<float>(file.data() + i * kRecordBytes + axis * sizeof(float));
  return cloud;
}

}  // namespace accessvdb::io
