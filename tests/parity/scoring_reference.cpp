// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "parity/scoring_reference.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <tuple>

#include "accessvdb/tsdf_volume.h"
#include "support/orientation_reference.h"

namespace accessvdb::test {
namespace {

/// Local positions are multiples of 2^-20 m.
Eigen::Vector3d toLocal(const Eigen::Vector3d& p_W, const Eigen::Vector3d& origin_W) {
  Eigen::Vector3d p;
  for (int a = 0; a < 3; ++a) p[a] = std::round((p_W[a] - origin_W[a]) * 1048576.0) / 1048576.0;
  return p;
}

/// Faces belong to the voxel above. Positions are kept so far from faces that no rounding moves them across: two steps
/// of 2^-20 m, and five roundings of float32.
struct PlacedCoordinate {
  std::int32_t voxel;
  float x_m;
};
PlacedCoordinate placed(double x_m, double v) {
  const double per_m = static_cast<float>(1.0 / v), x = x_m * per_m;
  const double slack = per_m / 524288 + std::abs(x) * 5 / 16777216;
  const double voxel = std::floor(x + 0.5 + slack / 2), most = 0.5 - slack;
  const double kept = std::clamp(x - voxel, -most, most);
  return {static_cast<std::int32_t>(voxel), static_cast<float>(kept == x - voxel ? x_m : (voxel + kept) / per_m)};
}

using Axes = std::vector<std::array<double, 3>>;

Axes axesOf(const ApproachParams& approach) {
  Axes axes = referenceAxes(approach);
  for (int d = 0; d < approach.num_directions && approach.orientations.isYaw(); ++d) {
    const double yaw = 2 * std::numbers::pi * d / approach.num_directions;
    axes.push_back({std::cos(yaw), std::sin(yaw), 0});
  }
  return axes;
}

std::vector<bool> directionsTowards(const Eigen::Vector3f& from, const Eigen::Vector3f& to, const FieldParams& p,
                                    const Axes& axes) {
  const float dx = to.x() - from.x(), dy = to.y() - from.y(), dz = to.z() - from.z();
  const float length = std::sqrt(dx * dx + dy * dy + dz * dz);
  std::vector<bool> seen;
  for (const std::array<double, 3>& axis : axes) {
    const float x_part = dx / length * static_cast<float>(axis[0]);
    const float y_part = dy / length * static_cast<float>(axis[1]);
    const float z_part = dz / length * static_cast<float>(axis[2]);
    const float level_part = x_part + y_part;
    seen.push_back(level_part + z_part > static_cast<float>(p.approach.observation_cos_min));
  }
  return seen;
}

struct Sums {
  GatheredPoint point;
  std::array<std::int64_t, 3> offset = {}, sensor = {};
  std::int64_t count = 0;
};

std::vector<double> armDistances(const FieldParams& p) {
  const double tau = p.tsdf.truncation_distance_m, length = p.approach.corridor_length_m;
  std::vector<double> distances;
  for (const double f : p.approach.arm_tau) distances.push_back(f * tau);
  // Beyond the paper's three, one every tau; the last one at the end of the corridor.
  for (double s = distances.back() + tau; s < length; s += tau) distances.push_back(s);
  if (length > distances.back()) distances.push_back(length);
  return distances;
}

}  // namespace

std::vector<GatheredPoint> gatherPoints(const std::vector<RayScan>& scans, const FieldParams& resolved,
                                        const Eigen::Vector3d& origin_W) {
  const double v = resolved.tsdf.voxel_size_m;
  const Axes axes = axesOf(resolved.approach);
  std::vector<Sums> all;
  std::map<VoxelCoord, std::size_t> id_of;
  for (const RayScan& scan : scans) {
    struct Return {
      VoxelCoord voxel;
      Eigen::Vector3f p, q;
    };
    std::vector<Return> returns;
    for (std::size_t n = 0; n < scan.points_W.size(); ++n) {
      Return r;
      const Eigen::Vector3d p_L = toLocal(scan.points_W[n], origin_W);
      r.q = toLocal(scan.origins_W[n], origin_W).cast<float>();
      for (int a = 0; a < 3; ++a) {
        const PlacedCoordinate at = placed(p_L[a], v);
        r.voxel[static_cast<std::size_t>(a)] = at.voxel;
        r.p[a] = at.x_m;
      }
      returns.push_back(r);
    }
    // New points are numbered leaf by leaf, cubes with edges of eight voxels.
    const auto place = [](const Return& r) {
      VoxelCoord leaf = r.voxel;
      for (auto& axis : leaf) axis = static_cast<std::int32_t>(std::floor(axis / 8.0));
      return std::make_tuple(leaf, r.voxel, r.p.x(), r.p.y(), r.p.z());
    };
    std::sort(returns.begin(), returns.end(), [&](const Return& a, const Return& b) { return place(a) < place(b); });
    for (const Return& r : returns) {
      const auto [entry, is_new] = id_of.try_emplace(r.voxel, all.size());
      if (is_new) {
        all.emplace_back();
        all.back().point.voxel = r.voxel;
        all.back().point.first_L = r.p;
        all.back().point.seen.assign(axes.size(), false);
      }
      Sums& sums = all[entry->second];
      ++sums.count;
      for (std::size_t a = 0; a < 3; ++a) {
        const double p = r.p[static_cast<int>(a)], q = r.q[static_cast<int>(a)];
        sums.offset[a] += std::llround((p - r.voxel[a] * v) / v * 1048576.0);
        sums.sensor[a] += std::llround(q * 65536.0);
      }
      const std::vector<bool> seen = directionsTowards(r.p, r.q, resolved, axes);
      for (std::size_t d = 0; d < seen.size(); ++d) sums.point.seen[d] = sums.point.seen[d] || seen[d];
    }
  }
  std::vector<GatheredPoint> points;
  for (Sums& sums : all) {
    const auto n = static_cast<double>(sums.count);
    for (std::size_t a = 0; a < 3; ++a) {
      const double offset = static_cast<double>(sums.offset[a]) / n / 1048576.0;
      sums.point.mean_L[static_cast<int>(a)] = static_cast<float>((sums.point.voxel[a] + offset) * v);
      sums.point.sensor_L[static_cast<int>(a)] = static_cast<double>(sums.sensor[a]) / n / 65536.0;
    }
    if (!resolved.scoring.mean_positions) sums.point.mean_L = sums.point.first_L;
    points.push_back(sums.point);
  }
  return points;
}

internal::ToolKernel toolKernel(const AccessibilityField& field) {
  return internal::ToolKernel::make(field.tool(), field.params());
}

BruteForceInput oracleInput(const AccessibilityField& field, const std::vector<GatheredPoint>& points,
                            const FieldSnapshot& snapshot) {
  const FieldParams& p = field.params();
  BruteForceInput input;
  input.voxel_size_m = p.tsdf.voxel_size_m;
  input.collision_distance_m = static_cast<float>(p.scoring.collision_distance_m);
  const auto rolls = static_cast<std::size_t>(p.approach.rolls);
  for (const auto& axis : rolls > 1 ? axesOf(p.approach) : referenceAxes(p.approach)) {
    input.axes.insert(input.axes.end(), rolls, axis);
  }
  input.num_directions = input.axes.empty() ? p.approach.num_directions : static_cast<int>(input.axes.size());
  input.normal_cone_rad = p.approach.normal_cone_rad;
  input.arm_distances_m = armDistances(p);
  input.neighbours = p.scoring.neighbours;
  input.join_neighbour_views = p.scoring.join_neighbour_views;
  input.neighbourhood_weight = p.scoring.neighbourhood_weight;
  input.confidence_half_weight = p.scoring.confidence_half_weight;
  input.confidence_min = p.scoring.confidence_min;
  const internal::ToolKernel kernel = toolKernel(field);
  input.collision_limit = kernel.collision_limit;
  for (std::size_t d = 0; d < static_cast<std::size_t>(input.num_directions); ++d) {
    std::vector<VoxelCoord>& voxels = input.tool_voxels.emplace_back();
    const auto addPart = [&](std::size_t part) {
      for (std::uint32_t n = kernel.column_begin[part]; n < kernel.column_begin[part + 1]; ++n) {
        const kernels::VoxelColumn& column = kernel.columns[n];
        for (int bit = 0; bit < 64; ++bit) {
          if ((column.bits >> bit & 1) != 0) voxels.push_back({column.dx, column.dy, column.dz + bit});
        }
      }
    };
    if (rolls == 1) {
      addPart(d);
    } else {
      const std::size_t first = d / rolls * (rolls + 1);
      addPart(first);  // the core
      addPart(first + 1 + d % rolls);
    }
  }
  for (std::size_t id = 0; id < points.size(); ++id) {
    BruteForcePoint& point = input.points.emplace_back();
    point.id = static_cast<std::uint32_t>(id);
    point.voxel = points[id].voxel;
    point.first_position_L = points[id].first_L;
    point.mean_position_L = points[id].mean_L;
    point.mean_sensor_L = points[id].sensor_L;
    for (const bool seen : points[id].seen) point.seen.insert(point.seen.end(), rolls, seen);
    if (!snapshot.points[id].normal_W.isZero()) point.given_normal = snapshot.points[id].normal_W;
  }
  return input;
}

DenseMap copyOfMap(const TsdfVolume& volume) {
  const openvdb::CoordBBox box = volume.leafBounds();
  if (box.empty()) return DenseMap({0, 0, 0}, {0, 0, 0});
  const MapLookup source = [&](const VoxelCoord& c) {
    const VoxelState state = volume.at({c[0], c[1], c[2]});
    return MapVoxel{state.weight > 0, state.distance_m, state.weight, state.cleared};
  };
  return DenseMap({box.min().x(), box.min().y(), box.min().z()}, {box.max().x(), box.max().y(), box.max().z()}, source);
}

}  // namespace accessvdb::test
