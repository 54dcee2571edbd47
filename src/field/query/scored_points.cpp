// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/scored_points.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <numeric>
#include <span>
#include <utility>

#include "accessvdb/survey_frame.h"
#include "field/left_out_points.h"
#include "field/point_weights.h"
#include "field/query/access_probability.h"
#include "field/query/withheld.h"
#include "field/tools/tool_heading.h"

namespace accessvdb::internal {
namespace {

/// At most, so that blocks of more than that have half of it or more.
constexpr std::uint32_t kWeightsPerBlock = 2 * kWeightsOnHost;

/// The state of some points on the host, in their order. Those beyond its end were added after the last update.
struct HostState {
  std::uint32_t size = 0;
  std::vector<std::uint16_t> score, direction;
  std::vector<float> stability, normal_L;
  std::vector<PointLabel> label;
  std::vector<PointReason> reason;
  std::vector<std::uint8_t> roll;  ///< only if the tool rolls

  HostState() = default;  // for no points
  HostState(const PointScorer& scorer, kernels::Backend& backend, std::uint32_t begin, std::uint32_t end)
      : size(std::min(end, scorer.device().size()) - std::min(begin, scorer.device().size())) {
    const kernels::PointStateView view = scorer.device().view();
    const auto fetch = [&](auto& to, const auto* from, std::size_t values_per_point) {
      to.resize(values_per_point * size);
      if (size > 0) backend.download(to.data(), from + values_per_point * begin, to.size() * sizeof(to[0]));
    };
    fetch(score, view.score, 1);
    fetch(direction, view.direction, 1);
    fetch(stability, view.stability, 1);
    fetch(normal_L, view.normal_L, 3);
    fetch(label, view.label, 1);
    fetch(reason, view.reason, 1);
    ToldPoints{label, reason, score, direction, begin}.withhold({{}, scorer.waiting()});
    if (view.roll != nullptr) fetch(roll, view.roll, 1);
  }
  /// @param ids  ascending
  HostState(const PointScorer& scorer, kernels::Backend& backend, std::span<const std::uint32_t> ids) {
    const auto known = std::ranges::lower_bound(ids, scorer.device().size());
    size = static_cast<std::uint32_t>(known - ids.begin());
    std::vector<kernels::StateRow> rows(size);
    const kernels::PointStateView view = scorer.device().view();
    backend.readPoints(view, ids.data(), rows.data(), size);
    score.resize(size);
    direction.resize(size);
    stability.resize(size);
    normal_L.resize(std::size_t{3} * size);
    label.resize(size);
    reason.resize(size);
    if (view.roll != nullptr) roll.resize(size);
    tbb::parallel_for(std::uint32_t{0}, size, [&](std::uint32_t n) {
      const kernels::StateRow& row = rows[n];
      score[n] = row.score;
      direction[n] = row.direction;
      stability[n] = row.stability;
      std::copy_n(row.normal_L, 3, normal_L.begin() + std::ptrdiff_t{3} * n);
      label[n] = row.label;
      reason[n] = row.reason;
      if (view.roll != nullptr) roll[n] = row.roll;
      ToldPoints{{&label[n], 1}, {&reason[n], 1}, {&score[n], 1}, {&direction[n], 1}, ids[n]}.withhold(
          {{}, scorer.waiting()});
    });
  }
};

/// Some points, by id.
class ScoredPoints final : public SurfacePoints {
 public:
  /// Those whose ids are first, first + 1 ...
  ScoredPoints(const ScoredField& field, HostState state, std::uint32_t first, std::uint32_t count)
      : ScoredPoints(field, std::move(state), first, count, {}) {}
  /// @param ids  ascending
  ScoredPoints(const ScoredField& field, HostState state, std::span<const std::uint32_t> ids)
      : ScoredPoints(field, std::move(state), 0, static_cast<std::uint32_t>(ids.size()), {ids.begin(), ids.end()}) {}

  [[nodiscard]] std::size_t size() const override { return weights_.size(); }
  [[nodiscard]] SurfacePoint at(std::size_t index) const override;
  [[nodiscard]] Eigen::Vector3d position_W(std::size_t index) const override {
    return origin_W_ + scorer_.points().first_L(idOf(index)).cast<double>();
  }
  [[nodiscard]] Eigen::Vector3d origin_W() const override { return origin_W_; }
  [[nodiscard]] double voxel_size_m() const override { return scorer_.params().tsdf.voxel_size_m; }
  [[nodiscard]] bool hasProbability() const override { return scorer_.params().update.policy == UpdatePolicy::Exact; }
  [[nodiscard]] std::vector<std::string> attributeNames() const override {
    std::vector<std::string> names;
    if (attributes_ == nullptr) return names;
    for (const CarriedAttribute& attribute : attributes_->carried()) {
      if (!isHidden(attribute)) names.push_back(attribute.name);  // the others come last
    }
    return names;
  }
  [[nodiscard]] std::optional<FirstReturn> firstReturn(std::size_t index) const override {
    const std::size_t columns = attributes_ == nullptr ? 0 : attributes_->columns();
    if (columns < 3 || attributes_->carried()[columns - 1].name != kFirstReturnNames[2]) return std::nullopt;
    const std::uint32_t id = idOf(index);
    const auto half = [&](std::size_t c) {
      return std::uint64_t{std::bit_cast<std::uint32_t>(attributes_->value(id, columns - 3 + c))};
    };
    const bool timed = half(0) != half(1) || attributes_->value(id, columns - 2) != kNoAttribute;
    const std::int32_t point_class = attributes_->value(id, columns - 1);
    const bool known = point_class >= 0 && point_class <= 255;
    return FirstReturn{timed ? std::bit_cast<double>(half(0) | half(1) << 32) : 0.0,
                       static_cast<std::uint8_t>(known ? point_class : 0)};
  }
  [[nodiscard]] std::int32_t attribute(std::size_t index, std::size_t column) const override {
    return attributes_->value(idOf(index), column);
  }

 private:
  ScoredPoints(const ScoredField& field, HostState state, std::uint32_t first, std::uint32_t count,
               std::vector<std::uint32_t> ids)
      : scorer_(field.scorer),
        origin_W_(field.origin_W),
        some_wait_(field.some_wait),
        withheld_(field.withheld),
        attributes_(field.attributes),
        state_(std::move(state)),
        first_(first),
        ids_(std::move(ids)),
        weights_(count),
        rolls_(field.rolls.count),
        probability_(scorer_.params(), field.collision_limit),
        headings_(toolHeadings(scorer_.params().approach, field.rolls)) {
    if (!ids_.empty()) {
      scorer_.reads().weights(ids_, weights_);
      return;
    }
    const std::uint32_t blocks = count / kWeightsPerBlock + 1, most = count / blocks + 1;
    std::vector<std::uint32_t> block;
    for (std::uint32_t begin = 0; begin < count; begin += most) {
      block.resize(std::min(count - begin, most));
      std::iota(block.begin(), block.end(), first + begin);
      scorer_.reads().weights(block, std::span(weights_).subspan(begin, block.size()));
    }
  }

  [[nodiscard]] std::uint32_t idOf(std::size_t index) const {
    return ids_.empty() ? first_ + static_cast<std::uint32_t>(index) : ids_[index];
  }

  const PointScorer& scorer_;
  Eigen::Vector3d origin_W_;
  bool some_wait_;
  std::span<const std::uint8_t> withheld_;
  const PointAttributes* attributes_;
  HostState state_;
  std::uint32_t first_;
  std::vector<std::uint32_t> ids_;  ///< empty: from first_ on
  std::vector<std::uint16_t> weights_;
  int rolls_;
  ProbabilityModel probability_;
  std::vector<ToolHeading> headings_;  ///< per direction and roll
};

SurfacePoint ScoredPoints::at(std::size_t index) const {
  SurfacePoint point;
  point.id = idOf(index);
  point.position_W = position_W(index);
  point.weight = weights_[index];
  point.confidence =
      kernels::confidenceOf(weights_[index], static_cast<float>(scorer_.params().scoring.confidence_half_weight));
  const bool gone = weights_[index] == 0 && scorer_.params().tsdf.region != UpdateRegion::Projective;
  if (gone) point.reason = PointReason::Changed;  // point_weights.cpp: its voxel was taken out
  if (index >= state_.size) return point;         // added after the last update
  if (point.id < withheld_.size() && withheld_[point.id] != 0) {
    point.reason = reasonOf(withheld_[point.id]);
    return point;
  }
  const std::size_t n = index;
  point.normal_W = Eigen::Vector3f(state_.normal_L.data() + 3 * n);
  if (point.normal_W.isZero()) point.normal_W.setZero();  // its signs are ours (kernels::writeBesideSurface)
  point.score = state_.score[n];
  point.direction = state_.direction[n];
  point.stability = state_.stability[n];
  point.label = state_.label[n];
  if (!gone || point.label != PointLabel::Unscored) point.reason = state_.reason[n];
  if (point.direction != kNoDirection) {
    if (!state_.roll.empty()) point.roll = state_.roll[n];
    const ToolHeading& heading =
        headings_[std::size_t{point.direction} * static_cast<std::size_t>(rolls_) + point.roll];
    point.yaw_rad = heading.yaw_rad;
    point.direction_W = heading.direction_W;
    point.orientation_WT = heading.orientation_WT;
  }
  point.access_probability = probability_.of(point);
  point.confident = point.label == PointLabel::Accessible && !some_wait_ &&
                    point.confidence * point.stability > static_cast<float>(scorer_.params().update.stability_min);
  return point;
}

/// The points of a tile's core.
class CorePoints final : public SurfacePoints {
 public:
  CorePoints(std::unique_ptr<const ScoredPoints> all, const PointStore& store, const VoxelColumnBox& core)
      : all_(std::move(all)) {
    for (std::uint32_t id = 0; id < all_->size(); ++id) {
      if (core.contains(store.voxelOf(store.first_L(id)))) ids_.push_back(id);
    }
  }

  [[nodiscard]] std::size_t size() const override { return ids_.size(); }
  [[nodiscard]] SurfacePoint at(std::size_t index) const override { return all_->at(ids_[index]); }
  [[nodiscard]] Eigen::Vector3d position_W(std::size_t index) const override { return all_->position_W(ids_[index]); }
  [[nodiscard]] Eigen::Vector3d origin_W() const override { return all_->origin_W(); }
  [[nodiscard]] double voxel_size_m() const override { return all_->voxel_size_m(); }
  [[nodiscard]] bool hasProbability() const override { return all_->hasProbability(); }
  [[nodiscard]] std::vector<std::string> attributeNames() const override { return all_->attributeNames(); }
  [[nodiscard]] std::int32_t attribute(std::size_t index, std::size_t column) const override {
    return all_->attribute(ids_[index], column);
  }
  [[nodiscard]] std::optional<FirstReturn> firstReturn(std::size_t index) const override {
    return all_->firstReturn(ids_[index]);
  }

 private:
  std::unique_ptr<const ScoredPoints> all_;
  std::vector<std::uint32_t> ids_;
};

}  // namespace

std::unique_ptr<const SurfacePoints> scoredPoints(const ScoredField& field, PointStates states) {
  const std::uint32_t count = field.scorer.points().size();
  HostState state = states == PointStates::None ? HostState() : HostState(field.scorer, field.backend, 0, count);
  auto all = std::make_unique<ScoredPoints>(field, std::move(state), 0, count);
  if (!field.core) return all;
  return std::make_unique<CorePoints>(std::move(all), field.scorer.points(), *field.core);
}

std::unique_ptr<const SurfacePoints> scoredPoints(const ScoredField& field, std::span<const std::uint32_t> ids) {
  return std::make_unique<ScoredPoints>(field, HostState(field.scorer, field.backend, ids), ids);
}

FieldSnapshot snapshotOf(const SurfacePoints& points) {
  FieldSnapshot snapshot;
  snapshot.origin_W = points.origin_W();
  snapshot.voxel_size_m = points.voxel_size_m();
  snapshot.points.resize(points.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 1024), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) snapshot.points[n] = points.at(n);
  });
  for (std::string& name : points.attributeNames()) {
    const std::size_t column = snapshot.attributes.size();
    std::vector<std::int32_t>& values = snapshot.attributes.emplace_back(AttributeColumn{std::move(name), {}}).values;
    values.resize(points.size());
    for (std::size_t n = 0; n < values.size(); ++n) values[n] = points.attribute(n, column);
  }
  return snapshot;
}

SurfacePoint scoredPoint(const ScoredField& field, std::uint32_t id) {
  return ScoredPoints(field, HostState(field.scorer, field.backend, id, id + 1), id, 1).at(0);
}

}  // namespace accessvdb::internal
