// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What "the same map" means. Not in determinism_support.h: OpenVDB takes seconds to compile.
#pragma once

#include <gtest/gtest.h>

#include "accessvdb/tsdf_volume.h"

namespace accessvdb::test {

/// Leaves, values and which of them are active.
inline void expectSameMap(const TsdfVolume& a, const TsdfVolume& b) {
  ASSERT_EQ(a.leafCount(), b.leafCount());
  ASSERT_EQ(a.activeVoxelCount(), b.activeVoxelCount());
  const auto compare = [](const auto& x, const auto& y) {
    ASSERT_TRUE(x->tree().hasSameTopology(y->tree()));
    for (auto leaf = x->tree().cbeginLeaf(); leaf; ++leaf) {
      const auto* other = y->tree().probeConstLeaf(leaf->origin());
      ASSERT_NE(other, nullptr);
      ASSERT_TRUE(leaf->buffer() == other->buffer());
    }
  };
  compare(a.distance(), b.distance());
  compare(a.weight(), b.weight());
  compare(a.cleared(), b.cleared());
}

}  // namespace accessvdb::test
