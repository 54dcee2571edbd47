// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Plans around a ball of known place and size, by OMPL's own planners: no state of theirs is inside it.
#include "accessvdb/ompl.h"

#include <gtest/gtest.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <memory>
#include <vector>

#include "accessvdb/approaches.h"
#include "property/ball_world.h"

namespace accessvdb::test {
namespace {

using namespace ball_world;
namespace ob = ompl::base;

std::shared_ptr<ob::SE3StateSpace> spaceAround(double half_m) {
  auto space = std::make_shared<ob::SE3StateSpace>();
  ob::RealVectorBounds bounds(3);
  for (unsigned axis = 0; axis < 3; ++axis) {
    bounds.setLow(axis, kCentre_W[axis] - half_m);
    bounds.setHigh(axis, kCentre_W[axis] + half_m);
  }
  space->setBounds(bounds);
  return space;
}

/// The tool points at the ball from outside, its body away from it.
Eigen::Isometry3d outside(const Eigen::Vector3d& side, double away_m) {
  Eigen::Isometry3d T_WT = Eigen::Isometry3d::Identity();
  T_WT.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitX(), side).toRotationMatrix();
  T_WT.translation() = kCentre_W + (kRadius_m + away_m) * side;
  return T_WT;
}

/// How deep the tool is in the ball; negative: how far off.
double depth_m(const std::vector<Eigen::Vector3d>& surface_T, const Eigen::Isometry3d& T_WT) {
  double depth = -1e9;
  for (const Eigen::Vector3d& p_T : surface_T) depth = std::max(depth, kRadius_m - (T_WT * p_T - kCentre_W).norm());
  return depth;
}

class PlansAroundABall : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
    ompl::RNG::setSeed(3);
  }
  ToolGeometry tool_ = ToolGeometry::builtin("builtin:pencil");
  AccessibilityField field_ = ballField(tool_);
  std::vector<Eigen::Vector3d> surface_T_ = surfaceOf(tool_, 0.01);
  std::shared_ptr<ob::SE3StateSpace> space_ = spaceAround(1.6);
  std::shared_ptr<ob::SpaceInformation> information_ = std::make_shared<ob::SpaceInformation>(space_);
};

TEST_F(PlansAroundABall, ReachesItsOtherSideAndTouchesNothing) {
  Random random;
  for (int n = 0; n < 5; ++n) {
    const Eigen::Vector3d side = random.direction();
    ompl::geometric::SimpleSetup setup(space_);
    planIn(field_, *setup.getSpaceInformation());
    setup.setPlanner(std::make_shared<ompl::geometric::RRTConnect>(setup.getSpaceInformation()));
    setup.setStartAndGoalStates(stateOf(outside(side, 0.1), space_), stateOf(outside(-side, 0.1), space_));
    ASSERT_EQ(setup.solve(20.0), ob::PlannerStatus::EXACT_SOLUTION) << n;
    ompl::geometric::PathGeometric& path = setup.getSolutionPath();
    path.interpolate(400);
    for (const ob::State* state : path.getStates())
      EXPECT_LT(depth_m(surface_T_, poseOf(*state->as<ob::SE3StateSpace::StateType>())), kVoxel_m) << n;
  }
}

TEST_F(PlansAroundABall, MotionsEndWhereTheToolMeetsIt) {
  planIn(field_, *information_);
  const auto motions = information_->getMotionValidator();
  Random random;
  std::size_t ended = 0, went_through = 0;
  for (int n = 0; n < 200; ++n) {
    const Eigen::Isometry3d from_T_WT = random.pose(0.8, 1.2);
    Eigen::Isometry3d to_T_WT = random.pose(0.8, 1.2);
    if (n % 2 == 0) to_T_WT = PlanningWorld::between(from_T_WT, to_T_WT, 0.1);  // most long ones end
    const auto from = stateOf(from_T_WT, space_), to = stateOf(to_T_WT, space_);
    if (!information_->isValid(from.get())) continue;
    ob::ScopedState<ob::SE3StateSpace> reached(space_);
    std::pair<ob::State*, double> last(reached.get(), -1);
    const bool whole = motions->checkMotion(from.get(), to.get(), last);
    EXPECT_EQ(motions->checkMotion(from.get(), to.get()), whole) << n;
    const PathFitAnswer answer =
        field_.poseQuery().fitsAlong(std::vector<Eigen::Isometry3d>{from_T_WT, to_T_WT}, {.unknown_blocks = true});
    EXPECT_EQ(whole, answer.free()) << n;
    if (whole) {
      ++went_through;
      EXPECT_EQ(last.second, -1);
      continue;
    }
    ++ended;
    EXPECT_TRUE(last.second >= 0 && last.second < 1) << n;
    EXPECT_TRUE(information_->isValid(reached.get())) << n;
    if (answer.collision) {
      EXPECT_LT(last.second, answer.first_hit) << n;
    }
  }
  EXPECT_GT(ended, 30U);
  EXPECT_GT(went_through, 10U);
}

TEST_F(PlansAroundABall, UnknownSpaceIsFreeOnlyIfThatIsAllowed) {
  auto space = spaceAround(50);
  Eigen::Isometry3d far_T_WT = outside(Eigen::Vector3d::UnitX(), 30);
  for (const bool allow_unknown : {false, true}) {
    ob::SpaceInformation information(space);
    planIn(field_, information, {.allow_unknown = allow_unknown});
    EXPECT_EQ(information.isValid(stateOf(far_T_WT, space).get()), allow_unknown);
    EXPECT_EQ(information.checkMotion(stateOf(outside(Eigen::Vector3d::UnitX(), 0.1), space).get(),
                                      stateOf(far_T_WT, space).get()),
              allow_unknown);
    EXPECT_FALSE(information.isValid(stateOf(outside(Eigen::Vector3d::UnitX(), -0.2), space).get()));
  }
}

TEST_F(PlansAroundABall, ContactIsReachedAlongTheBodyOnly) {
  field_.update();
  const Approaches found = approaches(field_, {.most = 5});
  ASSERT_GE(found.targets.size(), 3U);
  for (const ApproachTarget& target : found.targets) {
    const ApproachPath& path = target.approaches.front();
    const auto before = stateOf(path.pre_contact_T_WT, space_), at = stateOf(path.contact_T_WT, space_);
    Eigen::Isometry3d beside_T_WT = path.pre_contact_T_WT;
    beside_T_WT.translation() += 0.02 * beside_T_WT.linear().col(1);
    const auto beside = stateOf(beside_T_WT, space_);

    ob::SpaceInformation touching(space_);
    planIn(field_, touching, {.contact_T_WT = {path.contact_T_WT}});
    EXPECT_TRUE(touching.isValid(at.get()));
    EXPECT_TRUE(touching.checkMotion(before.get(), at.get()));
    EXPECT_TRUE(touching.checkMotion(at.get(), before.get()));
    EXPECT_TRUE(touching.checkMotion(before.get(), beside.get()));
    EXPECT_FALSE(touching.checkMotion(beside.get(), at.get()));
    EXPECT_FALSE(touching.checkMotion(at.get(), beside.get()));

    planIn(field_, *information_);
    EXPECT_FALSE(information_->isValid(at.get()));
    EXPECT_FALSE(information_->checkMotion(before.get(), at.get()));
  }
  // In contact, where the tool does not fit, it may not be.
  const Eigen::Isometry3d inside = outside(Eigen::Vector3d::UnitX(), -0.2);
  ob::SpaceInformation stuck(space_);
  planIn(field_, stuck, {.contact_T_WT = {inside}});
  EXPECT_FALSE(stuck.isValid(stateOf(inside, space_).get()));
  EXPECT_FALSE(
      stuck.checkMotion(stateOf(outside(Eigen::Vector3d::UnitX(), 0.3), space_).get(), stateOf(inside, space_).get()));
}

/// Away from contact into what nobody saw: not a step of it counts as free.
TEST_F(PlansAroundABall, ARetreatIntoTheUnknownEndsWhereItBegins) {
  AccessibilityField field(tool_, [] {
    FieldParams params;
    params.tsdf.voxel_size_m = kVoxel_m;
    params.tsdf.range_noise_m = 0;
    params.backend = BackendKind::Cpu;
    return params;
  }());
  std::vector<Eigen::Vector3d> points_W, origins_W;
  for (double y = -0.2; y < 0.2; y += 0.01) {
    for (double z = 1.8; z < 2.2; z += 0.01) {
      points_W.emplace_back(0.5, y, z);
      origins_W.emplace_back(2.5, y, z);
    }
  }
  for (int n = 0; n < 5; ++n) field.integrateRays(points_W, origins_W);
  Eigen::Isometry3d contact_T_WT = Eigen::Isometry3d::Identity();
  contact_T_WT.translation() = Eigen::Vector3d(0.5, 0, 2);
  ob::SpaceInformation information(space_);
  planIn(field, information, {.contact_T_WT = {contact_T_WT}});
  const double way_m = field.poseQuery().contactWay_m();
  for (const double back_m : {way_m + 1e-9, way_m + 1e-4, 0.5, 1.0}) {
    Eigen::Isometry3d back_T_WT = contact_T_WT;
    back_T_WT.translation().x() += back_m;
    const auto contact = stateOf(contact_T_WT, space_), back = stateOf(back_T_WT, space_);
    ASSERT_TRUE(information.isValid(contact.get()));
    ASSERT_FALSE(information.isValid(back.get())) << back_m;
    EXPECT_FALSE(information.checkMotion(contact.get(), back.get())) << back_m;
    ob::ScopedState<ob::SE3StateSpace> reached(space_);
    std::pair<ob::State*, double> last(reached.get(), -1);
    EXPECT_FALSE(information.checkMotion(contact.get(), back.get(), last)) << back_m;
    EXPECT_EQ(last.second, 0) << back_m;
    EXPECT_TRUE(information.isValid(reached.get())) << back_m;
  }
}

/// A turn by 180 degrees goes the way that the states say, which their rotations do not.
TEST_F(PlansAroundABall, HalfTurnsGoTheWayThatStatesSay) {
  planIn(field_, *information_, {.allow_unknown = true});
  std::size_t free = 0, blocked = 0;
  for (int yaw = 0; yaw < 360; yaw += 10) {
    for (const double sign : {1.0, -1.0}) {
      // Beside the ball, so near that the tool meets it where it points to it.
      Eigen::Isometry3d from_T_WT = Eigen::Isometry3d::Identity();
      from_T_WT.translation() = kCentre_W + Eigen::Vector3d(kRadius_m + 0.1, 0, 0);
      from_T_WT.linear() = Eigen::AngleAxisd(yaw * M_PI / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix();
      const auto from = stateOf(from_T_WT, space_);
      auto to = from;
      const Eigen::Quaterniond half = Eigen::Quaterniond(from_T_WT.linear()) * Eigen::Quaterniond(0, 0, 0, sign);
      to->rotation().w = half.w();
      to->rotation().x = half.x();
      to->rotation().y = half.y();
      to->rotation().z = half.z();
      if (!information_->isValid(from.get()) || !information_->isValid(to.get())) continue;
      bool all_valid = true;
      ob::ScopedState<ob::SE3StateSpace> state(space_);
      for (int n = 1; n < 200; ++n) {
        space_->interpolate(from.get(), to.get(), n / 200.0, state.get());
        all_valid = all_valid && information_->isValid(state.get());
      }
      EXPECT_EQ(information_->checkMotion(from.get(), to.get()), all_valid) << yaw << " " << sign;
      ++(all_valid ? free : blocked);
    }
  }
  EXPECT_GT(free, 5U);
  EXPECT_GT(blocked, 5U);
}

/// A thin plate just behind the crossbar of the tool in contact: nothing collides there, nor where the way in begins.
TEST_F(PlansAroundABall, NothingIsPassedOnTheLastPartOfTheWay) {
  const Eigen::Isometry3d contact_T_WT = outside(Eigen::Vector3d::UnitX(), 0);
  for (const bool with_plate : {false, true}) {
    AccessibilityField field = ballField(teeTool());
    if (with_plate) addPlate(field);
    const FitAnswer at = field.poseQuery().fits({&contact_T_WT, 1}, {.contact = true})[0];
    ASSERT_FALSE(at.collision()) << at.collisions;
    Eigen::Isometry3d before_T_WT = contact_T_WT;
    before_T_WT.translation().x() += 0.25;
    ob::SpaceInformation information(space_);
    planIn(field, information, {.allow_unknown = true, .contact_T_WT = {contact_T_WT}});
    const auto before = stateOf(before_T_WT, space_), contact = stateOf(contact_T_WT, space_);
    EXPECT_TRUE(information.isValid(before.get()));
    EXPECT_EQ(information.isValid(contact.get()), !with_plate);
    EXPECT_EQ(information.checkMotion(before.get(), contact.get()), !with_plate);
    EXPECT_EQ(information.checkMotion(contact.get(), before.get()), !with_plate);
  }
}

TEST_F(PlansAroundABall, WhatCarriesTheToolMustFitToo) {
  // Beside the tool, as far away as the ball is from it.
  const BodyCapsule beside = {.a_T = {0, 0, -0.45}, .b_T = {0.1, 0, -0.45}, .radius_m = 0.1};
  Eigen::Isometry3d above_T_WT = Eigen::Isometry3d::Identity();
  above_T_WT.translation() = kCentre_W + Eigen::Vector3d(0, 0, 0.9);
  Eigen::Isometry3d below_T_WT = above_T_WT;
  below_T_WT.translation().z() = kCentre_W.z() - 0.9;
  Eigen::Isometry3d left_T_WT = above_T_WT;
  left_T_WT.translation() += Eigen::Vector3d(-0.9, 0, 0.1);
  const auto above = stateOf(above_T_WT, space_), below = stateOf(below_T_WT, space_),
             left = stateOf(left_T_WT, space_);
  planIn(field_, *information_, {.allow_unknown = true});
  EXPECT_TRUE(information_->isValid(above.get()));
  ob::SpaceInformation carried(space_);
  planIn(field_, carried, {.body = {beside}, .allow_unknown = true});
  EXPECT_FALSE(carried.isValid(above.get()));
  EXPECT_TRUE(carried.isValid(below.get()));
  EXPECT_TRUE(carried.isValid(left.get()));
  ob::ScopedState<ob::SE3StateSpace> reached(space_);
  std::pair<ob::State*, double> last(reached.get(), -1);
  EXPECT_FALSE(carried.checkMotion(left.get(), above.get()));
  EXPECT_FALSE(carried.checkMotion(left.get(), above.get(), last));
  EXPECT_NEAR(last.second, 0.48, 0.03);
  EXPECT_TRUE(carried.isValid(reached.get()));
}

TEST_F(PlansAroundABall, SaysWhatIsWrong) {
  const auto idOf = [&](const auto& call) -> std::string {
    try {
      call();
    } catch (const Error& error) {
      return error.id();
    }
    return "none";
  };
  ob::SpaceInformation flat(std::make_shared<ob::RealVectorStateSpace>(2));
  EXPECT_EQ(idOf([&] { planIn(field_, flat); }), "plan.space");
  EXPECT_EQ(idOf([&] { planIn(field_, *information_, {.tool = 1}); }), "tool.index");
  EXPECT_EQ(idOf([&] { planIn(field_, *information_, {.body = {{.radius_m = -1}}}); }), "plan.options");
  EXPECT_EQ(idOf([&] { planIn(field_, *information_, {.body = {{.a_T = {NAN, 0, 0}}}}); }), "plan.options");
  Eigen::Isometry3d scaled = Eigen::Isometry3d::Identity();
  scaled.linear() *= 2;
  EXPECT_EQ(idOf([&] { planIn(field_, *information_, {.contact_T_WT = {scaled}}); }), "plan.options");
  planIn(field_, *information_);
  const auto state = stateOf(outside(Eigen::Vector3d::UnitX(), 0.3), space_);
  EXPECT_TRUE(information_->isValid(state.get()));
  Eigen::Isometry3d nowhere = outside(Eigen::Vector3d::UnitX(), 0.3);
  nowhere.translation().x() = NAN;
  EXPECT_FALSE(information_->isValid(stateOf(nowhere, space_).get()));
  EXPECT_FALSE(information_->isValid(stateOf(outside(Eigen::Vector3d::UnitX(), 3), space_).get()));  // out of bounds
  EXPECT_FALSE(information_->checkMotion(state.get(), stateOf(nowhere, space_).get()));
  const Eigen::Isometry3d contact_T_WT = outside(Eigen::Vector3d::UnitX(), 0);
  Eigen::Isometry3d back_T_WT = contact_T_WT;
  back_T_WT.translation().x() += 0.03;
  ob::SpaceInformation touching(space_);
  planIn(field_, touching, {.contact_T_WT = {contact_T_WT}});
  const auto contact = stateOf(contact_T_WT, space_), back = stateOf(back_T_WT, space_);
  EXPECT_TRUE(touching.checkMotion(contact.get(), back.get()));
  field_.update();
  EXPECT_EQ(idOf([&] { static_cast<void>(information_->isValid(state.get())); }), "query.stale");
  EXPECT_EQ(idOf([&] { static_cast<void>(touching.checkMotion(contact.get(), back.get())); }), "query.stale");
}

}  // namespace
}  // namespace accessvdb::test
