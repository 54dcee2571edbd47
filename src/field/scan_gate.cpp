// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/scan_gate.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "accessvdb/attributes.h"
#include "accessvdb/error.h"
#include "hostdev/position_voxel.h"
#include "hostdev/voxel_scale.h"
#include "points/surface_index.h"

namespace accessvdb::internal {
namespace {

/// Local positions are rounded to this, so that shifting the world by whole voxels does not change their last bits.
constexpr double kPositionStep_m = 0x1.0p-20;
/// Voxel indices fit into 21 bits, with room for tau, the tool and the corridor around them.
/// Largest deviation of R^T R from the identity.
constexpr double kRigidTolerance = 1e-6;
/// No survey frame has larger coordinates (the Earth's circumference is 4e7 m); doubles still resolve 10 nm there.
constexpr double kFarthest_m = 1e8;
constexpr std::size_t kGatedPerTask = 1024;
/// Returns checked per batch; bounds the memory that a long list of rays takes.
constexpr std::size_t kMostChecked = 1 << 16;

Eigen::Vector3d roundToStep(const Eigen::Vector3d& x) {
  return {std::round(x.x() / kPositionStep_m) * kPositionStep_m, std::round(x.y() / kPositionStep_m) * kPositionStep_m,
          std::round(x.z() / kPositionStep_m) * kPositionStep_m};
}

}  // namespace

ScanGate::ScanGate(const TsdfParams& resolved, const std::optional<std::array<double, 3>>& origin_W,
                   const std::optional<VoxelColumnBox>& window, std::size_t attributes)
    : params_(resolved),
      inverse_voxel_size_(kernels::VoxelScale(resolved.voxel_size_m).inverse_float32),
      window_(window),
      attributes_(attributes) {
  if (origin_W) setOrigin({(*origin_W)[0], (*origin_W)[1], (*origin_W)[2]});
}

void ScanGate::setOrigin(const Eigen::Vector3d& sensor_W) {
  if (have_origin_) return;
  const double v = params_.voxel_size_m;
  // + 0.0 turns -0 into 0, which is easier to read.
  origin_W_ = {std::round(sensor_W.x() / v) * v + 0.0, std::round(sensor_W.y() / v) * v + 0.0,
               std::round(sensor_W.z() / v) * v + 0.0};
  have_origin_ = true;
}

ScanGate::Checked ScanGate::check(const Eigen::Vector3d& p_L, const Eigen::Vector3d& q_L) const {
  const auto dropped = [](DropReason reason) { return Checked{{}, {}, reason}; };
  const double range = (p_L - q_L).norm();
  if (!std::isfinite(range)) return dropped(DropReason::NonFinite);
  if (!(range > 0)) return dropped(DropReason::NoReturn);
  if (range < params_.min_range_m) return dropped(DropReason::BelowMinRange);
  if (range > params_.max_range_m) return dropped(DropReason::BeyondMaxRange);
  const double bound = kFarthestVoxel * params_.voxel_size_m;
  if (!(p_L.lpNorm<Eigen::Infinity>() <= bound) || !(q_L.lpNorm<Eigen::Infinity>() <= bound)) {
    return dropped(DropReason::OutOfBounds);
  }
  const auto stored = [this](double x_m) { return kernels::storedCoordinate(x_m, inverse_voxel_size_); };
  return checkLocal({stored(p_L.x()), stored(p_L.y()), stored(p_L.z())}, q_L.cast<float>());
}

ScanGate::Checked ScanGate::checkLocal(const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L) const {
  if (p_L == q_L) return {{}, {}, DropReason::NoReturn};  // after rounding there is no ray left
  Checked kept = {p_L, q_L, {}};
  if (window_) {
    const auto ijk = kernels::voxelOf(kept.p_L.x(), kept.p_L.y(), kept.p_L.z(), inverse_voxel_size_);
    kept.outside = !window_->contains({ijk[0], ijk[1], ijk[2]});
  }
  return kept;
}

void ScanGate::startScan(const Eigen::Matrix3d& R_W_S) {
  scan_.p_L.clear();
  scan_.q_L.clear();
  scan_.attributes.clear();
  scan_.R_W_S = R_W_S;
}

void ScanGate::requireAttributes(std::size_t returns, Attributes attributes) const {
  if (attributes.empty() || attributes.size() == returns * attributes_) return;
  throw InvalidArgument("carry.sizes", "attributes",
                        "there are " + std::to_string(attributes.size()) + " values for " + std::to_string(returns) +
                            " returns with " + std::to_string(attributes_) + " each",
                        "Pass one value per return for each of FieldParams::carry");
}

/// Adds the returns that are kept, in order. @param checkOf  (n) -> Checked of return n, from any thread
template <typename CheckOf>
void ScanGate::admit(std::size_t count, bool own_origins, const CheckOf& checkOf, FrameStats& stats,
                     Attributes attributes) {
  GatedScan& scan = scan_;
  scan.p_L.reserve(count);
  checked_.resize(std::max(checked_.size(), std::min(count, kMostChecked)));
  for (std::size_t first = 0; first < count; first += kMostChecked) {
    const std::size_t end = std::min(count, first + kMostChecked);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(first, end, kGatedPerTask), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) checked_[n - first] = checkOf(n);
    });
    for (std::size_t n = first; n < end; ++n) {
      const Checked& one = checked_[n - first];
      if (one.dropped) {
        ++stats.dropped[static_cast<std::size_t>(*one.dropped)];
        continue;
      }
      if (one.outside) continue;
      scan.p_L.push_back(one.p_L);
      if (own_origins) scan.q_L.push_back(one.q_L);
      if (!attributes.empty()) {
        const auto own = attributes.begin() + static_cast<std::ptrdiff_t>(n * attributes_);
        scan.attributes.insert(scan.attributes.end(), own, own + static_cast<std::ptrdiff_t>(attributes_));
      }
      ++stats.points_used;
    }
  }
  if (attributes.empty()) scan.attributes.assign(scan.p_L.size() * attributes_, kNoAttribute);
}

const GatedScan& ScanGate::gate(std::span<const Eigen::Vector3f> points_S, const Eigen::Isometry3d& T_W_S,
                                FrameStats& stats, Attributes attributes) {
  requireAttributes(points_S.size(), attributes);
  const Eigen::Matrix3d R = T_W_S.linear();
  const Eigen::Vector3d t = T_W_S.translation();
  const double skew = (R.transpose() * R - Eigen::Matrix3d::Identity()).lpNorm<Eigen::Infinity>();
  if (!t.allFinite() || !R.allFinite()) {
    throw UnusableInput("pose.not_rigid", "", "a sensor pose is not finite", "Leave out scans whose pose is not known");
  }
  if (!(t.lpNorm<Eigen::Infinity>() <= kFarthest_m) || !(skew <= kRigidTolerance) || !(R.determinant() > 0)) {
    throw UnusableInput("pose.not_rigid", "", "a sensor pose is not rigid, or beyond 1e8 m",
                        "Use unit quaternions or orthonormal matrices");
  }
  setOrigin(t);
  startScan(R);
  stats.points_in += points_S.size();
  const Eigen::Vector3d q_L = roundToStep(t - origin_W_);
  const auto checkOf = [&](std::size_t n) {
    const Eigen::Vector3f& p_S = points_S[n];
    if (p_S.x() == 0 && p_S.y() == 0 && p_S.z() == 0) return Checked{{}, {}, DropReason::NoReturn};
    return check(R * p_S.cast<double>() + q_L, q_L);
  };
  admit(points_S.size(), false, checkOf, stats, attributes);
  scan_.q_L.push_back(q_L.cast<float>());
  return scan_;
}

const GatedScan& ScanGate::gateLocal(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                                     FrameStats& stats, Attributes attributes) {
  requireAttributes(p_L.size(), attributes);
  startScan(Eigen::Matrix3d::Identity());
  stats.points_in += p_L.size();
  const bool own = q_L.size() > 1;
  const float bound = static_cast<float>(kFarthestVoxel * params_.voxel_size_m);
  const auto inside = [bound](const Eigen::Vector3f& x) {
    return x.lpNorm<Eigen::Infinity>() <= bound && x.allFinite();
  };
  const auto checkOf = [&](std::size_t n) {
    const Eigen::Vector3f& q = q_L[own ? n : 0];
    // The gate before has seen to this; a damaged file may not get past it.
    if (!inside(p_L[n]) || !inside(q)) return Checked{{}, {}, DropReason::OutOfBounds};
    return checkLocal(p_L[n], q);
  };
  admit(p_L.size(), own, checkOf, stats, attributes);
  if (!own && !q_L.empty()) scan_.q_L.push_back(q_L.front());
  return scan_;
}

const GatedScan& ScanGate::gate(std::span<const Eigen::Vector3d> points_W, std::span<const Eigen::Vector3d> origins_W,
                                FrameStats& stats, Attributes attributes) {
  requireAttributes(points_W.size(), attributes);
  if (origins_W.size() != 1 && origins_W.size() != points_W.size()) {
    throw InvalidArgument("rays.sizes", "origins_W", "there must be one origin, or one for each point",
                          "Pass arrays of equal length");
  }
  startScan(Eigen::Matrix3d::Identity());
  stats.points_in += points_W.size();
  if (points_W.empty()) return scan_;
  const bool own = origins_W.size() > 1;
  const auto plausible = [](const Eigen::Vector3d& x) {
    return x.lpNorm<Eigen::Infinity>() <= kFarthest_m && x.allFinite();
  };
  if (!own && !plausible(origins_W.front())) {
    throw UnusableInput("pose.not_finite", "", "the sensor position is not finite, or beyond 1e8 m", "Check origins_W");
  }
  for (std::size_t n = 0; n < points_W.size() && !have_origin_; ++n) {
    const Eigen::Vector3d& q = origins_W[own ? n : 0];
    if (plausible(q) && plausible(points_W[n])) setOrigin(q);  // a garbage ray must not decide the origin
  }
  const auto checkOf = [&](std::size_t n) {
    return check(roundToStep(points_W[n] - origin_W_), roundToStep(origins_W[own ? n : 0] - origin_W_));
  };
  admit(points_W.size(), own, checkOf, stats, attributes);
  if (!own) scan_.q_L.push_back(roundToStep(origins_W.front() - origin_W_).cast<float>());
  return scan_;
}

}  // namespace accessvdb::internal
