// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/ball_tree.h"

#include <algorithm>
#include <array>

#include "eval/collision_field.h"

namespace accessvdb::eval {
namespace {

/// Rounding of positions and distances; a thousand times more than doubles need at the size of these scenes.
constexpr double kRounding_m = 1e-9;
/// Deeper than any tree that halves an int number of samples.
constexpr std::size_t kMaxDepth = 64;

enum class Settled { All, None, Some };

}  // namespace

BallTree::BallTree(const std::vector<Eigen::Vector3d>& samples_T) {
  std::vector<Eigen::Vector3d> samples = samples_T;
  nodes_.reserve(2 * samples.size());
  if (!samples.empty()) build(samples, 0, samples.size());
}

void BallTree::build(std::vector<Eigen::Vector3d>& samples_T, std::size_t begin, std::size_t end) {
  const auto first = samples_T.begin() + static_cast<std::ptrdiff_t>(begin);
  const auto last = samples_T.begin() + static_cast<std::ptrdiff_t>(end);
  Eigen::Vector3d low = *first, high = *first;
  for (auto p = first; p != last; ++p) low = low.cwiseMin(*p), high = high.cwiseMax(*p);
  Node node{0.5 * (low + high), 0, static_cast<int>(end - begin), -1};
  if (low == high) node.centre_T = low;  // a single position: not moved by rounding
  for (auto p = first; p != last; ++p) node.radius_m = std::max(node.radius_m, (*p - node.centre_T).norm());
  const std::size_t here = nodes_.size();
  nodes_.push_back(node);
  if (low == high) return;

  int axis = 0;
  (high - low).maxCoeff(&axis);
  const std::size_t middle = begin + (end - begin) / 2;
  std::nth_element(first, samples_T.begin() + static_cast<std::ptrdiff_t>(middle), last,
                   [axis](const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return a[axis] < b[axis]; });
  build(samples_T, begin, middle);
  nodes_[here].second = static_cast<std::int32_t>(nodes_.size());
  build(samples_T, middle, end);
}

/// @param settle  ball centre, radius -> whether all, none or some of its samples are below the threshold; never some
///                for a radius of 0
template <typename Settle>
int BallTree::count(int enough, const Settle& settle) const {
  if (nodes_.empty()) return 0;
  std::array<std::int32_t, kMaxDepth> open;
  std::size_t depth = 0;
  open[depth++] = 0;
  int count = 0;
  while (depth > 0 && count < enough) {
    const std::int32_t n = open[--depth];
    const Node& node = nodes_[static_cast<std::size_t>(n)];
    const Settled settled = settle(node.centre_T, node.radius_m);
    if (settled == Settled::All) {
      count += node.samples;
    } else if (settled == Settled::Some) {
      open[depth++] = node.second;
      open[depth++] = n + 1;
    }
  }
  return count;
}

int BallTree::countBelow(const sim::SignedDistance& distance, const ToolPlacement& tool,
                         const SampleThreshold& threshold, int enough) const {
  const double margin_m = distance.errorBound_m() + kRounding_m;
  return count(enough, [&](const Eigen::Vector3d& centre_T, double radius_m) {
    const double d_m = distance.at(tool.at(centre_T)), from_tip_m = centre_T.norm();
    if (radius_m == 0) return d_m < threshold.at(from_tip_m) ? Settled::All : Settled::None;
    if (d_m + radius_m + margin_m < threshold.at(from_tip_m - radius_m)) return Settled::All;
    return d_m - radius_m - margin_m < threshold.at(from_tip_m + radius_m) ? Settled::Some : Settled::None;
  });
}

int BallTree::countBelow(const CollisionField& distance, const ToolPlacement& tool, const SampleThreshold& threshold,
                         int enough) const {
  const double margin_m = distance.distance().errorBound_m() + kRounding_m;
  return count(enough, [&](const Eigen::Vector3d& centre_T, double radius_m) {
    const Eigen::Vector3d centre_W = tool.at(centre_T);
    const double from_tip_m = centre_T.norm();
    if (radius_m == 0) return distance.below(centre_W, threshold.at(from_tip_m)) ? Settled::All : Settled::None;
    const double reach_m = radius_m + margin_m, least_m = threshold.at(from_tip_m - radius_m),
                 most_m = threshold.at(from_tip_m + radius_m);
    const auto bounds = distance.bounds(centre_W, least_m - reach_m, most_m + reach_m);
    if (bounds.upper_m + reach_m < least_m) return Settled::All;
    return bounds.lower_m - reach_m < most_m ? Settled::Some : Settled::None;
  });
}

}  // namespace accessvdb::eval
