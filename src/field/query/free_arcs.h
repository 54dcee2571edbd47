// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How far a tool can turn from a free direction and stay free.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/params.h"
#include "field/query/access_map.h"

namespace accessvdb::internal {

/// Which directions of a set are beside which, and how much each stands for.
class DirectionNeighbours {
 public:
  explicit DirectionNeighbours(const ApproachParams& resolved);

  /// False: of a list nothing is known.
  [[nodiscard]] bool any() const { return !neighbours_.empty(); }
  [[nodiscard]] std::span<const std::uint16_t> of(std::uint16_t direction) const { return neighbours_[direction]; }
  /// False: between those of a sphere.
  [[nodiscard]] bool counts(std::uint16_t direction) const { return direction >= first_; }
  /// Of so many that count and hang together, one of which is `direction`: degrees of arc, or of a cone's opening.
  [[nodiscard]] float width_deg(std::size_t directions, std::uint16_t direction) const;

 private:
  std::vector<std::vector<std::uint16_t>> neighbours_;
  std::vector<std::uint32_t> ring_size_;  ///< of each direction; empty over a sphere
  std::size_t first_ = 0;                 ///< that counts
};

/// The width around one direction, from what all of them say. @param free  [D]
[[nodiscard]] float freeArc_deg(const DirectionNeighbours& neighbours, const std::vector<bool>& free,
                                std::uint16_t from);

/// How many steps from neighbour to neighbour it takes from each direction to one that is not free, 0 for those; the
/// same for all free ones where nothing is known of neighbours. @param free  [D]  @return [D]
[[nodiscard]] std::vector<std::size_t> freeDepths(const DirectionNeighbours& neighbours, const std::vector<bool>& free);

/// freeArc_deg() for many points, trying only as many directions as it takes.
/// @param ids, from  points, and a free direction of each
[[nodiscard]] std::vector<float> freeArcs_deg(DirectionTrials& trials, const DirectionNeighbours& neighbours,
                                              std::span<const std::uint32_t> ids, std::span<const std::uint16_t> from);

}  // namespace accessvdb::internal
