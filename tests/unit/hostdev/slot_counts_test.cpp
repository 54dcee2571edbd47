// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Slots of values on a device: how many are freed before more are taken.
#include "launch/slot_counts.h"

#include <gtest/gtest.h>

namespace accessvdb::kernels {
namespace {

TEST(SlotCounts, FreeOnesComeFirst) {
  SlotCounts slots = {3, 10};
  slots.take(2);
  EXPECT_EQ(slots.free, 1u);
  EXPECT_EQ(slots.next, 10u);
  slots.take(5);
  EXPECT_EQ(slots.free, 0u);
  EXPECT_EQ(slots.next, 14u);
}

TEST(SlotCounts, AreFreedForWhatDoesNotFit) {
  const SlotCounts slots = {3, 10};
  EXPECT_EQ(slots.toFree(3, 10), 0u);  // the free ones suffice
  EXPECT_EQ(slots.toFree(7, 14), 0u);
  EXPECT_EQ(slots.toFree(7, 12), 2u);
  EXPECT_EQ(slots.toFree(7, 10), 4u);
}

/// A scan that alone needs more than the limit made more slots than that: later ones free no more than they need.
TEST(SlotCounts, BeyondTheLimitFreeNoMoreThanIsNeeded) {
  const SlotCounts slots = {3, 10};
  EXPECT_EQ(slots.toFree(3, 4), 0u);
  EXPECT_EQ(slots.toFree(5, 4), 2u);
  for (std::uint32_t needs = 0; needs < 20; ++needs) {
    SlotCounts after = slots;
    after.free += static_cast<std::uint32_t>(slots.toFree(needs, 4));
    after.take(needs);
    EXPECT_EQ(after.next, 10u) << needs;
  }
}

}  // namespace
}  // namespace accessvdb::kernels
