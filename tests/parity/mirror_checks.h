// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Invariants of every mirrored grid, whatever its contents, and random leaf changes to stress them.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "hostdev/nanovdb_compat.h"

namespace accessvdb::testing {

struct TreeCensus {
  std::string problem;  ///< empty = none
  std::uint64_t leaves = 0, lowers = 0, uppers = 0;
  std::uint64_t true_voxels = 0, active_voxels = 0;  ///< the former: voxels whose value is not 0
};

/// Walks every node from the root: aligned, inside [grid, grid + gridSize), where its parent's entry says it is.
/// NanoVDB's own validator does not check the leaves.
template <class Build>
TreeCensus walkTree(const nanovdb::NanoGrid<Build>& grid) {
  TreeCensus census;
  const auto* begin = reinterpret_cast<const std::uint8_t*>(&grid);
  const auto placed = [&](const auto& node, const nanovdb::Coord& origin) {
    const auto* at = reinterpret_cast<const std::uint8_t*>(&node);
    if (at <= begin || at + sizeof(node) > begin + grid.gridSize()) {
      census.problem = "a node is outside the grid";
    } else if (reinterpret_cast<std::uintptr_t>(at) % 32 != 0) {
      census.problem = "a node is not aligned";
    } else if (!(node.origin() == origin)) {
      census.problem = "a node is not where its parent says";
    }
    return census.problem.empty();
  };
  const auto& root = grid.tree().root();
  for (std::uint32_t t = 0; t < root.tileCount(); ++t) {
    const auto* tile = root.data()->tile(t);
    // Only what is not const has beginChild() in each of NanoVDB's releases.
    auto& upper = const_cast<nanovdb::NanoUpper<Build>&>(*root.data()->getChild(tile));
    if (tile->child == 0) census.problem = "a root tile without a child";
    if (!census.problem.empty() || !placed(upper, tile->origin())) return census;
    ++census.uppers;
    for (auto i = upper.beginChild(); i; ++i) {
      if (!placed(*i, upper.offsetToGlobalCoord(i.pos()))) return census;
      ++census.lowers;
      for (auto j = i->beginChild(); j; ++j) {
        if (!placed(*j, i->offsetToGlobalCoord(j.pos()))) return census;
        ++census.leaves;
        std::array<std::uint8_t, 8> cells = {};
        for (std::uint32_t n = 0; n < 512; ++n) {
          const bool holds = j->getValue(n) != Build{};
          census.true_voxels += holds;
          census.active_voxels += j->isActive(n);
          if (holds) ++cells[(n >> 8 & 1) << 2 | (n >> 5 & 1) << 1 | (n >> 2 & 1)];
        }
        if constexpr (std::is_same_v<Build, bool>) {
          if (std::memcmp(j->data()->mPadding, cells.data(), cells.size()) == 0) continue;
          census.problem = "a leaf's cells are miscounted";
          return census;
        }
      }
    }
  }
  return census;
}

/// Origins where bugs hide: around 0, on both sides of root tiles, in 27 of them around 0, and far away.
class ChangeMaker {
 public:
  explicit ChangeMaker(std::uint64_t seed) : random_(seed) {}

  [[nodiscard]] std::array<std::int32_t, 3> origin() {
    static constexpr std::int32_t kBoundaries[] = {0, 4096, -4096, 128, -128};
    static constexpr std::int32_t kFar[] = {1 << 20, -(1 << 20), 1 << 30, -(1 << 30)};
    std::array<std::int32_t, 3> ijk;
    const auto kind = below(10);
    for (auto& c : ijk) {
      const std::int32_t near = 8 * (static_cast<std::int32_t>(below(8)) - 4);  // of both signs
      if (kind < 3) c = near;
      if (kind >= 3 && kind < 6) c = kBoundaries[below(5)] + near;
      if (kind >= 6 && kind < 9) c = 4096 * (static_cast<std::int32_t>(below(3)) - 1) + 2048 + near;
      if (kind == 9) c = kFar[below(4)] + near;
    }
    return ijk;
  }

  [[nodiscard]] LeafChange change(const std::array<std::int32_t, 3>& origin_ijk) {
    LeafChange change;
    change.origin_ijk = origin_ijk;
    // Off bits occasionally overlap on bits: off wins.
    for (auto* bits : {&change.collides_on, &change.collides_off, &change.arm_free_on, &change.arm_free_off}) {
      if (below(3) == 0) continue;
      for (auto& word : *bits) word = below(4) == 0 ? 0 : random_() & random_();
    }
    return change;
  }

  [[nodiscard]] std::vector<LeafChange> batch(std::size_t count) {
    std::vector<LeafChange> changes;
    for (std::size_t i = 0; i < count; ++i) changes.push_back(change(origin()));
    return changes;
  }

  [[nodiscard]] std::uint64_t below(std::uint64_t n) { return random_() % n; }
  [[nodiscard]] std::mt19937_64& random() { return random_; }

 private:
  std::mt19937_64 random_;
};

}  // namespace accessvdb::testing
