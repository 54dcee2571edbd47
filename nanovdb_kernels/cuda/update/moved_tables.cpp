// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/moved_tables.h"

#include <algorithm>

#include "cuda/memory/growing.h"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {

void MovedTables::grow(std::uint32_t points, std::uint32_t blocks, cudaStream_t stream) {
  growFilled(ids_, memory_, points, 0, stream);
  growFilled(bits_, memory_, points / 32 + 1, 0, stream);
  growFilled(changed_bits_, memory_, points / 32 + 1, 0, stream);
  growFilled(touched_blocks_, memory_, blocks, 0, stream);
  growFilled(reached_blocks_, memory_, blocks, 0, stream);
  growFilled(blocks_, memory_, blocks, 0, stream);
  growFilled(head_, memory_, blocks, 0xff, stream);
  growFilled(reached_bits_, memory_, blocks / 32 + 1, 0, stream);
  view_.ids = ids_.data();
  view_.bits = bits_.data();
  view_.changed_bits = changed_bits_.data();
  view_.blocks = blocks_.data();
  view_.places.head = head_.data();
  view_.places.touched_blocks = touched_blocks_.data();
  view_.places.reached_bits = reached_bits_.data();
  view_.places.reached_blocks = reached_blocks_.data();
}

std::uint32_t MovedTables::addPlaces(std::uint32_t more) {
  const std::uint32_t first = places_used_;
  places_used_ += more;
  places_.growWithRoom(memory_, places_used_, roomFor(places_used_), first);
  view_.places.places = places_.data();
  return first;
}

void MovedTables::find(const PointsView& points, const CompetitionView& competition, cudaStream_t stream) {
  launchFindMoved(points, view_, competition, std::min(places_used_, points.index.blocks), stream);
}

void MovedTables::addCrossed(std::span<const PointWeight> crossed, const PointStateView& points, cudaStream_t stream) {
  launchAddCrossed(points, view_, crossed_.send(crossed, memory_, stream), stream);
}

void MovedTables::clear(cudaStream_t stream) {
  fillBytes(bits_.data(), 0, bits_.bytes(), stream);
  fillBytes(changed_bits_.data(), 0, changed_bits_.bytes(), stream);
  fillBytes(reached_bits_.data(), 0, reached_bits_.bytes(), stream);
  fillBytes(head_.data(), 0xff, head_.bytes(), stream);
  places_used_ = 0;
}

}  // namespace accessvdb::kernels
