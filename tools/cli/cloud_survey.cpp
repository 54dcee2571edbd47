// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cloud_survey.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

namespace accessvdb::tools {
namespace {

constexpr std::size_t kMostKept = 3'000'000, kMostKeptRanges = 1'000'000;
constexpr double kBlock_m = 2;
/// Planes: points for a fit that means something, how much wider than thick, and how many of them.
constexpr std::size_t kPlanePoints = 15, kLeastPlanes = 30;
constexpr double kWiderThanThick = 5;
/// Rays that graze a plane say little about ranges.
constexpr double kLeastCosine = 0.4;
constexpr std::size_t kSpacingQueries = 20'000;

using Cell = std::array<std::int64_t, 3>;

Cell cellAt(const Eigen::Vector3f& p, double edge_m) {
  Cell cell;
  for (int axis = 0; axis < 3; ++axis)
    cell[static_cast<std::size_t>(axis)] = static_cast<std::int64_t>(std::floor(static_cast<double>(p[axis]) / edge_m));
  return cell;
}

std::uint64_t mixed(const Cell& cell) {
  std::uint64_t hash = 0x9e3779b97f4a7c15;
  for (const std::int64_t part : cell) {
    hash ^= static_cast<std::uint64_t>(part) + 0x9e3779b97f4a7c15 + (hash << 6) + (hash >> 2);
    hash *= 0xff51afd7ed558ccd;
    hash ^= hash >> 33;
  }
  return hash;
}
struct CellHash {
  std::size_t operator()(const Cell& cell) const { return mixed(cell); }
};
template <typename Value>
using Cells = std::unordered_map<Cell, Value, CellHash>;

double middleOf(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void CloudSurvey::keep(const Return& one) {
  if (mixed(cellAt(one.p_L, kBlock_m)) % block_share_ != 0) return;
  kept_.push_back(one);
  if (kept_.size() <= kMostKept) return;
  block_share_ *= 2;
  std::erase_if(kept_, [this](const Return& other) { return mixed(cellAt(other.p_L, kBlock_m)) % block_share_ != 0; });
}

void CloudSurvey::add(const io::ScanRecord& record) {
  const auto addReturn = [this](const Eigen::Vector3d& sensor_W, const Eigen::Vector3d& p_W) {
    const double range_m = (p_W - sensor_W).norm();
    if (!(range_m > 0) || !std::isfinite(range_m)) return;
    if (!origin_W_) origin_W_ = sensor_W;
    ++returns_;
    extent_W_.extend(p_W);
    if (ranges_m_.size() < kMostKeptRanges) ranges_m_.push_back(static_cast<float>(range_m));
    keep({(p_W - *origin_W_).cast<float>(), ((sensor_W - p_W) / range_m).cast<float>()});
  };
  for (std::size_t i = 0; i < record.points_W.size(); ++i)
    addReturn(record.origins_W.size() == 1 ? record.origins_W[0] : record.origins_W.at(i), record.points_W[i]);
  for (const Eigen::Vector3f& p_S : record.points_S)
    addReturn(record.T_W_S.translation(), record.T_W_S * p_S.cast<double>());
}

double CloudSurvey::medianRange_m() const {
  std::vector<double> ranges(ranges_m_.begin(), ranges_m_.end());
  return ranges.empty() ? 0 : middleOf(ranges);
}

double CloudSurvey::shareSeen(double voxel_m, double least, double times) const {
  if (kept_.empty()) return 0;
  Cells<std::uint32_t> count;
  for (const Return& one : kept_) ++count[cellAt(one.p_L, voxel_m)];
  std::uint64_t seen = 0;
  for (const auto& [cell, own] : count) {
    double around = 0;
    for (std::int64_t x = -1; x <= 1; ++x)
      for (std::int64_t y = -1; y <= 1; ++y)
        for (std::int64_t z = -1; z <= 1; ++z) {
          const auto near = count.find({cell[0] + x, cell[1] + y, cell[2] + z});
          if (near != count.end()) around += near->second;
        }
    if (around * times >= least) seen += own;
  }
  return static_cast<double>(seen) / static_cast<double>(kept_.size());
}

double CloudSurvey::spacing_m() const {
  if (kept_.size() < 2) return 0;
  // Cells that hold a few points each, found by doubling; a nearest neighbour beyond the cells around counts as one
  // cell away.
  double cell_m = 1e-3;
  Cells<std::vector<std::uint32_t>> cells;
  for (; cell_m < 100; cell_m *= 2) {
    cells.clear();
    for (std::uint32_t n = 0; n < kept_.size(); ++n) cells[cellAt(kept_[n].p_L, cell_m)].push_back(n);
    if (cells.size() * 4 <= kept_.size()) break;
  }
  std::vector<double> nearest;
  const std::size_t stride = std::max<std::size_t>(1, kept_.size() / kSpacingQueries);
  for (std::size_t n = 0; n < kept_.size(); n += stride) {
    const Cell own = cellAt(kept_[n].p_L, cell_m);
    double best = cell_m;
    for (std::int64_t i = 0; i < 27; ++i) {
      const auto near = cells.find({own[0] + i / 9 - 1, own[1] + i / 3 % 3 - 1, own[2] + i % 3 - 1});
      if (near == cells.end()) continue;
      for (const std::uint32_t other : near->second)
        if (other != n) best = std::min(best, static_cast<double>((kept_[other].p_L - kept_[n].p_L).norm()));
    }
    nearest.push_back(best);
  }
  return middleOf(nearest);
}

std::optional<PlaneNoise> CloudSurvey::noise() const {
  std::optional<PlaneNoise> best;
  double best_share = 0;
  for (const double edge_m : {0.05, 0.1, 0.2, 0.4, 0.8}) {
    Cells<std::vector<std::uint32_t>> cells;
    for (std::uint32_t n = 0; n < kept_.size(); ++n) cells[cellAt(kept_[n].p_L, edge_m)].push_back(n);
    std::vector<double> sigmas;
    std::size_t candidates = 0;
    for (const auto& [cell, points] : cells) {
      if (points.size() < kPlanePoints) continue;
      ++candidates;
      const auto count = static_cast<double>(points.size());
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      for (const std::uint32_t n : points) mean += kept_[n].p_L.cast<double>();
      mean /= count;
      Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
      for (const std::uint32_t n : points) {
        const Eigen::Vector3d d = kept_[n].p_L.cast<double>() - mean;
        spread += d * d.transpose();
      }
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread / (count - 3));
      if (!(std::sqrt(axes.eigenvalues()[1]) >= kWiderThanThick * std::sqrt(std::max(0.0, axes.eigenvalues()[0]))))
        continue;
      const Eigen::Vector3d normal = axes.eigenvectors().col(0);
      double squares = 0, used = 0;
      for (const std::uint32_t n : points) {
        const double cosine = std::abs(normal.dot(kept_[n].u.cast<double>()));
        if (cosine < kLeastCosine) continue;
        const double along_m = normal.dot(kept_[n].p_L.cast<double>() - mean) / cosine;
        squares += along_m * along_m;
        ++used;
      }
      if (used * 2 < count || used <= 3) continue;
      sigmas.push_back(std::sqrt(squares / used * count / (count - 3)));
    }
    if (sigmas.size() < kLeastPlanes) continue;
    const double share = static_cast<double>(sigmas.size()) / static_cast<double>(candidates);
    if (best && share <= best_share) continue;
    best_share = share;
    const std::uint64_t planes = sigmas.size();
    best = PlaneNoise{middleOf(sigmas), edge_m, planes};
    // In small cubes only the thinnest pass for planes; in large ones a surface is no longer flat.
    if (share >= 0.5) break;
  }
  return best;
}

}  // namespace accessvdb::tools
