// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/answers.h"

#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "field/query/access_map.h"
#include "field/query/free_arcs.h"
#include "field/tools/best_tool.h"

namespace accessvdb::internal {
namespace {

using PointsOfEach = std::vector<std::unique_ptr<const SurfacePoints>>;

std::unique_ptr<const SurfacePoints> pointsOf(const FieldStages& field, PointsOfEach each) {
  if (each.size() == 1) return std::move(each.front());
  return std::make_unique<PointsOfTools>(std::move(each), field.tools.traits());
}

std::unique_ptr<PointScorer> freshScorer(const FieldStages& field, const ToolScoring& tool) {
  return std::make_unique<PointScorer>(*tool.points, tool.params, *field.backend, tool.reads);
}

/// The points of one tool, scored by `again`. @param tests  increased by those that it took
std::unique_ptr<const SurfacePoints> fromScratch(const FieldStages& field, std::size_t tool, PointScorer& again,
                                                 std::uint64_t& tests) {
  const ScoringSetup& setup = field.tools.at(tool).setup;
  again.grow();
  std::vector<std::uint32_t> ids(field.points.size());
  std::iota(ids.begin(), ids.end(), 0u);
  again.refreshWeights(ids);
  std::erase_if(ids, [&](std::uint32_t id) { return !again.confidentEnough(id); });
  again.refreshNeighbourhoods(ids);
  again.upload(ids);
  // Masks of a wide set are not read.
  const int masked = std::min(setup.tool().num_directions, kernels::kMostMaskedDirections);
  const kernels::DirectionMask all = kernels::allDirections(masked);
  std::vector<kernels::ScoreItem> items(ids.size());
  for (std::size_t n = 0; n < ids.size(); ++n) {
    items[n].id = ids[n];
    items[n].candidates = all;
  }
  ScoringTables tables = setup.tables(field.mirrors.grid());
  tables.rule.keep_best = false;
  for (const auto& result : again.score(items, tables)) tests += result.tests;
  const ScoredField scored = {
      again,        *field.backend, field.gate.origin_W(), setup.tool().rolls,        setup.tool().collision_limit,
      field.core(), false,          field.withheld(),      &field.points.attributes()};
  return scoredPoints(scored, PointStates::AsOfTheLastUpdate);
}

}  // namespace

std::uint32_t idAt(const FieldStages& field, const Eigen::Vector3d& p_W) {
  if (!p_W.allFinite()) return kNone;
  const Eigen::Vector3d p_L = p_W - field.gate.origin_W();
  if (!(p_L.lpNorm<Eigen::Infinity>() <= kFarthestVoxel * field.params.tsdf.voxel_size_m)) return kNone;
  return field.points.index().find(field.points.voxelOf(p_L));
}

void requireIds(const FieldStages& field, std::span<const std::uint32_t> ids) {
  std::vector<bool> met(field.points.size(), false);
  for (const std::uint32_t id : ids) {
    if (id >= met.size() || met[id])
      throw InvalidArgument("point.id", std::to_string(id),
                            id < met.size() ? "comes twice" : "is no point of the field",
                            "Give ids of its snapshot, each once");
    met[id] = true;
  }
}

ScoredField scoredFor(const FieldStages& field, std::size_t tool) {
  const ToolScoring& scoring = field.tools.at(tool);
  return {*scoring.scorer,
          *field.backend,
          field.gate.origin_W(),
          scoring.setup.tool().rolls,
          scoring.collisionLimit(),
          field.core(),
          field.labels.backlog > 0 || !field.labels.current,
          field.withheld(),
          &field.points.attributes()};
}

std::unique_ptr<const SurfacePoints> scoredPoints(const FieldStages& field) {
  PointsOfEach each;
  for (std::size_t k = 0; k < field.tools.size(); ++k) {
    each.push_back(scoredPoints(scoredFor(field, k), PointStates::AsOfTheLastUpdate));
  }
  return pointsOf(field, std::move(each));
}

std::unique_ptr<const SurfacePoints> scoredPoints(const FieldStages& field, std::span<const std::uint32_t> ids) {
  PointsOfEach each;
  for (std::size_t k = 0; k < field.tools.size(); ++k) each.push_back(scoredPoints(scoredFor(field, k), ids));
  return pointsOf(field, std::move(each));
}

SurfacePoint scoredPoint(const FieldStages& field, std::uint32_t id) {
  std::vector<SurfacePoint> each;
  for (std::size_t k = 0; k < field.tools.size(); ++k) each.push_back(scoredPoint(scoredFor(field, k), id));
  if (each.size() == 1) return each.front();  // of one tool alone, points do not say which
  return pointOfTools(each, field.tools.traits());
}

FieldSnapshot evaluatedFromScratch(const FieldStages& field, std::uint64_t* tests) {
  std::vector<std::unique_ptr<PointScorer>> scorers;  // the points refer to them
  PointsOfEach each;
  std::uint64_t all_tests = 0;
  for (std::size_t k = 0; k < field.tools.size(); ++k) {
    scorers.push_back(freshScorer(field, field.tools.at(k)));
    each.push_back(fromScratch(field, k, *scorers.back(), all_tests));
  }
  if (tests != nullptr) *tests = all_tests;
  return snapshotOf(*pointsOf(field, std::move(each)));
}

std::vector<AccessMap> accessMapsOf(const FieldStages& field, std::span<const std::uint32_t> ids, std::size_t tool) {
  const ToolScoring& scoring = field.tools.at(tool);
  const auto scorer = freshScorer(field, scoring);
  DirectionTrials trials(*scorer, scoring.setup, field.mirrors.grid(), ids);
  std::vector<std::vector<DirectionOutcome>> outcomes = trials.all(ids);
  std::vector<AccessMap> maps;
  for (std::size_t n = 0; n < ids.size(); ++n) {
    AccessMap& map = maps.emplace_back(
        AccessMap{scoredPoint(scoredFor(field, tool), ids[n]), scoring.collisionLimit(), std::move(outcomes[n])});
    const std::uint8_t why = ids[n] < field.withheld().size() ? field.withheld()[ids[n]] : 0;
    for (DirectionOutcome& outcome : map.directions) {
      if (why != 0 && outcome.reason == PointReason::None) outcome.reason = reasonOf(why);
    }
  }
  return maps;
}

std::vector<float> freeArcsOf(const FieldStages& field, std::span<const std::uint32_t> ids, std::size_t tool) {
  const ToolScoring& scoring = field.tools.at(tool);
  std::vector<std::uint16_t> best(field.points.size(), kNoDirection);
  const auto points = scoredPoints(scoredFor(field, tool), PointStates::AsOfTheLastUpdate);
  for (std::size_t n = 0; n < points->size(); ++n) {
    const SurfacePoint point = points->at(n);
    if (point.label == PointLabel::Accessible) best[point.id] = point.direction;
  }
  std::vector<std::uint32_t> reached;
  std::vector<std::uint16_t> from;
  std::vector<std::size_t> places;
  for (std::size_t n = 0; n < ids.size(); ++n) {
    if (best[ids[n]] == kNoDirection) continue;
    reached.push_back(ids[n]);
    from.push_back(best[ids[n]]);
    places.push_back(n);
  }
  const auto scorer = freshScorer(field, scoring);
  DirectionTrials trials(*scorer, scoring.setup, field.mirrors.grid(), reached);
  const std::vector<float> found = freeArcs_deg(trials, DirectionNeighbours(scoring.params.approach), reached, from);
  std::vector<float> arcs(ids.size(), -1);
  for (std::size_t k = 0; k < places.size(); ++k) arcs[places[k]] = found[k];
  return arcs;
}

FitInputs fitInputs(FieldStages& field) {
  field.steps.requireWhole();
  const ScoringTables tables = field.tools.front().setup.tables(field.mirrors.grid());
  return {&field.map,
          field.backend,
          tables.map,
          &field.tools,
          field.gate.origin_W(),
          &field.arena,
          field.views.revisionCounter()};
}

ViewInputs viewedParts(FieldStages& field) {
  field.steps.requireWhole();
  std::vector<ViewedTool> tools;
  const std::vector<ToolTraits> traits = field.tools.traits();
  for (const auto& tool : field.tools) {
    tools.push_back({*tool->scorer, tool->setup.hostApproach(), tool->collisionLimit(), isGrown(traits, tools.size())});
  }
  const ScoringTables tables = field.tools.front().setup.tables(field.mirrors.grid());
  const kernels::DistanceView distances = {field.mirrors.distanceGrid(), tables.map.inverse_voxel_size};
  return {field.map,       *field.backend,        tables.map,       distances,
          tables.approach, field.gate.origin_W(), std::move(tools), field.withheld()};
}

}  // namespace accessvdb::internal
