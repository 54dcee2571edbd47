// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whether scans agree, in a room whose surfaces are known exactly.
#include "accessvdb/program/scan_agreement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "io/agreement/level_surfaces.h"
#include "io/agreement/pose_changes.h"
#include "io/agreement/scan_view.h"

namespace accessvdb::io {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// Where a ray inside a room of 8 x 6 x 3 m with a block in it ends.
Eigen::Vector3d end(const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
  const auto leave = [&](const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
    double t = 1e9;
    for (int axis = 0; axis < 3; ++axis) {
      if (d[axis] > 0) t = std::min(t, (high[axis] - o[axis]) / d[axis]);
      if (d[axis] < 0) t = std::min(t, (low[axis] - o[axis]) / d[axis]);
    }
    return t;
  };
  const auto enter = [&](const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
    double first = 0, last = 1e9;
    for (int axis = 0; axis < 3; ++axis) {
      const double a = (low[axis] - o[axis]) / d[axis], b = (high[axis] - o[axis]) / d[axis];
      first = std::max(first, std::min(a, b));
      last = std::min(last, std::max(a, b));
    }
    return first < last ? first : 1e9;
  };
  const double t = std::min(leave({-4, -3, 0}, {4, 3, 3}), enter({0.5, 0.3, 0}, {1.4, 1.6, 1.2}));
  return o + t * d;
}

struct Walk {
  std::vector<Eigen::Isometry3d> T_W_B;
  std::vector<ScanRecord> scans;
};

/// Ten scans of a sensor that is mounted with T_B_S, on a way with turns and tilts.
Walk walk(const Eigen::Isometry3d& T_B_S = Eigen::Isometry3d::Identity()) {
  Walk walk;
  std::mt19937 random(5);
  const auto uniform = [&] { return random() / 4294967296.0; };
  for (int i = 0; i < 10; ++i) {
    Eigen::Isometry3d T_W_B = Eigen::Translation3d(-3 + 0.5 * i, -1.5 + 0.02 * i * i, 1.3) *
                              Eigen::AngleAxisd(0.35 * i, Eigen::Vector3d::UnitZ()) *
                              Eigen::AngleAxisd(0.15 * std::sin(2.0 * i), Eigen::Vector3d::UnitY()) *
                              Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitX());
    ScanRecord scan;
    scan.T_W_S = T_W_B * T_B_S;
    const Eigen::Isometry3d T_S_W = scan.T_W_S.inverse();
    for (int k = 0; k < 4000; ++k) {
      const double z = 2 * uniform() - 1, a = 2 * std::numbers::pi * uniform(), r = std::sqrt(1 - z * z);
      const Eigen::Vector3d p_W = end(scan.T_W_S.translation(), {r * std::cos(a), r * std::sin(a), z});
      scan.points_S.push_back((T_S_W * p_W).cast<float>());
    }
    scan.points_S.push_back(Eigen::Vector3f::Zero());  // a ray without a return
    walk.T_W_B.push_back(T_W_B);
    walk.scans.push_back(std::move(scan));
  }
  return walk;
}

/// As if the poses had been read as `poses`, with this extrinsic.
ScanAgreement agreementOf(Walk walk, const std::vector<Eigen::Isometry3d>& poses,
                          const std::optional<Eigen::Isometry3d>& T_B_S = {}) {
  AgreementMeter meter(0.01, T_B_S);
  for (std::size_t i = 0; i < walk.scans.size(); ++i) {
    const Eigen::Isometry3d T_W_B = poses[i];
    walk.scans[i].T_W_S = T_B_S ? T_W_B * *T_B_S : T_W_B;
    meter.add(walk.scans[i], [T_W_B](double shift_s) { return shift_s == 0 ? std::optional(T_W_B) : std::nullopt; });
  }
  return meter.measure();
}

template <typename Change>
std::vector<Eigen::Isometry3d> changed(std::vector<Eigen::Isometry3d> poses, const Change& change) {
  for (Eigen::Isometry3d& pose : poses) pose = change(pose);
  return poses;
}

void expectCure(const ScanAgreement& agreement, PoseFault fault, int axis = 0, double value = 0) {
  EXPECT_EQ(agreement.verdict, AgreementVerdict::Disagree) << agreement.counts.score();
  ASSERT_TRUE(agreement.cure);
  EXPECT_EQ(static_cast<int>(agreement.cure->fault), static_cast<int>(fault));
  EXPECT_EQ(agreement.cure->axis, axis);
  EXPECT_EQ(agreement.cure->value, value);
}

TEST(ScanAgreement, IsUsualWherePosesAreRight) {
  const Walk room = walk();
  const ScanAgreement agreement = agreementOf(room, room.T_W_B);
  EXPECT_EQ(agreement.verdict, AgreementVerdict::Usual);
  EXPECT_EQ(agreement.scans, 10u);
  EXPECT_GT(agreement.counts.share(), 0.99);
  EXPECT_FALSE(agreement.cure);
}

TEST(ScanAgreement, JitterOfACentimetreIsUsual) {
  const Walk room = walk();
  std::mt19937 random(3);
  std::normal_distribution<double> jitter(0, 0.01);
  const auto moved = changed(room.T_W_B, [&](Eigen::Isometry3d T) {
    T.translation() += Eigen::Vector3d(jitter(random), jitter(random), jitter(random));
    return T;
  });
  EXPECT_EQ(agreementOf(room, moved).verdict, AgreementVerdict::Usual);
}

TEST(ScanAgreement, NamesHowPosesAreWrong) {
  const Walk room = walk();
  expectCure(agreementOf(room, changed(room.T_W_B, [](const auto& T) { return T.inverse(); })), PoseFault::Inverse);
  expectCure(agreementOf(room, changed(room.T_W_B,
                                       [](Eigen::Isometry3d T) {
                                         const Eigen::Quaterniond q(T.linear());  // w x y z, read as x y z w
                                         T.linear() = Eigen::Quaterniond(q.z(), q.w(), q.x(), q.y()).toRotationMatrix();
                                         return T;
                                       })),
             PoseFault::QuaternionWFirst);
  expectCure(agreementOf(room, changed(room.T_W_B,
                                       [](Eigen::Isometry3d T) {
                                         const Eigen::Quaterniond q(T.linear());  // x y z w, read as w x y z
                                         T.linear() = Eigen::Quaterniond(q.x(), q.y(), q.z(), q.w()).toRotationMatrix();
                                         return T;
                                       })),
             PoseFault::QuaternionWLast);
  expectCure(agreementOf(room, changed(room.T_W_B,
                                       [](Eigen::Isometry3d T) {
                                         T.translation() *= 1000;
                                         return T;
                                       })),
             PoseFault::Unit, 0, 0.001);
}

TEST(ScanAgreement, NamesTurnsOfTheSensor) {
  const Walk room = walk();
  for (int axis = 0; axis < 3; ++axis) {
    for (const double turn : {90.0, -90.0, 180.0, 30.0}) {
      SCOPED_TRACE(std::to_string(axis) + " by " + std::to_string(turn));
      const Eigen::AngleAxisd turned(turn * kDegree, Eigen::Vector3d::Unit(axis));
      expectCure(agreementOf(room, changed(room.T_W_B, [&](const auto& T) { return Eigen::Isometry3d(T * turned); })),
                 PoseFault::Turned, axis, turn == 180 ? 180 : -turn);
    }
  }
}

TEST(ScanAgreement, NamesAnInverseExtrinsic) {
  const Eigen::Isometry3d mount =
      Eigen::Translation3d(0.1, 0.05, 0.2) * Eigen::AngleAxisd(0.9, Eigen::Vector3d(1, 2, 3).normalized());
  const Walk room = walk(mount);
  EXPECT_EQ(agreementOf(room, room.T_W_B, mount).verdict, AgreementVerdict::Usual);
  expectCure(agreementOf(room, room.T_W_B, mount.inverse()), PoseFault::InverseExtrinsic);
}

TEST(ScanAgreement, KnowsScansThatAreInTheWorldAlready) {
  Walk room = walk();
  for (ScanRecord& scan : room.scans)
    for (Eigen::Vector3f& p : scan.points_S) p = (scan.T_W_S * p.cast<double>()).cast<float>();
  expectCure(agreementOf(room, room.T_W_B), PoseFault::InWorld);
}

/// Past a long wall, with a sensor that sees a piece of it: every scan looks alike, as if all had been taken in one
/// place.
TEST(ScanAgreement, ALongWallSeenInPiecesIsUsual) {
  Walk facade;
  for (int i = 0; i < 10; ++i) {
    ScanRecord scan;
    scan.T_W_S = Eigen::Translation3d(0, 0.3 * i, 1);
    for (int k = 0; k < 1600; ++k)
      scan.points_S.emplace_back(2.0F, -0.5F + static_cast<float>(k % 40) / 40,
                                 -0.5F + static_cast<float>(k / 40) / 40);
    facade.T_W_B.push_back(scan.T_W_S);
    facade.scans.push_back(std::move(scan));
  }
  const ScanAgreement agreement = agreementOf(facade, facade.T_W_B);
  EXPECT_EQ(agreement.verdict, AgreementVerdict::Usual);
  EXPECT_LT(agreement.counts.score(), 0.8);
}

TEST(ScanAgreement, DoesNotDependOnTheWorldFrame) {
  const Walk room = walk();
  const Eigen::Isometry3d T = Eigen::Translation3d(100, -50, 7) * Eigen::AngleAxisd(1, Eigen::Vector3d::UnitX());
  const auto moved = changed(room.T_W_B, [&](const auto& T_W_B) { return T * T_W_B; });
  const AgreementCounts here = agreementOf(room, room.T_W_B).counts, there = agreementOf(room, moved).counts;
  EXPECT_NEAR(here.share(), there.share(), 0.002);  // other roundings at the cells' edges
}

TEST(ScanAgreement, IsNotMeasuredOfOneScan) {
  Walk room = walk();
  AgreementMeter meter(0.01);
  EXPECT_EQ(meter.measure().verdict, AgreementVerdict::NotMeasured);
  meter.add(room.scans[0]);
  const ScanAgreement one = meter.measure();
  EXPECT_EQ(one.verdict, AgreementVerdict::NotMeasured);
  EXPECT_EQ(one.why_not, "a single scan");
  ScanRecord empty;
  empty.points_S.assign(100, Eigen::Vector3f::Constant(std::nanf("")));
  meter.add(empty);
  EXPECT_EQ(meter.size(), 1u);
}

/// The parts of one cloud of one scanner are one scan, those of two scanners are two.
TEST(ScanAgreement, CloudsInTheWorldFrameAreComparedByScanner) {
  Walk room = walk();
  AgreementMeter meter(0.01);
  for (std::size_t i = 0; i < 2; ++i) {
    ScanRecord part[2];
    for (std::size_t k = 0; k < 4000; ++k)
      part[k % 2].points_W.push_back(room.scans[i].T_W_S * room.scans[i].points_S[k].cast<double>());
    for (ScanRecord& record : part) {
      record.origins_W = {room.scans[i].T_W_S.translation()};
      meter.add(record);
    }
    EXPECT_EQ(meter.size(), i + 1);
  }
  EXPECT_EQ(meter.measure().verdict, AgreementVerdict::Usual);
}

TEST(ScanView, TellsWhatIsSeenThroughHiddenAndBeside) {
  std::vector<Eigen::Vector3f> wall;
  for (int y = -100; y <= 100; ++y)
    for (int z = -100; z <= 100; ++z) wall.emplace_back(4.0F, 0.01F * y, 0.01F * z);
  const ScanView image(wall);
  EXPECT_EQ(image.at({4, 0.2F, 0.3F}, 0.03F), ScanView::Answer::Surface);
  EXPECT_EQ(image.at({4.02F, 0.2F, 0.3F}, 0.03F), ScanView::Answer::Surface);
  EXPECT_EQ(image.at({3, 0.2F, 0.3F}, 0.03F), ScanView::Answer::Free);
  EXPECT_EQ(image.at({5, 0.2F, 0.3F}, 0.03F), ScanView::Answer::Hidden);
  EXPECT_EQ(image.at({-4, 0.2F, 0.3F}, 0.03F), ScanView::Answer::Nothing);
  EXPECT_EQ(image.at({0, 0, 4}, 0.03F), ScanView::Answer::Nothing);
  EXPECT_EQ(image.at({0, 0, 0}, 0.03F), ScanView::Answer::Nothing);
  EXPECT_EQ(image.at(Eigen::Vector3f::Constant(std::nanf("")), 0.03F), ScanView::Answer::Nothing);
}

/// Floor, walls and ceiling of the room, turned.
std::optional<Eigen::Vector3d> upOfRoom(const Eigen::Matrix3d& R) {
  std::vector<Eigen::Vector3f> points, normals;
  std::mt19937 random(5);
  const auto uniform = [&] { return random() / 4294967296.0; };
  for (int k = 0; k < 20000; ++k) {
    const double z = 2 * uniform() - 1, a = 2 * std::numbers::pi * uniform(), r = std::sqrt(1 - z * z);
    const Eigen::Vector3d o(-2, 1, 1.3);
    points.push_back((R * (end(o, {r * std::cos(a), r * std::sin(a), z}) - o)).cast<float>());
  }
  appendPatchNormals(points, 0.2F, normals);
  return upBesideZ(normals);
}

TEST(LevelSurfaces, SayWhatIsUp) {
  EXPECT_FALSE(upOfRoom(Eigen::Matrix3d::Identity()));
  EXPECT_FALSE(upOfRoom(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()).toRotationMatrix()));
  EXPECT_FALSE(upOfRoom(Eigen::AngleAxisd(5 * kDegree, Eigen::Vector3d::UnitY()).toRotationMatrix()));
  for (const double turn : {15.0, -30.0}) {
    const Eigen::Matrix3d R = (Eigen::AngleAxisd(turn * kDegree, Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(0.8 * turn * kDegree, Eigen::Vector3d::UnitX()))
                                  .toRotationMatrix();
    const auto up = upOfRoom(R);
    ASSERT_TRUE(up) << turn;
    EXPECT_GT(up->dot(R.col(2)), std::cos(2 * kDegree)) << turn;
  }
}

TEST(LevelSurfaces, LevelForMakesADirectionZ) {
  for (const Eigen::Vector3d& up : {Eigen::Vector3d(0.3, 0.1, 0.9), Eigen::Vector3d(-0.5, 0.7, 0.2),
                                    Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0.2, -0.1, -0.95)}) {
    const Level level = levelFor(up.normalized());
    const Eigen::Matrix3d R = (Eigen::AngleAxisd(level.pitch_rad, Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(level.roll_rad, Eigen::Vector3d::UnitX()))
                                  .toRotationMatrix();
    EXPECT_NEAR((R * up.normalized()).z(), 1, 1e-12);
  }
}

}  // namespace
}  // namespace accessvdb::io
