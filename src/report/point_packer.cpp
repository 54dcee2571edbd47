// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/point_packer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "accessvdb/error.h"
#include "report/text_coding.h"

namespace accessvdb::internal {
namespace {

constexpr int kIdPlane = 0, kPositionPlane = 4, kStatePlane = 16, kDirectionPlane = 17, kScorePlane = 19,
              kConfidencePlane = 21, kNormalPlane = 22, kToolPlane = 23, kToolsPlane = 24, kPlanes = 23,
              kPlanesOfSeveral = 28;
constexpr std::uint64_t kNoProbability = 255;
constexpr float kProbabilitySteps = 200;
constexpr double kMostSteps = 1 << 30;
constexpr std::size_t kMostDirections = kNoDirection;
constexpr int kNormalCells = 15;
constexpr std::uint8_t kNoNormal = 255;

void put(std::vector<std::string>& planes, int first, int count, std::uint64_t value) {
  for (int plane = 0; plane < count; ++plane) {
    planes[static_cast<std::size_t>(first + plane)] += static_cast<char>(value >> (8 * plane) & 255);
  }
}

std::uint64_t zigzag(std::int64_t value) {
  return static_cast<std::uint64_t>(value) << 1 ^ static_cast<std::uint64_t>(value >> 63);
}

}  // namespace

std::uint8_t octahedralByte(const Eigen::Vector3f& normal) {
  const float sum = normal.cwiseAbs().sum();
  if (!(sum > 0)) return kNoNormal;
  Eigen::Vector2f uv = normal.head<2>() / sum;
  if (normal.z() < 0) {
    const Eigen::Vector2f folded = Eigen::Vector2f(1, 1) - uv.reverse().cwiseAbs();
    uv = {uv.x() < 0 ? -folded.x() : folded.x(), uv.y() < 0 ? -folded.y() : folded.y()};
  }
  const auto cell = [](float t) {
    return std::clamp(static_cast<int>(std::lround((t + 1) / 2 * (kNormalCells - 1))), 0, kNormalCells - 1);
  };
  return static_cast<std::uint8_t>(kNormalCells * cell(uv.y()) + cell(uv.x()));
}

PointPacker::PointPacker(const Eigen::Vector3d& origin_W, double step_m, bool several_tools, bool probability,
                         std::function<void(PackedBlock)> write)
    : origin_W_(origin_W),
      step_m_(step_m),
      several_tools_(several_tools),
      probability_(probability),
      write_(std::move(write)),
      planes_(static_cast<std::size_t>((several_tools ? kPlanesOfSeveral : kPlanes) + (probability ? 1 : 0))) {
  for (std::string& plane : planes_) plane.reserve(kPointsPerBlock);
}

std::array<std::int64_t, 3> PointPacker::stepsOf(const Eigen::Vector3d& p_W) const {
  std::array<std::int64_t, 3> steps = {};
  for (int axis = 0; axis < 3; ++axis) {
    const double exact = (p_W[axis] - origin_W_[axis]) / step_m_;
    if (!(std::abs(exact) < kMostSteps)) {
      throw InputError("report.extent", "points.ply", "has a point too far from the field's origin to be drawn",
                       "Check the poses and max_range_m of the run");
    }
    steps[static_cast<std::size_t>(axis)] = std::llround(exact);
  }
  return steps;
}

std::uint16_t PointPacker::indexOf(const SurfacePoint& point) {
  const Eigen::Vector3f& d = point.direction_W;
  if (d.isZero()) return kNoDirection;
  const Eigen::Quaternionf& q = point.orientation_WT;
  const auto [found, added] = index_of_.try_emplace({d.x(), d.y(), d.z(), q.w(), q.x(), q.y(), q.z()},
                                                    static_cast<std::uint16_t>(directions_W_.size()));
  if (added) {
    if (directions_W_.size() == kMostDirections) {
      throw InputError("report.directions", "points.ply", "has more than 65535 different directions",
                       "Use a points.ply written by accessvdb map");
    }
    directions_W_.push_back(d);
    ups_W_.push_back(q * Eigen::Vector3f::UnitZ());
  }
  return found->second;
}

void PointPacker::startBlock(const std::string& tile, const SurfacePoint& point) {
  block_.tile = tile;
  block_.base = last_ = stepsOf(point.position_W);
  last_id_ = -1;
}

void PointPacker::add(const std::string& tile, const SurfacePoint& point) {
  if (block_.points == kPointsPerBlock || (block_.points > 0 && block_.tile != tile)) finish();
  if (block_.points == 0) startBlock(tile, point);
  ++block_.points;
  put(planes_, kIdPlane, 4, static_cast<std::uint64_t>(point.id - last_id_ - 1));
  last_id_ = point.id;
  const std::array<std::int64_t, 3> steps = stepsOf(point.position_W);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    put(planes_, kPositionPlane + 4 * static_cast<int>(axis), 4, zigzag(steps[axis] - last_[axis]));
  }
  last_ = steps;
  put(planes_, kStatePlane, 1, static_cast<unsigned>(point.label) + 4 * static_cast<unsigned>(point.reason));
  put(planes_, kDirectionPlane, 2, indexOf(point));
  put(planes_, kScorePlane, 2, point.score);
  put(planes_, kConfidencePlane, 1,
      static_cast<std::uint64_t>(std::lround(255 * std::clamp(point.confidence, 0.0f, 1.0f))));
  put(planes_, kNormalPlane, 1, octahedralByte(point.normal_W));
  if (several_tools_) {
    put(planes_, kToolPlane, 1, point.tool);
    put(planes_, kToolsPlane, 4, point.tools);
  }
  if (!probability_) return;
  const float p = point.access_probability;
  put(planes_, several_tools_ ? kPlanesOfSeveral : kPlanes, 1,
      p >= 0 ? static_cast<std::uint64_t>(std::lround(kProbabilitySteps * std::min(p, 1.0F))) : kNoProbability);
}

void PointPacker::finish() {
  if (block_.points == 0) return;
  std::string columns;
  columns.reserve(planes_.size() * block_.points);
  for (std::string& plane : planes_) {
    columns += plane;
    plane.clear();
  }
  block_.base64 = base64(deflated(columns));
  write_(std::exchange(block_, {}));
}

}  // namespace accessvdb::internal
