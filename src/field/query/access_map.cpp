// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/access_map.h"

#include <span>

#include "field/tools/tool_heading.h"
#include "hostdev/direction_filter.h"

namespace accessvdb::internal {

std::vector<DirectionOutcome> tryEveryDirection(PointScorer& scorer, const ScoringSetup& setup,
                                                const kernels::OccupancyGrid* grid, std::uint32_t id) {
  const std::span<const std::uint32_t> ids(&id, 1);
  scorer.grow();
  scorer.refreshWeights(ids);
  scorer.refreshNeighbourhoods(ids);
  scorer.upload(ids);
  ScoringTables tables = setup.tables(grid);
  tables.rule.keep_best = false;
  const kernels::ApproachView approach = setup.hostApproach();
  const Eigen::Vector3f normal = scorer.record(id).normal_L;
  const bool beside_surface = kernels::besideSurfaceAxis(normal.data()) >= 0;
  const ToolRolls& rolls = setup.tool().rolls;
  const std::vector<ToolHeading> headings = toolHeadings(scorer.params().approach, rolls);
  std::vector<DirectionOutcome> outcomes;
  for (std::size_t first = 0; first < headings.size(); first += static_cast<std::size_t>(rolls.count)) {
    const auto d = static_cast<int>(outcomes.size());
    DirectionOutcome& outcome = outcomes.emplace_back();
    outcome.direction_W = headings[first].direction_W;
    outcome.orientation_WT = headings[first].orientation_WT;
    const bool in_cone =
        !normal.isZero() && kernels::cosToNormal(approach, d, normal.data()) >= approach.normal_cos_min;
    if (beside_surface) outcome.reason = PointReason::BesideSurface;
    if (!in_cone) continue;  // the search would only say that others are
    kernels::ScoreItem item;
    item.id = id;
    if (kernels::isWide(approach.num_directions)) {
      item.only_direction = d;
    } else {
      item.candidates.set(d);
    }
    const kernels::ScoreResult result = scorer.score({&item, 1}, tables).front();
    outcome.reason = result.reason;
    outcome.score = result.score;
    outcome.roll = result.roll;
    outcome.orientation_WT = headings[first + result.roll].orientation_WT;
  }
  return outcomes;
}

}  // namespace accessvdb::internal
