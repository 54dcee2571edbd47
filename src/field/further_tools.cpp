// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/further_tools.h"

#include <algorithm>
#include <span>
#include <utility>

#include "accessvdb/error.h"
#include "field/point_weights.h"
#include "tool/tool_rolls.h"
#include "update/make_scheduler.h"

namespace accessvdb::internal {
namespace {

/// Whether two tools are tried in the same directions, so that they are seen from the same sides.
bool sameDirections(const FieldParams& a, const FieldParams& b) {
  return a.approach.num_directions == b.approach.num_directions &&
         a.approach.orientations.text() == b.approach.orientations.text();
}

/// Tells all tools' schedulers of what happens, and runs them one after the other.
class SchedulerOfTools final : public UpdateScheduler {
 public:
  /// Of one tool, or on a device of all that read the same points.
  struct Part {
    std::unique_ptr<UpdateScheduler> scheduler;
    const ScoringSetup& setup;
    std::size_t views_of;  ///< the part that was told first of the points it reads
    PointStore* points;    ///< of its own; null: another's, or the field's
    const TouchedPoints* touched = nullptr;
  };
  explicit SchedulerOfTools(std::vector<Part> parts) : parts_(std::move(parts)) {}

  [[nodiscard]] Needs needs() const override {
    Needs all;
    for (const Part& part : parts_) {
      const Needs needs = part.scheduler->needs();
      all.news = all.news || needs.news;
      all.changes = all.changes || needs.changes;
      all.distances = all.distances || needs.distances;
    }
    return all;
  }

  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L) override {
    for (Part& part : parts_) {
      if (part.points != nullptr) {
        part.points->describeTouched(part.scheduler->needs().news);
        part.touched = &part.points->addReturns(p_L, q_L);
      } else {
        part.touched = part.views_of == 0 ? &touched : parts_[part.views_of].touched;
      }
      part.scheduler->noteReturns(*part.touched, p_L, q_L);
    }
  }
  void noteChange(std::size_t number, const LeafChange& change) override {
    for (const Part& part : parts_) part.scheduler->noteChange(number, change);
  }
  void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                   const MapChanges& changes) override {
    for (const Part& part : parts_) part.scheduler->noteChanges(p_L, q_L, changes);
  }
  void noteChangesAlone(std::span<const std::span<const LeafChange>> facts) override {
    for (const Part& part : parts_) part.scheduler->noteChangesAlone(facts);
  }
  void noteRestored() override {
    for (const Part& part : parts_) part.scheduler->noteRestored();
  }

  void prepare(const ScoringTables& tables) override {
    for (const Part& part : parts_) part.scheduler->prepare(part.setup.tables(tables.map.grid));
  }

  UpdateStats update(const ScoringTables& tables) override {
    UpdateStats all;
    for (const Part& part : parts_) {
      const bool last = &part == &parts_.back();
      part.scheduler->whenMapIsFree(last ? std::function<void()>([this] { mapIsFree(); }) : nullptr);
      const UpdateStats stats = part.scheduler->update(part.setup.tables(tables.map.grid));
      all.dirty_points += stats.dirty_points;
      all.scored_points += stats.scored_points;
      all.direction_tests += stats.direction_tests;
      all.backlog += stats.backlog;
      all.label_changes += stats.label_changes;
      all.moved_points += stats.moved_points;
      all.score_ms += stats.score_ms;
    }
    return all;
  }

  [[nodiscard]] std::uint64_t bytes() const override {
    std::uint64_t bytes = 0;
    for (const Part& part : parts_) bytes += part.scheduler->bytes();
    return bytes;
  }
  [[nodiscard]] std::uint64_t deviceBytes() const override {
    std::uint64_t bytes = 0;
    for (const Part& part : parts_) bytes += part.scheduler->deviceBytes();
    return bytes;
  }

 private:
  std::vector<Part> parts_;
};

}  // namespace

void requireManyTools(const std::vector<ToolSpec>& tools, const FieldParams& resolved) {
  const bool paper =
      resolved.update.policy == UpdatePolicy::Paper || resolved.approach.coarse_to_fine || resolved.approach.viewpoints;
  if (tools.size() == 1) return;
  if (paper) {
    throw InvalidArgument("tool.policy", std::to_string(tools.size()) + " tools",
                          "the paper's policy, its coarse pass and its viewpoints support only one tool",
                          "Use the exact policy and the product profile, or one tool");
  }
  int directions = 0;
  for (const ToolSpec& tool : tools) directions += toolParams(tool, resolved).approach.directionCount();
  if (directions >= kNoDirection) {
    throw ResourceLimit("orientations.count", std::to_string(tools.size()) + " tools",
                        "have " + std::to_string(directions) + " orientations together; at most " +
                            std::to_string(kNoDirection - 1) + " can be handled",
                        "Use a larger STEP, or fewer tools");
  }
}

FieldParams resolvedFor(const ToolSpec& tool, const FieldParams& params) {
  FieldParams resolved = toolParams(tool, params).resolved();
  resolved.approach.rolls = toolRolls(tool.tool, resolved.approach).count;
  return resolved;
}

FurtherTools::FurtherTools(const std::vector<ToolSpec>& tools, const FieldParams& resolved, const Shared& shared,
                           const TableProgress& progress)
    : shared_(shared) {
  for (std::size_t n = 1; n < tools.size(); ++n) {
    const FieldParams params = resolvedFor(tools[n], resolved);
    Tool& tool = *tools_.emplace_back(std::make_unique<Tool>(tools[n], params, shared.backend, progress));
    while (tool.views_of < n && !sameDirections(toolParams(tools[tool.views_of], resolved), params)) ++tool.views_of;
    if (tool.views_of == n) {
      tool.own_points = std::make_unique<PointStore>(params, tool.setup.directions_xy(), tool.setup.axes_xyz());
      tool.points = tool.own_points.get();
    } else {
      tool.points = tool.views_of == 0 ? &shared.points : tools_[tool.views_of - 1]->points;
    }
    tool.reads = makeMapReads(shared.map, *tool.points, params.scoring.neighbourhood_weight, shared.core);
    if (shared.gone != nullptr) tool.reads = readsWithGone(tool.reads, *tool.points, *shared.gone);
    makeScorer(tool);
  }
}

void FurtherTools::makeScorer(Tool& tool) const {
  tool.scorer = std::make_unique<PointScorer>(*tool.points, tool.params, shared_.backend, tool.reads);
}

void FurtherTools::forget() {
  for (const auto& tool : tools_) makeScorer(*tool);
}

std::unique_ptr<UpdateScheduler> FurtherTools::makeSchedulers(PointScorer& scorer, const ScoringSetup& setup) {
  struct OfTool {
    PointScorer& scorer;
    const ScoringSetup& setup;
    std::size_t views_of;
    PointStore* own_points;
    [[nodiscard]] HostTables host() const { return {setup.hostTool(), setup.hostApproach()}; }
  };
  std::vector<OfTool> all = {{scorer, setup, 0, nullptr}};
  if (tools_.empty()) return makeScheduler(scorer, all.front().host());
  for (const auto& tool : tools_) {
    all.push_back({*tool->scorer, tool->setup, tool->views_of, tool->own_points.get()});
  }
  std::vector<SchedulerOfTools::Part> parts;
  for (std::size_t first = 0; first < all.size(); ++first) {
    const OfTool& leader = all[first];
    if (leader.views_of != first) continue;  // it reads the points of an earlier tool
    const std::size_t store = parts.size();
    std::vector<FurtherTool> further;
    std::vector<const OfTool*> others;
    for (const OfTool& tool : std::span(all).subspan(first + 1)) {
      if (tool.views_of != first) continue;
      others.push_back(&tool);
      further.push_back(
          {tool.scorer, tool.host(), [&of_tool = tool.setup](const auto* mirror) { return of_tool.tables(mirror); }});
    }
    if (auto on_device = makeExactOnDevice(leader.scorer, leader.host(), further)) {
      parts.push_back({std::move(on_device), leader.setup, store, leader.own_points});
      continue;
    }
    const auto changes = std::make_shared<ScanChanges>(leader.scorer);
    parts.push_back({makeExactOnHost(leader.scorer, leader.host(), changes), leader.setup, store, leader.own_points});
    for (const OfTool* tool : others) {
      parts.push_back({makeExactOnHost(tool->scorer, tool->host(), changes), tool->setup, store, nullptr});
    }
  }
  return std::make_unique<SchedulerOfTools>(std::move(parts));
}

std::vector<PointStore*> FurtherTools::ownStores() const {
  std::vector<PointStore*> stores;
  for (const auto& tool : tools_) {
    if (tool->own_points) stores.push_back(tool->own_points.get());
  }
  return stores;
}

std::vector<ScoredField> FurtherTools::ofEach(const ScoredField& first) const {
  std::vector<ScoredField> fields = {first};
  for (const auto& tool : tools_)
    fields.push_back({*tool->scorer, first.backend, first.origin_W, tool->setup.tool().rolls, first.core,
                      first.some_wait, first.withheld});
  return fields;
}

std::vector<SavedTool> FurtherTools::saved(const std::vector<ToolSpec>& tools) const {
  std::vector<SavedTool> saved;
  for (std::size_t k = 0; k < tools.size() && !tools_.empty(); ++k) {
    const ToolSpec& spec = tools[k];
    const bool own_views = k > 0 && tools_[k - 1]->own_points != nullptr;
    const int words = own_views ? (tools_[k - 1]->points->numDirections() + 63) / 64 : 0;
    saved.push_back({spec.name, spec.tool.sha256(), spec.orientations.text(), spec.rolls, spec.max_collisions,
                     static_cast<std::uint32_t>(words)});
  }
  return saved;
}

std::uint64_t FurtherTools::hostBytes() const {
  std::uint64_t bytes = 0;
  for (const auto& tool : tools_) {
    bytes += tool->setup.hostBytes() + tool->scorer->hostBytes() + (tool->own_points ? tool->own_points->bytes() : 0);
  }
  return bytes;
}

std::uint64_t FurtherTools::deviceBytes() const {
  std::uint64_t bytes = 0;
  for (const auto& tool : tools_) bytes += tool->setup.deviceBytes() + tool->scorer->device().bytes();
  return bytes;
}

}  // namespace accessvdb::internal
