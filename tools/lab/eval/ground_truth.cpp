// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/ground_truth.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "accessvdb/error.h"
#include "eval/ball_tree.h"
#include "eval/collision_field.h"
#include "eval/tool_samples.h"
#include "eval/truth_orientations.h"

namespace accessvdb::eval {
namespace {

std::vector<Eigen::Vector3d> samplesOutside(const ToolGeometry& tool, const TruthOptions& options) {
  std::vector<Eigen::Vector3d> samples = sampleToolSurface(tool, options.surface_samples, options.seed);
  std::erase_if(samples, [&](const Eigen::Vector3d& p_T) { return !(p_T.norm() > options.self_exclusion_m); });
  return samples;
}

}  // namespace

TruthOptions truthOptions(const FieldParams& resolved) {
  TruthOptions options;
  options.normal_cone_rad = resolved.approach.normal_cone_rad;
  const double tau = resolved.tsdf.truncation_distance_m, length = resolved.approach.corridor_length_m;
  for (const double fraction : resolved.approach.arm_tau) options.arm_m.push_back(fraction * tau);
  // A longer corridor is sampled every tau up to its end (ApproachParams::corridor_length_m).
  for (double next = options.arm_m.back() + tau; next < length; next += tau) options.arm_m.push_back(next);
  if (length > options.arm_m.back()) options.arm_m.push_back(length);
  options.collision_distance_m = resolved.scoring.collision_distance_m;
  options.self_exclusion_m = resolved.scoring.self_exclusion_voxels * resolved.tsdf.voxel_size_m;
  return options;
}

struct GroundTruth::Impl {
  TruthOptions options;
  BallTree tool;
  std::vector<Eigen::Matrix3d> orientations;  // R_WT; the first column is the axis
  // Exactly one of the two is set.
  std::shared_ptr<const sim::SignedDistance> distance;
  std::shared_ptr<const CollisionField> field;

  Impl(const ToolGeometry& geometry, const TruthOptions& given)
      : options(given), tool(samplesOutside(geometry, given)) {
    if (options.num_directions < 1 || options.surface_samples < 1 || options.collision_limit < 1) {
      throw InvalidArgument("truth.options", "", "directions, samples and collision limit must be positive");
    }
    orientations = options.orientations.empty() ? yawOrientations(options.num_directions) : options.orientations;
    for (const Eigen::Matrix3d& R_WT : orientations) {
      // Negated, so that NaN is refused.
      constexpr double kRigid = 1e-9;
      if (!((R_WT * R_WT.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < kRigid)) {
        throw InvalidArgument("truth.options", "", "an orientation is no rotation");
      }
    }
  }

  [[nodiscard]] bool outside(const Eigen::Vector3d& p_W) const {
    if (field == nullptr) return distance->at(p_W) > 0;
    // The smallest positive number: "not below it" is "above zero".
    return !field->below(p_W, std::numeric_limits<double>::denorm_min());
  }

  [[nodiscard]] bool free(const Eigen::Vector3d& position_W, const Eigen::Matrix3d& R_WT) const {
    for (const double along_m : options.arm_m) {
      if (!outside(position_W + along_m * R_WT.col(0))) return false;
    }
    const ToolPlacement placed{position_W, R_WT};
    const SampleThreshold threshold = {options.collision_distance_m, options.margin_m, options.self_exclusion_m};
    const int limit = options.collision_limit;
    const int count = field == nullptr ? tool.countBelow(*distance, placed, threshold, limit)
                                       : tool.countBelow(*field, placed, threshold, limit);
    return count < limit;
  }
};

GroundTruth::GroundTruth(std::shared_ptr<const sim::SignedDistance> distance, const ToolGeometry& tool,
                         const TruthOptions& options)
    : impl_(std::make_unique<Impl>(tool, options)) {
  if (distance == nullptr) {
    throw InvalidArgument("truth.distance", "", "the scene has no signed distance, so its ground truth is unknown",
                          "Use a scene whose mesh is closed");
  }
  impl_->distance = std::move(distance);
}

GroundTruth::GroundTruth(std::shared_ptr<const CollisionField> field, const ToolGeometry& tool,
                         const TruthOptions& options)
    : impl_(std::make_unique<Impl>(tool, options)) {
  if (field == nullptr) throw InvalidArgument("truth.distance", "", "there is no distance");
  impl_->field = std::move(field);
}

GroundTruth::~GroundTruth() = default;
GroundTruth::GroundTruth(GroundTruth&&) noexcept = default;

bool GroundTruth::free(const Eigen::Vector3d& position_W, int orientation) const {
  return impl_->free(position_W, impl_->orientations[static_cast<std::size_t>(orientation)]);
}

bool GroundTruth::accessible(const Eigen::Vector3d& position_W, const Eigen::Vector3d& normal_W) const {
  if (!position_W.allFinite() || !normal_W.allFinite() || normal_W.isZero(0)) return false;
  const double cos_min = std::cos(impl_->options.normal_cone_rad);
  // The order only affects speed, as any free orientation will do: axes near the normal are the most likely.
  std::vector<std::pair<double, int>> in_cone;
  in_cone.reserve(impl_->orientations.size());
  for (std::size_t d = 0; d < impl_->orientations.size(); ++d) {
    const auto axis_W = impl_->orientations[d].col(0);
    // In this order: a level axis adds nothing at the end.
    const double cosine = axis_W.x() * normal_W.x() + axis_W.y() * normal_W.y() + axis_W.z() * normal_W.z();
    if (cosine >= cos_min) in_cone.emplace_back(-cosine, static_cast<int>(d));
  }
  std::sort(in_cone.begin(), in_cone.end());
  return std::any_of(in_cone.begin(), in_cone.end(),
                     [&](const auto& candidate) { return free(position_W, candidate.second); });
}

std::vector<std::uint8_t> GroundTruth::accessible(std::span<const Eigen::Vector3d> positions_W,
                                                  std::span<const Eigen::Vector3d> normals_W) const {
  if (positions_W.size() != normals_W.size()) {
    throw InvalidArgument("truth.size", "", "positions and normals differ in number");
  }
  std::vector<std::uint8_t> result(positions_W.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, positions_W.size(), 64), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      result[n] = accessible(positions_W[n], normals_W[n]) ? 1 : 0;
    }
  });
  return result;
}

}  // namespace accessvdb::eval
