// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Plain text clouds: x y z at the beginning of each line; what follows on the line is ignored.
#include "accessvdb/error.h"
#include "io/input_file.h"
#include "io/point_cloud.h"
#include "io/text_lines.h"

namespace accessvdb::io {

PointCloud readXyz(const std::filesystem::path& path, const ReadOptions& options) {
  const std::string file = readInputFile(path);
  LineReader lines(file, forMessage(path.native()));
  PointCloud cloud;
  std::string_view line;
  std::vector<std::string_view> tokens;
  while (lines.next(line)) {
    if (isBlankOrComment(line)) continue;
    splitTokens(line, tokens);
    if (tokens.size() < 3 && !lines.terminated() && !cloud.points.empty()) {
      if (!options.allow_truncated)
        throw InputError("input.truncated", lines.subject(),
                         "the last line (" + std::to_string(lines.number()) + ") is incomplete",
                         "Use --allow-truncated to keep " + std::to_string(cloud.points.size()) + " points");
      cloud.truncated_points = 1;
      break;
    }
    Eigen::Vector3d point;
    bool numbers = tokens.size() >= 3;
    for (int axis = 0; numbers && axis < 3; ++axis) numbers = parseNumber(tokens[axis], point[axis]);
    if (!numbers) lines.fail("does not begin with three numbers");
    cloud.points.push_back(point);
  }
  return cloud;
}

PointCloud readCloud(const std::filesystem::path& path, ScanKind kind, const ReadOptions& options) {
  switch (kind) {
    case ScanKind::Pcd:
      return readPcd(path, options);
    case ScanKind::Ply:
      return readPly(path, options);
    case ScanKind::KittiBin:
      return readKittiBin(path, options);
    case ScanKind::Las:
      return readLas(path, options);
    case ScanKind::Xyz:
      return readXyz(path, options);
  }
  throw InternalError("internal.scan_kind", path.string(), "has an unknown kind");
}

}  // namespace accessvdb::io
