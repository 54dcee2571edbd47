// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Ways to approaches, planned through what the map knows to be free. The reference is a search in the exact scene:
/// which targets can be reached at all; and no plan may touch that scene.
#include "accessvdb/error.h"
#include "eval/table_context.h"

#ifndef ACCESSVDB_HAS_OMPL

namespace accessvdb::eval {

void makePlansTable(TableContext&) {
  throw InvalidArgument("evaluate.ompl", "plans", "needs OMPL, which this build does not have",
                        "On Debian and Ubuntu: apt install libompl-dev, and build again");
}

}  // namespace accessvdb::eval

#else

#include <ompl/base/goals/GoalStates.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <optional>
#include <queue>
#include <string>
#include <unordered_map>
#include <vector>

#include "accessvdb/ompl.h"
#include "accessvdb/tool_spec.h"
#include "eval/action_scenes.h"
#include "eval/collision_field.h"
#include "eval/tool_samples.h"

namespace accessvdb::eval {
namespace {

namespace ob = ompl::base;

constexpr double kCell_m = 0.05;
constexpr int kYaws = 30;  // of 12 degrees
constexpr std::size_t kTargets = 20;
constexpr double kMostSeconds = 1;
constexpr std::size_t kMostNodes = 400000;
constexpr int kSamples = 1000;

/// The tool in the exact scene.
class ExactTool {
 public:
  ExactTool(const CollisionField& scene, const ToolGeometry& tool)
      : scene_(scene), samples_T_(sampleToolSurface(tool, kSamples, 7)), reach_m_(tool.reach_m()) {}

  /// Some of it is deeper in the scene than that. @param beside_m  what is so near to the tip does not count
  [[nodiscard]] bool touches(const Eigen::Isometry3d& T_WT, double deeper_m, double beside_m = -1) const {
    return std::ranges::any_of(samples_T_, [&](const Eigen::Vector3d& p_T) {
      return p_T.norm() > beside_m && scene_.below(T_WT * p_T, -deeper_m);
    });
  }
  [[nodiscard]] bool touchesBetween(const Eigen::Isometry3d& from_T_WT, const Eigen::Isometry3d& to_T_WT,
                                    double deeper_m, double step_m, double beside_m = -1) const {
    const Eigen::AngleAxisd turn(from_T_WT.linear().transpose() * to_T_WT.linear());
    const double moved_m = (to_T_WT.translation() - from_T_WT.translation()).norm() + std::abs(turn.angle()) * reach_m_;
    const int steps = std::max(1, static_cast<int>(std::ceil(moved_m / step_m)));
    for (int n = 0; n <= steps; ++n)
      if (touches(PlanningWorld::between(from_T_WT, to_T_WT, double(n) / steps), deeper_m, beside_m)) return true;
    return false;
  }

 private:
  const CollisionField& scene_;
  std::vector<Eigen::Vector3d> samples_T_;
  double reach_m_;
};

/// A* over places on a grid and turns about the vertical.
class ExactSearch {
 public:
  ExactSearch(const ExactTool& tool, const Eigen::Vector3d& start_W, const Eigen::AlignedBox3d& box_W)
      : tool_(tool), start_W_(start_W), box_W_(box_W) {}

  /// Whether a pose can be reached from the start, whichever way the tool is turned there.
  [[nodiscard]] bool reaches(const Eigen::Isometry3d& T_WT) {
    const std::optional<Node> goal = nodeBeside(T_WT);
    if (!goal) return false;
    std::priority_queue<Open> open;
    std::unordered_map<std::uint64_t, int> cost;
    for (int yaw = 0; yaw < kYaws; ++yaw) {
      const Node node = {0, 0, 0, yaw};
      if (!isFree(node)) continue;
      cost[keyOf(node)] = 0;
      open.push({leastCost(node, *goal), 0, node});
    }
    while (!open.empty() && cost.size() < kMostNodes) {
      const Open best = open.top();
      open.pop();
      if (best.node == *goal) return true;
      if (cost[keyOf(best.node)] < best.cost) continue;
      for (int axis = 0; axis < 4; ++axis) {
        for (const int step : {-1, 1}) {
          Node next = best.node;
          next[static_cast<std::size_t>(axis)] += step;
          if (axis == 3) next[3] = (next[3] + kYaws) % kYaws;
          const auto [at, is_new] = cost.try_emplace(keyOf(next), best.cost + 1);
          if (!is_new && at->second <= best.cost + 1) continue;
          at->second = best.cost + 1;
          if (isFree(next)) open.push({best.cost + 1 + leastCost(next, *goal), best.cost + 1, next});
        }
      }
    }
    return false;
  }

 private:
  using Node = std::array<int, 4>;  ///< x, y, z, yaw
  struct Open {
    int least, cost;
    Node node;
    bool operator<(const Open& other) const { return least != other.least ? least > other.least : cost < other.cost; }
  };
  static std::uint64_t keyOf(const Node& node) {
    constexpr int kHalf = 1 << 15;
    std::uint64_t key = 0;
    for (const int part : node) key = key << 16 | static_cast<std::uint64_t>(part + kHalf);
    return key;
  }
  static int leastCost(const Node& a, const Node& b) {
    const int turn = std::abs(a[3] - b[3]);
    return std::abs(a[0] - b[0]) + std::abs(a[1] - b[1]) + std::abs(a[2] - b[2]) + std::min(turn, kYaws - turn);
  }
  [[nodiscard]] Eigen::Isometry3d poseOf(const Node& node) const {
    Eigen::Isometry3d T_WT = Eigen::Isometry3d::Identity();
    T_WT.translation() = start_W_ + kCell_m * Eigen::Vector3d(node[0], node[1], node[2]);
    T_WT.linear() =
        Eigen::AngleAxisd(2 * std::numbers::pi * node[3] / kYaws, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    return T_WT;
  }
  [[nodiscard]] bool isFree(const Node& node) {
    const auto [at, is_new] = free_.try_emplace(keyOf(node), false);
    if (is_new) {
      const Eigen::Isometry3d T_WT = poseOf(node);
      at->second = box_W_.contains(T_WT.translation()) && !tool_.touches(T_WT, 0);
    }
    return at->second;
  }
  /// A free node from which the pose is reached straight.
  [[nodiscard]] std::optional<Node> nodeBeside(const Eigen::Isometry3d& T_WT) {
    const Eigen::Vector3d at = (T_WT.translation() - start_W_) / kCell_m;
    const Eigen::Vector3d axis_W = T_WT.linear().col(0);
    const int yaw = static_cast<int>(std::lround(std::atan2(axis_W.y(), axis_W.x()) / (2 * std::numbers::pi) * kYaws));
    for (int n = 0; n < 81; ++n) {
      constexpr std::array kBeside = {0, 1, -1};
      const auto beside = [&](int place) { return kBeside[static_cast<std::size_t>(n / place % 3)]; };
      Node node = {};
      for (int axis = 0; axis < 3; ++axis)
        node[static_cast<std::size_t>(axis)] = static_cast<int>(std::lround(at[axis])) + beside(axis == 0   ? 1
                                                                                                : axis == 1 ? 3
                                                                                                            : 9);
      node[3] = ((yaw + beside(27)) % kYaws + kYaws) % kYaws;
      if (isFree(node) && !tool_.touchesBetween(poseOf(node), T_WT, 0, 0.01)) return node;
    }
    return std::nullopt;
  }

  const ExactTool& tool_;
  Eigen::Vector3d start_W_;
  Eigen::AlignedBox3d box_W_;
  std::unordered_map<std::uint64_t, bool> free_;
};

std::optional<Eigen::Isometry3d> startPose(const AccessibilityField& field, const Eigen::Vector3d& start_W) {
  std::vector<Eigen::Isometry3d> poses(kYaws, Eigen::Isometry3d::Identity());
  for (int n = 0; n < kYaws; ++n) {
    Eigen::Isometry3d& T_WT = poses[static_cast<std::size_t>(n)];
    T_WT.translation() = start_W;
    T_WT.linear() = Eigen::AngleAxisd(2 * std::numbers::pi * n / kYaws, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  }
  const std::vector<FitAnswer> answers = field.poseQuery().fits(poses);
  for (std::size_t n = 0; n < answers.size(); ++n)
    if (answers[n].free()) return poses[n];
  return std::nullopt;
}

/// A plan to one of a target's approaches, and to contact. @return its poses, the last one in contact; empty: none
std::vector<Eigen::Isometry3d> planTo(const AccessibilityField& field, const ApproachTarget& target,
                                      const Eigen::Isometry3d& start_T_WT, const Eigen::AlignedBox3d& box_W,
                                      double& seconds) {
  auto space = std::make_shared<ob::SE3StateSpace>();
  ob::RealVectorBounds bounds(3);
  for (unsigned axis = 0; axis < 3; ++axis) {
    bounds.setLow(axis, box_W.min()[axis]);
    bounds.setHigh(axis, box_W.max()[axis]);
  }
  space->setBounds(bounds);
  ompl::geometric::SimpleSetup setup(space);
  PlanningOptions options;
  for (const ApproachPath& path : target.approaches) options.contact_T_WT.push_back(path.contact_T_WT);
  planIn(field, *setup.getSpaceInformation(), options);
  // Steps as long as the tool: known free space is as wide as that, not as the room.
  const auto planner = std::make_shared<ompl::geometric::RRTConnect>(setup.getSpaceInformation());
  planner->setRange(field.tool().reach_m());
  setup.setPlanner(planner);
  setup.setStartState(stateOf(start_T_WT, space));
  auto goals = std::make_shared<ob::GoalStates>(setup.getSpaceInformation());
  for (const ApproachPath& path : target.approaches) goals->addState(stateOf(path.pre_contact_T_WT, space));
  setup.setGoal(goals);
  const auto begin = std::chrono::steady_clock::now();
  const bool found = setup.solve(kMostSeconds) == ob::PlannerStatus::EXACT_SOLUTION;
  seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  std::vector<Eigen::Isometry3d> way;
  if (!found) return way;
  for (const ob::State* state : setup.getSolutionPath().getStates())
    way.push_back(poseOf(*state->as<ob::SE3StateSpace::StateType>()));
  for (const ApproachPath& path : target.approaches) {
    if (!way.back().isApprox(path.pre_contact_T_WT, 1e-6)) continue;
    const bool reaches = setup.getSpaceInformation()->checkMotion(stateOf(path.pre_contact_T_WT, space).get(),
                                                                  stateOf(path.contact_T_WT, space).get());
    if (!reaches) return {};
    way.push_back(path.contact_T_WT);
    return way;
  }
  return {};
}

bool touchesScene(const ExactTool& tool, const std::vector<Eigen::Isometry3d>& way, double voxel_m, double tip_m) {
  for (std::size_t n = 1; n < way.size(); ++n) {
    const bool to_contact = n + 1 == way.size();
    if (tool.touchesBetween(way[n - 1], way[n], voxel_m, voxel_m / 2, to_contact ? tip_m : -1)) return true;
  }
  return false;
}

void addPlanRow(TableContext& context, const ActionScene& scene) {
  const AccessibilityField& field = scene.field;
  const FieldParams params = field.params();
  const double v = params.tsdf.voxel_size_m;
  const CollisionField exact_scene(scene.distance, scene.box_W, std::max(v, 0.005));
  const ExactTool tool(exact_scene, field.tool());
  const std::optional<Eigen::Isometry3d> start_T_WT = startPose(field, scene.start_W);
  if (!start_T_WT)
    throw UnusableInput("evaluate.plans", scene.name, "the tool is not known to fit at the first pose of the sensor");
  const ApproachOptions options = {
      .most = 0, .spacing_m = scene.spacing_m, .stand_off_m = scene.stand_off_m, .from_W = scene.start_W};
  const Approaches found = approaches(field, options);
  ExactSearch search(tool, scene.start_W, scene.box_W);
  std::size_t reached = 0, tried = 0, planned = 0, touching = 0;
  std::vector<double> all_seconds;
  ompl::RNG::setSeed(1);
  for (const ApproachTarget& target : found.targets) {
    if (reached == kTargets) break;
    context.options.observer.checkStop();
    ++tried;
    const bool reachable = std::ranges::any_of(
        target.approaches, [&](const ApproachPath& path) { return search.reaches(path.pre_contact_T_WT); });
    if (!reachable) continue;
    ++reached;
    double seconds = 0;
    const std::vector<Eigen::Isometry3d> way = planTo(field, target, *start_T_WT, scene.box_W, seconds);
    all_seconds.push_back(seconds);
    if (way.empty()) continue;
    ++planned;
    touching += touchesScene(tool, way, v, params.scoring.self_exclusion_voxels * v) ? 1 : 0;
  }
  std::ranges::sort(all_seconds);
  const double median_s = all_seconds.empty() ? 0 : all_seconds[all_seconds.size() / 2];
  const double planned_percent = reached > 0 ? 100.0 * double(planned) / double(reached) : 0;
  TableRow row;
  row.table = "plans";
  row.scene = scene.name;
  row.method = "product";
  row.variant = "known free";
  row.voxel_m = v;
  row.more = {{"targets", static_cast<double>(found.targets.size())},
              {"tried", static_cast<double>(tried)},
              {"reached_by_exact_search", static_cast<double>(reached)},
              {"planned_percent", planned_percent},
              {"touching", static_cast<double>(touching)},
              {"median_s", median_s}};
  row.must_hold = planned_percent >= 95 && touching == 0;
  context.rows.push_back(row);
  char line[240];
  std::snprintf(line, sizeof line,
                "%s at %g mm: %zu targets, of %zu an exact search reaches %zu, %.0f %% of them planned in %g s (median "
                "%.3f s), %zu plans touch the scene",
                scene.name.c_str(), 1000 * v, found.targets.size(), tried, reached, planned_percent, kMostSeconds,
                median_s, touching);
  context.options.observer.say(line);
}

}  // namespace

void makePlansTable(TableContext& context) {
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  for (const char* name : kActionScenes) {
    const ActionScene scene = makeActionScene(context, name);
    addPlanRow(context, scene);
    if (scene.name != "pine") continue;  // the others are in the table of approaches
    for (const bool allow_unknown : {false, true}) {
      addApproachRow(context, scene.field, scene.distance, scene.name,
                     {.most = 100, .each = 1, .allow_unknown = allow_unknown}, 98);
    }
  }
}

}  // namespace accessvdb::eval

#endif
