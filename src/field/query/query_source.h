// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What batch queries read: the live map, the points, and their state on the host.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "accessvdb/batch_query.h"
#include "accessvdb/params.h"
#include "field/query/query_index.h"
#include "field/query/withheld.h"
#include "launch/backend.h"
#include "tsdf/packed_map.h"

namespace accessvdb::internal {

/// State of the points in host memory: the backend's own arrays if it works there and all of it may be told, else
/// copies.
struct HostPointState {
  const std::uint16_t* score = nullptr;
  const std::uint16_t* direction = nullptr;
  const PointLabel* label = nullptr;
  const PointReason* reason = nullptr;
  std::uint32_t size = 0;  ///< points of the last update; later ones have no state
  std::vector<std::uint16_t> score_copy, direction_copy;
  std::vector<PointLabel> label_copy;
  std::vector<PointReason> reason_copy;

  /// @param on_host  the view's arrays can be read here
  HostPointState(kernels::Backend& backend, const kernels::PointStateView& view, std::uint32_t count, bool on_host,
                 const Withheld& withheld);
};

/// Everything that a query reads; it all stays in place until the field next changes.
struct QuerySource {
  const PackedMap* map = nullptr;
  const QueryIndex* index = nullptr;
  std::shared_ptr<const HostPointState> state;
  std::vector<Eigen::Vector3f> directions;  ///< [D] as SurfacePoint::direction_W
  Eigen::Vector3d origin_W = {0, 0, 0};
  float voxel_size_m = 0, inverse_voxel_size = 0;
};

/// Answers points_W[n] into answers[n], on the calling thread.
void answerPoints(const QuerySource& source, std::span<const Eigen::Vector3d> points_W, std::span<PointAnswer> answers);
CapsuleAnswer answerCapsule(const QuerySource& source, const CapsuleQuery& query);

/// Unit vectors of the directions, as SurfacePoint::direction_W.
std::vector<Eigen::Vector3f> directionVectors(const ApproachParams& resolved);

}  // namespace accessvdb::internal
