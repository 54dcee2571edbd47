// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/point_attributes.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kPointsAtOnce = 256;

std::uint32_t saturated(std::uint32_t a, std::uint32_t b) {
  return a + std::min(b, std::numeric_limits<std::uint32_t>::max() - a);
}

}  // namespace

PointAttributes::PointAttributes(std::vector<CarriedAttribute> carried)
    : carried_(std::move(carried)), columns_(carried_.size()) {}

std::int32_t PointAttributes::value(std::uint32_t id, std::size_t c) const {
  const Column& column = columns_[c];
  if (!isSplit(column, id)) return column.value[id];
  Vote best = {kNoAttribute, 0};
  for (auto n = std::bit_cast<std::uint32_t>(column.value[id]); n != kEnd; n = column.pool[n].next) {
    if (column.pool[n].vote.returns > best.returns) best = column.pool[n].vote;
  }
  return best.value;
}

void PointAttributes::votes(std::uint32_t id, std::size_t c, std::vector<Vote>& to) const {
  const Column& column = columns_[c];
  to.clear();
  if (!isSplit(column, id)) return;
  for (auto n = std::bit_cast<std::uint32_t>(column.value[id]); n != kEnd; n = column.pool[n].next) {
    to.push_back(column.pool[n].vote);
  }
}

void PointAttributes::grow(std::uint32_t points) {
  for (Column& column : columns_) {
    column.value.growRaw(points);
    column.split.grow((std::size_t{points} + 63) / 64, 0);
  }
}

/// Takes what leaves a point with returns that agree, which is nearly all. @return numbers of the others
const std::vector<std::uint32_t>& PointAttributes::addAgreeing(const ReturnsOfPoints& scan,
                                                               std::span<const std::int32_t> values,
                                                               std::uint32_t points) {
  const std::size_t width = columns_.size(), count = scan.ids.size();
  split_.clear();
  if (width == 0) return split_;
  grow(points);
  is_split_.assign(count, 0);
  const auto valueOf = [&](std::uint32_t m, std::size_t c) { return values[scan.returns[m] * width + c]; };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kPointsAtOnce), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const std::uint32_t id = scan.ids[n], begin = scan.begin[n], end = scan.begin[n + 1];
      const bool fresh = id >= scan.first_new;
      for (std::size_t c = 0; c < width; ++c) {
        if (carried_[c].keep == Keep::First) {
          if (!fresh) continue;
          const std::uint32_t* const first = scan.returns.data() + begin;
          columns_[c].value[id] = values[*std::min_element(first, first + scan.first_ties[n]) * width + c];
          continue;
        }
        const std::int32_t before = fresh ? valueOf(begin, c) : columns_[c].value[id];
        bool agree = fresh || !isSplit(columns_[c], id);
        for (std::uint32_t m = begin; agree && m < end; ++m) agree = valueOf(m, c) == before;
        // What a new point that is split has by then is no return's: see addSplit().
        if (fresh) columns_[c].value[id] = agree ? before : kNoAttribute;
        if (!agree) is_split_[n] = 1;
      }
    }
  });
  for (std::uint32_t n = 0; n < count; ++n) {
    if (is_split_[n] != 0) split_.push_back(n);
  }
  return split_;
}

/// @param returns  of the point, with those of this scan
void PointAttributes::addSplit(const ReturnsOfPoints& scan, std::span<const std::int32_t> values, std::uint32_t n,
                               std::uint32_t returns) {
  const std::size_t width = columns_.size();
  const std::uint32_t id = scan.ids[n], begin = scan.begin[n], end = scan.begin[n + 1];
  const bool fresh = id >= scan.first_new;
  for (std::size_t c = 0; c < width; ++c) {
    if (carried_[c].keep == Keep::First) continue;
    Column& column = columns_[c];
    if (!isSplit(column, id)) {
      const std::int32_t before = column.value[id];
      bool agree = true;
      for (std::uint32_t m = begin; agree && m < end; ++m) agree = values[scan.returns[m] * width + c] == before;
      if (agree) continue;  // another column is the one that is split
      makeSplit(column, id);
      const std::uint32_t earlier = returns - std::min(returns, end - begin);
      if (!fresh && before != kNoAttribute) addVote(column, id, {before, earlier});
    }
    for (std::uint32_t m = begin; m < end; ++m) {
      const std::int32_t value = values[scan.returns[m] * width + c];
      if (value != kNoAttribute) addVote(column, id, {value, 1});
    }
  }
}

void PointAttributes::makeSplit(Column& column, std::uint32_t id) {
  column.split[id / 64] |= std::uint64_t{1} << (id % 64);
  column.value[id] = std::bit_cast<std::int32_t>(kEnd);
}

void PointAttributes::addVote(Column& column, std::uint32_t id, const Vote& vote) {
  std::uint32_t before = kEnd, at = std::bit_cast<std::uint32_t>(column.value[id]);
  while (at != kEnd && column.pool[at].vote.value < vote.value) before = std::exchange(at, column.pool[at].next);
  if (at != kEnd && column.pool[at].vote.value == vote.value) {
    column.pool[at].vote.returns = saturated(column.pool[at].vote.returns, vote.returns);
    return;
  }
  const auto added = static_cast<std::uint32_t>(column.pool.size());
  column.pool.push_back({vote, at});
  if (before == kEnd) {
    column.value[id] = std::bit_cast<std::int32_t>(added);
  } else {
    column.pool[before].next = added;
  }
}

void PointAttributes::restore(std::span<const std::int32_t> values) {
  const std::size_t width = columns_.size();
  if (width == 0) return;
  const std::size_t first = columns_.front().value.size(), count = values.size() / width;
  grow(static_cast<std::uint32_t>(first + count));
  for (std::size_t n = 0; n < count; ++n) {
    for (std::size_t c = 0; c < width; ++c) columns_[c].value[first + n] = values[n * width + c];
  }
}

bool PointAttributes::restoreVotes(std::uint32_t id, std::size_t c, std::span<const Vote> votes) {
  Column& column = columns_[c];
  if (id >= column.value.size() || isSplit(column, id) || votes.empty()) return false;
  const std::int32_t said = column.value[id];
  for (std::size_t n = 0; n < votes.size(); ++n) {
    if (votes[n].value == kNoAttribute || votes[n].returns == 0) return false;
    if (n > 0 && votes[n].value <= votes[n - 1].value) return false;
  }
  makeSplit(column, id);
  for (const Vote& vote : votes) addVote(column, id, vote);
  return value(id, c) == said;
}

std::uint64_t PointAttributes::bytes() const {
  std::uint64_t bytes = is_split_.capacity() + split_.capacity() * sizeof(split_[0]);
  for (const Column& column : columns_) bytes += column.value.bytes() + column.split.bytes() + column.pool.bytes();
  return bytes;
}

}  // namespace accessvdb::internal
