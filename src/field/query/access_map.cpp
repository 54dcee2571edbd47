// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/access_map.h"

#include "field/tools/tool_heading.h"
#include "hostdev/direction_filter.h"

namespace accessvdb::internal {

DirectionTrials::DirectionTrials(PointScorer& scorer, const ScoringSetup& setup, const kernels::OccupancyGrid* grid,
                                 std::span<const std::uint32_t> ids)
    : scorer_(scorer), setup_(setup), tables_(setup.tables(grid)), approach_(setup.hostApproach()) {
  scorer.grow();
  scorer.refreshWeights(ids);
  scorer.refreshNeighbourhoods(ids);
  scorer.upload(ids);
  tables_.rule.keep_best = false;
}

bool DirectionTrials::inCone(std::uint32_t id, int direction) const {
  const Eigen::Vector3f normal = scorer_.record(id).normal_L;
  return !normal.isZero() && kernels::cosToNormal(approach_, direction, normal.data()) >= approach_.normal_cos_min;
}

std::vector<kernels::ScoreResult> DirectionTrials::tried(std::span<const Trial> trials) {
  std::vector<kernels::ScoreItem> items(trials.size());
  for (std::size_t n = 0; n < trials.size(); ++n) {
    items[n].id = trials[n].id;
    if (kernels::isWide(approach_.num_directions)) {
      items[n].only_direction = trials[n].direction;
    } else {
      items[n].candidates.set(trials[n].direction);
    }
  }
  return scorer_.score(items, tables_);
}

std::vector<std::vector<DirectionOutcome>> DirectionTrials::all(std::span<const std::uint32_t> ids) {
  const ToolRolls& rolls = setup_.tool().rolls;
  const std::vector<ToolHeading> headings = toolHeadings(scorer_.params().approach, rolls);
  const auto D = static_cast<std::size_t>(directions());
  std::vector<std::vector<DirectionOutcome>> outcomes(ids.size(), std::vector<DirectionOutcome>(D));
  std::vector<Trial> trials;
  std::vector<std::size_t> places;
  for (std::size_t d = 0; d < D; ++d) {
    const std::size_t first = d * static_cast<std::size_t>(rolls.count);
    trials.clear();
    places.clear();
    for (std::size_t n = 0; n < ids.size(); ++n) {
      DirectionOutcome& outcome = outcomes[n][d];
      outcome.direction_W = headings[first].direction_W;
      outcome.orientation_WT = headings[first].orientation_WT;
      const Eigen::Vector3f normal = scorer_.record(ids[n]).normal_L;
      if (kernels::besideSurfaceAxis(normal.data()) >= 0) outcome.reason = PointReason::BesideSurface;
      if (!inCone(ids[n], static_cast<int>(d))) continue;  // the search would only say that others are
      trials.push_back({ids[n], static_cast<int>(d)});
      places.push_back(n);
    }
    const std::vector<kernels::ScoreResult> results = tried(trials);
    for (std::size_t k = 0; k < places.size(); ++k) {
      DirectionOutcome& outcome = outcomes[places[k]][d];
      outcome.reason = results[k].reason;
      outcome.score = results[k].score;
      outcome.roll = results[k].roll;
      outcome.orientation_WT = headings[first + results[k].roll].orientation_WT;
    }
  }
  return outcomes;
}

}  // namespace accessvdb::internal
