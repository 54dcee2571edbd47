// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/collision_field.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/error.h"

namespace accessvdb::eval {
namespace {

constexpr int kSplit = 4;  // children of a cell along each axis
constexpr int kChildren = kSplit * kSplit * kSplit;
/// Rounding of a stored float and of the arithmetic here, relative to the distance and to the size of the coordinates.
constexpr double kRounding = 1e-7;

/// Distance at a cell's centre; NaN until requested. Threads that request it concurrently write the same value.
class LazyDistance {
 public:
  [[nodiscard]] float get() const { return value_.load(std::memory_order_relaxed); }
  void set(float distance_m) { value_.store(distance_m, std::memory_order_relaxed); }

 private:
  std::atomic<float> value_{std::numeric_limits<float>::quiet_NaN()};
};

struct FineBlock {
  LazyDistance distance_m[kChildren];
};

struct MiddleBlock {
  LazyDistance distance_m[kChildren];
  std::atomic<FineBlock*> below[kChildren] = {};
  ~MiddleBlock() {
    for (auto& block : below) delete block.load(std::memory_order_relaxed);
  }
};

struct TopCell {
  LazyDistance distance_m;
  std::atomic<MiddleBlock*> below{nullptr};
  ~TopCell() { delete below.load(std::memory_order_relaxed); }
};

}  // namespace

struct CollisionField::Impl {
  std::shared_ptr<const sim::SignedDistance> distance;
  Eigen::Vector3d origin_W = {0, 0, 0};  // lowest corner of the first cell
  double cell_m = 0, rounding_m = 0;
  Eigen::Array3i top_cells = {0, 0, 0};
  std::vector<TopCell> top;
  std::uint64_t max_bytes = 0;
  std::atomic<std::uint64_t> bytes{0};
  mutable tbb::enumerable_thread_specific<Work> work;

  /// Bounds of the distance at p from that at c.
  [[nodiscard]] Bounds around(double stored_m, const Eigen::Vector3d& p_W, const Eigen::Vector3d& centre_W) const {
    const double reach_m = (p_W - centre_W).norm() + rounding_m + kRounding * std::abs(stored_m);
    return {stored_m - reach_m, stored_m + reach_m};
  }

  double fill(LazyDistance& cell, const Eigen::Vector3d& centre_W) {
    float value_m = cell.get();
    if (std::isnan(value_m)) {
      value_m = float(distance->at(centre_W));
      cell.set(value_m);
      ++work.local().cells_filled;
    }
    return value_m;
  }

  /// The block that a pointer refers to, created if there is none; null if memory is used up.
  template <typename Block>
  Block* made(std::atomic<Block*>& pointer) {
    Block* block = pointer.load(std::memory_order_acquire);
    if (block) return block;
    if (bytes.fetch_add(sizeof(Block), std::memory_order_relaxed) + sizeof(Block) > max_bytes) {
      bytes.fetch_sub(sizeof(Block), std::memory_order_relaxed);
      return nullptr;
    }
    auto fresh = std::make_unique<Block>();
    if (pointer.compare_exchange_strong(block, fresh.get(), std::memory_order_acq_rel)) return fresh.release();
    bytes.fetch_sub(sizeof(Block), std::memory_order_relaxed);  // another thread was first
    return block;
  }

  Bounds bounds(const Eigen::Vector3d& p_W, double low_m, double high_m) {
    const auto settled = [&](const Bounds& b) { return b.upper_m < low_m || b.lower_m >= high_m; };
    // Outside the box: from the cell at its wall; just as valid, only wider.
    Eigen::Array3d in_cells = (p_W - origin_W).array() / cell_m;
    in_cells = in_cells.max(0.0).min((top_cells * kSplit * kSplit).cast<double>() - 0.5);
    const Eigen::Array3i fine = in_cells.cast<int>();
    const Eigen::Array3i middle = fine / kSplit, coarse = middle / kSplit;
    const auto centre = [&](const Eigen::Array3i& cell, int edge) -> Eigen::Vector3d {
      return origin_W + (cell_m * edge * (cell.cast<double>() + 0.5)).matrix();
    };
    const auto child = [](const Eigen::Array3i& cell) {
      const Eigen::Array3i inside = cell - cell / kSplit * kSplit;
      return std::size_t((inside[0] * kSplit + inside[1]) * kSplit + inside[2]);
    };
    TopCell& cell =
        top[(std::size_t(coarse[0]) * std::size_t(top_cells[1]) + std::size_t(coarse[1])) * std::size_t(top_cells[2]) +
            std::size_t(coarse[2])];
    const Eigen::Vector3d coarse_W = centre(coarse, kSplit * kSplit);
    Bounds found = around(fill(cell.distance_m, coarse_W), p_W, coarse_W);
    if (settled(found)) return found;
    MiddleBlock* const block = made(cell.below);
    if (!block) return found;
    const Eigen::Vector3d middle_W = centre(middle, kSplit);
    const std::size_t in_block = child(middle);
    found = around(fill(block->distance_m[in_block], middle_W), p_W, middle_W);
    if (settled(found)) return found;
    FineBlock* const fine_block = made(block->below[in_block]);
    if (!fine_block) return found;
    const Eigen::Vector3d fine_W = centre(fine, 1);
    return around(fill(fine_block->distance_m[child(fine)], fine_W), p_W, fine_W);
  }
};

CollisionField::CollisionField(std::shared_ptr<const sim::SignedDistance> distance, const Eigen::AlignedBox3d& box_W,
                               double cell_m, std::uint64_t max_bytes)
    : impl_(std::make_unique<Impl>()) {
  if (!distance) throw InvalidArgument("truth.distance", "", "there is no distance");
  if (!(cell_m > 0 && std::isfinite(cell_m)))
    throw InvalidArgument("truth.cell", "", "the cells of a collision field need an edge above zero");
  if (box_W.isEmpty() || !box_W.min().allFinite() || !box_W.max().allFinite())
    throw InvalidArgument("truth.box", "", "the box of a collision field must be finite and not empty");
  impl_->distance = std::move(distance);
  impl_->origin_W = box_W.min();
  impl_->cell_m = cell_m;
  impl_->max_bytes = max_bytes;
  const double edge_m = cell_m * kSplit * kSplit;
  const Eigen::Array3d cells = (box_W.sizes().array() / edge_m).floor() + 1;
  if (!(cells.prod() * double(sizeof(TopCell)) <= double(max_bytes)))
    throw ResourceLimit("truth.memory", "collision field", "needs more than " + std::to_string(max_bytes) + " bytes",
                        "Use larger cells");
  impl_->top_cells = cells.cast<int>();
  impl_->top = std::vector<TopCell>(std::size_t(cells.prod()));
  impl_->bytes = impl_->top.size() * sizeof(TopCell);
  const double largest_m = std::max(box_W.min().cwiseAbs().maxCoeff(), box_W.max().cwiseAbs().maxCoeff()) + edge_m;
  // Centres and differences in double; an error of the distance itself loosens the Lipschitz bound by as much.
  impl_->rounding_m = 1e-12 + 1e-14 * largest_m + 2 * impl_->distance->errorBound_m();
}

CollisionField::~CollisionField() = default;
CollisionField::CollisionField(CollisionField&&) noexcept = default;

CollisionField::Bounds CollisionField::bounds(const Eigen::Vector3d& p_W, double low_m, double high_m) const {
  if (!p_W.allFinite()) return {-std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  return impl_->bounds(p_W, low_m, high_m);
}

bool CollisionField::below(const Eigen::Vector3d& p_W, double r_m) const {
  const Bounds bound = bounds(p_W, r_m, r_m);
  if (bound.upper_m < r_m) return true;
  if (bound.lower_m >= r_m) return false;
  ++impl_->work.local().left_open;
  // Cheaper than the distance: is any surface within r? If so the answer is yes on either side; if not, and the point
  // cannot be r deep inside, it is outside.
  if (r_m > 0) {
    if (impl_->distance->surfaceNearerThan(p_W, r_m)) return true;
    if (bound.lower_m > -r_m) return false;
  }
  return impl_->distance->at(p_W) < r_m;
}

const sim::SignedDistance& CollisionField::distance() const { return *impl_->distance; }
std::uint64_t CollisionField::bytes() const { return impl_->bytes; }

CollisionField::Work CollisionField::work() const {
  Work sum;
  for (const Work& mine : impl_->work) {
    sum.cells_filled += mine.cells_filled;
    sum.left_open += mine.left_open;
  }
  return sum;
}

}  // namespace accessvdb::eval
