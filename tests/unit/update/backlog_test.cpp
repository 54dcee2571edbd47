// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The queue of both policies against a plain list of requests.
#include "update/backlog.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <utility>
#include <vector>

namespace accessvdb::internal {
namespace {

TEST(Backlog, ServesTheFirstComersOnceWithAllThatWasAsked) {
  constexpr std::uint32_t kPoints = 200;
  std::mt19937 random(5);
  Backlog backlog;
  std::vector<std::pair<std::uint32_t, unsigned>> wanted;  // in order
  std::vector<int> since;                                  // the round in which each came
  std::uint32_t points = 0;
  std::size_t served = 0, joined = 0;
  std::uint64_t longest = 0;
  for (int round = 0; round < 400; ++round) {
    points = std::min(kPoints, points + 7);
    backlog.grow(points);
    for (int n = 0; n < 30; ++n) {
      const std::uint32_t id = std::uniform_int_distribution<std::uint32_t>(0, points - 1)(random);
      const unsigned what = 1u << std::uniform_int_distribution<unsigned>(0, 3)(random);
      const auto there = std::ranges::find(wanted, id, &std::pair<std::uint32_t, unsigned>::first);
      EXPECT_EQ(backlog.holds(id), there != wanted.end());
      backlog.ask(id, static_cast<std::uint8_t>(what));
      if (there == wanted.end()) {
        wanted.emplace_back(id, what);
        since.push_back(round);
      } else {
        there->second |= what;
        ++joined;
      }
    }
    ASSERT_EQ(backlog.size(), wanted.size());
    const int budget = round % 11 == 10 ? 0 : round % 2 == 0 ? 17 : 9;
    const Backlog::Turn turn = backlog.take(budget);
    const std::size_t count = budget == 0 ? wanted.size() : std::min(wanted.size(), static_cast<std::size_t>(budget));
    ASSERT_EQ(turn.ids.size(), count);
    ASSERT_EQ(turn.asked.size(), count);
    for (std::size_t n = 0; n < count; ++n) {
      EXPECT_EQ(turn.ids[n], wanted[n].first);
      EXPECT_EQ(turn.asked[n], wanted[n].second);
      EXPECT_FALSE(backlog.holds(turn.ids[n]));
    }
    wanted.erase(wanted.begin(), wanted.begin() + static_cast<std::ptrdiff_t>(count));
    since.erase(since.begin(), since.begin() + static_cast<std::ptrdiff_t>(count));
    const std::uint64_t left_by = since.empty() ? 0 : static_cast<std::uint64_t>(round - since.front() + 1);
    ASSERT_EQ(backlog.updates(), left_by);
    longest = std::max(longest, left_by);
    served += count;
  }
  EXPECT_GT(served, 5000u);
  EXPECT_GT(joined, 1000u);
  EXPECT_GE(longest, 3u);
}

}  // namespace
}  // namespace accessvdb::internal
