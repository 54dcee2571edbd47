// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Poses that come one by one give the answers that the same poses give when all are there: io::PoseTrack, which reads
/// recordings.
#include "live/pose_buffer.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "io/poses/pose_track.h"
#include "support/determinism_support.h"

namespace accessvdb::internal {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(PoseBuffer, AnswersAsARecordingsTrackDoes) {
  std::mt19937_64 random(5);
  for (int round = 0; round < 40; ++round) {
    io::PoseTrack track;
    PoseBuffer buffer(10000);
    Eigen::Vector3d p(0, 0, 1);
    std::int64_t stamp_ns = 1'000'000'000;
    std::vector<std::int64_t> asked;
    for (int n = 0; n < 60; ++n) {
      const std::uint64_t kind = random() % 12;
      stamp_ns += static_cast<std::int64_t>(test::uniform(random, 1e6, kind == 0 ? 6e8 : 2e8));  // gaps of over 0.2 s
      p += Eigen::Vector3d(test::uniform(random, 0, kind == 1 ? 40.0 : 0.1), 0.01, 0);           // jumps
      Eigen::Vector4d q(1, test::uniform(random, -0.1, 0.1), 0, test::uniform(random, -0.5, 0.5));
      q.normalize();
      if (kind == 2) q *= 1.005;  // repaired
      if (kind == 3) q *= 1.5;    // refused
      const Eigen::Vector3d sent = kind == 4 ? Eigen::Vector3d(0, kNaN, 0) : p;
      const std::int64_t late_ns = kind == 5 ? -250'000'000 : kind == 6 ? -1 : 0;
      track.add(stamp_ns + late_ns, sent, q);
      buffer.add(stamp_ns + late_ns, sent, Eigen::Quaterniond(q[0], q[1], q[2], q[3]));
      if (kind == 7) {
        track.add(stamp_ns, Eigen::Vector3d(9, 9, 9), q);
        buffer.add(stamp_ns, Eigen::Vector3d(9, 9, 9), Eigen::Quaterniond(q[0], q[1], q[2], q[3]));
      }
      for (const std::int64_t near_ns : {-300'000'000, -30'000'000, -9'000, -5'000, 0, 5'000, 10'500, 40'000'000})
        asked.push_back(stamp_ns + near_ns);
    }
    track.finish();
    std::size_t found = 0;
    for (const std::int64_t at_ns : asked) {
      const auto expected = track.at(at_ns), answer = buffer.at(at_ns);
      ASSERT_EQ(expected.has_value(), answer.has_value()) << round << " " << at_ns;
      if (!expected) continue;
      ++found;
      ASSERT_EQ(expected->matrix(), answer->matrix()) << round << " " << at_ns;
    }
    EXPECT_GT(found, 60U);
    EXPECT_LT(found, asked.size());
    EXPECT_EQ(buffer.size(), track.size());
    EXPECT_EQ(buffer.counts().invalid, track.counts().invalid);
    EXPECT_EQ(buffer.counts().repeated, track.counts().repeated);
  }
}

TEST(PoseBuffer, KeepsTheLatest) {
  PoseBuffer buffer(3);
  for (int n = 0; n < 5; ++n) buffer.add(n * 100'000'000, Eigen::Vector3d(n, 0, 0), Eigen::Quaterniond::Identity());
  EXPECT_EQ(buffer.size(), 3U);
  EXPECT_FALSE(buffer.at(100'000'000));
  ASSERT_TRUE(buffer.at(200'000'000));
  EXPECT_EQ(buffer.at(200'000'000)->translation().x(), 2);
  EXPECT_FALSE(buffer.at(500'000'000));
}

TEST(PoseBuffer, BridgesLongerGapsWhenAsked) {
  PoseBuffer usual(10), longer(10, 0.5);
  for (PoseBuffer* buffer : {&usual, &longer}) {
    for (int n = 0; n < 2; ++n) buffer->add(n * 400'000'000, Eigen::Vector3d(n, 0, 0), Eigen::Quaterniond::Identity());
  }
  EXPECT_FALSE(usual.at(100'000'000));
  ASSERT_TRUE(longer.at(100'000'000));
  EXPECT_DOUBLE_EQ(longer.at(100'000'000)->translation().x(), 0.25);
}

TEST(PoseBuffer, ForgetsAPoseFromTheFarFutureAsAMeasureOfTime) {
  PoseBuffer buffer(100);
  buffer.add(1'000, Eigen::Vector3d::Zero(), Eigen::Quaterniond::Identity());
  EXPECT_FALSE(buffer.isPast(1'000));
  buffer.add(io::kMostStamp_ns, Eigen::Vector3d::Zero(), Eigen::Quaterniond::Identity());
  EXPECT_TRUE(buffer.isPast(2'000));
  buffer.add(1'500, Eigen::Vector3d::Zero(), Eigen::Quaterniond::Identity());
  EXPECT_FALSE(buffer.isPast(2'000));
  EXPECT_EQ(buffer.counts().backwards, 1U);
}

/// A clock that jumped forth and back: what came under the wrong time makes place for what comes now.
TEST(PoseBuffer, PosesFromTheFarFutureDoNotKeepOutThoseThatFollow) {
  PoseBuffer buffer(5);
  const auto add = [&](std::int64_t stamp_ns) {
    buffer.add(stamp_ns, Eigen::Vector3d::Zero(), Eigen::Quaterniond::Identity());
  };
  for (int n = 0; n < 20; ++n) add(86'400'000'000'000 + n * 50'000'000);
  for (int n = 0; n < 10; ++n) {
    add(1'000'000'000 + n * 50'000'000);
    EXPECT_TRUE(buffer.at(1'000'000'000 + n * 50'000'000)) << n;
    EXPECT_EQ(buffer.size(), 5U);
  }
  EXPECT_FALSE(buffer.at(1'000'000'000)) << "the first of them went before the last";
}

}  // namespace
}  // namespace accessvdb::internal
