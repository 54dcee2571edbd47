// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which of several tools stands for a point, and the points of a field of several tools.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "accessvdb/surface_points.h"
#include "field/query/query_source.h"
#include "field/query/scored_points.h"

namespace accessvdb::internal {

/// What decides between tools at one point.
struct ToolVerdict {
  PointLabel label = PointLabel::Unscored;
  PointReason reason = PointReason::Confidence;
  std::uint16_t score = kNoScore;
  std::uint16_t collision_limit = 1;  ///< [n_c] of the tool
};

/// The first tool that reaches the point. If none does, the first for which it is unscored for want of confidence, as
/// where it waits: that tool may reach it. Else the one that came closest: by the stage at which it failed, then by its
/// collisions as a multiple of its limit, then by the order of the tools.
[[nodiscard]] std::size_t bestTool(std::span<const ToolVerdict> tools);

/// The points of one tool each, as those of the best tool.
class PointsOfTools final : public SurfacePoints {
 public:
  /// @param tools  of the same points; at least one  @param collision_limits  of each
  PointsOfTools(std::vector<std::unique_ptr<const SurfacePoints>> tools, std::vector<std::uint16_t> collision_limits)
      : tools_(std::move(tools)), limits_(std::move(collision_limits)) {}

  [[nodiscard]] std::size_t size() const override { return tools_.front()->size(); }
  [[nodiscard]] SurfacePoint at(std::size_t index) const override;
  [[nodiscard]] Eigen::Vector3d position_W(std::size_t index) const override {
    return tools_.front()->position_W(index);
  }
  [[nodiscard]] Eigen::Vector3d origin_W() const override { return tools_.front()->origin_W(); }
  [[nodiscard]] double voxel_size_m() const override { return tools_.front()->voxel_size_m(); }
  [[nodiscard]] std::vector<std::string> attributeNames() const override { return tools_.front()->attributeNames(); }
  [[nodiscard]] std::int32_t attribute(std::size_t index, std::size_t column) const override {
    return tools_.front()->attribute(index, column);
  }
  [[nodiscard]] std::optional<FirstReturn> firstReturn(std::size_t index) const override {
    return tools_.front()->firstReturn(index);
  }

 private:
  std::vector<std::unique_ptr<const SurfacePoints>> tools_;
  std::vector<std::uint16_t> limits_;
};

/// The point of the best tool. @param tools  the same point for each tool  @param collision_limits  of each
[[nodiscard]] SurfacePoint pointOfTools(std::span<const SurfacePoint> tools,
                                        std::span<const std::uint16_t> collision_limits);

}  // namespace accessvdb::internal
