// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which of several tools stands for a point, and the points of a field of several tools.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "accessvdb/surface_points.h"
#include "accessvdb/tool_spec.h"
#include "field/query/access_probability.h"
#include "field/query/query_source.h"
#include "field/query/scored_points.h"

namespace accessvdb::internal {

/// What a tool's points are to be told apart by.
struct ToolTraits {
  std::uint16_t collision_limit = 1;  ///< [n_c]
  /// The tools of a family are the same tool with different margins, one behind the other.
  std::uint8_t family = 0;
  float margin_m = 0;
  ProbabilityModel probability = {};
};
/// @param tools, collision_limits  of each tool  @param resolved  of the field
[[nodiscard]] std::vector<ToolTraits> toolTraits(const std::vector<ToolSpec>& tools,
                                                 const std::vector<std::uint16_t>& collision_limits,
                                                 const FieldParams& resolved);

/// Whether it is not the first of its family.
[[nodiscard]] bool isGrown(std::span<const ToolTraits> traits, std::size_t k);

/// What decides between tools at one point.
struct ToolVerdict {
  PointLabel label = PointLabel::Unscored;
  PointReason reason = PointReason::Confidence;
  std::uint16_t score = kNoScore;
  std::uint16_t collision_limit = 1;  ///< [n_c] of the tool
  bool grown = false;                 ///< by a margin, behind the tool without one, which stands for both
};

/// Of the tools that are not grown, the first that reaches the point. If none does, the first for which it is unscored
/// for want of confidence, as where it waits: that tool may reach it. Else the one that came closest: by the stage at
/// which it failed, then by its collisions as a multiple of its limit, then by the order of the tools.
[[nodiscard]] std::size_t bestTool(std::span<const ToolVerdict> tools);

/// The points of one tool each, as those of the best tool.
class PointsOfTools final : public SurfacePoints {
 public:
  /// @param tools  of the same points; at least one  @param traits  of each
  PointsOfTools(std::vector<std::unique_ptr<const SurfacePoints>> tools, std::vector<ToolTraits> traits)
      : tools_(std::move(tools)), traits_(std::move(traits)) {}

  [[nodiscard]] std::size_t size() const override { return tools_.front()->size(); }
  [[nodiscard]] SurfacePoint at(std::size_t index) const override;
  [[nodiscard]] Eigen::Vector3d position_W(std::size_t index) const override {
    return tools_.front()->position_W(index);
  }
  [[nodiscard]] Eigen::Vector3d origin_W() const override { return tools_.front()->origin_W(); }
  [[nodiscard]] double voxel_size_m() const override { return tools_.front()->voxel_size_m(); }
  [[nodiscard]] bool hasMargins() const override { return traits_.back().family + 1U < traits_.size(); }
  [[nodiscard]] bool hasProbability() const override { return tools_.front()->hasProbability(); }
  [[nodiscard]] std::vector<std::string> attributeNames() const override { return tools_.front()->attributeNames(); }
  [[nodiscard]] std::int32_t attribute(std::size_t index, std::size_t column) const override {
    return tools_.front()->attribute(index, column);
  }
  [[nodiscard]] std::optional<FirstReturn> firstReturn(std::size_t index) const override {
    return tools_.front()->firstReturn(index);
  }

 private:
  std::vector<std::unique_ptr<const SurfacePoints>> tools_;
  std::vector<ToolTraits> traits_;
};

/// The point of the best tool. @param tools  the same point for each tool  @param traits  of each
[[nodiscard]] SurfacePoint pointOfTools(std::span<const SurfacePoint> tools, std::span<const ToolTraits> traits);

}  // namespace accessvdb::internal
