// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Records that several threads add and remove at once, in batches and one by one.
#include "tsdf/record_pool.h"

#include <gtest/gtest.h>

#include <iterator>
#include <map>
#include <random>
#include <thread>
#include <vector>

namespace accessvdb::internal {
namespace {

using Pool = RecordPool<std::uint64_t>;
/// What a thread put in and did not remove, by number.
using Kept = std::map<std::uint32_t, std::uint64_t>;

/// @param records  a Pool, or a batch of one
template <typename Records>
void addAndRemove(Records& records, std::mt19937_64& random, int steps, Kept& kept) {
  for (int step = 0; step < steps; ++step) {
    // Phases in which more is added than removed, and the other way round.
    const bool adds = kept.empty() || random() % 8 < (step / 300 % 2 == 0 ? 6u : 2u);
    if (adds) {
      const std::uint64_t value = random();
      const std::uint32_t number = records.add(value);
      EXPECT_NE(number, 0u);
      EXPECT_TRUE(kept.emplace(number, value).second) << "a number given twice";
    } else {
      const auto one = std::next(kept.begin(), static_cast<std::ptrdiff_t>(random() % kept.size()));
      EXPECT_EQ(records.get(one->first), one->second);
      records.remove(one->first);
      kept.erase(one);
    }
  }
}

TEST(RecordPool, KeepsWhatSeveralThreadsPutIn) {
  constexpr int kThreads = 4, kRounds = 8, kSteps = 2000;
  Pool pool;
  std::vector<Kept> kept(kThreads);
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&pool, &own = kept[static_cast<std::size_t>(t)], t] {
      std::mt19937_64 random(static_cast<std::uint64_t>(t) + 1);
      for (int round = 0; round < kRounds; ++round) {
        if (t == 0) {
          addAndRemove(pool, random, kSteps, own);
        } else {
          Pool::Batch batch(pool);
          addAndRemove(batch, random, kSteps, own);
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  Kept all;
  for (const Kept& own : kept) {
    for (const auto& [number, value] : own) {
      EXPECT_TRUE(all.emplace(number, value).second) << "two threads have number " << number;
      EXPECT_EQ(pool.get(number), value);
    }
  }
  EXPECT_GT(all.size(), 1000u);
  EXPECT_EQ(pool.size(), all.size());
}

TEST(RecordPool, UsesNumbersOfABatchAgain) {
  Pool pool;
  for (int round = 0; round < 100; ++round) {
    Pool::Batch batch(pool);
    std::vector<std::uint32_t> numbers;
    for (std::uint64_t n = 0; n < 150; ++n) numbers.push_back(batch.add(n));
    for (const std::uint32_t number : numbers) {
      EXPECT_LE(number, 256u) << "the pool grew though it had free numbers";
      batch.remove(number);
    }
  }
  EXPECT_EQ(pool.size(), 0u);
  EXPECT_EQ(pool.bytes(), 0u);
}

}  // namespace
}  // namespace accessvdb::internal
