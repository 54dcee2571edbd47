// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/run_beside.h"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <stdexcept>
#include <thread>

namespace accessvdb::internal {
namespace {

constexpr int kTurns = 2000;

/// A loop that TBB would abandon if cancelled, long enough for that.
void count(std::atomic<int>& turns) {
  tbb::parallel_for(0, kTurns, [&](int) {
    ++turns;
    std::this_thread::yield();
  });
}

class RunBeside : public testing::TestWithParam<int> {};

TEST_P(RunBeside, RunsBothToTheirEndsWhateverFails) {
  tbb::task_arena arena(GetParam());
  arena.execute([] {
    const auto caller = std::this_thread::get_id();
    for (int fails = 0; fails < 4; ++fails) {
      std::atomic<int> here = 0, beside = 0;
      std::string caught;
      try {
        runBeside(
            [&] {
              EXPECT_EQ(std::this_thread::get_id(), caller);
              if ((fails & 1) != 0) throw std::runtime_error("here");
              count(here);
            },
            [&] {
              if ((fails & 2) != 0) throw std::runtime_error("beside");
              count(beside);
            });
      } catch (const std::runtime_error& error) {
        caught = error.what();
      }
      EXPECT_EQ(here, (fails & 1) != 0 ? 0 : kTurns);
      EXPECT_EQ(beside, (fails & 2) != 0 ? 0 : kTurns);
      EXPECT_EQ(caught, (fails & 2) != 0 ? "beside" : (fails & 1) != 0 ? "here" : "");
    }
  });
}

INSTANTIATE_TEST_SUITE_P(Threads, RunBeside, testing::Values(1, 2, 8));

}  // namespace
}  // namespace accessvdb::internal
