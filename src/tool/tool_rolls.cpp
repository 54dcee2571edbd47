// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_rolls.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>
#include <vector>

#include "accessvdb/tool_tables.h"
#include "tool/mesh_openings.h"
#include "tool/yaw_direction.h"

namespace accessvdb::internal {
namespace {

constexpr int kMostFold = 360;
/// Of the largest radius. Meshes are float32, and exporters round to a few digits.
constexpr double kTolerance = 1e-3;

/// y + i z: a roll is a product.
std::complex<double> across(const Eigen::Vector3f& p) { return {p.y(), p.z()}; }

/// Vertices by cells of the tolerance's size, to find one near a place.
class NearVertices {
 public:
  NearVertices(const std::vector<Eigen::Vector3f>& vertices, double tolerance_m) : tolerance_m_(tolerance_m) {
    for (const Eigen::Vector3f& p : vertices) cells_[cellOf(p.x(), across(p))].push_back(p);
  }
  [[nodiscard]] bool anyAt(double x, const std::complex<double>& yz) const {
    const Cell cell = cellOf(x, yz);
    for (std::int64_t n = 0; n < 27; ++n) {
      const auto found = cells_.find({cell[0] + n / 9 - 1, cell[1] + n / 3 % 3 - 1, cell[2] + n % 3 - 1});
      if (found == cells_.end()) continue;
      for (const Eigen::Vector3f& p : found->second) {
        if (std::norm(across(p) - yz) + (p.x() - x) * (p.x() - x) <= tolerance_m_ * tolerance_m_) return true;
      }
    }
    return false;
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  [[nodiscard]] Cell cellOf(double x, const std::complex<double>& yz) const {
    const auto index = [this](double value) { return static_cast<std::int64_t>(std::floor(value / tolerance_m_)); };
    return {index(x), index(yz.real()), index(yz.imag())};
  }
  double tolerance_m_;
  std::map<Cell, std::vector<Eigen::Vector3f>> cells_;
};

/// Means of (y + i z) and of its square over the surface. The first is 0 under any symmetry, the second under any but
/// that of half a turn. Vertices alone would not notice a face that is missing.
struct SurfaceMoments {
  std::complex<double> first = 0, second = 0;

  explicit SurfaceMoments(const ToolGeometry& tool) {
    double area = 0;
    for (const auto& t : tool.triangles()) {
      const Eigen::Vector3f &a = tool.vertices_T()[t[0]], &b = tool.vertices_T()[t[1]], &c = tool.vertices_T()[t[2]];
      const double weight = 0.5 * (b - a).cast<double>().cross((c - a).cast<double>()).norm();
      const std::complex<double> u = across(a), v = across(b), w = across(c);
      area += weight;
      first += weight * (u + v + w) / 3.0;
      second += weight * (u * u + v * v + w * w + u * v + v * w + w * u) / 6.0;
    }
    if (area > 0) first /= area, second /= area;
  }
  [[nodiscard]] bool allow(int fold, double radius_m) const {
    const double most = kTolerance * radius_m;
    return std::abs(first) <= most && (fold == 2 || std::abs(second) <= most * radius_m);
  }
};

}  // namespace

int foldAboutBody(const ToolGeometry& tool) {
  std::vector<Eigen::Vector3f> vertices = tool.vertices_T();
  std::ranges::sort(vertices, [](const auto& a, const auto& b) { return std::norm(across(a)) > std::norm(across(b)); });
  const double radius_m = vertices.empty() ? 0 : std::abs(across(vertices.front()));
  if (!(radius_m > 0)) return kMostFold;  // all on the axis
  // What is missing of a tool whose openings are closed must not give it other rolls than the whole tool has.
  MeshOpenings openings;
  if (!tool.watertight()) openings = findOpenings(tool.vertices_T(), tool.triangles());
  const double size_m = (tool.max_T() - tool.min_T()).cast<double>().maxCoeff();
  const bool closes = openings.any() && openings.width_m <= kWidestOpening * size_m;
  const NearVertices near(vertices, kTolerance * radius_m + openings.tear_m);
  const SurfaceMoments moments(tool);
  for (int fold = kMostFold; fold >= 2; --fold) {
    if (!closes && !moments.allow(fold, radius_m)) continue;
    const std::complex<double> turn = std::polar(1.0, 2 * std::numbers::pi / fold);
    // Those farthest out first: most candidates end with the first vertex.
    if (std::ranges::all_of(vertices, [&](const auto& p) { return near.anyAt(p.x(), across(p) * turn); })) return fold;
  }
  return 1;
}

ToolRolls toolRolls(const ToolGeometry& tool, const ApproachParams& approach) {
  const bool by_rule = approach.rolls == 0;
  if (approach.rolls == 1 || (by_rule && approach.orientations.kind != OrientationKind::Sphere)) return {};
  const int fold = foldAboutBody(tool);
  if (!by_rule) return {approach.rolls, fold};
  if (fold >= kTurnedFold) return {};
  return {(kRollsPerTurn + fold - 1) / fold, fold};
}

ToolOrientation rolledBy(const ToolOrientation& orientation, const ToolRolls& rolls, int roll) {
  if (roll == 0) return orientation;
  ToolOrientation rolled = orientation;
  const CosSin turn = yawDirection(roll, rolls.count * rolls.fold);
  const Eigen::Vector3d side = orientation.R_WT.col(1), top = orientation.R_WT.col(2);
  rolled.R_WT.col(1) = turn.cos * side + turn.sin * top;
  rolled.R_WT.col(2) = -turn.sin * side + turn.cos * top;
  rolled.roll_rad += 2 * std::numbers::pi * roll / (rolls.count * rolls.fold);
  return rolled;
}

}  // namespace accessvdb::internal

int accessvdb::rollsOf(const ToolGeometry& tool, const ApproachParams& approach) {
  return internal::toolRolls(tool, approach).count;
}
