// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/snapshot_builder.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <numeric>
#include <vector>

namespace accessvdb::internal {
namespace {

/// A slice of the state arrays on the host.
struct HostState {
  std::uint32_t first = 0, size = 0;
  std::vector<std::uint16_t> score, direction;
  std::vector<float> stability, normal_L;
  std::vector<PointLabel> label;
  std::vector<PointReason> reason;

  HostState() = default;  // for no points
  HostState(const PointScorer& scorer, kernels::Backend& backend, std::uint32_t begin, std::uint32_t end)
      : first(begin), size(std::min(end, scorer.device().size()) - std::min(begin, scorer.device().size())) {
    const kernels::PointStateView view = scorer.device().view();
    const auto fetch = [&](auto& to, const auto* from) {
      to.resize(size);
      if (size > 0) backend.download(to.data(), from + begin, size * sizeof(to[0]));
    };
    fetch(score, view.score);
    fetch(direction, view.direction);
    fetch(stability, view.stability);
    normal_L.resize(std::size_t{3} * size);
    if (size > 0)
      backend.download(normal_L.data(), view.normal_L + std::size_t{3} * begin, normal_L.size() * sizeof(float));
    fetch(label, view.label);
    fetch(reason, view.reason);
  }
};

SurfacePoint build(const PointScorer& scorer, const HostState& state, const Eigen::Vector3d& origin_W, std::uint32_t id,
                   std::uint16_t weight) {
  SurfacePoint point;
  point.id = id;
  point.position_W = origin_W + scorer.points().first_L(id).cast<double>();
  point.weight = weight;
  point.confidence = kernels::confidenceOf(weight, static_cast<float>(scorer.params().scoring.confidence_half_weight));
  if (id - state.first >= state.size) return point;  // added after the last update
  const std::uint32_t n = id - state.first;
  point.normal_W = Eigen::Vector3f(state.normal_L.data() + std::size_t{3} * n);
  point.score = state.score[n];
  point.direction = state.direction[n];
  point.stability = state.stability[n];
  point.label = state.label[n];
  point.reason = state.reason[n];
  if (point.direction != kNoDirection) {
    const double yaw = 2 * 3.141592653589793 * point.direction / scorer.params().approach.num_directions;
    point.yaw_rad = static_cast<float>(yaw);
    point.direction_W = {static_cast<float>(std::cos(yaw)), static_cast<float>(std::sin(yaw)), 0.0f};
  }
  point.confident = point.label == PointLabel::Accessible &&
                    point.confidence * point.stability > static_cast<float>(scorer.params().update.stability_min);
  return point;
}

FieldSnapshot buildAll(const PointScorer& scorer, const HostState& state, const Eigen::Vector3d& origin_W) {
  FieldSnapshot snapshot;
  snapshot.origin_W = origin_W;
  snapshot.voxel_size_m = scorer.params().tsdf.voxel_size_m;
  const std::uint32_t count = scorer.points().size();
  std::vector<std::uint32_t> ids(count);
  std::iota(ids.begin(), ids.end(), 0u);
  std::vector<std::uint16_t> weights(count);
  scorer.reads().weights(ids, weights);
  snapshot.points.resize(count);
  tbb::parallel_for(tbb::blocked_range<std::uint32_t>(0, count, 1024), [&](const auto& range) {
    for (std::uint32_t id = range.begin(); id != range.end(); ++id) {
      snapshot.points[id] = build(scorer, state, origin_W, id, weights[id]);
    }
  });
  return snapshot;
}

}  // namespace

FieldSnapshot makeSnapshot(const PointScorer& scorer, kernels::Backend& backend, const Eigen::Vector3d& origin_W) {
  return buildAll(scorer, HostState(scorer, backend, 0, scorer.points().size()), origin_W);
}

FieldSnapshot makeUnscoredSnapshot(const PointScorer& scorer, const Eigen::Vector3d& origin_W) {
  return buildAll(scorer, HostState(), origin_W);
}

SurfacePoint makePoint(const PointScorer& scorer, kernels::Backend& backend, const Eigen::Vector3d& origin_W,
                       std::uint32_t id) {
  std::uint16_t weight = 0;
  scorer.reads().weights({&id, 1}, {&weight, 1});
  return build(scorer, HostState(scorer, backend, id, id + 1), origin_W, id, weight);
}

}  // namespace accessvdb::internal
