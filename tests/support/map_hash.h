// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A hash of the authored map: what it holds in every leaf.
#pragma once

#include <cstdint>

#include "tsdf/packed_map.h"

namespace accessvdb::test {

/// FNV-1a over leaves in the order of the tree.
inline std::uint64_t hashOf(const internal::PackedMap& map) {
  std::uint64_t hash = 0xcbf29ce484222325ull;
  const auto add = [&hash](std::uint64_t value) { hash = (hash ^ value) * 0x100000001b3ull; };
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    for (int axis = 0; axis < 3; ++axis) add(static_cast<std::uint32_t>(leaf->origin()[axis]));
    for (openvdb::Index w = 0; w < 8; ++w) add(leaf->getValueMask().getWord<openvdb::Index64>(w));
    internal::LeafValues::Room room;
    const std::uint32_t* packed = internal::LeafValues(*leaf).all(room);
    for (openvdb::Index n = 0; packed != nullptr && n < internal::PackedLeaf::SIZE; ++n) add(packed[n]);
  }
  return hash;
}

}  // namespace accessvdb::test
