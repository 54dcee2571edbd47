// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/waiting_flips.h"

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdlib>
#include <utility>

#include "hostdev/cell_counts.h"
#include "update/flip_set.h"

namespace accessvdb::internal {
namespace {

using kernels::LeafFlips;

/// Adds two counts of freed voxels, cell by cell.
std::uint64_t joinedFreed(std::uint64_t a, std::uint64_t b) {
  std::uint64_t sum = 0;
  for (int shift = 0; shift < 64; shift += 8) {
    const std::uint64_t cell = (a >> shift & 0xff) + (b >> shift & 0xff);
    sum |= std::min<std::uint64_t>(cell, LeafFlips::kManyFreed) << shift;
  }
  return sum;
}

/// Appends codes of the voxels of a leaf. @param collides  what they began to do, or ceased
void appendVoxels(const LeafBits& bits, bool collides, std::vector<std::uint16_t>& voxels) {
  for (std::size_t x = 0; x < bits.size(); ++x) {
    for (std::uint64_t left = bits[x]; left != 0; left &= left - 1) {
      voxels.push_back(kernels::flipped_voxel::codeOf(static_cast<int>(64 * x) + std::countr_zero(left), collides));
    }
  }
}

std::array<std::int32_t, 3> placeOf(const LeafFlips& flips) { return {flips.leaf[0], flips.leaf[1], flips.leaf[2]}; }

}  // namespace

void WaitingFlips::add(const LeafChange& change, bool with_voxels) {
  const Index3 leaf = parentOf(change.origin_ijk);
  const kernels::ColumnsForArm freed = kernels::columnsForArm(change.arm_free_on.data()),
                               blocked = kernels::columnsForArm(change.arm_free_off.data());
  LeafFlips flips = {{leaf[0], leaf[1], leaf[2]},
                     kindsOf(change),
                     static_cast<std::uint8_t>(freed.heights),
                     static_cast<std::uint8_t>(blocked.heights),
                     kernels::countCells(change.collides_off.data()),
                     freed.columns,
                     blocked.columns};
  if (with_voxels) {
    const std::size_t before = voxels_.size();
    appendVoxels(change.collides_on, true, voxels_);
    appendVoxels(change.collides_off, false, voxels_);
    flips.first_voxel = first_ + static_cast<std::uint32_t>(before);
    flips.voxels = static_cast<std::uint32_t>(voxels_.size() - before);
  }
  leaves_.push_back(flips);
}

void WaitingFlips::beginVoxelsAt(std::uint32_t first) {
  const std::uint32_t more = first - std::exchange(first_, first);
  if (more == 0) return;
  for (LeafFlips& flips : leaves_) flips.first_voxel += more;
}

void WaitingFlips::join() {
  tbb::parallel_sort(leaves_.begin(), leaves_.end(),
                     [](const LeafFlips& a, const LeafFlips& b) { return placeOf(a) < placeOf(b); });
  std::vector<std::uint16_t> joined;
  // Of each voxel of the leaf, how often it began to collide, less how often it ceased to. Other lists may hold what
  // happened in between, so that it need not be one of -1, 0 and 1.
  std::array<int, 512> began = {};
  std::size_t out = 0;
  for (std::size_t n = 0; n < leaves_.size(); ++n) {
    const LeafFlips flips = leaves_[n];
    for (std::uint32_t v = 0; v < flips.voxels; ++v) {
      const std::uint16_t code = voxels_[flips.first_voxel - first_ + v];
      began[code >> 1] += (code & 1) != 0 ? 1 : -1;
    }
    if (out > 0 && placeOf(leaves_[out - 1]) == placeOf(flips)) {
      LeafFlips& before = leaves_[out - 1];
      before.kinds |= flips.kinds;
      before.freed_heights |= flips.freed_heights;
      before.blocked_heights |= flips.blocked_heights;
      before.freed = joinedFreed(before.freed, flips.freed);
      before.freed_columns |= flips.freed_columns;
      before.blocked_columns |= flips.blocked_columns;
    } else {
      leaves_[out++] = flips;
    }
    if (n + 1 < leaves_.size() && placeOf(leaves_[n + 1]) == placeOf(flips)) continue;
    leaves_[out - 1].first_voxel = first_ + static_cast<std::uint32_t>(joined.size());
    for (std::size_t at = 0; at < began.size(); ++at) {
      const std::uint16_t code = kernels::flipped_voxel::codeOf(static_cast<int>(at), began[at] > 0);
      joined.insert(joined.end(), static_cast<std::size_t>(std::abs(began[at])), code);
      began[at] = 0;
    }
    leaves_[out - 1].voxels = first_ + static_cast<std::uint32_t>(joined.size()) - leaves_[out - 1].first_voxel;
  }
  leaves_.resize(out);
  voxels_ = std::move(joined);
}

void WaitingFlips::clear() {
  leaves_.clear();
  voxels_.clear();
  first_ = 0;
}

}  // namespace accessvdb::internal
