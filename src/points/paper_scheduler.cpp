// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's incremental updates: new points, three triggers, a budget, a backlog (paper, "Incremental Updates and
/// Confidence"; SPEC a.8). Labels are not those of a full evaluation; they approach them.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <random>

#include "points/update_scheduler.h"

namespace accessvdb::internal {
namespace {

using Clock = std::chrono::steady_clock;
double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

constexpr double kDegrees = 0.017453292519943295;
constexpr double kCoarseStep_rad = 20 * kDegrees, kFineWindow_rad = 25 * kDegrees;
/// A resolved point within this lends its best direction to the fine window.
constexpr float kResolvedRadius_m = 0.3f;

class PaperScheduler final : public UpdateScheduler {
 public:
  PaperScheduler(PointScorer& scorer, const kernels::ToolKernelView& tool, const kernels::ApproachView& approach)
      : scorer_(scorer), approach_(approach), collision_limit_(tool.collision_limit), random_(scorer.params().update.seed) {}

  void noteScan(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                std::span<const Eigen::Vector3f> q_L, std::span<const std::span<const LeafChange>>) override {
    const auto size = scorer_.points().size();
    queued_.resize(size, 0);
    last_distance_m_.resize(size, std::numeric_limits<float>::quiet_NaN());
    for (; known_points_ < size; ++known_points_) enqueue(known_points_);
    triggerOnDistance(touched.all);
    triggerOnSample(p_L);
    triggerOnMotion(q_L.empty() ? last_sensor_L_ : q_L.front());
  }

  UpdateStats update(const ScoringTables& tables) override {
    UpdateStats stats;
    const auto start = Clock::now();
    scorer_.grow();
    const int budget = scorer_.params().update.budget_points;
    std::size_t left = budget > 0 ? static_cast<std::size_t>(budget) : queue_.size();
    std::vector<std::uint32_t> work;
    std::vector<std::uint32_t> popped;
    for (; left > 0 && !queue_.empty(); --left) {
      popped.push_back(queue_.front());
      queued_[queue_.front()] = 0;
      queue_.pop_front();
    }
    scorer_.refreshWeights(popped);
    for (const std::uint32_t id : popped) {
      if (scorer_.confidentEnough(id)) {
        work.push_back(id);
      } else {
        waiting_.push_back(id);  // "fresh": queued again with the next scan
      }
    }
    scorer_.refreshNeighbourhoods(work);
    scorer_.upload(work);
    std::vector<kernels::ScoreItem> items(work.size());
    for (std::size_t n = 0; n < work.size(); ++n) {
      items[n].id = work[n];
      items[n].candidates = candidatesOf(work[n]);
    }
    std::vector<PointLabel> before;
    for (const std::uint32_t id : work) before.push_back(scorer_.record(id).label);
    stats.dirty_points = popped.size();
    stats.update_ms = millisecondsSince(start);
    const auto scoring = Clock::now();
    const auto results = scorer_.score(items, tables);
    stats.score_ms = millisecondsSince(scoring);
    for (std::size_t n = 0; n < results.size(); ++n) {
      stats.direction_tests += results[n].tests;
      stats.scored_points += results[n].tests > 0 ? 1 : 0;
      stats.label_changes += results[n].label != before[n] ? 1 : 0;
    }
    for (const std::uint32_t id : waiting_) enqueue(id);
    waiting_.clear();
    stats.backlog = queue_.size();
    return stats;
  }

  std::uint64_t bytes() const override {
    return (queue_.size() + waiting_.capacity()) * sizeof(std::uint32_t) + queued_.capacity() +
           last_distance_m_.capacity() * sizeof(float);
  }

 private:
  void enqueue(std::uint32_t id) {
    if (queued_[id] != 0) return;
    queued_[id] = 1;
    queue_.push_back(id);
  }

  /// (i) The TSDF at a point's voxel changed by more than 2 v since the last frame.
  void triggerOnDistance(std::span<const std::uint32_t> touched) {
    std::vector<float> distances(touched.size());
    scorer_.reads().distances(touched, distances);
    const auto bound = static_cast<float>(2 * scorer_.params().tsdf.voxel_size_m);
    for (std::size_t n = 0; n < touched.size(); ++n) {
      float& last = last_distance_m_[touched[n]];
      if (std::fabs(distances[n] - last) > bound) enqueue(touched[n]);  // false at birth: last is NaN
      last = distances[n];
    }
  }

  /// (ii) Points within r_u of up to 256 of the voxels written this frame (drawn in the cubes of random returns).
  void triggerOnSample(std::span<const Eigen::Vector3f> p_L) {
    if (p_L.empty()) return;
    const FieldParams& p = scorer_.params();
    const double v = p.tsdf.voxel_size_m, tau = p.tsdf.truncation_distance_m;
    const double radius = p.update.changed_voxel_radius_voxels * v;
    const auto reach = static_cast<std::int32_t>(p.update.changed_voxel_radius_voxels / 8) + 1;
    const auto unit = [this] { return static_cast<double>(random_() >> 11) * 0x1.0p-53; };
    const PointStore& points = scorer_.points();
    for (int n = 0; n < p.update.changed_voxel_sample; ++n) {
      const Eigen::Vector3f& around = p_L[static_cast<std::size_t>(unit() * static_cast<double>(p_L.size()))];
      Eigen::Vector3d x = around.cast<double>();
      for (Eigen::Index axis = 0; axis < 3; ++axis) x[axis] = std::round((x[axis] + (2 * unit() - 1) * tau) / v) * v;
      const Index3 leaf = parentOf(points.voxelOf(x.cast<float>()));
      points.index().forEachBlock({leaf[0] - reach, leaf[1] - reach, leaf[2] - reach},
                                  {leaf[0] + reach, leaf[1] + reach, leaf[2] + reach}, [&](std::uint32_t b) {
                                    for (const std::uint32_t id : points.index().blocks()[b].ids) {
                                      if ((points.first_L(id).cast<double>() - x).norm() <= radius) enqueue(id);
                                    }
                                  });
    }
  }

  /// (iii) The sensor moved: every point that is not accessible may have gained an observation side.
  void triggerOnMotion(const Eigen::Vector3f& q_L) {
    if (have_sensor_ && !((q_L - last_sensor_L_).norm() > static_cast<float>(scorer_.params().update.requeue_motion_m))) return;
    const bool first = !have_sensor_;
    last_sensor_L_ = q_L;
    have_sensor_ = true;
    if (first) return;
    for (std::uint32_t id = 0; id < scorer_.device().size(); ++id) {
      if (scorer_.record(id).label != PointLabel::Accessible) enqueue(id);
    }
  }

  /// All directions, or the coarse pass and the window around the nearest resolved point's best direction.
  [[nodiscard]] DirectionMask candidatesOf(std::uint32_t id) const {
    const int count = approach_.num_directions;
    if (!scorer_.params().approach.coarse_to_fine) return allDirections(count);
    DirectionMask candidates = {};
    const double step = 2 * 3.141592653589793 / count;
    const int coarse = std::max(1, static_cast<int>(std::lround(kCoarseStep_rad / step)));
    for (int d = 0; d < count; d += coarse) candidates.set(d);
    const std::uint16_t hint = directionOfNearestResolved(id);
    if (hint == kNoDirection) return candidates;
    const int window = static_cast<int>(kFineWindow_rad / step + 1e-9);
    for (int offset = -window; offset <= window; ++offset) candidates.set(((hint + offset) % count + count) % count);
    return candidates;
  }

  [[nodiscard]] std::uint16_t directionOfNearestResolved(std::uint32_t id) const {
    const PointStore& points = scorer_.points();
    const Eigen::Vector3f& p = points.first_L(id);
    const Index3 leaf = parentOf(points.voxelOf(p));
    const auto block_m = static_cast<float>(8 * scorer_.params().tsdf.voxel_size_m);
    const auto most = static_cast<std::int32_t>(kResolvedRadius_m / block_m) + 1;
    float best = kResolvedRadius_m;
    std::uint32_t best_id = kNone;
    for (std::int32_t ring = 0; ring <= most; ++ring) {
      // Blocks of this ring are at least ring - 1 blocks away.
      if (static_cast<float>(ring - 1) * block_m > best) break;
      points.index().forEachBlock({leaf[0] - ring, leaf[1] - ring, leaf[2] - ring}, {leaf[0] + ring, leaf[1] + ring, leaf[2] + ring},
                                  [&](std::uint32_t b) {
                                    const PointBlock& block = points.index().blocks()[b];
                                    const std::int32_t away = std::max({std::abs(block.leaf[0] - leaf[0]), std::abs(block.leaf[1] - leaf[1]),
                                                                        std::abs(block.leaf[2] - leaf[2])});
                                    if (away != ring) return;
                                    for (const std::uint32_t other : block.ids) {
                                      const PointRecord& record = scorer_.record(other);
                                      if (other == id || record.score >= collision_limit_ || record.direction == kNoDirection) continue;
                                      const float distance = (points.first_L(other) - p).norm();
                                      if (distance < best || (distance == best && other < best_id)) {
                                        best = distance;
                                        best_id = other;
                                      }
                                    }
                                  });
    }
    return best_id == kNone ? kNoDirection : scorer_.record(best_id).direction;
  }

  PointScorer& scorer_;
  kernels::ApproachView approach_;
  std::uint16_t collision_limit_;
  std::mt19937_64 random_;
  std::deque<std::uint32_t> queue_;
  std::vector<std::uint8_t> queued_;
  std::vector<std::uint32_t> waiting_;
  std::vector<float> last_distance_m_;
  std::uint32_t known_points_ = 0;
  Eigen::Vector3f last_sensor_L_ = {0, 0, 0};
  bool have_sensor_ = false;
};

}  // namespace

std::unique_ptr<UpdateScheduler> makePaperScheduler(PointScorer& scorer, const kernels::ToolKernelView& tool,
                                                    const kernels::ApproachView& approach) {
  return std::make_unique<PaperScheduler>(scorer, tool, approach);
}

}  // namespace accessvdb::internal
