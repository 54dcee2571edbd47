// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/cloud_survey.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

namespace accessvdb::tools {
namespace {

constexpr std::size_t kMostKept = 3'000'000, kMostKeptRanges = 1'000'000;
constexpr double kBlock_m = 2;
/// No LiDAR measures that far: a number in a damaged file does.
constexpr double kFarthest_m = 1e7;
/// Planes: points for a fit that means something, how much wider than thick, and how many of them.
constexpr std::size_t kPlanePoints = 15, kLeastPlanes = 10;
constexpr double kWiderThanThick = 3;
/// Rays that graze a plane say little about ranges.
constexpr double kLeastCosine = 0.4;
constexpr std::size_t kSpacingQueries = 20'000, kMostSeeds = 2'000;

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
    if (!(range_m > 0 && range_m <= kFarthest_m)) return;
    if (!origin_W_) origin_W_ = sensor_W;
    if (!((p_W - *origin_W_).norm() <= kFarthest_m)) return;
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
    const auto [sigmas, seeds] = planesOf(edge_m);
    if (sigmas.size() < kLeastPlanes) continue;
    const double share = static_cast<double>(sigmas.size()) / static_cast<double>(seeds);
    if (best && share <= best_share) continue;
    best_share = share;
    std::vector<double> values = sigmas;
    best = PlaneNoise{middleOf(values), edge_m, sigmas.size()};
    // In small discs only the thinnest pass for planes; in large ones a surface is no longer flat.
    if (share >= 0.5) break;
  }
  return best;
}

std::pair<std::vector<double>, std::size_t> CloudSurvey::planesOf(double edge_m) const {
  Cells<std::vector<std::uint32_t>> cells;
  for (std::uint32_t n = 0; n < kept_.size(); ++n) cells[cellAt(kept_[n].p_L, edge_m)].push_back(n);
  std::vector<Cell> seeds;
  for (const auto& [cell, points] : cells)
    if (points.size() >= kPlanePoints) seeds.push_back(cell);
  // By place, not by the order of a hash table, which is the library's own affair.
  std::sort(seeds.begin(), seeds.end());
  std::vector<double> sigmas;
  const std::size_t stride = std::max<std::size_t>(1, seeds.size() / kMostSeeds);
  std::size_t tried = 0;
  for (std::size_t i = 0; i < seeds.size(); i += stride, ++tried) {
    std::vector<std::uint32_t> around;
    for (std::int64_t k = 0; k < 27; ++k) {
      const auto near = cells.find({seeds[i][0] + k / 9 - 1, seeds[i][1] + k / 3 % 3 - 1, seeds[i][2] + k % 3 - 1});
      if (near != cells.end()) around.insert(around.end(), near->second.begin(), near->second.end());
    }
    if (const auto sigma_m = thicknessOf(cells.at(seeds[i]), around, edge_m)) sigmas.push_back(*sigma_m);
  }
  return {sigmas, tried};
}

/// A cube cuts off the noise of a surface that runs along its face, so the plane that it finds only begins the search:
/// a disc around it that is as high as it is wide holds all of it.
std::optional<double> CloudSurvey::thicknessOf(const std::vector<std::uint32_t>& seed,
                                               const std::vector<std::uint32_t>& around, double edge_m) const {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const std::uint32_t n : seed) middle += kept_[n].p_L.cast<double>();
  middle /= static_cast<double>(seed.size());
  const double radius_m = edge_m / 2;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // none yet: a ball
  std::vector<std::uint32_t> disc;
  Eigen::Vector3d spread_m2 = Eigen::Vector3d::Zero();
  for (int pass = 0; pass < 3; ++pass) {
    disc.clear();
    for (const std::uint32_t n : around) {
      const Eigen::Vector3d d = kept_[n].p_L.cast<double>() - middle;
      const double height_m = normal.dot(d);
      if (std::abs(height_m) <= radius_m && (d - height_m * normal).norm() <= radius_m) disc.push_back(n);
    }
    if (disc.size() < kPlanePoints) return std::nullopt;
    middle.setZero();
    for (const std::uint32_t n : disc) middle += kept_[n].p_L.cast<double>();
    middle /= static_cast<double>(disc.size());
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const std::uint32_t n : disc) {
      const Eigen::Vector3d d = kept_[n].p_L.cast<double>() - middle;
      spread += d * d.transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread / static_cast<double>(disc.size() - 3));
    normal = axes.eigenvectors().col(0);
    spread_m2 = axes.eigenvalues().cwiseMax(0.0);
  }
  if (!(std::sqrt(spread_m2[1]) >= kWiderThanThick * std::sqrt(spread_m2[0]))) return std::nullopt;
  double squares = 0, used = 0;
  for (const std::uint32_t n : disc) {
    const double cosine = std::abs(normal.dot(kept_[n].u.cast<double>()));
    if (cosine < kLeastCosine) continue;
    const double along_m = normal.dot(kept_[n].p_L.cast<double>() - middle) / cosine;
    squares += along_m * along_m;
    ++used;
  }
  const auto count = static_cast<double>(disc.size());
  if (used * 2 < count || used <= 3) return std::nullopt;
  return std::sqrt(squares / used * count / (count - 3));
}

}  // namespace accessvdb::tools
