// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/free_generations.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "processor/prefetch.h"
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

/// How far ahead of its use a leaf, and then what it has beside the map, is asked for.
constexpr std::size_t kLeafAhead = 12, kRecordAhead = 6;
constexpr std::size_t kNodeAhead = 8, kNodesPerTask = 256;

/// A leaf of a node, and how many generations have ended there.
struct DueLeaf {
  PackedLeaf* leaf;
  std::int64_t ended;
};

using Records = RecordPool<AgedLeaf>;

/// Lets leaves turn, one after the other, and lists those in which a voxel is no longer free.
class Turning {
 public:
  Turning(PackedMap& map, Records& records, std::vector<LeafChange>& changes)
      : map_(map), records_(records), changes_(changes) {}

  void turn(std::span<const DueLeaf> due) {
    for (std::size_t n = 0; n < due.size(); ++n) {
      if (n + kLeafAhead < due.size()) prefetchWrite(due[n + kLeafAhead].leaf, sizeof(PackedLeaf));
      if (n + kRecordAhead < due.size()) {
        if (const LeafBits* before = map_.beforeOf(*due[n + kRecordAhead].leaf))
          prefetchWrite(before, sizeof(AgedLeaf));
      }
      turn(*due[n].leaf, due[n].ended);
    }
  }

 private:
  void turn(PackedLeaf& leaf, std::int64_t ended) {
    LeafBits now, before = {}, lost;
    for (openvdb::Index x = 0; x < 8; ++x) now[x] = leaf.getValueMask().getWord<std::uint64_t>(x);
    if (const LeafBits* known = map_.beforeOf(leaf)) before = *known;
    std::uint64_t any_lost = 0;
    for (std::size_t x = 0; x < 8; ++x) {
      lost[x] = ended == 1 ? before[x] & ~now[x] : before[x] | now[x];
      any_lost |= lost[x];
    }
    if (any_lost != 0) noteLost(leaf, lost);
    map_.setBefore(leaf, ended == 1 ? now : LeafBits{}, records_);
    for (openvdb::Index x = 0; x < 8; ++x) leaf.getValueMask().getWord<std::uint64_t>(x) = 0;
  }

  void noteLost(const PackedLeaf& leaf, const LeafBits& lost) {
    const LeafBits collides = map_.collidingIn(leaf);
    LeafChange change;
    change.origin_ijk = {leaf.origin().x(), leaf.origin().y(), leaf.origin().z()};
    std::uint64_t any = 0;
    for (std::size_t x = 0; x < 8; ++x) {
      change.arm_free_off[x] = lost[x] & ~collides[x];
      any |= change.arm_free_off[x];
    }
    if (any != 0) changes_.push_back(change);
  }

  PackedMap& map_;
  Records::Batch records_;
  std::vector<LeafChange>& changes_;
};

}  // namespace

std::int64_t FreeGenerations::generationAt(double age_s, std::int32_t x, std::int32_t y, std::int32_t z) const {
  return static_cast<std::int64_t>(std::floor(age_s / free_for_s_ + static_cast<double>(phaseOf(x, y, z)) / kPhases));
}

double FreeGenerations::ageAfter(double seconds) const {
  return seconds > 0 ? age_s_ + std::min(seconds, 2 * free_for_s_) : age_s_;
}

bool FreeGenerations::isDue(const PackedMap& map, double age_s) const {
  if (!(age_s > age_s_)) return false;
  std::vector<const PackedLowerNode*> nodes;
  map.tree().getNodes(nodes);
  return std::ranges::any_of(nodes, [&](const PackedLowerNode* node) {
    const openvdb::Coord& origin = node->origin();
    return generationAt(age_s, origin.x(), origin.y(), origin.z()) > generationOf(origin.x(), origin.y(), origin.z());
  });
}

std::vector<std::span<const LeafChange>> FreeGenerations::passTo(PackedMap& map, double age_s) {
  if (!(age_s > age_s_)) return {};
  const double before_s = std::exchange(age_s_, age_s);
  std::vector<PackedLowerNode*> nodes;
  map.tree().getNodes(nodes);
  // Thousands of nodes, each somewhere in memory, of which few are due.
  std::vector<std::int64_t> ended(nodes.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, nodes.size(), kNodesPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      if (n + kNodeAhead < nodes.size()) prefetchWrite(&nodes[n + kNodeAhead]->origin(), sizeof(openvdb::Coord));
      const openvdb::Coord& origin = nodes[n]->origin();
      ended[n] =
          generationOf(origin.x(), origin.y(), origin.z()) - generationAt(before_s, origin.x(), origin.y(), origin.z());
    }
  });
  // Up to 4096 leaves each: shared out by leaf.
  std::vector<DueLeaf> due;
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    if (ended[n] <= 0) continue;
    for (auto leaf = nodes[n]->beginChildOn(); leaf; ++leaf) due.push_back({&*leaf, ended[n]});
  }
  tbb::parallel_for(std::size_t{0}, kLists, [&](std::size_t part) {
    changes_[part].clear();
    const std::size_t begin = due.size() * part / kLists, end = due.size() * (part + 1) / kLists;
    Turning(map, records_, changes_[part]).turn(std::span(due).subspan(begin, end - begin));
  });
  std::vector<std::span<const LeafChange>> parts;
  for (const std::vector<LeafChange>& part : changes_) {
    if (!part.empty()) parts.emplace_back(part);
  }
  return parts;
}

}  // namespace accessvdb::internal
