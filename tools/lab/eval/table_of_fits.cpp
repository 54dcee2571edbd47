// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What PoseQuery::fits() says of random poses, judged by the exact scene: of surface that a scan hit, no pose that is
/// called free touches more than a voxel of it, and few that are called blocked have room.
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <random>
#include <set>
#include <vector>

#include "accessvdb/pose_query.h"
#include "accessvdb/surface_points.h"
#include "eval/action_scenes.h"
#include "eval/collision_field.h"
#include "eval/tool_samples.h"

namespace accessvdb::eval {
namespace {

constexpr std::size_t kPoses = 100000;
constexpr int kSamples = 4000;

/// Poses as far from surface points as the tool reaches, turned at random.
std::vector<Eigen::Isometry3d> randomPoses(const SurfacePoints& points, double reach_m) {
  std::mt19937 engine(5);
  std::uniform_real_distribution<double> share(0, 1);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Isometry3d> poses(kPoses, Eigen::Isometry3d::Identity());
  for (Eigen::Isometry3d& T_WT : poses) {
    const auto n = static_cast<std::size_t>(share(engine) * static_cast<double>(points.size()));
    const Eigen::Vector3d away = Eigen::Vector3d(normal(engine), normal(engine), normal(engine)).normalized();
    T_WT.translation() = points.at(n).position_W + reach_m * share(engine) * away;
    T_WT.linear() = Eigen::Quaterniond(normal(engine), normal(engine), normal(engine), normal(engine))
                        .normalized()
                        .toRotationMatrix();
  }
  return poses;
}

/// Places inside the tool, in its frame: a twig may be all within it, far from its surface.
std::vector<Eigen::Vector3d> insideOf(const ToolGeometry& tool, std::size_t count) {
  const Eigen::Vector3d low = tool.min_T().cast<double>(), size = tool.max_T().cast<double>() - low;
  std::mt19937 engine(6);
  std::uniform_real_distribution<double> share(0, 1);
  const auto isInside = [&](const Eigen::Vector3d& p) {
    int above = 0;
    for (const auto& triangle : tool.triangles()) {
      const auto corner = [&](std::size_t k) -> Eigen::Vector3d {
        return tool.vertices_T()[triangle[k]].cast<double>();
      };
      const Eigen::Vector3d a = corner(0) - p, b = corner(1) - p, c = corner(2) - p;
      const auto cross = [](const Eigen::Vector3d& u, const Eigen::Vector3d& w) {
        return u.x() * w.y() - u.y() * w.x();
      };
      const double of_a = cross(b, c), of_b = cross(c, a), of_c = cross(a, b), all = of_a + of_b + of_c;
      const bool over = (of_a > 0 && of_b > 0 && of_c > 0) || (of_a < 0 && of_b < 0 && of_c < 0);
      if (over && (of_a * a.z() + of_b * b.z() + of_c * c.z()) / all > 0) ++above;
    }
    return above % 2 == 1;
  };
  std::vector<Eigen::Vector3d> places;
  while (places.size() < count) {
    const Eigen::Vector3d p = low + size.cwiseProduct(Eigen::Vector3d(share(engine), share(engine), share(engine)));
    if (isInside(p)) places.push_back(p);
  }
  return places;
}

/// Voxels around those with a return.
class HitSurface {
 public:
  HitSurface(const SurfacePoints& points, double voxel_m) : voxel_m_(voxel_m) {
    for (std::size_t n = 0; n < points.size(); ++n) {
      const Cell at = cellOf(points.at(n).position_W);
      for (std::int64_t x = -1; x <= 1; ++x)
        for (std::int64_t y = -1; y <= 1; ++y)
          for (std::int64_t z = -1; z <= 1; ++z) cells_.insert({at[0] + x, at[1] + y, at[2] + z});
    }
  }
  [[nodiscard]] bool isAt(const Eigen::Vector3d& p_W) const { return cells_.contains(cellOf(p_W)); }

 private:
  using Cell = std::array<std::int64_t, 3>;
  [[nodiscard]] Cell cellOf(const Eigen::Vector3d& p_W) const {
    return {std::llround(std::floor(p_W.x() / voxel_m_)), std::llround(std::floor(p_W.y() / voxel_m_)),
            std::llround(std::floor(p_W.z() / voxel_m_))};
  }
  double voxel_m_;
  std::set<Cell> cells_;
};

struct Truth {
  bool touches_hit = false;  ///< more than a voxel deep, beside surface that was hit
  bool has_room = true;      ///< more than two voxels everywhere
};

void addFitRow(TableContext& context, const ActionScene& scene) {
  const double v = scene.field.params().tsdf.voxel_size_m;
  const auto points = scene.field.points();
  const ToolGeometry& tool = scene.field.tool();
  const std::vector<Eigen::Isometry3d> poses = randomPoses(*points, tool.reach_m());
  const std::vector<FitAnswer> answers = scene.field.poseQuery().fits(poses);
  const HitSurface hit(*points, v);
  Eigen::AlignedBox3d around_W;
  for (std::size_t n = 0; n < points->size(); ++n) around_W.extend(points->at(n).position_W);
  around_W =
      Eigen::AlignedBox3d(around_W.min().array() - 2 * tool.reach_m(), around_W.max().array() + 2 * tool.reach_m());
  const CollisionField exact(scene.distance, around_W, std::max(v, 0.005));
  const std::vector<Eigen::Vector3d> samples_T = sampleToolSurface(tool, kSamples, 7),
                                     inside_T = insideOf(tool, kSamples);
  std::vector<Truth> truths(poses.size());
  tbb::parallel_for(std::size_t{0}, poses.size(), [&](std::size_t n) {
    for (const Eigen::Vector3d& p_T : samples_T) {
      const Eigen::Vector3d p_W = poses[n] * p_T;
      if (truths[n].has_room && exact.below(p_W, 2 * v)) truths[n].has_room = false;
      if (!answers[n].free() || !exact.below(p_W, -v)) continue;
      const double depth_m = exact.distance().at(p_W);
      if (hit.isAt(p_W - depth_m * exact.distance().outwardNormal(p_W))) truths[n].touches_hit = true;
    }
    truths[n].has_room = truths[n].has_room && std::ranges::none_of(inside_T, [&](const Eigen::Vector3d& p_T) {
                           return exact.below(poses[n] * p_T, 2 * v);
                         });
  });
  std::size_t free = 0, blocked = 0, wrongly_free = 0, wrongly_blocked = 0;
  for (std::size_t n = 0; n < poses.size(); ++n) {
    free += answers[n].free() ? 1 : 0;
    blocked += answers[n].collision() ? 1 : 0;
    wrongly_free += answers[n].free() && truths[n].touches_hit ? 1 : 0;
    wrongly_blocked += answers[n].collision() && truths[n].has_room ? 1 : 0;
  }
  const double wrongly_blocked_percent = blocked > 0 ? 100.0 * double(wrongly_blocked) / double(blocked) : 0;
  TableRow row;
  row.table = "fits";
  row.scene = scene.name;
  row.method = "product";
  row.voxel_m = v;
  row.more = {{"poses", double(poses.size())},
              {"called_free", double(free)},
              {"called_blocked", double(blocked)},
              {"free_but_touching", double(wrongly_free)},
              {"blocked_with_room_percent", wrongly_blocked_percent}};
  row.must_hold = wrongly_free == 0 && wrongly_blocked_percent <= 1;
  context.rows.push_back(row);
  char line[200];
  std::snprintf(line, sizeof line,
                "%s at %g mm: of %zu poses %zu are called free, of which %zu touch surface that was hit by more than a "
                "voxel; %zu blocked, of which %.2f %% have more than two voxels of room",
                scene.name.c_str(), 1000 * v, poses.size(), free, wrongly_free, blocked, wrongly_blocked_percent);
  context.options.observer.say(line);
}

}  // namespace

void makeFitsTable(TableContext& context) {
  for (const char* name : kActionScenes) {
    const ActionScene scene = makeActionScene(context, name);
    context.options.observer.checkStop();
    addFitRow(context, scene);
  }
}

}  // namespace accessvdb::eval
