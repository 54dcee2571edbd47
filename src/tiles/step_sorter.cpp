// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/step_sorter.h"

#include <algorithm>

#include "hostdev/occupancy_query.h"
#include "hostdev/voxel_scale.h"

namespace accessvdb::tiles {
namespace {

void gather(const std::vector<Eigen::Vector3f>& from, const std::vector<std::uint32_t>& which,
            std::vector<Eigen::Vector3f>& to) {
  to.resize(which.size());
  for (std::size_t n = 0; n < which.size(); ++n) to[n] = from[which[n]];
}

void gatherRows(const std::vector<std::int32_t>& from, std::size_t rows, const std::vector<std::uint32_t>& which,
                std::vector<std::int32_t>& to) {
  const std::size_t width = from.size() / rows;
  to.resize(which.size() * width);
  for (std::size_t n = 0; n < which.size(); ++n) {
    std::copy_n(from.begin() + static_cast<std::ptrdiff_t>(which[n] * width), width,
                to.begin() + static_cast<std::ptrdiff_t>(n * width));
  }
}

}  // namespace

float longestRay_m(const internal::GatedScan& scan) {
  float longest_m = 0;
  for (std::size_t n = 0; n < scan.p_L.size(); ++n) {
    longest_m = std::max(longest_m, (scan.p_L[n] - scan.q_L[scan.q_L.size() > 1 ? n : 0]).norm());
  }
  return longest_m;
}

StepSorter::StepSorter(std::int32_t tile_voxels, std::int32_t margin_voxels, double voxel_size_m)
    : grid_(tile_voxels, margin_voxels), inverse_voxel_size_(kernels::VoxelScale(voxel_size_m).inverse_float32) {}

std::span<const TileIndex> StepSorter::sort(const internal::GatedScan& scan) {
  // A long walk leaves most tiles behind: their lists go.
  if (returns_of_.size() > 2 * touched_.size() + 16) returns_of_.clear();
  for (const TileIndex& tile : touched_) returns_of_[tile].clear();
  touched_.clear();
  TileIndex last_tile;
  std::vector<std::uint32_t>* last = nullptr;
  for (std::uint32_t n = 0; n < scan.p_L.size(); ++n) {
    const Eigen::Vector3f& p_L = scan.p_L[n];
    const auto ijk = kernels::voxelOf(p_L.x(), p_L.y(), p_L.z(), inverse_voxel_size_);
    const TileRange tiles = grid_.around(ijk[0], ijk[1]);
    for (std::int32_t x = tiles.x_low; x <= tiles.x_high; ++x) {
      for (std::int32_t y = tiles.y_low; y <= tiles.y_high; ++y) {
        if (last == nullptr || last_tile != TileIndex{x, y}) {
          last_tile = {x, y};
          last = &returns_of_[last_tile];
        }
        if (last->empty()) touched_.push_back(last_tile);
        last->push_back(n);
      }
    }
  }
  return touched_;
}

StepSorter::Returns StepSorter::returnsOf(const TileIndex& tile, const internal::GatedScan& scan) {
  const std::vector<std::uint32_t>& which = returns_of_.at(tile);
  gather(scan.p_L, which, p_L_);
  gatherRows(scan.attributes, scan.p_L.size(), which, attributes_);
  // One return with its own sensor has one sensor, as it should.
  if (scan.q_L.size() <= 1) return {p_L_, scan.q_L, attributes_};
  gather(scan.q_L, which, q_L_);
  return {p_L_, q_L_, attributes_};
}

}  // namespace accessvdb::tiles
