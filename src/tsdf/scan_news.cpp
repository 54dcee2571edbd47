// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/scan_news.h"

#include <algorithm>
#include <array>

#include "processor/prefetch.h"

namespace accessvdb::internal {
namespace {

/// A return on its way through the tree. Voxels are scattered over the map, so each step only asks for the memory that
/// the next one reads, and all returns of a group take a step before any takes the next.
struct Visit {
  const PackedLowerNode* node;
  const PackedLeaf* leaf;
  LeafValues values;
  openvdb::Index in_node, in_leaf;
};
constexpr std::size_t kGroup = 32;

}  // namespace

void markNews(const PackedMap& map, std::span<ReturnRay> rays) {
  const NewsRule& rule = map.newsRule();
  // Where the map has no place for values, it does not know whether a return is news, and no vote may be missing.
  const std::uint32_t without_values = map.grows() ? 0 : 1;
  ConstPackedAccessor accessor(map.tree());
  std::array<Visit, kGroup> visits;
  for (std::size_t first = 0; first < rays.size(); first += kGroup) {
    const std::size_t count = std::min(kGroup, rays.size() - first);
    for (std::size_t n = 0; n < count; ++n) {
      const auto& base = rays[first + n].base_ijk;
      const openvdb::Coord ijk(base[0], base[1], base[2]);
      Visit& visit = visits[n];
      visit = {accessor.probeConstNode<PackedLowerNode>(ijk),
               nullptr,
               {},
               PackedLowerNode::coordToOffset(ijk),
               PackedLeaf::coordToOffset(ijk)};
      if (visit.node == nullptr) continue;
      prefetchRead(visit.node->getTable() + visit.in_node);
      prefetchRead(reinterpret_cast<const std::byte*>(&visit.node->getChildMask()) + visit.in_node / 8);
    }
    for (std::size_t n = 0; n < count; ++n) {
      Visit& visit = visits[n];
      if (visit.node == nullptr || !visit.node->isChildMaskOn(visit.in_node)) continue;
      visit.leaf = visit.node->getTable()[visit.in_node].getChild();
      prefetchRead(visit.leaf);
    }
    for (std::size_t n = 0; n < count; ++n) {
      Visit& visit = visits[n];
      if (visit.leaf == nullptr) continue;
      visit.values = LeafValues(*visit.leaf);
      if (visit.values) visit.values.prefetch(visit.in_leaf);
    }
    for (std::size_t n = 0; n < count; ++n) {
      const Visit& visit = visits[n];
      rays[first + n].news = !visit.values ? without_values : rule.isNews(visit.values[visit.in_leaf]) ? 1 : 0;
    }
  }
}

}  // namespace accessvdb::internal
