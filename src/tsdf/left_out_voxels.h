// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Voxels in which returns had to be left out, because the map may no longer grow (PackedMap::stopGrowing). They count
/// as colliding and not as free for an arm: what is not in the map must not make a point accessible
/// (docs/design/left_out.md, "What is left out blocks").
#pragma once

#include <openvdb/math/Coord.h>

#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "accessvdb/leaf_change.h"

namespace accessvdb::internal {

class LeftOutVoxels {
 public:
  [[nodiscard]] bool empty() const { return leaves_.empty(); }
  [[nodiscard]] std::size_t leaves() const { return leaves_.size(); }
  /// nullptr if nothing was left out in this leaf. @param origin_ijk  multiples of 8
  [[nodiscard]] const LeafBits* find(const openvdb::Coord& origin_ijk) const {
    const auto found = leaves_.find(origin_ijk);
    return found == leaves_.end() ? nullptr : &found->second;
  }
  /// All of a leaf's voxels that are left out from now on.
  void set(const openvdb::Coord& origin_ijk, const LeafBits& voxels);
  /// By place: files do not depend on the order in which leaves came.
  [[nodiscard]] std::vector<std::pair<openvdb::Coord, LeafBits>> inOrder() const;

  /// Forgets all voxels and takes no more: from now on a scan only names the leaves (IntegrationResult::left_out).
  void stopKeeping();
  [[nodiscard]] bool keeps() const { return keeps_; }
  /// When to.
  [[nodiscard]] std::size_t most() const { return most_; }
  void keepMost(std::size_t leaves) { most_ = leaves; }

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct Hash {
    std::size_t operator()(const openvdb::Coord& ijk) const { return ijk.hash(); }
  };
  std::unordered_map<openvdb::Coord, LeafBits, Hash> leaves_;
  bool keeps_ = true;
  std::size_t most_ = 0;
};

}  // namespace accessvdb::internal
