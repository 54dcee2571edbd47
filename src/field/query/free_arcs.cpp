// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/free_arcs.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace accessvdb::internal {
namespace {

/// Of a step's length: neighbours on a sphere are nearer than this, and the next ones are not.
constexpr double kNeighbour = 1.5;

double degrees(double radians) { return radians * 180 / std::numbers::pi; }

}  // namespace

DirectionNeighbours::DirectionNeighbours(const ApproachParams& resolved) {
  const OrientationSet& set = resolved.orientations;
  if (set.kind == OrientationKind::List) return;
  const std::vector<ToolOrientation> all = set.orientations(resolved.num_directions);
  neighbours_.resize(all.size());
  if (set.kind == OrientationKind::Sphere) {
    if (set.with_yaw) first_ = static_cast<std::size_t>(resolved.num_directions);
    const double cos_min = std::cos(std::min(kNeighbour * set.step_deg, 180.0) * std::numbers::pi / 180);
    for (std::size_t a = 0; a < all.size(); ++a) {
      for (std::size_t b = 0; b < all.size(); ++b) {
        if (a != b && all[a].R_WT.col(0).dot(all[b].R_WT.col(0)) >= cos_min)
          neighbours_[a].push_back(static_cast<std::uint16_t>(b));
      }
    }
    return;
  }
  ring_size_.resize(all.size());
  for (std::size_t begin = 0, end = 0; begin < all.size(); begin = end) {
    while (end < all.size() && all[end].pitch_rad == all[begin].pitch_rad) ++end;
    const std::size_t size = end - begin;
    for (std::size_t n = 0; n < size; ++n) {
      ring_size_[begin + n] = static_cast<std::uint32_t>(size);
      if (size < 2) continue;
      neighbours_[begin + n].push_back(static_cast<std::uint16_t>(begin + (n + 1) % size));
      neighbours_[begin + n].push_back(static_cast<std::uint16_t>(begin + (n + size - 1) % size));
    }
  }
}

float DirectionNeighbours::width_deg(std::size_t directions, std::uint16_t direction) const {
  const auto count = static_cast<double>(std::max<std::size_t>(directions, 1));
  if (!ring_size_.empty()) return static_cast<float>(360 * count / ring_size_[direction]);
  // A cone with this share of the sphere.
  return static_cast<float>(degrees(2 * std::acos(1 - 2 * count / static_cast<double>(neighbours_.size() - first_))));
}

float freeArc_deg(const DirectionNeighbours& neighbours, const std::vector<bool>& free, std::uint16_t from) {
  if (!neighbours.any() || !free[from]) return -1;
  std::vector<bool> met(free.size(), false);
  std::vector<std::uint16_t> open = {from};
  met[from] = true;
  std::size_t count = 0;
  while (!open.empty()) {
    const std::uint16_t d = open.back();
    open.pop_back();
    count += neighbours.counts(d) ? 1 : 0;
    for (const std::uint16_t next : neighbours.of(d)) {
      if (met[next] || !free[next]) continue;
      met[next] = true;
      open.push_back(next);
    }
  }
  return neighbours.width_deg(count, from);
}

std::vector<std::size_t> freeDepths(const DirectionNeighbours& neighbours, const std::vector<bool>& free) {
  std::vector<std::size_t> depth(free.size(), free.size());
  std::vector<std::uint16_t> reached;
  for (std::size_t d = 0; d < free.size(); ++d) {
    if (free[d]) continue;
    depth[d] = 0;
    reached.push_back(static_cast<std::uint16_t>(d));
  }
  if (!neighbours.any()) return depth;
  for (std::size_t n = 0; n < reached.size(); ++n) {  // grows
    for (const std::uint16_t next : neighbours.of(reached[n])) {
      if (depth[next] <= depth[reached[n]] + 1) continue;
      depth[next] = depth[reached[n]] + 1;
      reached.push_back(next);
    }
  }
  return depth;
}

std::vector<float> freeArcs_deg(DirectionTrials& trials, const DirectionNeighbours& neighbours,
                                std::span<const std::uint32_t> ids, std::span<const std::uint16_t> from) {
  std::vector<float> arcs(ids.size(), -1);
  if (!neighbours.any()) return arcs;
  struct Search {
    std::size_t place;
    std::vector<bool> met;
    std::vector<std::uint16_t> open;  ///< to be tried
    std::size_t free = 0;
  };
  const auto D = static_cast<std::size_t>(trials.directions());
  std::vector<Search> searches(ids.size());
  const auto meet = [&](Search& search, std::uint16_t direction) {
    for (const std::uint16_t next : neighbours.of(direction)) {
      if (search.met[next]) continue;
      search.met[next] = true;
      if (trials.inCone(ids[search.place], next)) search.open.push_back(next);
    }
  };
  for (std::size_t n = 0; n < ids.size(); ++n) {
    searches[n] = {n, std::vector<bool>(D, false), {}, neighbours.counts(from[n]) ? 1U : 0U};
    searches[n].met[from[n]] = true;
    meet(searches[n], from[n]);
  }
  std::vector<DirectionTrials::Trial> round;
  while (true) {
    std::erase_if(searches, [&](const Search& search) {
      if (!search.open.empty()) return false;
      arcs[search.place] = neighbours.width_deg(search.free, from[search.place]);
      return true;
    });
    if (searches.empty()) return arcs;
    round.clear();
    for (Search& search : searches) {
      round.push_back({ids[search.place], search.open.back()});
      search.open.pop_back();
    }
    const std::vector<kernels::ScoreResult> results = trials.tried(round);
    for (std::size_t k = 0; k < searches.size(); ++k) {
      if (results[k].reason != PointReason::None) continue;
      searches[k].free += neighbours.counts(static_cast<std::uint16_t>(round[k].direction)) ? 1 : 0;
      meet(searches[k], static_cast<std::uint16_t>(round[k].direction));
    }
  }
}

}  // namespace accessvdb::internal
