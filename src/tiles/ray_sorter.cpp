// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/ray_sorter.h"

#include <algorithm>
#include <cmath>

namespace accessvdb::tiles {
namespace {

struct PartOfRay {
  double low, high;
};

/// The part of a way from 0 to 1 that lies from low to high along one axis.
PartOfRay partWithin(double from, double to, double low, double high) {
  if (from == to) return {0, 1};
  const double a = (low - from) / (to - from), b = (high - from) / (to - from);
  return {std::clamp(std::min(a, b), 0.0, 1.0), std::clamp(std::max(a, b), 0.0, 1.0)};
}

}  // namespace

RaySorter::RaySorter(std::int32_t tile_voxels, std::int32_t margin_voxels, double voxel_size_m)
    : tile_voxels_(tile_voxels), margin_voxels_(margin_voxels), voxel_size_m_(voxel_size_m) {}

std::span<const TileIndex> RaySorter::sort(const internal::GatedScan& scan, const Wanted& is_wanted) {
  rays_of_.clear();
  crossed_.clear();
  for (std::uint32_t n = 0; n < scan.p_L.size(); ++n) {
    const Eigen::Vector2d from = voxelsOf(scan.q_L[scan.q_L.size() == 1 ? 0 : n]), to = voxelsOf(scan.p_L[n]);
    forEachTile(from, to, [&](const TileIndex& id) {
      auto tile = rays_of_.find(id);
      if (tile == rays_of_.end()) tile = rays_of_.emplace(id, Rays{is_wanted(id), {}}).first;
      if (tile->second.wanted) tile->second.rays.push_back(n);
    });
  }
  for (const auto& [id, tile] : rays_of_) {
    if (tile.wanted) crossed_.push_back(id);
  }
  return crossed_;
}

Eigen::Vector2d RaySorter::voxelsOf(const Eigen::Vector3f& x_L) const {
  return x_L.head<2>().cast<double>() / voxel_size_m_;
}

/// Column by column of tiles: which of its rows the part of the ray in it comes near.
template <typename Visit>
void RaySorter::forEachTile(const Eigen::Vector2d& from, const Eigen::Vector2d& to, const Visit& visit) const {
  const auto first = [this](double x) {
    return static_cast<std::int32_t>(std::floor((x - margin_voxels_) / tile_voxels_));
  };
  const auto last = [this](double x) {
    return static_cast<std::int32_t>(std::floor((x + margin_voxels_) / tile_voxels_));
  };
  TileIndex id;
  for (id.first = first(std::min(from.x(), to.x())); id.first <= last(std::max(from.x(), to.x())); ++id.first) {
    const double begin = static_cast<double>(id.first) * tile_voxels_;
    const PartOfRay part = partWithin(from.x(), to.x(), begin - margin_voxels_, begin + tile_voxels_ + margin_voxels_);
    const double a = from.y() + part.low * (to.y() - from.y()), b = from.y() + part.high * (to.y() - from.y());
    for (id.second = first(std::min(a, b)); id.second <= last(std::max(a, b)); ++id.second) visit(id);
  }
}

internal::FieldAccess::Returns RaySorter::raysOf(const TileIndex& tile, const internal::GatedScan& scan) {
  p_L_.clear();
  q_L_.clear();
  const auto found = rays_of_.find(tile);
  if (found == rays_of_.end()) return {p_L_, scan.q_L};
  for (const std::uint32_t n : found->second.rays) p_L_.push_back(scan.p_L[n]);
  if (scan.q_L.size() <= 1) return {p_L_, scan.q_L};
  for (const std::uint32_t n : found->second.rays) q_L_.push_back(scan.q_L[n]);
  return {p_L_, q_L_};
}

}  // namespace accessvdb::tiles
