// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Body of SurfaceVoxels::grid(): leaves are filled in parallel and linked serially.
#pragma once

#include <tbb/parallel_for.h>

#include <memory>

#include "io/field_grids.h"

namespace accessvdb::internal {

template <typename GridT, typename Keep, typename Value>
typename GridT::Ptr SurfaceVoxels::grid(const std::string& name, const typename GridT::ValueType& background,
                                        const Keep& keep, const Value& value) const {
  using LeafT = typename GridT::TreeType::LeafNodeType;
  const std::size_t leaf_count = leaf_begins_.size() - 1;
  std::vector<std::unique_ptr<LeafT>> leaves(leaf_count);
  tbb::parallel_for(std::size_t{0}, leaf_count, [&](std::size_t i) {
    for (std::size_t e = leaf_begins_[i]; e < leaf_begins_[i + 1]; ++e) {
      const SurfacePoint& point = field_.points[entries_[e].index];
      if (!keep(point)) continue;
      const openvdb::Coord& ijk = entries_[e].ijk;
      if (!leaves[i]) leaves[i] = std::make_unique<LeafT>(ijk, background, false);
      leaves[i]->setValueOn(LeafT::coordToOffset(ijk), value(point, entries_[e].index));
    }
  });
  auto grid = GridT::create(background);
  for (auto& leaf : leaves) {
    if (leaf) grid->tree().addLeaf(leaf.release());
  }
  grid->setName(name);
  grid->setTransform(fieldTransform(field_.voxel_size_m));
  return grid;
}

}  // namespace accessvdb::internal
