// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/tool_solid.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "accessvdb/tool_tables.h"
#include "tool/grown_voxels.h"
#include "tool/voxel_runs.h"

namespace accessvdb::internal {
namespace {

/// Half the diagonal of a voxel: a cell that holds a place has its centre nearer than this.
constexpr double kHalfDiagonal = 0.8660254037844387;
constexpr double kRounding = 1e-6;
/// What openings shut in beside the tool counts, too, and a torn surface may touch more than the whole one.
constexpr double kCertainShare = 0.9;

/// A slab and a ball that hold all rims of an opening, and what bulges out from between them.
struct Bounds {
  Eigen::Vector3d centre, normal;
  double low, high, radius;

  Bounds(const std::vector<Eigen::Vector3d>& vertices, const Opening& opening, double bulge) {
    centre.setZero();
    for (const auto& rim : opening.rims) centre += (vertices[rim[0]] + vertices[rim[1]]) / 2;
    centre /= double(opening.rims.size());
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    const auto forEach = [&](const auto& use) {
      for (const auto& rim : opening.rims) {
        for (const std::uint32_t v : rim) use(Eigen::Vector3d(vertices[v] - centre));
      }
    };
    forEach([&](const Eigen::Vector3d& to) { spread += to * to.transpose(); });
    normal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors().col(0);
    low = high = radius = 0;
    forEach([&](const Eigen::Vector3d& to) {
      low = std::min(low, to.dot(normal));
      high = std::max(high, to.dot(normal));
      radius = std::max(radius, to.norm());
    });
    const double more = bulge + kHalfDiagonal + kRounding;
    low -= more, high += more, radius += more;
  }
  [[nodiscard]] bool has(const Eigen::Vector3d& p) const {
    const double height = (p - centre).dot(normal);
    return height >= low && height <= high && (p - centre).squaredNorm() <= radius * radius;
  }
};

/// Voxels with a place within the radius of an edge and within the bounds; a few more.
/// @param a, b, radius  in voxels
void addTube(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double radius, const Bounds& bounds,
             std::vector<VoxelRun>& runs) {
  const Eigen::Vector3d along = b - a;
  const double length2 = along.squaredNorm(), most = radius + kHalfDiagonal + kRounding;
  const auto isNear = [&](const VoxelRun& run, std::int32_t k) {
    const Eigen::Vector3d centre(run.i, run.j, k), to = centre - a;
    const double t = length2 > 0 ? std::clamp(to.dot(along) / length2, 0.0, 1.0) : 0.0;
    return (to - t * along).squaredNorm() <= most * most && bounds.has(centre);
  };
  // Of a box around each place. Tube and bounds are convex, so only the ends of a column can lie outside.
  for (VoxelRun run : touchedVoxels({a, b}, {{0, 1, 1}}, radius)) {
    while (run.lo <= run.hi && !isNear(run, run.lo)) ++run.lo;
    while (run.hi > run.lo && !isNear(run, run.hi)) --run.hi;
    if (run.lo <= run.hi) runs.push_back(run);
  }
}

}  // namespace

ToolSolid::ToolSolid(const ToolGeometry& tool) : tool_(tool) {
  if (!tool.watertight()) openings_ = findOpenings(tool.vertices_T(), tool.triangles());
}

SolidVoxels ToolSolid::voxels(const std::vector<Eigen::Vector3d>& vertices, double voxel_size_m,
                              double self_exclusion_voxels) const {
  SolidVoxels solid = ownVoxels(vertices, voxel_size_m, self_exclusion_voxels);
  if (tool_.margin_m() > 0)
    solid.runs = grownVoxels(solid.runs, tool_.margin_m() / voxel_size_m, self_exclusion_voxels);
  return solid;
}

SolidVoxels ToolSolid::ownVoxels(const std::vector<Eigen::Vector3d>& vertices, double voxel_size_m,
                                 double self_exclusion_voxels) const {
  SolidVoxels solid;
  if (tool_.watertight()) {
    solid.runs = voxelize(vertices, tool_.triangles(), true);
    solid.all = countVoxels(solid.runs);
    solid.hidden = removeBall(solid.runs, self_exclusion_voxels);
    solid.counted = solid.all - solid.hidden;
    return solid;
  }
  const double tear = openings_.tear_m / voxel_size_m;
  std::vector<VoxelRun> certain = touchedVoxels(vertices, tool_.triangles(), 0);
  solid.runs = tear > 0 ? touchedVoxels(vertices, tool_.triangles(), tear) : certain;
  bool closes = tear > 0;
  for (const Opening& opening : openings_.openings) {
    if (!(opening.radius_m > 0)) continue;
    closes = true;
    const Bounds bounds(vertices, opening, opening.bulge_m / voxel_size_m);
    for (const auto& [a, b] : opening.rims) {
      addTube(vertices[a], vertices[b], opening.radius_m / voxel_size_m, bounds, solid.runs);
    }
  }
  joinRuns(solid.runs);
  const std::vector<VoxelRun> enclosed = enclosedBy(solid.runs);
  solid.runs.insert(solid.runs.end(), enclosed.begin(), enclosed.end());
  joinRuns(solid.runs);
  // What is enclosed blocks, but may be a cavity that the whole tool does not fill: it does not count for the limit.
  joinRuns(certain);
  solid.all = countVoxels(solid.runs);
  solid.hidden = removeBall(solid.runs, self_exclusion_voxels);
  removeBall(certain, self_exclusion_voxels);
  solid.counted = countVoxels(certain);
  if (closes) solid.counted = static_cast<std::uint64_t>(std::floor(kCertainShare * double(solid.counted)));
  return solid;
}

}  // namespace accessvdb::internal

double accessvdb::openingWidth_m(const ToolGeometry& tool) {
  if (tool.watertight()) return 0;
  return internal::findOpenings(tool.vertices_T(), tool.triangles()).width_m;
}

bool accessvdb::isWideOpen(const ToolGeometry& tool) {
  const double size_m = (tool.max_T() - tool.min_T()).cast<double>().maxCoeff();
  return openingWidth_m(tool) > internal::kWidestOpening * size_m;
}
