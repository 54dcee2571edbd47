// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sets of orientations against plain trigonometry, and what is refused.
#include "accessvdb/orientations.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <numbers>

#include "accessvdb/error.h"
#include "accessvdb/params.h"
#include "support/orientation_reference.h"
#include "support/scratch_folder.h"
#include "tool/tool_kernel.h"
#include "tool/yaw_direction.h"

namespace accessvdb {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Id and code of what is thrown; "" for nothing.
std::pair<std::string, int> failureOf(const std::function<void()>& body) {
  try {
    body();
  } catch (const Error& error) {
    EXPECT_FALSE(error.advice().empty()) << error.what();
    return {error.id(), error.exitCode()};
  }
  return {"", 0};
}
std::pair<std::string, int> countFailureOf(const std::string& text, int num_directions = 180) {
  return failureOf([&] { static_cast<void>(OrientationSet::parse(text).count(num_directions)); });
}
using Failure = std::pair<std::string, int>;

ApproachParams approachOf(const std::string& text, int num_directions) {
  ApproachParams approach;
  approach.num_directions = num_directions;
  approach.orientations = OrientationSet::parse(text);
  return approach;
}

TEST(Orientations, AreAsManyAsDocumented) {
  const auto count = [](const std::string& text, int num_directions = 180) {
    return OrientationSet::parse(text).count(num_directions);
  };
  EXPECT_EQ(count("yaw"), 180);
  EXPECT_EQ(count("yaw", 36), 36);
  EXPECT_EQ(count("sphere:15"), 186);
  EXPECT_EQ(count("sphere:12.5"), 254);
  EXPECT_EQ(count("sphere:90"), 6);
  EXPECT_EQ(count("pitch:0:0:1"), 180);
  EXPECT_EQ(count("sphere:3.8", 180), 2906);
  EXPECT_EQ(count("pitch:-30:30:10", 36), 252);
  EXPECT_EQ(count("pitch:-30:30:10", 180), 1260);
  EXPECT_EQ(count("pitch:0:90:45", 36), 73);             // straight down once
  EXPECT_EQ(count("pitch:-30:35:10", 8), 56);            // up to 30
  EXPECT_EQ(count("pitch:0:0.3:0.1", 4), 16);            // 0.3 / 0.1 is just below 3
  EXPECT_EQ(count("sphere:15+yaw", 36), 186 + 36 - 12);  // the level ones at whole multiples of 30 degrees are there
}

TEST(Orientations, AreThoseOfPlainTrigonometry) {
  for (const auto& [text, num_directions] : {std::pair{"sphere:12.5", 180},
                                             {"sphere:3.8", 180},
                                             {"sphere:15", 36},
                                             {"sphere:90", 36},
                                             {"sphere:33", 4},
                                             {"pitch:-30:30:10", 36},
                                             {"pitch:-90:90:22.5", 17},
                                             {"pitch:12.5:12.5:3", 256}}) {
    SCOPED_TRACE(text);
    const ApproachParams approach = approachOf(text, num_directions);
    const auto orientations = approach.orientations.orientations(num_directions);
    const auto axes = test::referenceAxes(approach);
    ASSERT_EQ(orientations.size(), axes.size());
    const kernels::DirectionTable table = internal::ExpandedOrientations::of(approach).table();
    ASSERT_TRUE(table.xy.empty());
    ASSERT_EQ(table.axes_xyz.size(), 3 * axes.size());
    for (std::size_t d = 0; d < axes.size(); ++d) {
      const ToolOrientation& o = orientations[d];
      const Eigen::Matrix3d expected = (Eigen::AngleAxisd(o.yaw_rad, Eigen::Vector3d::UnitZ()) *
                                        Eigen::AngleAxisd(-o.pitch_rad, Eigen::Vector3d::UnitY()) *
                                        Eigen::AngleAxisd(o.roll_rad, Eigen::Vector3d::UnitX()))
                                           .toRotationMatrix();
      // A few roundings of double.
      EXPECT_LT((o.R_WT - expected).cwiseAbs().maxCoeff(), 1e-14) << d;
      EXPECT_LT((o.R_WT.col(0) - Eigen::Vector3d(axes[d][0], axes[d][1], axes[d][2])).norm(), 1e-14) << d;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(table.axes_xyz[3 * d + axis], axes[d][axis], 3.1e-8) << d;  // half a unit of float32 near 1
      }
    }
  }
}

/// Everything on the axes is exactly there, so that quarter turns are exact.
TEST(Orientations, AreClosedUnderQuarterTurns) {
  for (const std::string text : {"sphere:12.5", "sphere:15", "pitch:-40:40:20"}) {
    const auto all = OrientationSet::parse(text).orientations(36);
    for (const ToolOrientation& o : all) {
      const Eigen::Vector3d turned(-o.R_WT(1, 0), o.R_WT(0, 0), o.R_WT(2, 0));
      EXPECT_TRUE(std::any_of(all.begin(), all.end(),
                              [&](const ToolOrientation& other) { return other.R_WT.col(0) == turned; }))
          << text << ": " << turned.transpose();
    }
  }
  const auto sphere = OrientationSet::sphere(12.5).orientations(180);
  EXPECT_EQ(sphere.front().R_WT.col(0), Eigen::Vector3d(0, 0, -1));
  EXPECT_EQ(sphere.back().R_WT.col(0), Eigen::Vector3d(0, 0, 1));
  EXPECT_EQ(orientationOf(90, 0, 0).R_WT.col(0), Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(orientationOf(-450, 0, 0).R_WT.col(0), Eigen::Vector3d(0, -1, 0));
  EXPECT_EQ(orientationOf(30, 90, 0).R_WT.col(0), Eigen::Vector3d(0, 0, 1));
  // From above, roll 0: the tool's top points away from where it came from, as far up as possible before.
  EXPECT_EQ(orientationOf(0, 90, 0).R_WT.col(2), Eigen::Vector3d(-1, 0, 0));
  EXPECT_EQ(orientationOf(0, 0, 90).R_WT.col(1), Eigen::Vector3d(0, 0, 1));
}

/// The farthest any direction is from the set: rings and yaws are at most STEP apart.
TEST(Orientations, LeaveNoGapOnTheSphere) {
  for (const double step_deg : {12.5, 15.0, 30.0}) {
    const auto all = OrientationSet::sphere(step_deg).orientations(180);
    double farthest_deg = 0;
    for (int n = 0; n < 20000; ++n) {  // a Fibonacci sphere
      const double z = 1 - (2 * n + 1) / 20000.0, yaw = n * std::numbers::pi * (3 - std::sqrt(5.0));
      const double level = std::sqrt(1 - z * z);
      const Eigen::Vector3d direction(level * std::cos(yaw), level * std::sin(yaw), z);
      double best = -1;
      for (const ToolOrientation& o : all) best = std::max(best, direction.dot(o.R_WT.col(0)));
      farthest_deg = std::max(farthest_deg, std::acos(std::min(best, 1.0)) * 180 / std::numbers::pi);
    }
    EXPECT_LT(farthest_deg, 0.8 * step_deg);  // half the diagonal of a square of STEP is 0.71
  }
}

/// The directions of the default, written down as a list or as a ring, have the same bits.
TEST(Orientations, OfYawAreTheSameHoweverTheyAreWritten) {
  std::vector<ToolOrientation> list;
  for (int d = 0; d < 180; ++d) list.push_back(orientationOf(2.0 * d, 0, 0));
  const auto yaw = OrientationSet::yaw().orientations(180), ring = OrientationSet::pitch(0, 0, 1).orientations(180);
  ASSERT_EQ(yaw.size(), 180u);
  for (std::size_t d = 0; d < 180; ++d) {
    const internal::CosSin direction = internal::yawDirection(static_cast<int>(d), 180);
    EXPECT_EQ(yaw[d].R_WT.col(0), Eigen::Vector3d(direction.cos, direction.sin, 0));
    for (const ToolOrientation& other : {list[d], ring[d]}) {
      EXPECT_EQ(yaw[d].R_WT, other.R_WT) << d;
      EXPECT_EQ(yaw[d].yaw_rad, other.yaw_rad) << d;
      EXPECT_EQ(other.pitch_rad, 0);
    }
  }
  // With other numbers of directions, they have the same bits in the precision of scoring.
  for (int D = 4; D <= 256; ++D) {
    const kernels::DirectionTable table = internal::ExpandedOrientations::of(approachOf("yaw", D)).table();
    const kernels::DirectionTable any = internal::ExpandedOrientations::of(approachOf("pitch:0:0:1", D)).table();
    for (std::size_t d = 0; d < static_cast<std::size_t>(D); ++d) {
      ASSERT_EQ(table.xy[2 * d], any.axes_xyz[3 * d]);
      ASSERT_EQ(table.xy[2 * d + 1], any.axes_xyz[3 * d + 1]);
      ASSERT_EQ(any.axes_xyz[3 * d + 2], 0.0f);
    }
  }
}

TEST(Orientations, ComeFromQuaternionsToo) {
  for (int n = 0; n < 500; ++n) {
    const Eigen::Quaterniond q =
        Eigen::Quaterniond(Eigen::Vector4d(std::sin(n), std::cos(3.0 * n), std::sin(7.0 * n), std::cos(11.0 * n)))
            .normalized();
    const ToolOrientation o = orientationOf(q.w(), q.x(), q.y(), q.z());
    EXPECT_LT((o.R_WT - q.toRotationMatrix()).cwiseAbs().maxCoeff(), 1e-14);
    const double degrees = 180 / std::numbers::pi;
    const ToolOrientation again = orientationOf(o.yaw_rad * degrees, o.pitch_rad * degrees, o.roll_rad * degrees);
    EXPECT_LT((o.R_WT - again.R_WT).cwiseAbs().maxCoeff(), 1e-12) << n;
  }
  const ToolOrientation down = orientationOf(std::sqrt(0.5), 0, -std::sqrt(0.5), 0);
  EXPECT_LT((down.R_WT.col(0) - Eigen::Vector3d(0, 0, 1)).norm(), 1e-15);
  EXPECT_EQ(down.yaw_rad, 0);
  EXPECT_EQ(failureOf([] { static_cast<void>(orientationOf(1, 0.1, 0, 0)); }), Failure("orientations.range", 2));
  EXPECT_EQ(failureOf([] { static_cast<void>(orientationOf(kNaN, 0, 0, 0)); }), Failure("orientations.range", 2));
  EXPECT_EQ(failureOf([] { static_cast<void>(orientationOf(0, 0, 0, 0)); }), Failure("orientations.range", 2));
}

TEST(Orientations, TextReadsBack) {
  for (const std::string text : {"yaw", "pitch:-30:30:10", "pitch:0:0:1", "sphere:12.5", "sphere:15+yaw"}) {
    EXPECT_EQ(OrientationSet::parse(text).text(), text);
  }
}

TEST(Orientations, RefuseWhatIsNoSet) {
  const Failure no_text = {"orientations.text", 2}, no_range = {"orientations.range", 2};
  for (const char* text : {"", "all", "yaw:", "yaw:3", "pitch", "pitch:", "pitch:0:1", "pitch:0:1:2:3", "pitch:0::1",
                           "pitch:a:b:c", "sphere", "sphere:", "sphere:12.5+", "sphere:12.5+roll", "sphere:1e", "list",
                           "list:", "Sphere:15", "sphere: 15"}) {
    EXPECT_EQ(countFailureOf(text), no_text) << text;
  }
  for (const char* text : {"sphere:0", "sphere:-12.5", "sphere:nan", "sphere:inf", "sphere:91", "sphere:1e-9",
                           "pitch:0:10:0", "pitch:0:10:-5", "pitch:0:10:nan", "pitch:nan:10:5", "pitch:0:nan:5",
                           "pitch:10:0:5", "pitch:-91:0:5", "pitch:0:90.1:5", "pitch:0:10:inf"}) {
    EXPECT_EQ(countFailureOf(text), no_range) << text;
  }
  EXPECT_EQ(failureOf([] { static_cast<void>(orientationOf(0, 91, 0)); }), no_range);
  EXPECT_EQ(failureOf([] { static_cast<void>(orientationOf(kNaN, 0, 0)); }), no_range);
  EXPECT_EQ(failureOf([] { static_cast<void>(OrientationSet::of({}).count(180)); }), no_range);
  ToolOrientation skewed;
  skewed.R_WT(0, 1) = 0.1;
  EXPECT_EQ(failureOf([&] { static_cast<void>(OrientationSet::of({skewed}).count(180)); }), no_range);
  skewed.R_WT = -Eigen::Matrix3d::Identity();  // a reflection
  EXPECT_EQ(failureOf([&] { static_cast<void>(OrientationSet::of({skewed}).count(180)); }), no_range);
}

/// The message names a set that does fit: the advice is followed.
TEST(Orientations, SayWhatWouldFit) {
  const auto adviceOf = [](const std::string& text, int num_directions) {
    try {
      static_cast<void>(OrientationSet::parse(text).count(num_directions));
    } catch (const ResourceLimit& error) {
      EXPECT_EQ(error.id(), "orientations.count");
      return error.advice();
    }
    return std::string("fits");
  };
  EXPECT_EQ(adviceOf("sphere:3", 180), "Use sphere:3.25 or a larger step");
  EXPECT_EQ(adviceOf("sphere:3.25", 180), "fits");
  EXPECT_EQ(adviceOf("sphere:3.1", 180), "Use sphere:3.25 or a larger step");
  const std::string with_yaw = adviceOf("sphere:3.2+yaw", 180);
  ASSERT_TRUE(with_yaw.starts_with("Use sphere:"));
  const std::string fitting = with_yaw.substr(4, with_yaw.find(' ', 4) - 4);
  EXPECT_EQ(adviceOf(fitting, 180), "fits") << fitting;
  EXPECT_EQ(adviceOf("pitch:-30:30:10", 180), "fits");
  EXPECT_EQ(adviceOf("pitch:-90:90:5", 180), "Use 108 yaw directions (num_directions 108) or a STEP of 8.58 degrees");
  EXPECT_EQ(adviceOf("pitch:-90:90:5", 108), "fits");
  EXPECT_EQ(adviceOf("pitch:-90:90:8.58", 180), "fits");
  EXPECT_EQ(adviceOf("pitch:-90:90:0.01", 4), "Use a STEP of 0.18 degrees");
  EXPECT_EQ(adviceOf("pitch:-90:90:0.18", 4), "fits");
  EXPECT_EQ(adviceOf("pitch:-80:80:0.1", 180), "Use a STEP of 7.62 degrees");
  EXPECT_EQ(adviceOf("pitch:-80:80:7.62", 180), "fits");
}

class OrientationList : public testing::Test {
 protected:
  Failure failureOfList(const std::string& content) {
    std::ofstream(folder_ / "list.txt", std::ios::binary) << content;
    return countFailureOf("list:" + (folder_ / "list.txt").string());
  }
  OrientationSet read(const std::string& content, int* twins = nullptr) {
    std::ofstream(folder_ / "list.txt", std::ios::binary) << content;
    return OrientationSet::read(folder_ / "list.txt", twins);
  }
  test::ScratchFolder folder_;
};

TEST_F(OrientationList, IsReadInBothForms) {
  int twins = -1;
  const OrientationSet angles =
      read("# my arm\n\nyaw pitch roll\n0 0 0\n90, 0, 0\r\n +30;-45\t10\n  # again\n360 0 0\n30 -45 10", &twins);
  ASSERT_EQ(angles.list.size(), 3u);
  EXPECT_EQ(twins, 2);
  EXPECT_EQ(angles.list[2].R_WT, orientationOf(30, -45, 10).R_WT);
  const OrientationSet quaternions = read("qw qx qy qz\n1 0 0 0\n-1 0 0 0\n0.7071 0 0 0.7071\n", &twins);
  ASSERT_EQ(quaternions.list.size(), 2u);
  EXPECT_EQ(twins, 1);
  EXPECT_LT((quaternions.list[1].R_WT.col(0) - Eigen::Vector3d(0, 1, 0)).norm(), 1e-15);  // normalised
  EXPECT_NE(angles.text(), quaternions.text());
  EXPECT_EQ(angles.text(), read("yaw pitch roll\n0 0 0\n90 0 0\n30 -45 10\n").text());
  EXPECT_TRUE(angles.text().starts_with("list:3:")) << angles.text();
}

TEST_F(OrientationList, RefusesWhatIsNone) {
  const Failure malformed = {"orientations.malformed", 3}, count = {"orientations.count", 5};
  for (const char* content :
       {"", "\n\n", "# nothing\n", "yaw pitch roll\n", "0 0 0\n", "pitch yaw roll\n0 0 0\n", "yaw pitch roll\n0 0\n",
        "yaw pitch roll\n0 0 0 0\n", "yaw pitch roll\n0 0 x\n", "yaw pitch roll\n0 91 0\n", "yaw pitch roll\n0 nan 0\n",
        "yaw pitch roll\ninf 0 0\n", "qw qx qy qz\n1 0 0\n", "qw qx qy qz\n1 0.1 0 0\n", "qw qx qy qz\n0 0 0 0\n",
        "qw qx qy qz\nnan 0 0 0\n", "qw qx qy qz\n1e200 0 0 0\n"}) {
    EXPECT_EQ(failureOfList(content), malformed) << content;
  }
  EXPECT_EQ(failureOfList("yaw pitch roll\n0 0 " + std::string(100000, '0')), malformed);
  EXPECT_EQ(failureOfList(std::string(1000, '\0')), malformed);
  std::string many = "yaw pitch roll\n";
  for (int n = 0; n < 1'000'000; ++n) many += std::to_string(n % 360) + " " + std::to_string(n % 89) + " 0\n";
  EXPECT_EQ(failureOfList(many), count);
  std::string repeated = "yaw pitch roll\n";
  for (int n = 0; n < 1'000'000; ++n) repeated += "1 2 3\n";
  EXPECT_EQ(read(repeated).list.size(), 1u);
  EXPECT_EQ(countFailureOf("list:" + (folder_ / "none.txt").string()), Failure("input.missing", 3));
  EXPECT_EQ(countFailureOf("list:" + folder_.path().string()), Failure("input.missing", 3));
}

}  // namespace
}  // namespace accessvdb
