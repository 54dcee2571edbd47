// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// What changed at points: states compared on the device as on the host, and what a field on a GPU tells.
#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

#include "parity/gpu_test.h"
#include "support/told_changes.h"

namespace accessvdb::test {
namespace {

/// States of points in a backend's memory, as of a tool that rolls.
class StatesOnBackend {
 public:
  StatesOnBackend(kernels::Backend& backend, std::uint32_t count)
      : backend_(backend),
        normal_L_(backend, std::size_t{3} * count),
        stability_(backend, count),
        score_(backend, count),
        direction_(backend, count),
        label_(backend, count),
        reason_(backend, count),
        roll_(backend, count),
        told_(backend, count),
        differ_(backend, (count + 63) / 64) {}

  /// The same for the same seed.
  void write(std::uint64_t seed, std::uint32_t count) {
    std::mt19937_64 random(seed);
    std::vector<float> normals(std::size_t{3} * count), stability(count);
    std::vector<std::uint16_t> score(count), direction(count);
    std::vector<PointLabel> label(count);
    std::vector<PointReason> reason(count);
    std::vector<std::uint8_t> roll(count);
    for (float& x : normals) x = static_cast<float>(uniform(random, -1, 1));
    for (std::uint32_t n = 0; n < count; ++n) {
      stability[n] = static_cast<float>(uniform(random, 0, 1));
      score[n] = static_cast<std::uint16_t>(random() % 2);
      direction[n] = static_cast<std::uint16_t>(random() % 2);
      label[n] = static_cast<PointLabel>(random() % 2);
      reason[n] = static_cast<PointReason>(random() % 2);
      roll[n] = static_cast<std::uint8_t>(random());
    }
    normal_L_.upload(normals.data(), normals.size());
    stability_.upload(stability.data(), count);
    score_.upload(score.data(), count);
    direction_.upload(direction.data(), count);
    label_.upload(label.data(), count);
    reason_.upload(reason.data(), count);
    roll_.upload(roll.data(), count);
  }
  [[nodiscard]] std::vector<std::uint64_t> takeTold(std::uint32_t known, std::uint32_t count, bool with_score) {
    backend_.takeAllTold(view(), {told_.data(), known, count, with_score, differ_.data()});
    std::vector<std::uint64_t> words((count + 63) / 64);
    backend_.download(words.data(), differ_.data(), words.size() * sizeof(words[0]));
    return words;
  }
  [[nodiscard]] std::vector<kernels::StateRow> read(const std::vector<std::uint32_t>& ids) {
    std::vector<kernels::StateRow> rows(ids.size());
    backend_.readPoints(view(), ids.data(), rows.data(), ids.size());
    return rows;
  }

 private:
  [[nodiscard]] kernels::PointStateView view() const {
    kernels::PointStateView view;
    view.normal_L = normal_L_.data();
    view.stability = stability_.data();
    view.score = score_.data();
    view.direction = direction_.data();
    view.label = label_.data();
    view.reason = reason_.data();
    view.roll = roll_.data();
    return view;
  }
  kernels::Backend& backend_;
  kernels::DeviceArray<float> normal_L_, stability_;
  kernels::DeviceArray<std::uint16_t> score_, direction_;
  kernels::DeviceArray<PointLabel> label_;
  kernels::DeviceArray<PointReason> reason_;
  kernels::DeviceArray<std::uint8_t> roll_;
  kernels::DeviceArray<kernels::ToldState> told_;
  kernels::DeviceArray<std::uint64_t> differ_;
};

class CudaTold : public GpuTest {};

TEST_F(CudaTold, StatesAreComparedAndReadAsOnTheHost) {
  const auto host = kernels::makeCpuBackend();
  const auto cuda = kernels::makeCudaBackend();
  constexpr std::uint32_t kMost = 100003;
  for (const bool with_score : {false, true}) {
    SCOPED_TRACE(with_score);
    StatesOnBackend on_host(*host, kMost), on_device(*cuda, kMost);
    std::uint32_t known = 0;
    std::size_t differ = 0, equal = 0;
    std::uint64_t seed = 7;
    for (const std::uint32_t count : {1u, 1u, 31u, 32u, 33u, 64u, 65u, 255u, 257u, 70000u, kMost, kMost}) {
      SCOPED_TRACE(count);
      ++seed;
      on_host.write(seed, count);
      on_device.write(seed, count);
      const std::vector<std::uint64_t> expected = on_host.takeTold(known, count, with_score);
      ASSERT_EQ(on_device.takeTold(known, count, with_score), expected);
      for (std::uint32_t id = 0; id < known; ++id) ++((expected[id / 64] >> id % 64 & 1) != 0 ? differ : equal);
      for (std::uint32_t id = known; id < count; ++id) ASSERT_TRUE(expected[id / 64] >> id % 64 & 1) << id;
      known = count;
    }
    EXPECT_GT(differ, 100000u);
    EXPECT_GT(equal, 10000u);
    std::mt19937_64 random(3);
    std::vector<std::uint32_t> ids(90001);
    for (std::uint32_t& id : ids) id = static_cast<std::uint32_t>(random() % kMost);
    const auto expected = on_host.read(ids), read = on_device.read(ids);
    for (std::size_t n = 0; n < ids.size(); ++n) {
      const kernels::StateRow &a = expected[n], &b = read[n];
      for (int axis = 0; axis < 3; ++axis) ASSERT_TRUE(test::same(a.normal_L[axis], b.normal_L[axis])) << n;
      ASSERT_TRUE(test::same(a.stability, b.stability) && a.score == b.score && a.direction == b.direction &&
                  a.label == b.label && a.reason == b.reason && a.roll == b.roll)
          << n;
    }
  }
}

class CudaToldChanges : public GpuTest, public testing::WithParamInterface<ToldCase> {};

TEST_P(CudaToldChanges, AreThoseOfAComparisonOfAllPoints) {
  ToldTally tally;
  for (const std::uint64_t seed : {1u, 2u, 3u, 12u}) {
    SCOPED_TRACE(seed);
    expectToldAsCompared(GetParam(), seed, BackendKind::Cuda, tally);
  }
  expectAllKinds(GetParam(), tally);
}

INSTANTIATE_TEST_SUITE_P(Streams, CudaToldChanges, testing::ValuesIn(toldCases()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace accessvdb::test
