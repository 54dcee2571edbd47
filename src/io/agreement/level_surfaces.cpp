// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/agreement/level_surfaces.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>

namespace accessvdb::io {
namespace {

constexpr std::size_t kLeastPoints = 8;    ///< of a patch
constexpr float kFlat = 0.02F;             ///< thickness by width, squared: noise of a seventh
constexpr float kNotALine = 0.05F;         ///< width by length, squared: a single row of a spinning scanner is none
constexpr std::size_t kLeastPatches = 60;  ///< with fewer, a few boxes decide
constexpr std::size_t kCandidates = 200;
constexpr double kRadian = std::numbers::pi / 180;
constexpr double kSame_deg = 8, kTilted_deg = 10;
constexpr double kLevelShare = 0.25;    ///< of all patches, level by the new direction
constexpr double kUprightShare = 0.15;  ///< upright by it: a roof or a slope alone is no floor
constexpr double kExplained = 0.7;      ///< level or upright by it
constexpr double kExplainedByZ = 0.5;   ///< z explains at most this share of what it explains
constexpr double kLevelByZ = 0.3;       ///< and the same for what is level

/// 21 bits per axis around the origin; what is beyond falls into the outermost cells, where few returns are.
std::uint64_t cellOf(const Eigen::Vector3f& p, float cell_m) {
  std::uint64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const float index = std::clamp(std::floor(p[axis] / cell_m), -1.0e6F, 1.0e6F);
    key = key << 21 | static_cast<std::uint64_t>(static_cast<std::int64_t>(index) + 1'000'000);
  }
  return key;
}

struct Explained {
  std::size_t level = 0, upright = 0;
  [[nodiscard]] std::size_t all() const { return level + upright; }
};

Explained explainedBy(const Eigen::Vector3f& up, const std::vector<Eigen::Vector3f>& normals) {
  const auto level = static_cast<float>(std::cos(kSame_deg * kRadian));
  const auto upright = static_cast<float>(std::sin(kSame_deg * kRadian));
  Explained counts;
  for (const Eigen::Vector3f& normal : normals) {
    const float along = std::abs(normal.dot(up));
    counts.level += along >= level ? 1 : 0;
    counts.upright += along <= upright ? 1 : 0;
  }
  return counts;
}

}  // namespace

void appendPatchNormals(const std::vector<Eigen::Vector3f>& points, float cell_m,
                        std::vector<Eigen::Vector3f>& normals) {
  if (!(cell_m > 0)) return;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order;
  order.reserve(points.size());
  for (std::uint32_t i = 0; i < points.size(); ++i) order.emplace_back(cellOf(points[i], cell_m), i);
  std::sort(order.begin(), order.end());
  for (std::size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    while (end < order.size() && order[end].first == order[begin].first) ++end;
    if (end - begin < kLeastPoints) continue;
    Eigen::Vector3f mean = Eigen::Vector3f::Zero();
    for (std::size_t k = begin; k < end; ++k) mean += points[order[k].second];
    mean /= static_cast<float>(end - begin);
    Eigen::Matrix3f spread = Eigen::Matrix3f::Zero();
    for (std::size_t k = begin; k < end; ++k) {
      const Eigen::Vector3f d = points[order[k].second] - mean;
      spread += d * d.transpose();
    }
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver;
    solver.computeDirect(spread);
    const Eigen::Vector3f& widths = solver.eigenvalues();
    if (widths[0] < kFlat * widths[1] && widths[1] > kNotALine * widths[2])
      normals.push_back(solver.eigenvectors().col(0));
  }
}

std::optional<Eigen::Vector3d> upBesideZ(const std::vector<Eigen::Vector3f>& normals_W) {
  const std::size_t count = normals_W.size();
  if (count < kLeastPatches) return std::nullopt;
  const Explained by_z = explainedBy(Eigen::Vector3f::UnitZ(), normals_W);
  Explained best;
  Eigen::Vector3f up = Eigen::Vector3f::UnitZ();
  for (std::size_t i = 0; i < count; i += std::max<std::size_t>(1, count / kCandidates)) {
    const Explained by = explainedBy(normals_W[i], normals_W);
    // Of equals the one nearer to z: floors and walls of a room explain the same.
    const bool nearer = std::abs(normals_W[i].z()) > std::abs(up.z());
    if (by.all() < best.all() || (by.all() == best.all() && !nearer)) continue;
    if (static_cast<double>(by.level) < kLevelShare * static_cast<double>(count)) continue;
    best = by;
    up = normals_W[i];
  }
  const auto explains = static_cast<double>(best.all());
  if (static_cast<double>(best.upright) < kUprightShare * static_cast<double>(count) ||
      explains < kExplained * static_cast<double>(count) ||
      static_cast<double>(by_z.all()) > kExplainedByZ * explains ||
      static_cast<double>(by_z.level) > kLevelByZ * static_cast<double>(best.level))
    return std::nullopt;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  const auto same = static_cast<float>(std::cos(kSame_deg * kRadian));
  for (const Eigen::Vector3f& normal : normals_W) {
    const float along = normal.dot(up);
    if (std::abs(along) >= same) mean += (along > 0 ? 1.0 : -1.0) * normal.cast<double>();
  }
  mean.normalize();
  if (mean.z() < 0) mean = -mean;
  if (mean.z() > std::cos(kTilted_deg * kRadian)) return std::nullopt;
  return mean;
}

}  // namespace accessvdb::io
