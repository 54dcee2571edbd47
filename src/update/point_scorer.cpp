// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/point_scorer.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <utility>

#include "hostdev/direction_filter.h"

namespace accessvdb::internal {
namespace {
constexpr std::size_t kScoredPerTask = 1024;
}  // namespace

PointScorer::PointScorer(const PointStore& points, const FieldParams& resolved, kernels::Backend& backend,
                         MapReads reads)
    : points_(points),
      params_(resolved),
      backend_(backend),
      reads_(std::move(reads)),
      search_(points, resolved),
      device_(backend, points.directionWords(), resolved.approach.rolls > 1) {}

void PointScorer::grow() {
  device_.grow(points_.size());
  records_.grow(points_.size());
  if (keepsWideSeen())
    wide_seen_.resize(std::size_t{points_.size()} * static_cast<std::size_t>(points_.directionWords()));
}

bool PointScorer::isConfident(std::uint16_t weight) const {
  return kernels::confidenceOf(weight, static_cast<float>(params_.scoring.confidence_half_weight)) >=
         static_cast<float>(params_.scoring.confidence_min);
}

std::vector<std::uint32_t> PointScorer::refreshWeights(std::span<const std::uint32_t> ids) {
  std::vector<std::uint16_t> weights(ids.size());
  reads_.weights(ids, weights);
  std::vector<std::uint32_t> crossed;
  for (std::size_t n = 0; n < ids.size(); ++n) {
    const bool before = confidentEnough(ids[n]);
    records_[ids[n]].weight = weights[n];
    if (confidentEnough(ids[n]) != before) crossed.push_back(ids[n]);
  }
  return crossed;
}

std::vector<std::uint32_t> PointScorer::takeConfident(std::vector<std::uint32_t>& fresh) {
  std::vector<std::uint16_t> weights(fresh.size());
  reads_.weights(fresh, weights);
  struct Admitted {
    std::vector<std::uint32_t> confident, others;
  };
  std::vector<Admitted> of_tasks((fresh.size() + kScoredPerTask - 1) / kScoredPerTask);
  tbb::parallel_for(std::size_t{0}, of_tasks.size(), [&](std::size_t task) {
    for (std::size_t n = task * kScoredPerTask; n < std::min(fresh.size(), (task + 1) * kScoredPerTask); ++n) {
      records_[fresh[n]].weight = weights[n];
      (isConfident(weights[n]) ? of_tasks[task].confident : of_tasks[task].others).push_back(fresh[n]);
    }
  });
  std::vector<std::uint32_t> confident;
  fresh.clear();
  for (const Admitted& admitted : of_tasks) {
    confident.insert(confident.end(), admitted.confident.begin(), admitted.confident.end());
    fresh.insert(fresh.end(), admitted.others.begin(), admitted.others.end());
  }
  return confident;
}

void PointScorer::refreshTouched(std::vector<std::uint32_t> touched) {
  std::erase_if(touched, [&](std::uint32_t id) { return !records_[id].has_neighbourhood; });
  refreshWeights(touched);
  uploadInputs(touched);
}

PointScorer::Changed PointScorer::refreshNeighbourhoods(std::span<const std::uint32_t> ids, Changed memory) {
  const bool keep = keepsMemoryFor(ids.size());
  if (found_.size() < ids.size()) found_.resize(keep ? ids.size() + ids.size() / 4 : ids.size());
  const std::span<Neighbourhood> found = std::span(found_).first(ids.size());
  search_.compute(ids, found, points_.isWide() ? wideSeen() : nullptr);
  const std::size_t tasks = (ids.size() + kScoredPerTask - 1) / kScoredPerTask;
  std::vector<Changed> of_task(tasks);
  tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t task) {
    Changed& changed = of_task[task];
    for (std::size_t n = task * kScoredPerTask; n < std::min(ids.size(), (task + 1) * kScoredPerTask); ++n) {
      PointRecord& record = records_[ids[n]];
      // Normals of points that are not scored are all zero, and so is none at all: they differ in their signs.
      const bool turned =
          record.normal_L != found[n].normal_L ||
          kernels::besideSurfaceAxis(record.normal_L.data()) != kernels::besideSurfaceAxis(found[n].normal_L.data());
      if (!record.has_neighbourhood || turned || !(record.seen == found[n].seen) || found[n].wide_views_changed) {
        changed.ids.push_back(ids[n]);
        changed.before.push_back({{record.normal_L.x(), record.normal_L.y(), record.normal_L.z()}, record.seen});
      }
      record.normal_L = found[n].normal_L;
      record.seen = found[n].seen;
      record.reach_m = found[n].reach_m;
      record.has_neighbourhood = true;
    }
  });
  std::vector<std::size_t> begin(tasks + 1, 0);
  for (std::size_t task = 0; task < tasks; ++task) begin[task + 1] = begin[task] + of_task[task].ids.size();
  Changed all = std::move(memory);
  const auto resize = [keep](auto& list, std::size_t size) {
    list.clear();
    if (list.capacity() < size) list.reserve(keep ? size + size / 4 : size);
    list.resize(size);
  };
  resize(all.ids, begin[tasks]);
  resize(all.before, begin[tasks]);
  tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t task) {
    const auto first = static_cast<std::ptrdiff_t>(begin[task]);
    std::copy(of_task[task].ids.begin(), of_task[task].ids.end(), all.ids.begin() + first);
    std::copy(of_task[task].before.begin(), of_task[task].before.end(), all.before.begin() + first);
  });
  if (!keep) found_ = {};
  return all;
}

void PointScorer::adopt(const PointScorer& from, std::span<const std::uint32_t> ids) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), kScoredPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const PointRecord& theirs = from.records_[ids[n]];
      PointRecord& mine = records_[ids[n]];
      mine.normal_L = theirs.normal_L;
      mine.reach_m = theirs.reach_m;
      mine.seen = theirs.seen;
      mine.weight = theirs.weight;
      mine.has_neighbourhood = theirs.has_neighbourhood;
      if (points_.isWide()) {
        const auto words = static_cast<std::size_t>(points_.directionWords());
        std::copy_n(from.wideSeen() + words * ids[n], words, wideSeen() + words * ids[n]);
      }
    }
  });
  std::vector<std::uint32_t> known(ids.begin(), ids.end());
  std::erase_if(known, [&](std::uint32_t id) { return !records_[id].has_neighbourhood; });
  upload(known);
}

ScoredPoint PointScorer::scored(std::uint32_t id, std::span<std::uint64_t> seen) const {
  const PointRecord& record = records_[id];
  const kernels::PointStateView state = device_.view();
  if (!record.has_neighbourhood) {  // none have been joined; of a wide set their place was never written
    std::fill(seen.begin(), seen.end(), 0);
  } else if (points_.isWide()) {
    std::copy_n(wideSeen() + seen.size() * id, seen.size(), seen.data());
  } else {
    std::copy_n(record.seen.word, seen.size(), seen.data());
  }
  return {record.normal_L,  record.reach_m, state.stability[id], record.weight, record.score,
          record.direction, record.label,   state.reason[id],    record.roll,   record.has_neighbourhood};
}

void PointScorer::restore(std::uint32_t id, const ScoredPoint& point, std::span<const std::uint64_t> seen) {
  PointRecord& record = records_[id];
  record.normal_L = point.normal_L;
  record.reach_m = point.reach_m;
  record.weight = point.weight;
  record.score = point.score;
  record.direction = point.direction;
  record.label = point.label;
  record.roll = point.roll;
  record.has_neighbourhood = point.has_neighbourhood;
  if (points_.isWide()) {
    std::copy_n(seen.data(), seen.size(), wideSeen() + seen.size() * id);
  } else {
    std::copy_n(seen.data(), seen.size(), record.seen.word);
  }
  const kernels::PointStateView state = device_.view();
  state.score[id] = point.score;
  state.direction[id] = point.direction;
  state.label[id] = point.label;
  state.reason[id] = point.reason;
  state.stability[id] = point.stability;
  if (state.roll != nullptr) state.roll[id] = point.roll;
}

void PointScorer::upload(std::span<const std::uint32_t> ids) {
  uploadInputs(ids);
  if (keepsWideSeen()) uploadWideSeen(ids);
}

void PointScorer::uploadWideSeen(std::span<const std::uint32_t> ids) {
  constexpr std::size_t kChunk = 1 << 14;
  const auto words = static_cast<std::size_t>(points_.directionWords());
  std::vector<std::uint64_t> rows(words * std::min(ids.size(), kChunk));
  for (std::size_t first = 0; first < ids.size(); first += kChunk) {
    const std::size_t count = std::min(kChunk, ids.size() - first);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kScoredPerTask), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        std::copy_n(wideSeen() + words * ids[first + n], words, rows.data() + words * n);
      }
    });
    backend_.writeSeen(device_.view(), ids.data() + first, rows.data(), count);
  }
}

void PointScorer::uploadInputs(std::span<const std::uint32_t> ids) {
  constexpr std::size_t kChunk = 1 << 16;  // so that the memory in between stays small
  if (inputs_.size() < std::min(ids.size(), kChunk)) inputs_.resize(std::min(ids.size(), kChunk));
  for (std::size_t first = 0; first < ids.size(); first += kChunk) {
    const std::size_t count = std::min(kChunk, ids.size() - first);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kScoredPerTask), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const std::uint32_t id = ids[first + n];
        const PointRecord& record = records_[id];
        kernels::PointInput& input = inputs_[n];
        input.id = id;
        input.weight = record.weight;
        for (int axis = 0; axis < 3; ++axis) {
          input.position_L[axis] = points_.first_L(id)[axis];
          input.normal_L[axis] = record.normal_L[axis];
        }
        input.seen = record.seen;
      }
    });
    backend_.writePoints(device_.view(), inputs_.data(), count);
  }
}

std::vector<kernels::ScoreResult> PointScorer::score(std::span<const kernels::ScoreItem> items,
                                                     const ScoringTables& tables) {
  std::vector<kernels::ScoreResult> results(items.size());
  kernels::ScoreRequest request;
  request.map = tables.map;
  request.tool = tables.tool;
  request.approach = tables.approach;
  request.points = device_.view();
  request.rule = tables.rule;
  request.prepared = tables.prepared;
  request.items = items.data();
  request.results = results.data();
  request.count = items.size();
  backend_.scorePoints(request);
  for (std::size_t n = 0; n < items.size(); ++n) {
    PointRecord& record = records_[items[n].id];
    record.label = results[n].label;
    record.score = results[n].stored_score;
    record.direction = results[n].stored_direction;
    record.roll = results[n].stored_roll;
  }
  return results;
}

kernels::DueUpdate PointScorer::dueUpdate(const kernels::KnownScale& scale, const ScoringTables& tables) const {
  return {tables.map, tables.tool, tables.approach, device_.view(), tables.rule, scale, tables.prepared};
}

void PointScorer::store(std::uint32_t id, const kernels::DueOutcome& outcome) {
  PointRecord& record = records_[id];
  record.label = outcome.label;
  record.score = outcome.score;
  record.direction = outcome.direction;
  record.roll = outcome.roll;
}

}  // namespace accessvdb::internal
