// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/dense_view.h"

#include <openvdb/tools/Morphology.h>
#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <unordered_map>
#include <utility>

#include "vdb/standard_grids.h"

namespace accessvdb::eval {
namespace {

/// A plane has three unknowns: with four times as many returns it has half their noise, and with fewer than six one
/// stray return turns it.
constexpr std::size_t kEnoughReturns = 12, kFewestReturns = 6;
/// Radius of a patch: this many voxels where returns are exact and dense, and this many sigma beyond that, so that all
/// returns of one surface are in it; and at most this many voxels (or twice the least) where they are sparse.
constexpr double kLeastRadius_v = 1.5, kRadius_sigma = 4, kMostRadius_v = 4, kWiden = 1.4;
/// The window follows the surface that it finds: the mean of returns around a place beside the surface is off centre.
/// It is still when it moves by less than this share of its radius.
constexpr int kMostRounds = 20;
constexpr double kStill = 0.005;
/// Returns on a line do not determine a plane: second largest variance to largest.
constexpr double kLeastBreadth = 0.05;
/// Space before a patch is free as far as this: the rays that ended on it came through. Rays are noted up to there
/// only, so that the cells around their ends do not reach far behind the surface.
constexpr double kBefore_v = 3;
constexpr double kCell_v = 2;  ///< edge of the cells in which rays are noted

openvdb::Coord cellOf(const Eigen::Vector3d& p, double edge) {
  return {static_cast<int>(std::floor(p.x() / edge)), static_cast<int>(std::floor(p.y() / edge)),
          static_cast<int>(std::floor(p.z() / edge))};
}

/// The returns, by cells, in a frame near them.
class ReturnsNear {
 public:
  ReturnsNear(std::span<const SeenReturn> returns, const Eigen::Vector3d& origin_W, double edge_m)
      : edge_m_(edge_m), p_(returns.size()), sensor_(returns.size()) {
    std::vector<std::pair<openvdb::Coord, std::uint32_t>> order(returns.size());
    for (std::size_t n = 0; n < returns.size(); ++n) {
      order[n] = {cellOf(returns[n].p_W - origin_W, edge_m), static_cast<std::uint32_t>(n)};
    }
    std::sort(order.begin(), order.end());
    for (std::size_t n = 0; n < order.size(); ++n) {
      const SeenReturn& seen = returns[order[n].second];
      p_[n] = (seen.p_W - origin_W).cast<float>();
      sensor_[n] = (seen.sensor_W - origin_W).cast<float>();
      Range& range = cells_.try_emplace(order[n].first, Range{n, n}).first->second;
      range.end = n + 1;
    }
  }

  /// Calls back with position and sensor of each return within `radius_m`.
  template <typename Call>
  void within(const Eigen::Vector3d& centre, double radius_m, const Call& call) const {
    const openvdb::Coord low = cellOf(centre - Eigen::Vector3d::Constant(radius_m), edge_m_),
                         high = cellOf(centre + Eigen::Vector3d::Constant(radius_m), edge_m_);
    const Eigen::Vector3f c = centre.cast<float>();
    const auto most = static_cast<float>(radius_m * radius_m);
    for (auto cell = openvdb::CoordBBox(low, high).begin(); cell; ++cell) {
      const auto found = cells_.find(*cell);
      if (found == cells_.end()) continue;
      for (std::size_t n = found->second.begin; n < found->second.end; ++n) {
        if ((p_[n] - c).squaredNorm() < most) call(p_[n], sensor_[n]);
      }
    }
  }

 private:
  struct Range {
    std::size_t begin, end;
  };
  double edge_m_;
  std::vector<Eigen::Vector3f> p_, sensor_;
  std::unordered_map<openvdb::Coord, Range> cells_;
};

/// A piece of a surface, seen from the side that its normal points to.
struct Patch {
  Eigen::Vector3f centre, normal;
  float radius = 0;
  std::uint32_t returns = 0;
};

/// The plane through the returns around a place, weighted towards the middle.
std::optional<Patch> planeAround(const ReturnsNear& returns, const Eigen::Vector3d& centre, double radius_m) {
  std::uint32_t count = 0;
  double weights = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), to_sensor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  returns.within(centre, radius_m, [&](const Eigen::Vector3f& p, const Eigen::Vector3f& sensor) {
    const Eigen::Vector3d d = p.cast<double>() - centre;
    const double fall = 1 - d.squaredNorm() / (radius_m * radius_m), weight = fall * fall;
    ++count;
    weights += weight;
    sum += weight * d;
    squares += weight * d * d.transpose();
    to_sensor += weight * (sensor - p).cast<double>().normalized();
  });
  if (count < kFewestReturns || !(weights > 0)) return std::nullopt;
  const Eigen::Vector3d mean = sum / weights;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(squares / weights - mean * mean.transpose());
  if (!(axes.eigenvalues()[1] >= kLeastBreadth * axes.eigenvalues()[2])) return std::nullopt;
  Eigen::Vector3d normal = axes.eigenvectors().col(0);
  if (normal.dot(to_sensor) < 0) normal = -normal;
  return Patch{(centre + mean).cast<float>(), normal.cast<float>(), static_cast<float>(radius_m), count};
}

/// The mean return of each cell with this edge: where to look for surfaces.
std::vector<Eigen::Vector3d> seedsOf(std::span<const SeenReturn> returns, const Eigen::Vector3d& origin_W,
                                     double edge_m) {
  struct Sum {
    Eigen::Vector3d of_all = Eigen::Vector3d::Zero();
    double count = 0;
  };
  std::unordered_map<openvdb::Coord, std::size_t> cells;
  std::vector<Sum> sums;  // in the order of the returns, so that it is the same on every machine
  for (const SeenReturn& seen : returns) {
    const Eigen::Vector3d p = seen.p_W - origin_W;
    const auto [cell, is_new] = cells.try_emplace(cellOf(p, edge_m), sums.size());
    if (is_new) sums.emplace_back();
    sums[cell->second].of_all += p;
    ++sums[cell->second].count;
  }
  std::vector<Eigen::Vector3d> seeds;
  seeds.reserve(sums.size());
  for (const Sum& sum : sums) seeds.emplace_back(sum.of_all / sum.count);
  return seeds;
}

/// The surface next to a place, by a patch of the least radius that determines it.
std::optional<Patch> surfaceNear(const ReturnsNear& returns, const Eigen::Vector3d& seed, double least_m,
                                 double most_m) {
  for (double radius_m = least_m;; radius_m = std::min(kWiden * radius_m, most_m)) {
    const bool widest = radius_m >= most_m;
    std::optional<Patch> patch = planeAround(returns, seed, radius_m);
    Eigen::Vector3d centre = seed;
    for (int round = 0; patch && round < kMostRounds; ++round) {
      // Along the normal only: along the surface the window stays, or patches would gather where returns are densest.
      const Eigen::Vector3d normal = patch->normal.cast<double>();
      const Eigen::Vector3d shift = normal * normal.dot(patch->centre.cast<double>() - centre);
      centre += shift;
      patch->centre = centre.cast<float>();
      if (shift.norm() < kStill * radius_m) break;
      patch = planeAround(returns, centre, radius_m);
    }
    if (patch && (widest || patch->returns >= kEnoughReturns)) return patch;
    if (widest) return std::nullopt;
  }
}

}  // namespace

struct DenseView::Impl {
  DenseViewOptions options;
  Eigen::Vector3d origin_W = Eigen::Vector3d::Zero();
  std::vector<Patch> patches;
  openvdb::Int32Grid::Ptr nearest = openvdb::Int32Grid::create(-1);  // of each voxel-sized cell, by its middle
  openvdb::BoolGrid::Ptr passed = openvdb::BoolGrid::create();
  using NearestReader = openvdb::Int32Grid::ConstUnsafeAccessor;
  using PassedReader = openvdb::BoolGrid::ConstUnsafeAccessor;
  // An accessor remembers where it was last, so each thread has its own.
  mutable tbb::enumerable_thread_specific<std::pair<NearestReader, PassedReader>> readers{
      [this] { return std::pair(NearestReader(nearest->tree()), PassedReader(passed->tree())); }};

  explicit Impl(const DenseViewOptions& given) : options(given) {}

  void fitPatches(std::span<const SeenReturn> returns);
  void noteNearest();
  void noteRays(std::span<const SeenReturn> returns);

  struct Found {
    double before_m = 0;  ///< along the patch's normal
    const Patch* patch = nullptr;
  };
  [[nodiscard]] Found patchAt(const Eigen::Vector3d& p) const {
    const int index = readers.local().first.getValue(cellOf(p, options.voxel_size_m));
    if (index < 0) return {};
    const Patch& patch = patches[static_cast<std::size_t>(index)];
    const Eigen::Vector3d d = p - patch.centre.cast<double>(), normal = patch.normal.cast<double>();
    const double before_m = d.dot(normal), beside_m = (d - before_m * normal).norm();
    if (beside_m > static_cast<double>(patch.radius)) return {};
    return {before_m, &patch};
  }
};

void DenseView::Impl::fitPatches(std::span<const SeenReturn> returns) {
  const double v = options.voxel_size_m;
  const double least_m = std::hypot(kLeastRadius_v * v, kRadius_sigma * options.range_noise_m);
  const double most_m = std::max(kMostRadius_v * v, 2 * least_m);
  const ReturnsNear near(returns, origin_W, least_m);
  const std::vector<Eigen::Vector3d> seeds = seedsOf(returns, origin_W, v);
  std::vector<std::optional<Patch>> found(seeds.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, seeds.size(), 256), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      found[n] = surfaceNear(near, seeds[n], least_m, most_m);
    }
  });
  // Noise makes seeds far from a surface, which end on the same piece of it: in each voxel the best supported is kept.
  std::unordered_map<openvdb::Coord, std::size_t> best;
  for (const std::optional<Patch>& patch : found) {
    if (!patch) continue;
    const auto [at, is_new] = best.try_emplace(cellOf(patch->centre.cast<double>(), v), patches.size());
    if (is_new) {
      patches.push_back(*patch);
    } else if (patches[at->second].returns < patch->returns) {
      patches[at->second] = *patch;
    }
  }
}

void DenseView::Impl::noteNearest() {
  const double v = options.voxel_size_m;
  const double reach_m = std::max(options.depth_m, kBefore_v * v) + v;
  openvdb::FloatGrid distances(std::numeric_limits<float>::max());
  auto distance = distances.getAccessor();
  auto index = nearest->getAccessor();
  for (std::size_t n = 0; n < patches.size(); ++n) {
    const Eigen::Vector3d centre = patches[n].centre.cast<double>();
    const openvdb::CoordBBox box(cellOf(centre - Eigen::Vector3d::Constant(reach_m), v),
                                 cellOf(centre + Eigen::Vector3d::Constant(reach_m), v));
    for (auto cell = box.begin(); cell; ++cell) {
      const Eigen::Vector3d middle = v * (Eigen::Vector3d((*cell).x(), (*cell).y(), (*cell).z()).array() + 0.5);
      const auto d = static_cast<float>((middle - centre).squaredNorm());
      if (!(d < distance.getValue(*cell))) continue;
      distance.setValue(*cell, d);
      index.setValue(*cell, static_cast<int>(n));
    }
  }
}

void DenseView::Impl::noteRays(std::span<const SeenReturn> returns) {
  const double edge_m = kCell_v * options.voxel_size_m;
  const double before_m = kBefore_v * options.voxel_size_m + 3 * options.range_noise_m;
  auto cells = passed->getAccessor();
  openvdb::Coord last = openvdb::Coord::max();
  for (const SeenReturn& seen : returns) {
    const Eigen::Vector3d from = seen.sensor_W - origin_W, way = seen.p_W - seen.sensor_W;
    const double length_m = way.norm() - before_m;
    if (!(length_m > 0)) continue;
    const Eigen::Vector3d step = way.normalized() * (edge_m / 2);
    Eigen::Vector3d p = from;
    for (double at_m = 0; at_m < length_m; at_m += edge_m / 2, p += step) {
      const openvdb::Coord cell = cellOf(p, edge_m);
      if (cell == last) continue;
      cells.setValueOn(cell);
      last = cell;
    }
  }
  // Between two rays a cell apart nothing was missed that is as large as a cell.
  openvdb::tools::dilateActiveValues(passed->tree(), 1, openvdb::tools::NN_FACE_EDGE_VERTEX);
}

DenseView::DenseView(std::span<const SeenReturn> returns, const DenseViewOptions& options)
    : impl_(std::make_unique<Impl>(options)) {
  if (!returns.empty()) impl_->origin_W = returns.front().sensor_W;
  impl_->fitPatches(returns);
  impl_->noteNearest();
  impl_->noteRays(returns);
}

DenseView::~DenseView() = default;
DenseView::DenseView(DenseView&&) noexcept = default;

DenseView::Is DenseView::at(const Eigen::Vector3d& p_W, double closer_than_m) const {
  const Eigen::Vector3d p = p_W - impl_->origin_W;
  const Impl::Found found = impl_->patchAt(p);
  if (found.patch != nullptr) {
    const bool before = found.before_m >= closer_than_m;
    if (!before && found.before_m >= -impl_->options.depth_m) return Is::Solid;
    if (before && found.before_m <= kBefore_v * impl_->options.voxel_size_m) return Is::Free;
  }
  const auto cell = cellOf(p, kCell_v * impl_->options.voxel_size_m);
  return impl_->readers.local().second.isValueOn(cell) ? Is::Free : Is::Unseen;
}

bool DenseView::hasSurfaceAt(const Eigen::Vector3d& p_W) const {
  const Impl::Found found = impl_->patchAt(p_W - impl_->origin_W);
  return found.patch != nullptr && std::abs(found.before_m) <= impl_->options.depth_m;
}

std::size_t DenseView::patches() const { return impl_->patches.size(); }

}  // namespace accessvdb::eval
