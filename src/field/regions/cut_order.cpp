// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <utility>

#include "accessvdb/batch_query.h"
#include "accessvdb/error.h"
#include "accessvdb/what_if.h"
#include "field/field_access.h"

namespace accessvdb {
namespace {

using internal::FieldAccess;
using internal::VoxelSet;

/// Leaves in which points may depend on some voxels, inclusive.
struct LeafBox {
  std::array<std::int32_t, 3> low, high;
  [[nodiscard]] bool meets(const LeafBox& other) const {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (low[axis] > other.high[axis] || other.low[axis] > high[axis]) return false;
    }
    return true;
  }
};

LeafBox dependentsOf(const VoxelSet& voxels, std::int32_t leaves_read) {
  constexpr std::int32_t kFar = std::numeric_limits<std::int32_t>::max() / 2;
  LeafBox box = {{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
  for (const internal::LeafVoxels& part : voxels) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      box.low[a] = std::min(box.low[a], (part.origin_ijk[axis] >> 3) - leaves_read);
      box.high[a] = std::max(box.high[a], (part.origin_ijk[axis] >> 3) + leaves_read);
    }
  }
  return box;
}

std::vector<std::uint32_t> idsOf(const WhatIf& what_if) {
  std::vector<std::uint32_t> ids;
  for (const SurfacePoint& point : what_if.opens) ids.push_back(point.id);
  return ids;
}

struct Candidate {
  std::size_t segment = 0;
  VoxelSet voxels;
  LeafBox dependents = {};
  std::vector<std::uint32_t> opens;  ///< with what is cut already
  std::int64_t gain = 0;             ///< points more than without this cut
  std::uint64_t points_gone = 0;
  bool known = false;  ///< the three above hold
};

class GreedyOrder {
 public:
  GreedyOrder(const AccessibilityField& field, std::span<const Segment> segments) : field_(field) {
    const std::int32_t leaves_read = FieldAccess::leavesRead(field);
    for (std::size_t n = 0; n < segments.size(); ++n) {
      Candidate& candidate = left_.emplace_back();
      candidate.segment = n;
      candidate.voxels = FieldAccess::voxelsOf(field, segments[n].region);
      candidate.dependents = dependentsOf(candidate.voxels, leaves_read);
    }
  }

  CutOrder order(std::size_t most_cuts) {
    while (!left_.empty() && (most_cuts == 0 || order_.cuts.size() < most_cuts)) {
      for (Candidate& candidate : left_) learn(candidate);
      const auto best = std::max_element(left_.begin(), left_.end(),
                                         [](const Candidate& a, const Candidate& b) { return a.gain < b.gain; });
      if (best->gain <= 0) break;
      take(static_cast<std::size_t>(best - left_.begin()));
    }
    VoxelSet all = cut_;
    for (const Candidate& candidate : left_) {
      order_.left.push_back(candidate.segment);
      all = internal::unionOf(all, candidate.voxels);
    }
    if (left_.size() > 1) {
      const std::size_t together = what(all).opens.size();
      order_.left_together = together > opened_.size() ? together - opened_.size() : 0;
    }
    return std::move(order_);
  }

 private:
  WhatIf what(const VoxelSet& voxels) {
    ++order_.what_ifs;
    return FieldAccess::whatIf(field_, voxels);
  }

  void learn(Candidate& candidate) {
    if (std::exchange(candidate.known, true)) return;
    const WhatIf what_if = what(internal::unionOf(cut_, candidate.voxels));
    const std::vector<std::uint32_t> ids = idsOf(what_if);
    candidate.opens.clear();
    std::ranges::set_difference(ids, opened_, std::back_inserter(candidate.opens));
    candidate.gain = static_cast<std::int64_t>(ids.size()) - static_cast<std::int64_t>(opened_.size());
    candidate.points_gone = what_if.points_gone - points_gone_;
  }

  void take(std::size_t index) {
    Candidate taken = std::move(left_[index]);
    left_.erase(left_.begin() + static_cast<std::ptrdiff_t>(index));
    cut_ = internal::unionOf(cut_, taken.voxels);
    const WhatIf now = what(cut_);  // points of what is cut are no longer open
    opened_ = idsOf(now);
    points_gone_ = now.points_gone;
    // What no point depends on together with the segment just cut stays as it is.
    for (Candidate& candidate : left_) {
      if (candidate.dependents.meets(taken.dependents)) candidate.known = false;
    }
    order_.cuts.push_back({taken.segment, std::move(taken.opens), taken.points_gone});
  }

  const AccessibilityField& field_;
  std::vector<Candidate> left_;
  VoxelSet cut_;
  std::vector<std::uint32_t> opened_;  ///< by cut_, ascending
  std::uint64_t points_gone_ = 0;
  CutOrder order_;
};

}  // namespace

LabelledSegments segmentsOf(const AccessibilityField& field, std::span<const Eigen::Vector3d> positions_W,
                            std::span<const std::int64_t> labels) {
  if (positions_W.size() != labels.size()) {
    throw InvalidArgument("segments.sizes", "", "there must be one label per position", "Give arrays of one length");
  }
  LabelledSegments found;
  std::vector<PointAnswer> answers(positions_W.size());
  field.batchQuery().at(positions_W, answers);
  // Two positions in a voxel are at most its diagonal apart.
  const auto reach_m = static_cast<float>(std::sqrt(3.0) * field.params().tsdf.voxel_size_m);
  std::vector<std::pair<std::uint32_t, std::int64_t>> votes;  // id, label
  for (std::size_t n = 0; n < labels.size(); ++n) {
    if (labels[n] <= 0) {
      ++found.unlabelled;
      continue;
    }
    if (answers[n].point_id == kNoPoint || !(answers[n].point_distance_m <= reach_m)) {
      ++found.unmatched;
      continue;
    }
    votes.emplace_back(answers[n].point_id, labels[n]);
  }
  std::sort(votes.begin(), votes.end());
  std::map<std::int64_t, std::vector<std::uint32_t>> points_of;
  for (std::size_t begin = 0; begin < votes.size();) {
    const std::uint32_t id = votes[begin].first;
    std::int64_t label = 0;
    std::size_t most = 0;
    while (begin < votes.size() && votes[begin].first == id) {
      std::size_t end = begin;
      while (end < votes.size() && votes[end] == votes[begin]) ++end;
      if (end - begin > most) most = end - begin, label = votes[begin].second;
      begin = end;
    }
    points_of[label].push_back(id);
  }
  for (auto& [label, ids] : points_of) {
    found.segments.push_back({std::to_string(label), Region::points(std::move(ids))});
  }
  return found;
}

CutOrder orderCuts(const AccessibilityField& field, std::span<const Segment> segments, std::size_t most_cuts) {
  return GreedyOrder(field, segments).order(most_cuts);
}

}  // namespace accessvdb
