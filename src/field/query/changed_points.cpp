// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/query/changed_points.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <functional>
#include <new>
#include <optional>
#include <utility>

#include "accessvdb/error.h"
#include "field/field_stages.h"
#include "field/query/answers.h"

namespace accessvdb::internal {
namespace {

/// Marks that are others than before; ids beyond the end of one of the two have none. `before` becomes `now`.
void takeOtherMarks(std::span<const std::uint8_t> now, std::vector<std::uint8_t>& before,
                    std::vector<std::uint32_t>& others) {
  constexpr std::size_t kTogether = 1024;
  const std::size_t both = std::min(now.size(), before.size());
  const std::size_t found = others.size();
  for (std::size_t begin = 0; begin < both; begin += kTogether) {
    const std::size_t end = std::min(begin + kTogether, both);
    if (std::memcmp(now.data() + begin, before.data() + begin, end - begin) == 0) continue;
    for (std::size_t id = begin; id < end; ++id)
      if (now[id] != before[id]) others.push_back(static_cast<std::uint32_t>(id));
  }
  const auto addRest = [&](std::span<const std::uint8_t> marks) {
    for (std::size_t id = both; id < marks.size(); ++id)
      if (marks[id] != 0) others.push_back(static_cast<std::uint32_t>(id));
  };
  addRest(now);
  addRest(before);
  if (others.size() > found || now.size() != before.size()) before.assign(now.begin(), now.end());
}

}  // namespace

std::vector<SurfacePoint> ChangedPoints::take(const FieldStages& field) {
  bool all = std::exchange(compares_all_, true);  // whatever throws from here on
  others_.clear();
  if (all) {
    for (OfTool& of : tools_) of.known = 0;
  }
  bool has_states = true;
  try {
    takeOthers(field);
  } catch (const ResourceLimit&) {  // all points can be compared without them
    has_states = false;
    all = true;
  }
  if (!all) sortOthers(field);
  const auto points = all ? scoredPoints(field) : scoredPoints(field, others_);
  std::vector<SurfacePoint> changed = told_.since(*points, field.points.size());
  const bool notes_taken = noteTaken(all);
  // Of a tool that has a label without any observation, not all is a matter of states: another one may wait beside it.
  const bool any_confidence = several_ && field.params.scoring.confidence_min <= 0;
  compares_all_ = !has_states || !notes_taken || any_confidence;
  made_anew_ = false;
  return changed;
}

/// What was told becomes what is to be told.
void ChangedPoints::takeOthers(const FieldStages& field) {
  tools_.resize(field.tools.size());
  for (std::size_t k = 0; k < tools_.size(); ++k) {
    const PointScorer& scorer = *field.tools.at(k).scorer;
    takeOtherStates(scorer, tools_[k]);
    takeOtherMarks(scorer.waiting(), tools_[k].waiting, others_);
  }
  takeOtherMarks(field.withheld(), withheld_, others_);
}

/// Each once, with those that are new, and of the core.
void ChangedPoints::sortOthers(const FieldStages& field) {
  const std::uint32_t count = field.points.size();
  others_.insert(others_.end(), taken_.begin(), taken_.end());
  // New points have other states, but for those that came after the last update.
  for (std::uint32_t id = std::max(told_.size(), tools_.front().known); id < count; ++id) others_.push_back(id);
  if (std::ranges::adjacent_find(others_, std::greater_equal<>()) != others_.end()) {
    std::ranges::sort(others_);
    const auto twice = std::ranges::unique(others_);
    others_.erase(twice.begin(), twice.end());
  }
  const std::optional<VoxelColumnBox> core = field.core();
  std::erase_if(others_, [&](std::uint32_t id) {
    return id >= count || (core && !core->contains(field.points.voxelOf(field.points.first_L(id))));
  });
}

void ChangedPoints::takeOtherStates(const PointScorer& scorer, OfTool& of) {
  const std::uint32_t count = scorer.device().size();
  if (count == 0) return;
  const std::size_t words = (count + 63) / 64;
  of.states.growWithRoom(memory_, count, count + count / 4, of.known);
  differ_.growWithRoom(memory_, words, words + words / 4, 0);
  scorer.backend().takeAllTold(scorer.device().view(), {of.states.data(), of.known, count, several_, differ_.data()});
  of.known = count;
  differ_on_host_.resize(words);
  memory_.download(differ_on_host_.data(), differ_.data(), words * sizeof(differ_on_host_[0]));
  for (std::size_t word = 0; word < words; ++word) {
    for (std::uint64_t bits = differ_on_host_[word]; bits != 0; bits &= bits - 1)
      others_.push_back(static_cast<std::uint32_t>(64 * word + static_cast<std::size_t>(std::countr_zero(bits))));
  }
}

/// Those of all points, or of others_, which has those that were. @return false: there is no memory for them
bool ChangedPoints::noteTaken(bool all) try {
  taken_.clear();
  // Points without a state are not told as withheld (ScoredPoints::at).
  const std::size_t withheld = std::min<std::size_t>(withheld_.size(), tools_.front().known);
  const auto note = [&](std::uint32_t id) {
    if (told_.isTaken(id) && (id >= withheld || withheld_[id] == 0)) taken_.push_back(id);
  };
  if (all) {
    for (std::uint32_t id = 0; id < told_.size(); ++id) note(id);
  } else {
    for (const std::uint32_t id : others_) note(id);
  }
  return true;
} catch (const std::bad_alloc&) {  // what changed is told already
  return false;
}

std::uint64_t ChangedPoints::hostBytes() const {
  std::uint64_t bytes = differ_on_host_.capacity() * sizeof(differ_on_host_[0]) + withheld_.capacity() + told_.bytes() +
                        (taken_.capacity() + others_.capacity()) * sizeof(taken_[0]);
  for (const OfTool& of : tools_) bytes += of.waiting.capacity();
  return bytes;
}

}  // namespace accessvdb::internal
