// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/free_generations.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <mutex>

#include "tsdf/packed_map.h"

namespace accessvdb::internal {
namespace {

constexpr int kPhases = 256;

/// 0 .. 255, well spread over nodes that are neighbours.
int phaseOf(std::int32_t x, std::int32_t y, std::int32_t z) {
  std::uint64_t hash = 0;
  for (const std::int32_t axis : {x, y, z}) {
    hash = (hash ^ static_cast<std::uint32_t>(axis >> 7)) * 0x9e3779b97f4a7c15u;
    hash ^= hash >> 29;
  }
  return static_cast<int>(hash >> 40 & (kPhases - 1));
}

/// Leaves that a thread takes at a time.
constexpr std::size_t kAgedPerTask = 128;

/// A leaf of a node, and how many generations have ended there.
struct DueLeaf {
  PackedLeaf* leaf;
  std::int64_t ended;
};

/// @return whether a voxel is no longer free; then `change` says which
bool turn(PackedMap& map, PackedLeaf& leaf, std::int64_t ended, LeafChange& change) {
  LeafBits now, before = {}, lost;
  for (openvdb::Index x = 0; x < 8; ++x) now[x] = leaf.getValueMask().getWord<std::uint64_t>(x);
  if (const LeafBits* known = map.beforeOf(leaf)) before = *known;
  std::uint64_t any_lost = 0;
  for (std::size_t x = 0; x < 8; ++x) {
    lost[x] = ended == 1 ? before[x] & ~now[x] : before[x] | now[x];
    any_lost |= lost[x];
  }
  if (any_lost != 0) {
    const LeafBits collides = map.collidingIn(leaf);
    any_lost = 0;
    change = {};
    change.origin_ijk = {leaf.origin().x(), leaf.origin().y(), leaf.origin().z()};
    for (std::size_t x = 0; x < 8; ++x) {
      change.arm_free_off[x] = lost[x] & ~collides[x];
      any_lost |= change.arm_free_off[x];
    }
  }
  map.setBefore(leaf, ended == 1 ? now : LeafBits{});
  for (openvdb::Index x = 0; x < 8; ++x) leaf.getValueMask().getWord<std::uint64_t>(x) = 0;
  return any_lost != 0;
}

}  // namespace

std::int64_t FreeGenerations::generationAt(double age_s, std::int32_t x, std::int32_t y, std::int32_t z) const {
  return static_cast<std::int64_t>(std::floor(age_s / free_for_s_ + static_cast<double>(phaseOf(x, y, z)) / kPhases));
}

std::vector<LeafChange> FreeGenerations::pass(PackedMap& map, double seconds) {
  std::vector<LeafChange> changes;
  if (!(seconds > 0)) return changes;
  const double before_s = age_s_;
  age_s_ += std::min(seconds, 2 * free_for_s_);
  std::vector<PackedLowerNode*> nodes;
  map.tree().getNodes(nodes);
  // A few nodes per scan, with up to 4096 leaves each: shared out by leaf.
  std::vector<DueLeaf> due;
  for (PackedLowerNode* node : nodes) {
    const openvdb::Coord& origin = node->origin();
    const std::int64_t ended =
        generationOf(origin.x(), origin.y(), origin.z()) - generationAt(before_s, origin.x(), origin.y(), origin.z());
    if (ended <= 0) continue;
    for (auto leaf = node->beginChildOn(); leaf; ++leaf) due.push_back({&*leaf, ended});
  }
  std::mutex mutex;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, due.size(), kAgedPerTask), [&](const auto& range) {
    std::vector<LeafChange> found;
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      LeafChange change;
      if (turn(map, *due[n].leaf, due[n].ended, change)) found.push_back(change);
    }
    const std::lock_guard lock(mutex);
    changes.insert(changes.end(), found.begin(), found.end());
  });
  return changes;
}

}  // namespace accessvdb::internal
