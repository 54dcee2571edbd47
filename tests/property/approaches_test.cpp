// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Approaches, how far a tool can turn, and distances beyond tau: against every direction tried by itself, every voxel
/// by hand, and the exact distance of a ball.
#include "accessvdb/approaches.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/device_view.h"
#include "accessvdb/distance_field.h"
#include "accessvdb/error.h"
#include "accessvdb/pose_query.h"
#include "accessvdb/program/path_facts.h"
#include "property/ball_world.h"
#include "property/several_tools.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

using namespace ball_world;

AccessibilityField wallField(const OrientationSet& orientations, int threads = 2) {
  FieldParams params = paramsAt(0.04);
  params.approach.num_directions = 60;
  params.approach.orientations = orientations;
  params.threads = threads;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  for (const Scan& scan : wallScans(11, 6, 1200)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  return field;
}

/// How many free directions hang together with the first, by the angles between their axes.
std::size_t hangTogether(const AccessMap& map, double most_rad, double pitch_of = NAN) {
  std::set<std::size_t> met = {map.point.direction};
  std::vector<std::size_t> open = {map.point.direction};
  while (!open.empty()) {
    const Eigen::Vector3f axis = map.directions[open.back()].direction_W;
    open.pop_back();
    for (std::size_t d = 0; d < map.directions.size(); ++d) {
      const Eigen::Vector3f& other = map.directions[d].direction_W;
      const bool beside = std::acos(std::clamp(axis.dot(other), -1.0F, 1.0F)) <= most_rad;
      if (map.directions[d].reason != PointReason::None || !beside || met.contains(d)) continue;
      if (!std::isnan(pitch_of) && std::abs(std::asin(other.z()) - pitch_of) > 1e-3) continue;
      met.insert(d);
      open.push_back(d);
    }
  }
  return met.size();
}

class FreeArcs : public ::testing::TestWithParam<const char*> {};

TEST_P(FreeArcs, AreWhatEveryDirectionByItselfSays) {
  const OrientationSet set = OrientationSet::parse(GetParam());
  const AccessibilityField field = wallField(set);
  std::vector<std::uint32_t> ids;
  for (const SurfacePoint& point : field.snapshot().points) ids.push_back(point.id);
  const std::vector<float> arcs = field.freeArcs_deg(ids);
  const std::vector<AccessMap> maps = field.accessMaps(ids);
  std::set<float> widths;
  for (std::size_t n = 0; n < ids.size(); ++n) {
    const AccessMap& map = maps[n];
    ASSERT_EQ(map.point.id, ids[n]);
    if (map.point.label != PointLabel::Accessible) {
      ASSERT_EQ(arcs[n], -1);
      continue;
    }
    double expected = 0;
    if (set.kind == OrientationKind::Sphere) {
      const auto count = static_cast<double>(hangTogether(map, 1.5 * set.step_deg * M_PI / 180));
      expected = 360 / M_PI * std::acos(1 - 2 * count / static_cast<double>(map.directions.size()));
    } else {
      const double pitch = std::asin(map.directions[map.point.direction].direction_W.z());
      expected = 6.0 * static_cast<double>(hangTogether(map, 6.5 * M_PI / 180, pitch));
    }
    ASSERT_NEAR(arcs[n], expected, 1e-3) << n;
    widths.insert(arcs[n]);
  }
  EXPECT_GT(widths.size(), 5U);
}
INSTANTIATE_TEST_SUITE_P(Sets, FreeArcs, ::testing::Values("yaw", "pitch:-20:20:20", "sphere:20"),
                         [](const auto& test) { return std::string(test.param).substr(0, 3); });

TEST(FreeArcs, AreRefusedForWhatIsNoPoint) {
  const AccessibilityField field = wallField(OrientationSet::yaw());
  const auto refused = [&](std::vector<std::uint32_t> ids, std::size_t tool) -> std::string {
    try {
      return std::to_string(field.freeArcs_deg(ids, tool).size());
    } catch (const Error& error) {
      return error.id();
    }
  };
  EXPECT_EQ(refused({}, 0), "0");
  EXPECT_EQ(refused({0, 1, 0}, 0), "point.id");
  EXPECT_EQ(refused({1000000}, 0), "point.id");
  EXPECT_EQ(refused({0}, 1), "tool.index");
}

/// The batch answers as one call for each point does.
TEST(AccessMaps, AreThoseOfSinglePoints) {
  const AccessibilityField field = wallField(OrientationSet::yaw());
  std::vector<std::uint32_t> ids;
  for (const SurfacePoint& point : field.snapshot().points)
    if (point.id % 97 == 0) ids.push_back(point.id);
  ASSERT_GT(ids.size(), 10U);
  const std::vector<AccessMap> maps = field.accessMaps(ids);
  for (const AccessMap& map : maps) {
    const AccessMap one = *field.accessMap(map.point.position_W);
    ASSERT_EQ(one.point.id, map.point.id);
    for (std::size_t d = 0; d < one.directions.size(); ++d) {
      ASSERT_EQ(one.directions[d].reason, map.directions[d].reason);
      ASSERT_EQ(one.directions[d].score, map.directions[d].score);
    }
  }
}

TEST(DistanceGrid, IsTheDistanceToEveryVoxelByHand) {
  const AccessibilityField field = wallField(OrientationSet::yaw());
  const DeviceView view = field.hostView();
  const double v = 0.04, most_m = 0.2;
  const DistanceGrid grid = distanceGrid(field, {0.3, 0.2, 0.5}, {2.3, 0.9, 1.1}, most_m);
  ASSERT_EQ(grid.distance_m.size(), grid.size[0] * grid.size[1] * grid.size[2]);
  std::vector<Eigen::Vector3d> colliding;
  for (int x = -9; x < static_cast<int>(grid.size[0]) + 9; ++x)
    for (int y = -9; y < static_cast<int>(grid.size[1]) + 9; ++y)
      for (int z = -9; z < static_cast<int>(grid.size[2]) + 9; ++z) {
        const Eigen::Vector3d p_W = grid.first_W + v * Eigen::Vector3d(x, y, z);
        if (view.occupancyAt(p_W.data()) == Occupancy::Collides) colliding.push_back(p_W);
      }
  ASSERT_GT(colliding.size(), 100U);
  std::size_t beyond = 0, unknown = 0;
  for (std::size_t x = 0; x < grid.size[0]; ++x)
    for (std::size_t y = 0; y < grid.size[1]; ++y)
      for (std::size_t z = 0; z < grid.size[2]; ++z) {
        const Eigen::Vector3d p_W = grid.first_W + v * Eigen::Vector3d(double(x), double(y), double(z));
        double least_m = most_m;
        for (const Eigen::Vector3d& other : colliding) least_m = std::min(least_m, (other - p_W).norm());
        ASSERT_NEAR(grid.distance_m[grid.index(x, y, z)], least_m, 1e-5) << x << " " << y << " " << z;
        ASSERT_EQ(grid.known[grid.index(x, y, z)] == 0, view.occupancyAt(p_W.data()) == Occupancy::Unknown);
        beyond += least_m == most_m ? 1 : 0;
        unknown += grid.known[grid.index(x, y, z)] == 0 ? 1 : 0;
      }
  EXPECT_GT(beyond, 10U);
  EXPECT_GT(unknown, 10U);
  EXPECT_LT(beyond, grid.distance_m.size() * 9 / 10);
}

TEST(DistanceGrid, IsRefusedInWords) {
  const AccessibilityField field = wallField(OrientationSet::yaw());
  const auto refused = [&](const Eigen::Vector3d& low, const Eigen::Vector3d& high, double most_m) -> std::string {
    try {
      return std::to_string(distanceGrid(field, low, high, most_m).distance_m.size());
    } catch (const Error& error) {
      return error.id();
    }
  };
  EXPECT_EQ(refused({0, 0, 0}, {0, 0, 0}, 0.1), "1");
  EXPECT_EQ(refused({0, 0, 0}, {-1, 1, 1}, 0.1), "distance.box");
  EXPECT_EQ(refused({0, NAN, 0}, {1, 1, 1}, 0.1), "distance.box");
  EXPECT_EQ(refused({0, 0, 0}, {1e12, 1, 1}, 0.1), "distance.box");
  EXPECT_EQ(refused({0, 0, 0}, {1, 1, 1}, 0.01), "distance.range");
  EXPECT_EQ(refused({0, 0, 0}, {1, 1, 1}, NAN), "distance.range");
  EXPECT_EQ(refused({0, 0, 0}, {1000, 1000, 1000}, 1), "distance.size");
}

/// The room that a tool has at a pose, from the ball alone.
double roomAt(const std::vector<Eigen::Vector3d>& places_T, const Eigen::Isometry3d& T_WT) {
  double room_m = 10;
  for (const Eigen::Vector3d& p_T : places_T) room_m = std::min(room_m, (T_WT * p_T - kCentre_W).norm() - kRadius_m);
  return room_m;
}

TEST(Approaches, AreFreeInTheExactSceneAndSpreadOverIt) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  FieldParams params;
  params.approach.orientations = OrientationSet::pitch(-40, 40, 20);
  params.approach.num_directions = 60;
  AccessibilityField field = ballField(withMargins({{pencil, params.approach.orientations}}, {0.04, 0.08}), params);
  field.update();
  ApproachOptions options;
  options.most = 0;
  options.spacing_m = 0.2;
  options.stand_off_m = 0.16;
  options.from_W = Eigen::Vector3d(3, 0, 2);
  const Approaches found = approaches(field, options);
  ASSERT_GT(found.targets.size(), 20U);
  EXPECT_GT(found.covered, found.accessible * 8 / 10);
  const std::vector<Eigen::Vector3d> places = surfaceOf(pencil, 0.02);
  const PoseQuery query = field.poseQuery();
  std::size_t others = 0;
  std::vector<std::vector<double>> keys;
  for (const ApproachTarget& target : found.targets) {
    for (const ApproachTarget& other : found.targets) {
      if (&other != &target) {
        ASSERT_GE((other.position_W - target.position_W).norm(), options.spacing_m);
      }
    }
    ASSERT_FALSE(target.approaches.empty());
    ASSERT_LE(target.approaches.size(), 3U);
    ASSERT_EQ(target.tool, 0U);
    others += target.approaches.size() - 1;
    for (const ApproachPath& path : target.approaches) {
      const std::vector<Eigen::Isometry3d> poses = {path.pre_contact_T_WT, path.retreat_T_WT};
      for (const FitAnswer& answer : query.fits(poses)) ASSERT_TRUE(answer.free());
      for (const Eigen::Isometry3d& T_WT : poses) ASSERT_GT(roomAt(places, T_WT), -kVoxel_m);
      ASSERT_NEAR((path.pre_contact_T_WT.translation() - target.position_W).norm(), options.stand_off_m, 1e-9);
      ASSERT_LE((path.retreat_T_WT.translation() - target.position_W).norm(), 2 * options.stand_off_m + 1e-9);
      // With the room that is promised.
      const std::size_t with_room = target.margin_m > 0.07F ? 2 : target.margin_m > 0.03F ? 1 : 0;
      const FitAnswer contact = query.fits({&path.contact_T_WT, 1}, {.tool = with_room, .contact = true}).front();
      ASSERT_FALSE(contact.collision());
      ASSERT_EQ(contact.collisions, path.collisions);
      ASSERT_GT(path.free_arc_deg, 0);
    }
    keys.push_back({-target.margin_m, -std::floor(target.approaches[0].free_arc_deg / 10 + 1e-9),
                    -std::floor(target.confidence / 0.1 + 1e-9), std::floor(target.distance_m / 0.5 + 1e-9)});
  }
  EXPECT_GT(others, 10U);
  EXPECT_TRUE(std::is_sorted(keys.begin(), keys.end()));
  // The best ten are the first ten.
  options.most = 10;
  const Approaches ten = approaches(field, options);
  ASSERT_EQ(ten.targets.size(), 10U);
  for (std::size_t n = 0; n < 10; ++n) EXPECT_EQ(ten.targets[n].point, found.targets[n].point);
  options.within_m = 2.8;
  for (const ApproachTarget& target : approaches(field, options).targets) EXPECT_LE(target.distance_m, 2.8);
}

/// A plate stands where the tool passes on the last part of its way only: no way in leads through it.
TEST(Approaches, PassNothingOnTheLastPartOfTheWay) {
  ApproachOptions options;
  options.most = 0;
  options.spacing_m = 0.06;
  options.stand_off_m = 0.25;
  options.allow_unknown = true;
  std::size_t in_front = 0, behind_plate = 0;
  for (const bool with_plate : {false, true}) {
    AccessibilityField field = ballField(teeTool());
    if (with_plate) addPlate(field);
    field.update();
    const PoseQuery query = field.poseQuery();
    const Approaches found = approaches(field, options);
    ASSERT_GT(found.targets.size(), 30U);
    for (const ApproachTarget& target : found.targets) {
      for (const ApproachPath& path : target.approaches) {
        std::vector<Eigen::Isometry3d> poses;
        for (double back_m = 0; back_m < 5 * kVoxel_m; back_m += kVoxel_m) {
          poses.push_back(path.contact_T_WT);
          poses.back().translation() += back_m * path.contact_T_WT.linear().col(0);
        }
        std::size_t collide = 0;
        for (const FitAnswer& answer : query.fits(poses, {.contact = true})) collide += answer.collision() ? 1 : 0;
        EXPECT_EQ(collide, 0U) << target.position_W.transpose();
        const bool is_there = (target.position_W - kCentre_W - Eigen::Vector3d(kRadius_m, 0, 0)).norm() < 0.1 &&
                              path.contact_T_WT.linear()(0, 0) > 0.99;
        (with_plate ? behind_plate : in_front) += is_there ? 1 : 0;
      }
    }
  }
  EXPECT_GT(in_front, behind_plate);
}

/// A point's best direction without room need not be one with the room that its margin says.
TEST(Approaches, HaveTheRoomThatTheirMarginSays) {
  const std::vector<ToolSpec> tools = withMargins({{ToolGeometry::builtin("builtin:pruner")}}, {0.04, 0.08, 0.12});
  FieldParams params = paramsAt(0.04);
  params.approach.num_directions = 60;
  AccessibilityField field(tools, params);
  for (const Scan& scan : wallScans(5, 9, 1500)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  const PoseQuery query = field.poseQuery();
  std::size_t with_room = 0, only_others = 0;
  for (const ApproachTarget& target :
       approaches(field, {.most = 0, .spacing_m = 0.08, .stand_off_m = 0.32, .allow_unknown = true}).targets) {
    std::size_t k = 0;
    while (k + 1 < tools.size() && tools[k + 1].tool.margin_m() <= target.margin_m + 1e-6) ++k;
    with_room += k > 0 ? 1 : 0;
    for (const ApproachPath& path : target.approaches) {
      const FitAnswer contact = query.fits({&path.contact_T_WT, 1}, {.tool = k, .contact = true}).front();
      ASSERT_FALSE(contact.collision()) << target.point << " with " << tools[k].name;
    }
    const SurfacePoint point = *field.pointAt(target.position_W);
    Eigen::Isometry3d best = Eigen::Isometry3d::Identity();
    best.linear() = point.orientation_WT.cast<double>().normalized().toRotationMatrix();
    best.translation() = point.position_W;
    only_others += query.fits({&best, 1}, {.tool = k, .contact = true}).front().collision() ? 1 : 0;
  }
  EXPECT_GT(with_room, 10U);
  EXPECT_GT(only_others, 0U);
}

TEST(Approaches, NeedKnownFreeSpaceOrSayThatTheyDoNot) {
  const AccessibilityField field = wallField(OrientationSet::yaw());
  const Approaches none = approaches(field);
  EXPECT_TRUE(none.targets.empty());
  EXPECT_GT(none.without_way, 0U);
  const Approaches some = approaches(field, {.stand_off_m = 0.32, .allow_unknown = true});
  EXPECT_FALSE(some.targets.empty());
}

TEST(Approaches, DoNotDependOnThreads) {
  const ApproachOptions options = {.most = 0, .stand_off_m = 0.32, .allow_unknown = true};
  const std::string one = io::approachesJson(approaches(wallField(OrientationSet::yaw(), 1), options), {"pruner"});
  EXPECT_EQ(one, io::approachesJson(approaches(wallField(OrientationSet::yaw(), 3), options), {"pruner"}));
  EXPECT_GT(one.size(), 5000U);
}

TEST(Approaches, AreRefusedInWords) {
  const AccessibilityField field = wallField(OrientationSet::yaw());
  const auto refused = [&](const ApproachOptions& options) -> std::string {
    try {
      (void)approaches(field, options);
      return "taken";
    } catch (const Error& error) {
      return error.id();
    }
  };
  EXPECT_EQ(refused({}), "taken");
  EXPECT_EQ(refused({.spacing_m = 0.01}), "approaches.options");
  EXPECT_EQ(refused({.spacing_m = NAN}), "approaches.options");
  EXPECT_EQ(refused({.each = 0}), "approaches.options");
  EXPECT_EQ(refused({.within_m = 3}), "approaches.options");
  EXPECT_EQ(refused({.from_W = Eigen::Vector3d(1, NAN, 0)}), "approaches.options");
  EXPECT_EQ(refused({.per = "tree"}), "approaches.per");
  EXPECT_EQ(refused({.from_W = Eigen::Vector3d(500, 0, 0), .within_m = 1}), "approaches.none");
}

TEST(Approaches, HaveFilesThatSayTheSame) {
  const AccessibilityField field = wallField(OrientationSet::yaw());
  const Approaches found = approaches(field, {.most = 4, .stand_off_m = 0.32, .allow_unknown = true});
  const ScratchFolder scratch;
  io::writeApproaches(scratch.path(), found, {"pencil", "pencil_40mm", "pencil_80mm"});
  std::size_t paths = 0;
  for (const ApproachTarget& target : found.targets) paths += target.approaches.size();
  const std::string csv = io::contentAt(scratch / "approaches.csv"), ply = io::contentAt(scratch / "approaches.ply");
  EXPECT_EQ(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')), paths + 1);
  EXPECT_NE(ply.find("element vertex " + std::to_string(5 * paths)), std::string::npos);
  EXPECT_EQ(csv.substr(csv.find('\n') - 19, 19), ",access_probability");
  for (const ApproachTarget& target : found.targets) {
    EXPECT_GT(target.access_probability, 0.5F);  // its point is accessible
    EXPECT_EQ(target.access_probability, field.snapshot().points.at(target.point).access_probability);
  }
  const std::size_t header = ply.find("end_header\n") + 11;
  EXPECT_EQ(ply.size() - header, paths * (5 * (3 * 8 + 3 + 4) + 4 * (1 + 12) + 1 + 16));
  EXPECT_EQ(io::contentAt(scratch / "approaches.json"),
            io::approachesJson(found, {"pencil", "pencil_40mm", "pencil_80mm"}));
}

}  // namespace
}  // namespace accessvdb::test
