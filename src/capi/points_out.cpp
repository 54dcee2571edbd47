// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "capi/points_out.h"

#include <Eigen/Core>
#include <algorithm>
#include <string>

#include "capi/boundary.h"

namespace accessvdb::capi {
namespace {

static_assert(sizeof(accessvdb_point) >= kPointBytes1);

accessvdb_point pointToC(const SurfacePoint& p) {
  accessvdb_point c = {};
  Eigen::Map<Eigen::Vector3d>(c.position_W) = p.position_W;
  Eigen::Map<Eigen::Vector3f>(c.normal_W) = p.normal_W;
  Eigen::Map<Eigen::Vector3f>(c.direction_W) = p.direction_W;
  c.yaw_rad = p.yaw_rad;
  c.weight = p.weight;
  c.confidence = p.confidence;
  c.stability = p.stability;
  c.id = p.id;
  c.direction = p.direction;
  c.score = p.score;
  c.label = static_cast<std::uint8_t>(p.label);
  c.reason = static_cast<std::uint8_t>(p.reason);
  c.confident = p.confident;
  c.roll = p.roll;
  c.tool = p.tool;
  c.tools = p.tools;
  c.margin_m = p.margin_m;
  c.access_probability = p.access_probability;
  const Eigen::Quaternionf& q = p.orientation_WT;
  const float wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
  std::copy_n(wxyz, 4, c.orientation_WT);
  return c;
}

}  // namespace

void writePoint(void* out, std::size_t size, const SurfacePoint& point) { writeRow(out, size, pointToC(point)); }

void copyPoints(const std::vector<SurfacePoint>& all, const PointRange& range, accessvdb_point* points,
                std::size_t point_size) {
  const auto [first, count] = range;
  requireSize("point_size", point_size, kPointBytes1);
  requireArray("points", points, count, point_size, alignof(accessvdb_point));
  if (first > all.size() || count > all.size() - first) {
    throw InvalidArgument(
        "snapshot.range", "",
        std::to_string(count) + " points from " + std::to_string(first) + " on, of " + std::to_string(all.size()),
        "The call that found them returns their number");
  }
  auto* out = reinterpret_cast<unsigned char*>(points);
  for (std::size_t n = 0; n < count; ++n) writePoint(out + n * point_size, point_size, all[first + n]);
}

const FieldSnapshot& takenSnapshot(const std::optional<FieldSnapshot>& snapshot, const char* by) {
  if (snapshot) return *snapshot;
  throw InvalidArgument("snapshot.none", "", "no snapshot has been taken", std::string("Call ") + by + " first");
}

}  // namespace accessvdb::capi
