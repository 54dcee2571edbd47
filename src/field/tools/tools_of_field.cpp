// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/tools/tools_of_field.h"

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

ToolsOfField::ToolsOfField(std::vector<ToolSpec> specs, const FieldParams& resolved, const Shared& shared,
                           const TableProgress& progress)
    : shared_(shared), specs_(std::move(specs)) {
  for (std::size_t n = 0; n < specs_.size(); ++n) {
    const FieldParams params = n == 0 ? resolved : resolvedFor(specs_[n], resolved);
    auto tables = shared.tables != nullptr
                      ? shared.tables->tablesOf(n, specs_[n].tool, params, shared.backend, progress)
                      : std::make_shared<const ScoringSetup>(specs_[n].tool, params, shared.backend, progress);
    ToolScoring& tool = *tools_.emplace_back(std::make_unique<ToolScoring>(params, std::move(tables)));
    while (tool.views_of < n && !sameDirections(tools_[tool.views_of]->params, params)) ++tool.views_of;
    if (tool.views_of == n) {
      tool.own_points = std::make_unique<PointStore>(params, tool.setup.directions());
    }
    tool.points = tools_[tool.views_of]->own_points.get();
    tool.reads = makeMapReads(shared.map, *tool.points, params.scoring.neighbourhood_weight, shared.core);
    if (shared.lead != nullptr) {
      tool.reads = readsOfLead(tool.reads, *tool.points, params.scoring.neighbourhood_weight, *shared.lead);
    }
    if (shared.gone != nullptr) tool.reads = readsWithGone(tool.reads, *tool.points, *shared.gone);
  }
  forget();
}

const ToolScoring& ToolsOfField::at(std::size_t k) const {
  if (k < size()) return *tools_[k];
  throw InvalidArgument("tool.index", std::to_string(k),
                        "is not one of the field's " + std::to_string(size()) + " tools", "Count them from 0");
}

WindowMargins ToolsOfField::margins() const {
  WindowMargins margins = windowMargins(front().setup.tool(), front().params);
  for (const auto& tool : tools_) margins = unionOf(margins, windowMargins(tool->setup.tool(), tool->params));
  return margins;
}

std::vector<std::uint16_t> ToolsOfField::collisionLimits() const {
  std::vector<std::uint16_t> limits;
  for (const auto& tool : tools_) limits.push_back(tool->collisionLimit());
  return limits;
}

void ToolsOfField::forget() {
  for (const auto& tool : tools_) tool->scorer.reset();  // never two of them at once
  for (const auto& tool : tools_) {
    tool->scorer = std::make_unique<PointScorer>(*tool->points, tool->params, shared_.backend, tool->reads);
  }
}

std::unique_ptr<UpdateScheduler> ToolsOfField::makeScheduler() const {
  std::vector<ScheduledTool> scheduled;
  for (const auto& tool : tools_) {
    ScheduledTool& added = scheduled.emplace_back(tool->setup.scheduledFor(*tool->scorer));
    added.views_of = tool->views_of;
    if (tool != tools_.front()) added.adds_returns = tool->own_points.get();
  }
  return internal::makeScheduler(scheduled);
}

std::vector<PointStore*> ToolsOfField::stores() const {
  std::vector<PointStore*> stores;
  for (const auto& tool : tools_) {
    if (tool->own_points) stores.push_back(tool->own_points.get());
  }
  return stores;
}

std::vector<SavedTool> ToolsOfField::saved() const {
  std::vector<SavedTool> saved;
  if (size() == 1) return saved;
  for (std::size_t k = 0; k < size(); ++k) {
    const ToolSpec& spec = specs_[k];
    const bool own_views = k > 0 && tools_[k]->own_points != nullptr;
    const int words = own_views ? tools_[k]->points->directionWords() : 0;
    saved.push_back({spec.name, spec.tool.sha256(), spec.orientations.text(), spec.rolls, spec.max_collisions,
                     static_cast<std::uint32_t>(words)});
  }
  return saved;
}

std::uint64_t ToolsOfField::hostBytes() const {
  std::uint64_t bytes = 0;
  for (const auto& tool : tools_) {
    if (shared_.tables == nullptr) bytes += tool->setup.hostBytes();
    if (tool->scorer) bytes += tool->scorer->hostBytes();
    if (tool->own_points) bytes += tool->own_points->bytes();
  }
  return bytes;
}

std::uint64_t ToolsOfField::deviceBytes() const {
  std::uint64_t bytes = 0;
  for (const auto& tool : tools_) {
    if (shared_.tables == nullptr) bytes += tool->setup.deviceBytes();
    if (tool->scorer) bytes += tool->scorer->device().bytes();
  }
  return bytes;
}

}  // namespace accessvdb::internal
