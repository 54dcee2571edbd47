// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Plans of the Open Motion Planning Library through a live field: a tool, and what carries it, that move freely.
/// Header only, for programs that have OMPL: the library neither needs nor links it, and no other header includes this
/// one. Link OMPL yourself.
///
///   auto space = std::make_shared<ompl::base::SE3StateSpace>();
///   space->setBounds(bounds);                                   // world frame, metres
///   ompl::geometric::SimpleSetup setup(space);
///   accessvdb::planIn(field, *setup.getSpaceInformation(), {.contact_T_WT = {approach.contact_T_WT}});
///   setup.setStartAndGoalStates(accessvdb::stateOf(T_WT, space), accessvdb::stateOf(approach.pre_contact_T_WT,
///   space));
///
/// A state is a pose T_WT of the tool: its tip is at the translation, its body extends along its x axis. What PoseQuery
/// says decides: no voxel that the tool enters is missed, except by contact as PlanningOptions::contact_T_WT says.
///
/// Threads  As OMPL asks: any number may use them at the same time.
/// Validity Until the field next changes; after that they throw InvalidArgument "query.stale". Plan again then.
#pragma once

#include <ompl/base/MotionValidator.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateValidityChecker.h>
#include <ompl/base/spaces/SE3StateSpace.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/error.h"
#include "accessvdb/params.h"
#include "accessvdb/pose_query.h"
#include "accessvdb/tool_spec.h"

namespace accessvdb {

/// A part of what carries the tool: all that is within a radius of a segment, in the tool's frame.
struct BodyCapsule {
  Eigen::Vector3d a_T = {0, 0, 0}, b_T = {0, 0, 0};
  double radius_m = 0;
};

/// What moves, and through what.
struct PlanningOptions {
  std::size_t tool = 0;                ///< of the field's tools
  std::vector<BodyCapsule> body = {};  ///< moves with the tool, and never touches anything
  bool allow_unknown = false;          ///< through space that nothing is known of; else it is an obstacle
  /// Poses at which the tool touches what it works on, ApproachPath::contact_T_WT. They are reached straight along the
  /// tool's body. From where the tool comes within ScoringParams::self_exclusion_voxels and two voxels of them, it is
  /// judged as where the field scores a point, voxel by voxel of the way (FitOptions::contact), which takes unknown
  /// space for free. Without them, the tool touches nothing. Of two on one line, only the outer one is reached.
  std::vector<Eigen::Isometry3d> contact_T_WT = {};
};

[[nodiscard]] inline Eigen::Isometry3d poseOf(const ompl::base::SE3StateSpace::StateType& state) {
  const ompl::base::SO3StateSpace::StateType& q = state.rotation();
  Eigen::Isometry3d T_WT = Eigen::Isometry3d::Identity();
  T_WT.translation() = Eigen::Vector3d(state.getX(), state.getY(), state.getZ());
  T_WT.linear() = Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix();
  return T_WT;
}

[[nodiscard]] inline ompl::base::ScopedState<ompl::base::SE3StateSpace> stateOf(
    const Eigen::Isometry3d& T_WT, const std::shared_ptr<ompl::base::SE3StateSpace>& space) {
  ompl::base::ScopedState<ompl::base::SE3StateSpace> state(space);
  const Eigen::Quaterniond q(T_WT.linear());
  state->setXYZ(T_WT.translation().x(), T_WT.translation().y(), T_WT.translation().z());
  state->rotation().w = q.w();
  state->rotation().x = q.x();
  state->rotation().y = q.y();
  state->rotation().z = q.z();
  return state;
}

/// Poses and ways of a tool, and of its body, as planners ask for them.
class PlanningWorld {
 public:
  /// @throws InvalidArgument "plan.options" (a contact pose or a capsule with bad numbers), "tool.index"
  PlanningWorld(const AccessibilityField& field, PlanningOptions options)
      : options_(std::move(options)), poses_(field.poseQuery()), capsules_(field.batchQuery()) {
    const FieldParams params = field.params();
    voxel_size_m_ = params.tsdf.voxel_size_m;
    if (options_.tool >= field.tools().size())
      throw InvalidArgument("tool.index", "PlanningOptions::tool", "is not a tool of the field");
    for (const BodyCapsule& capsule : options_.body) {
      if (!capsule.a_T.allFinite() || !capsule.b_T.allFinite() || !(capsule.radius_m >= 0 && capsule.radius_m < 1e3))
        throw InvalidArgument("plan.options", "PlanningOptions::body", "has a capsule with bad numbers");
      body_reach_m_ =
          std::max({body_reach_m_, capsule.a_T.norm() + capsule.radius_m, capsule.b_T.norm() + capsule.radius_m});
    }
    for (const Eigen::Isometry3d& T_WT : options_.contact_T_WT) {
      if (!T_WT.matrix().allFinite() || !T_WT.linear().isUnitary(1e-5) || T_WT.linear().determinant() < 0)
        throw InvalidArgument("plan.options", "PlanningOptions::contact_T_WT", "has a pose that is not rigid");
    }
    // Once, since planners ask again and again.
    for (const FitAnswer& answer : poses_.fitsIntoContact(options_.contact_T_WT, options_.tool))
      contact_fits_.push_back(!answer.collision());
    contact_m_ = poses_.contactWay_m(options_.tool);
  }

  [[nodiscard]] bool fits(const Eigen::Isometry3d& T_WT) const {
    if (bodyFits({&T_WT, 1}) == 0) return false;
    if (const Contact contact = contactAt(T_WT); contact.is_near) return contact_fits_[contact.number];
    return isFree(poses_.fits({&T_WT, 1}, {.tool = options_.tool})[0]);
  }

  /// How far a way fits, 0 to 1 (all of it): from pose to pose evenly along the line, turning evenly about one axis, in
  /// parts of equal length. The first pose is taken to fit. @param T_WT  at least two; turns of less than 180 degrees
  [[nodiscard]] double fitsUntil(std::span<const Eigen::Isometry3d> T_WT) const {
    requireCurrent();
    const auto parts = static_cast<double>(T_WT.size() - 1);
    for (std::size_t n = 0; n + 1 < T_WT.size(); ++n) {
      const double of_body = bodyFitsUntil(T_WT[n], T_WT[n + 1]);
      const double until = of_body == 0 ? 0 : std::min(of_body, toolFitsUntil(T_WT[n], T_WT[n + 1]));
      if (until < 1) return std::min((static_cast<double>(n) + until) / parts, std::nextafter(1.0, 0.0));
    }
    return 1;
  }
  [[nodiscard]] bool fitsAlong(std::span<const Eigen::Isometry3d> T_WT) const { return fitsUntil(T_WT) == 1; }
  /// Some poses on the way: most ways that do not fit do not fit there, and are refused sooner.
  [[nodiscard]] bool fitsHereAndThere(std::span<const Eigen::Isometry3d> T_WT) const {
    requireCurrent();
    if (contactAt(T_WT.front()).is_on_line || contactAt(T_WT.back()).is_on_line) return true;  // fitsAlong() sees to it
    std::array<Eigen::Isometry3d, 7> some;
    const auto parts = static_cast<double>(T_WT.size() - 1);
    for (std::size_t n = 0; n < some.size(); ++n) {
      const double at = parts * static_cast<double>(n + 1) / static_cast<double>(some.size());
      const auto part = std::min(static_cast<std::size_t>(at), T_WT.size() - 2);
      some[n] = between(T_WT[part], T_WT[part + 1], at - static_cast<double>(part));
    }
    std::array<FitAnswer, 7> answers;
    poses_.fits(some, answers, {.tool = options_.tool});
    return std::ranges::all_of(answers, [this](const FitAnswer& answer) { return isFree(answer); });
  }

  [[nodiscard]] static Eigen::Isometry3d between(const Eigen::Isometry3d& from_T_WT, const Eigen::Isometry3d& to_T_WT,
                                                 double t) {
    Eigen::Isometry3d T_WT = Eigen::Isometry3d::Identity();
    T_WT.translation() = (1 - t) * from_T_WT.translation() + t * to_T_WT.translation();
    T_WT.linear() = Eigen::Quaterniond(from_T_WT.linear())
                        .slerp(t, Eigen::Quaterniond(to_T_WT.linear()))
                        .normalized()
                        .toRotationMatrix();
    return T_WT;
  }

 private:
  struct Contact {
    bool is_on_line = false;  ///< straight behind a contact pose, or at it
    bool is_near = false;     ///< so near that the tool touches
    std::size_t number = 0;
    double back_m = 0;
  };

  void requireCurrent() const {
    if (!poses_.current())
      throw InvalidArgument("query.stale", "PlanningWorld", "the field has changed since", "Plan again");
  }
  [[nodiscard]] bool isFree(const FitAnswer& answer) const {
    return !answer.collision() && (options_.allow_unknown || !answer.unknown());
  }
  [[nodiscard]] Contact contactAt(const Eigen::Isometry3d& T_WT) const {
    constexpr double kSame_m = 1e-6, kSameRotation = 1e-6;
    Contact found;
    for (std::size_t n = 0; n < options_.contact_T_WT.size(); ++n) {
      const Eigen::Isometry3d& contact_T_WT = options_.contact_T_WT[n];
      if (!T_WT.linear().isApprox(contact_T_WT.linear(), kSameRotation)) continue;
      const Eigen::Vector3d away_W = T_WT.translation() - contact_T_WT.translation();
      const Eigen::Vector3d axis_W = contact_T_WT.linear().col(0);
      const double back_m = away_W.dot(axis_W);
      if (!(back_m >= -kSame_m) || !((away_W - back_m * axis_W).norm() <= kSame_m)) continue;
      if (found.is_on_line && found.back_m <= back_m) continue;
      found = {true, back_m < contact_m_, n, back_m};
    }
    return found;
  }

  [[nodiscard]] double toolFitsUntil(const Eigen::Isometry3d& from_T_WT, const Eigen::Isometry3d& to_T_WT) const {
    const Contact from = contactAt(from_T_WT), to = contactAt(to_T_WT);
    if (!from.is_near && !to.is_near) return std::max(0.0, freeUntil(from_T_WT, to_T_WT));
    // In contact there is one way to move: along the tool's body.
    const Contact& contact = to.is_near ? to : from;
    const Contact& other = to.is_near ? from : to;
    if (!other.is_on_line || other.number != contact.number || !contact_fits_[contact.number]) return 0;
    if (other.is_near) return 1;
    Eigen::Isometry3d last_T_WT = options_.contact_T_WT[contact.number];
    last_T_WT.translation() += contact_m_ * last_T_WT.linear().col(0);
    // Of this way, so much is outside of contact.
    const double share = (other.back_m - contact_m_) / (other.back_m - contact.back_m);
    if (to.is_near) {
      const double until = freeUntil(from_T_WT, last_T_WT);
      return until == 1 ? 1 : std::max(0.0, until) * share;
    }
    const double until = freeUntil(last_T_WT, to_T_WT);
    if (until == 1) return 1;
    const double at = 1 - share + until * share;
    return until < 0 || at >= 1 ? 0 : at;
  }
  /// Negative: not even the first pose.
  [[nodiscard]] double freeUntil(const Eigen::Isometry3d& from_T_WT, const Eigen::Isometry3d& to_T_WT) const {
    const std::array<Eigen::Isometry3d, 2> way = {from_T_WT, to_T_WT};
    const PathFitAnswer answer =
        poses_.fitsAlong(way, {.tool = options_.tool, .unknown_blocks = !options_.allow_unknown});
    if (answer.valid && !answer.collision && (options_.allow_unknown || !answer.unknown)) return 1;
    return answer.valid && answer.fits_until >= 0 ? answer.fits_until : -1;
  }

  /// How many poses fit before the first that does not.
  [[nodiscard]] std::size_t bodyFits(std::span<const Eigen::Isometry3d> T_WT) const {
    std::vector<CapsuleQuery> capsules;
    for (const Eigen::Isometry3d& pose : T_WT)
      for (const BodyCapsule& part : options_.body)
        capsules.push_back({pose * part.a_T, pose * part.b_T, part.radius_m});
    const std::vector<CapsuleAnswer> answers = capsules_.along(capsules);
    const auto blocked = std::ranges::find_if(answers, [this](const CapsuleAnswer& answer) {
      return !answer.valid || answer.collision || (answer.unknown && !options_.allow_unknown);
    });
    return options_.body.empty() ? T_WT.size()
                                 : static_cast<std::size_t>(blocked - answers.begin()) / options_.body.size();
  }
  /// No part moves by more than half a voxel between the poses that are tried, as PoseQuery::fitsAlong().
  [[nodiscard]] double bodyFitsUntil(const Eigen::Isometry3d& from_T_WT, const Eigen::Isometry3d& to_T_WT) const {
    if (options_.body.empty()) return 1;
    constexpr double kMostTries = 1 << 20;
    const Eigen::AngleAxisd turn(from_T_WT.linear().transpose() * to_T_WT.linear());
    const double moved_m =
        (to_T_WT.translation() - from_T_WT.translation()).norm() + std::abs(turn.angle()) * body_reach_m_;
    const double tries = std::max(1.0, std::ceil(2 * moved_m / voxel_size_m_));
    if (!(tries <= kMostTries)) return 0;
    constexpr int kAtOnce = 64;
    std::vector<Eigen::Isometry3d> poses;
    for (int k = 1; k <= static_cast<int>(tries); ++k) {
      poses.push_back(between(from_T_WT, to_T_WT, k / tries));
      if (poses.size() < kAtOnce && k < static_cast<int>(tries)) continue;
      const std::size_t fit = bodyFits(poses);
      if (fit < poses.size()) return (k - static_cast<double>(poses.size() - fit)) / tries;
      poses.clear();
    }
    return 1;
  }

  PlanningOptions options_;
  PoseQuery poses_;
  BatchQuery capsules_;
  std::vector<bool> contact_fits_;
  double voxel_size_m_ = 0, contact_m_ = 0, body_reach_m_ = 0;
};

/// Whether the tool may be at a state. States are those of an SE3StateSpace.
class FieldStateChecker : public ompl::base::StateValidityChecker {
 public:
  FieldStateChecker(ompl::base::SpaceInformation* space, std::shared_ptr<const PlanningWorld> world)
      : ompl::base::StateValidityChecker(space), world_(std::move(world)) {}
  bool isValid(const ompl::base::State* state) const override {
    return si_->satisfiesBounds(state) && world_->fits(poseOf(*state->as<ompl::base::SE3StateSpace::StateType>()));
  }

 private:
  std::shared_ptr<const PlanningWorld> world_;
};

/// Whether it may move from one state to another.
class FieldMotionChecker : public ompl::base::MotionValidator {
 public:
  FieldMotionChecker(ompl::base::SpaceInformation* space, std::shared_ptr<const PlanningWorld> world)
      : ompl::base::MotionValidator(space), world_(std::move(world)) {}

  bool checkMotion(const ompl::base::State* from, const ompl::base::State* to) const override {
    const std::vector<Eigen::Isometry3d> way = wayOf(from, to);
    return counted(si_->satisfiesBounds(to) && world_->fitsHereAndThere(way) && world_->fitsAlong(way));
  }
  bool checkMotion(const ompl::base::State* from, const ompl::base::State* to,
                   std::pair<ompl::base::State*, double>& last_valid) const override {
    const double until = si_->satisfiesBounds(to) ? world_->fitsUntil(wayOf(from, to)) : 0;
    if (until == 1) return counted(true);
    last_valid.second = until;
    if (last_valid.first != nullptr) si_->getStateSpace()->interpolate(from, to, until, last_valid.first);
    return counted(false);
  }

 private:
  static Eigen::Isometry3d poseAt(const ompl::base::State* state) {
    return poseOf(*state->as<ompl::base::SE3StateSpace::StateType>());
  }
  /// The space says which way round a turn goes, by the signs of its quaternions, which poses do not have.
  std::vector<Eigen::Isometry3d> wayOf(const ompl::base::State* from, const ompl::base::State* to) const {
    std::vector<Eigen::Isometry3d> way = {poseAt(from)};
    constexpr double kClear_rad = 1.6;
    const Eigen::Isometry3d end = poseAt(to);
    const double turn_rad = Eigen::AngleAxisd(way.front().linear().transpose() * end.linear()).angle();
    if (!(turn_rad < kClear_rad)) {
      constexpr int kParts = 4;
      ompl::base::State* const state = si_->allocState();
      for (int n = 1; n < kParts; ++n) {
        si_->getStateSpace()->interpolate(from, to, static_cast<double>(n) / kParts, state);
        way.push_back(poseAt(state));
      }
      si_->freeState(state);
    }
    way.push_back(end);
    return way;
  }
  bool counted(bool valid) const {  // as OMPL's own
    ++(valid ? valid_ : invalid_);
    return valid;
  }

  std::shared_ptr<const PlanningWorld> world_;
};

/// Has the field decide about states and motions. @param space  of an SE3StateSpace
/// @throws InvalidArgument "plan.space" (of another kind of states), and as PlanningWorld
inline void planIn(const AccessibilityField& field, ompl::base::SpaceInformation& space, PlanningOptions options = {}) {
  if (dynamic_cast<ompl::base::SE3StateSpace*>(space.getStateSpace().get()) == nullptr) {
    throw InvalidArgument("plan.space", "planIn", "plans poses, and the space is not an SE3StateSpace",
                          "Make one of your own from PoseQuery for other machines");
  }
  const auto world = std::make_shared<const PlanningWorld>(field, std::move(options));
  space.setStateValidityChecker(std::make_shared<FieldStateChecker>(&space, world));
  space.setMotionValidator(std::make_shared<FieldMotionChecker>(&space, world));
}

}  // namespace accessvdb
