// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/tools/best_tool.h"

#include <algorithm>
#include <array>

#include "accessvdb/tool_spec.h"

namespace accessvdb::internal {
namespace {

/// How far a tool came: the larger, the closer. The two reasons of the corridor are one stage.
int stageOf(PointReason reason) {
  switch (reason) {
    case PointReason::Tool:
      return 3;
    case PointReason::Arm:
    case PointReason::Unknown:
      return 2;
    case PointReason::Unseen:
      return 1;
    default:
      return 0;
  }
}

/// Whether a came strictly closer than b. None of them reaches the point.
bool cameCloser(const ToolVerdict& a, const ToolVerdict& b) {
  const int stage_a = stageOf(a.reason), stage_b = stageOf(b.reason);
  if (stage_a != stage_b) return stage_a > stage_b;
  if (a.score == kNoScore || b.score == kNoScore) return a.score != kNoScore && b.score == kNoScore;
  return std::uint32_t{a.score} * b.collision_limit < std::uint32_t{b.score} * a.collision_limit;
}

/// What it would say is not known.
bool isOpen(const ToolVerdict& tool) {
  return tool.label == PointLabel::Unscored && tool.reason == PointReason::Confidence;
}

}  // namespace

std::vector<ToolTraits> toolTraits(const std::vector<ToolSpec>& tools,
                                   const std::vector<std::uint16_t>& collision_limits, const FieldParams& resolved) {
  std::vector<ToolTraits> traits;
  std::uint8_t family = 0;
  for (std::size_t k = 0; k < tools.size(); ++k) {
    const double margin_m = tools[k].tool.margin_m();
    if (k > 0 && margin_m == 0) ++family;
    traits.push_back(
        {collision_limits[k], family, static_cast<float>(margin_m), ProbabilityModel(resolved, collision_limits[k])});
  }
  return traits;
}

bool isGrown(std::span<const ToolTraits> traits, std::size_t k) {
  return k > 0 && traits[k].family == traits[k - 1].family;
}

std::size_t bestTool(std::span<const ToolVerdict> tools) {
  std::size_t closest = 0;
  for (std::size_t k = 0; k < tools.size(); ++k) {
    if (tools[k].grown) continue;
    if (tools[k].label == PointLabel::Accessible) return k;
    if (isOpen(tools[closest])) continue;  // the first of those that may yet reach it
    if (isOpen(tools[k]) || cameCloser(tools[k], tools[closest])) closest = k;
  }
  return closest;
}

SurfacePoint pointOfTools(std::span<const SurfacePoint> tools, std::span<const ToolTraits> traits) {
  std::array<ToolVerdict, kMostTools> verdicts;
  std::uint32_t reach = 0;
  for (std::size_t k = 0; k < tools.size(); ++k) {
    verdicts[k] = {tools[k].label, tools[k].reason, tools[k].score, traits[k].collision_limit, isGrown(traits, k)};
    if (tools[k].label == PointLabel::Accessible) reach |= std::uint32_t{1} << k;
  }
  const std::size_t best = bestTool(std::span(verdicts).first(tools.size()));
  SurfacePoint point = tools[best];
  point.tool = static_cast<std::uint8_t>(best);
  point.tools = reach;
  if (traits.back().family + 1U == traits.size()) return point;  // each is a family of its own: there are no margins
  for (std::size_t k = best; k < traits.size() && traits[k].family == traits[best].family; ++k)
    if ((reach >> k & 1) != 0) point.margin_m = std::max(point.margin_m, traits[k].margin_m);
  if (point.margin_m >= 0) point.access_probability = traits[best].probability.of(point);
  return point;
}

SurfacePoint PointsOfTools::at(std::size_t index) const {
  std::array<SurfacePoint, kMostTools> points;
  for (std::size_t k = 0; k < tools_.size(); ++k) points[k] = tools_[k]->at(index);
  return pointOfTools(std::span(points).first(tools_.size()), traits_);
}

}  // namespace accessvdb::internal
