// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the readers of all formats have in common.
#include <limits>

#include "accessvdb/error.h"
#include "io/clouds/point_cloud.h"

namespace accessvdb::io {

void CloudTotals::add(const PointCloud& part) {
  points += part.points.size();
  truncated_points += part.truncated_points;
  unbounded_rays += part.unbounded_rays;
  outside_points += part.outside_points;
  left_out.withheld += part.left_out.withheld;
  left_out.synthetic += part.left_out.synthetic;
  left_out.noise += part.left_out.noise;
}

std::string NoiseCounts::inWords() const {
  std::string words;
  const auto add = [&](std::uint64_t count, const char* what) {
    if (count != 0) words += (words.empty() ? "" : " and ") + std::to_string(count) + what;
  };
  add(withheld, " withheld points");
  add(synthetic, " synthetic points");
  add(noise, " points of the noise classes 7 and 18");
  return words;
}

std::vector<std::string> CloudReader::notices(const CloudTotals&) const { return {}; }

std::unique_ptr<CloudReader> openCloud(const std::filesystem::path& path, ScanKind kind, const ReadOptions& options) {
  switch (kind) {
    case ScanKind::Pcd:
      return openPcd(path, options);
    case ScanKind::Ply:
      return openPly(path, options);
    case ScanKind::KittiBin:
      return openKittiBin(path, options);
    case ScanKind::Las:
      return openLas(path, options);
    case ScanKind::Laz:
      return openLaz(path, options);
    case ScanKind::Xyz:
      return openXyz(path, options);
    case ScanKind::Ptx:
      return openPtx(path, options);
    case ScanKind::Mcap:
    case ScanKind::RosBag:
    case ScanKind::Sqlite:
      break;  // many clouds: see recording_steps.h
  }
  throw InternalError("internal.scan_kind", path.string(), "has an unknown kind");
}

PointCloud readWhole(CloudReader& reader) {
  PointCloud cloud = reader.next(std::numeric_limits<std::size_t>::max());
  CloudTotals totals;
  totals.add(cloud);
  for (std::string& notice : reader.notices(totals)) cloud.notices.push_back(std::move(notice));
  return cloud;
}

PointCloud readCloud(const std::filesystem::path& path, ScanKind kind, const ReadOptions& options) {
  return readWhole(*openCloud(path, kind, options));
}

}  // namespace accessvdb::io
