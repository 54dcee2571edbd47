// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/batch_query.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "field/query/batch_query_impl.h"
#include "field/query/query_checks.h"
#include "field/tools/tool_heading.h"

namespace accessvdb {
namespace internal {

HostPointState::HostPointState(kernels::Backend& backend, const kernels::PointStateView& view, std::uint32_t count,
                               bool on_host, const Withheld& withheld)
    : score(view.score), direction(view.direction), label(view.label), reason(view.reason), size(count) {
  if (size == 0) return;
  if (on_host && !withheld.any()) return;
  const auto fetch = [&](auto& copy, auto*& from) {
    copy.resize(size);
    backend.download(copy.data(), from, size * sizeof(copy[0]));
    from = copy.data();
  };
  fetch(score_copy, score);
  fetch(direction_copy, direction);
  fetch(label_copy, label);
  fetch(reason_copy, reason);
  ToldPoints{label_copy, reason_copy, score_copy, direction_copy}.withhold(withheld);
}

std::vector<Eigen::Vector3f> directionVectors(const ApproachParams& resolved) {
  std::vector<Eigen::Vector3f> directions;
  for (const ToolHeading& heading : toolHeadings(resolved)) directions.push_back(heading.direction_W);
  return directions;
}

}  // namespace internal

namespace {

/// Enough to be worth a task, few enough to spread.
constexpr std::size_t kPointsPerTask = 2048, kCapsulesPerTask = 4;

}  // namespace

BatchQuery::BatchQuery(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
std::uint64_t BatchQuery::revision() const { return impl_->revision; }
bool BatchQuery::current() const { return impl_->current(); }

void BatchQuery::at(std::span<const Eigen::Vector3d> points_W, std::span<PointAnswer> answers) const {
  internal::requireSizes(points_W.size(), answers.size());
  internal::requireCurrent(current(), "batchQuery");
  impl_->arena->execute([&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points_W.size(), kPointsPerTask), [&](const auto& range) {
      internal::answerPoints(impl_->source, points_W.subspan(range.begin(), range.size()),
                             answers.subspan(range.begin(), range.size()));
    });
  });
}

std::vector<PointAnswer> BatchQuery::at(const Eigen::Ref<const Eigen::Matrix3Xd>& points_W) const {
  static_assert(sizeof(Eigen::Vector3d) == 3 * sizeof(double));
  const auto count = static_cast<std::size_t>(points_W.cols());
  std::vector<PointAnswer> answers(count);
  if (points_W.outerStride() == 3) {  // columns without gaps are positions in a row
    at({reinterpret_cast<const Eigen::Vector3d*>(points_W.data()), count}, answers);
  } else {
    std::vector<Eigen::Vector3d> packed;
    packed.reserve(count);
    for (Eigen::Index n = 0; n < points_W.cols(); ++n) packed.emplace_back(points_W.col(n));
    at(packed, answers);
  }
  return answers;
}

void BatchQuery::along(std::span<const CapsuleQuery> capsules, std::span<CapsuleAnswer> answers) const {
  internal::requireSizes(capsules.size(), answers.size());
  internal::requireCurrent(current(), "batchQuery");
  impl_->arena->execute([&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, capsules.size(), kCapsulesPerTask), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        answers[n] = internal::answerCapsule(impl_->source, capsules[n]);
      }
    });
  });
}

std::vector<CapsuleAnswer> BatchQuery::along(std::span<const CapsuleQuery> capsules) const {
  std::vector<CapsuleAnswer> answers(capsules.size());
  along(capsules, answers);
  return answers;
}

}  // namespace accessvdb
