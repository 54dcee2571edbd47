// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/pseudo_truth.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "eval/tool_samples.h"
#include "eval/truth_orientations.h"
#include "sim/counter_random.h"

namespace accessvdb::eval {
namespace {

/// How far behind a surface its thing is taken to reach: thicker than most leaves and twigs at this voxel size are, and
/// past the returns that noise puts behind a surface.
constexpr double kDepth_v = 4, kDepth_sigma = 5;

/// Keys of the lots that are drawn: for the half, and for the density.
constexpr std::uint64_t kLotOfHalf = 1, kLotOfDensity = 2;

class Halves {
 public:
  explicit Halves(const PseudoTruthRequest& request) : request_(request) {}

  [[nodiscard]] bool inDense(std::size_t scan, std::size_t index) const {
    if (request_.halves == HalvesBy::Scans) return scan % 2 == 0;
    return sim::CounterRandom{kLotOfHalf, scan, index}.uniform() < 0.5;
  }
  /// By lot, so that a pattern of the sensor (rings, rows) cannot fall in step with the thinning. What a lower density
  /// keeps, a higher one keeps as well.
  [[nodiscard]] bool inSparse(std::size_t scan, std::size_t index, double density) const {
    return !inDense(scan, index) && sim::CounterRandom{kLotOfDensity, scan, index}.uniform() < density;
  }

 private:
  const PseudoTruthRequest& request_;
};

const Eigen::Vector3d& originOf(const io::ScanRecord& record, std::size_t index) {
  return record.origins_W[record.origins_W.size() == 1 ? 0 : index];
}

bool usable(const Eigen::Vector3d& p_W, const Eigen::Vector3d& sensor_W, const TsdfParams& params) {
  const double range_m = (p_W - sensor_W).norm();
  return range_m > 0 && range_m >= params.min_range_m && range_m <= params.max_range_m;  // false for NaN
}

std::vector<SeenReturn> denseReturns(const PseudoTruthRequest& request, const TsdfParams& params,
                                     const Observer& observer) {
  const Halves halves(request);
  std::vector<SeenReturn> seen;
  for (std::size_t scan = 0; scan < request.scans; ++scan) {
    if (request.halves == HalvesBy::Scans && !halves.inDense(scan, 0)) continue;
    observer.checkStop();
    const io::ScanRecord record = request.read(scan);
    const auto take = [&](std::size_t n, const Eigen::Vector3d& p_W, const Eigen::Vector3d& sensor_W) {
      if (halves.inDense(scan, n) && usable(p_W, sensor_W, params)) seen.push_back({p_W, sensor_W});
    };
    for (std::size_t n = 0; n < record.points_S.size(); ++n) {
      take(n, record.T_W_S * record.points_S[n].cast<double>(), record.T_W_S.translation());
    }
    for (std::size_t n = 0; n < record.points_W.size(); ++n) take(n, record.points_W[n], originOf(record, n));
  }
  return seen;
}

struct HalfMap {
  FieldSnapshot snapshot;
  FieldParams params;  ///< resolved
  std::string device;
  std::uint64_t returns = 0;
};
/// Maps and scores one half. @param density  of the sparse half; none: the dense half
HalfMap mapHalf(const PseudoTruthRequest& request, std::optional<double> density, const ToolGeometry& tool,
                const Observer& observer) {
  const Halves halves(request);
  const auto keep = [&](std::size_t scan, std::size_t index) {
    return density ? halves.inSparse(scan, index, *density) : halves.inDense(scan, index);
  };
  AccessibilityField field(tool, request.params);
  HalfMap map;
  for (std::size_t scan = 0; scan < request.scans; ++scan) {
    if (request.halves == HalvesBy::Scans && halves.inDense(scan, 0) == density.has_value())
      continue;  // not to be read
    observer.checkStop();
    const io::ScanRecord record = request.read(scan);
    if (!record.points_W.empty()) {
      std::vector<Eigen::Vector3d> points_W, origins_W;
      for (std::size_t n = 0; n < record.points_W.size(); ++n) {
        if (!keep(scan, n)) continue;
        points_W.push_back(record.points_W[n]);
        origins_W.push_back(originOf(record, n));
      }
      if (!points_W.empty()) map.returns += field.integrateRays(points_W, origins_W).points_used;
      continue;
    }
    std::vector<Eigen::Vector3f> points_S;
    for (std::size_t n = 0; n < record.points_S.size(); ++n) {
      if (keep(scan, n)) points_S.push_back(record.points_S[n]);
    }
    if (!points_S.empty()) map.returns += field.integrateScan(points_S, record.T_W_S, record.stamp_s).points_used;
  }
  field.update();
  map.snapshot = field.snapshot();
  map.params = field.params();
  map.device = field.deviceName();
  return map;
}

/// As in the tables of simulated scenes.
bool counts(const SurfacePoint& point, const FieldParams& params) {
  return point.confidence >= static_cast<float>(params.scoring.confidence_min) &&
         point.reason != PointReason::BesideSurface;
}

PseudoTruthRun mapSparse(const PseudoTruthRequest& request, double density, const ToolGeometry& tool,
                         const Observer& observer, std::string& device) {
  const HalfMap map = mapHalf(request, density, tool, observer);
  device = map.device;
  PseudoTruthRun run;
  run.density = density;
  run.returns = map.returns;
  const auto& points = map.snapshot.points;
  run.points = static_cast<std::uint64_t>(std::count_if(
      points.begin(), points.end(), [&](const SurfacePoint& point) { return counts(point, map.params); }));
  const std::uint64_t every = std::max<std::uint64_t>(1, run.points / request.most_judged);
  std::uint64_t number = 0;
  for (const SurfacePoint& point : points) {
    if (!counts(point, map.params) || number++ % every != 0) continue;
    run.positions_W.push_back(point.position_W);
    run.normals_W.emplace_back(point.normal_W.cast<double>());
    run.found.push_back(point.label == PointLabel::Accessible ? 1 : 0);
  }
  return run;
}

/// The tool in each orientation, and what of it counts.
class Placements {
 public:
  Placements(const DenseView& view, const ToolGeometry& tool, const TruthOptions& options)
      : view_(view), options_(options) {
    samples_T_ = sampleToolSurface(tool, options.surface_samples, options.seed);
    std::erase_if(samples_T_, [&](const Eigen::Vector3d& p_T) { return !(p_T.norm() > options.self_exclusion_m); });
    // Collisions are most likely near the tip; the order only affects speed.
    std::sort(samples_T_.begin(), samples_T_.end(),
              [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return a.squaredNorm() < b.squaredNorm(); });
    orientations_ = options.orientations.empty() ? yawOrientations(options.num_directions) : options.orientations;
  }

  [[nodiscard]] PseudoVerdict judge(const Eigen::Vector3d& position_W, const Eigen::Vector3d& normal_W) const {
    if (!view_.hasSurfaceAt(position_W)) return PseudoVerdict::NoSurface;
    if (!normal_W.allFinite() || normal_W.isZero(0)) return PseudoVerdict::Blocked;
    const double cos_min = std::cos(options_.normal_cone_rad);
    std::vector<std::pair<double, std::size_t>> in_cone;
    for (std::size_t d = 0; d < orientations_.size(); ++d) {
      const double cosine = orientations_[d].col(0).dot(normal_W);
      if (cosine >= cos_min) in_cone.emplace_back(-cosine, d);
    }
    std::sort(in_cone.begin(), in_cone.end());  // likely ones first
    PseudoVerdict verdict = PseudoVerdict::Blocked;
    for (const auto& [cosine, d] : in_cone) {
      const DenseView::Is is = place(position_W, orientations_[d]);
      if (is == DenseView::Is::Free) return PseudoVerdict::Accessible;
      if (is == DenseView::Is::Unseen) verdict = PseudoVerdict::Undecided;
    }
    return verdict;
  }

 private:
  /// Solid: blocked by what was seen. Free: whatever is in the unseen. Unseen: depends on it.
  [[nodiscard]] DenseView::Is place(const Eigen::Vector3d& position_W, const Eigen::Matrix3d& R_WT) const {
    bool seen = true;
    for (const double along_m : options_.arm_m) {
      // The smallest positive number: an arm on the surface is not outside.
      const DenseView::Is is = view_.at(position_W + along_m * R_WT.col(0), std::numeric_limits<double>::denorm_min());
      if (is == DenseView::Is::Solid) return is;
      seen = seen && is == DenseView::Is::Free;
    }
    int solid = 0, unseen = 0;
    for (const Eigen::Vector3d& p_T : samples_T_) {
      const DenseView::Is is = view_.at(position_W + R_WT * p_T, options_.collision_distance_m + options_.margin_m);
      solid += is == DenseView::Is::Solid ? 1 : 0;
      unseen += is == DenseView::Is::Unseen ? 1 : 0;
      if (solid >= options_.collision_limit) return DenseView::Is::Solid;
    }
    return seen && solid + unseen < options_.collision_limit ? DenseView::Is::Free : DenseView::Is::Unseen;
  }

  const DenseView& view_;
  TruthOptions options_;
  std::vector<Eigen::Vector3d> samples_T_;
  std::vector<Eigen::Matrix3d> orientations_;
};

using Voxel = std::array<std::int64_t, 3>;
Voxel voxelOf(const Eigen::Vector3d& p_W, double voxel_size_m) {
  Voxel voxel;
  for (int axis = 0; axis < 3; ++axis) {
    voxel[static_cast<std::size_t>(axis)] = static_cast<std::int64_t>(std::floor(p_W[axis] / voxel_size_m + 0.5));
  }
  return voxel;
}

}  // namespace

std::vector<PseudoVerdict> verdictsOfLabels(const PseudoTruthRequest& request, const ToolGeometry& tool,
                                            const Observer& observer, std::span<const Eigen::Vector3d> positions_W) {
  const HalfMap map = mapHalf(request, std::nullopt, tool, observer);
  const double v = map.params.tsdf.voxel_size_m;
  std::map<Voxel, bool> accessible;  // origins of maps are multiples of a voxel, so that they share one grid
  for (const SurfacePoint& point : map.snapshot.points) {
    if (point.label == PointLabel::Unscored || !counts(point, map.params)) continue;
    accessible[voxelOf(point.position_W, v)] = point.label == PointLabel::Accessible;
  }
  std::vector<PseudoVerdict> verdicts;
  verdicts.reserve(positions_W.size());
  for (const Eigen::Vector3d& p_W : positions_W) {
    const auto found = accessible.find(voxelOf(p_W, v));
    verdicts.push_back(found == accessible.end() ? PseudoVerdict::NoSurface
                       : found->second           ? PseudoVerdict::Accessible
                                                 : PseudoVerdict::Blocked);
  }
  return verdicts;
}

std::vector<PseudoVerdict> judgeBy(const DenseView& view, const ToolGeometry& tool, const TruthOptions& options,
                                   std::span<const Eigen::Vector3d> positions_W,
                                   std::span<const Eigen::Vector3d> normals_W) {
  const Placements placements(view, tool, options);
  std::vector<PseudoVerdict> verdicts(positions_W.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, positions_W.size(), 64), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      verdicts[n] = placements.judge(positions_W[n], normals_W[n]);
    }
  });
  return verdicts;
}

Confusion PseudoTruthRun::judged() const {
  Confusion figures;
  for (std::size_t n = 0; n < verdicts.size(); ++n) {
    if (verdicts[n] != PseudoVerdict::Accessible && verdicts[n] != PseudoVerdict::Blocked) continue;
    figures.add(verdicts[n] == PseudoVerdict::Accessible, found[n] != 0);
  }
  return figures;
}

double PseudoTruthRun::percentOf(PseudoVerdict verdict) const {
  const auto count = std::count(verdicts.begin(), verdicts.end(), verdict);
  return verdicts.empty() ? 0 : 100 * static_cast<double>(count) / static_cast<double>(verdicts.size());
}

PseudoTruthResult pseudoTruth(const PseudoTruthRequest& request, const ToolGeometry& tool, const Observer& observer) {
  for (const double density : request.densities) {
    if (density > 0 && density <= 1) continue;
    throw InvalidArgument("pseudo_truth.density", "densities", "a density is not above 0 and at most 1",
                          "Use shares of the sparse half's returns, for example 1, 0.25 and 0.0625");
  }
  if (request.scans < (request.halves == HalvesBy::Scans ? 2U : 1U)) {
    throw UnusableInput("pseudo_truth.scans", request.name,
                        "there is only " + std::to_string(request.scans) + " scan, which cannot be split by scans",
                        "Use a recording of two or more scans, or HalvesBy::Returns");
  }
  PseudoTruthResult result;
  result.params = request.params.resolved();
  const std::vector<SeenReturn> seen = denseReturns(request, result.params.tsdf, observer);
  result.dense_returns = seen.size();
  observer.say(request.name + ": surfaces of the dense half, " + std::to_string(seen.size()) + " returns");
  DenseViewOptions view_options;
  view_options.voxel_size_m = result.params.tsdf.voxel_size_m;
  view_options.range_noise_m = request.range_noise_m;
  view_options.depth_m = std::max(kDepth_v * view_options.voxel_size_m, kDepth_sigma * request.range_noise_m);
  const DenseView view(seen, view_options);
  std::uint64_t judged = 0;
  for (const double density : request.densities) {
    observer.checkStop();
    observer.say(request.name + ": mapping and judging " + std::to_string(density) + " of the sparse half");
    PseudoTruthRun run = mapSparse(request, density, tool, observer, result.device);
    run.verdicts = judgeBy(view, tool, truthOptions(result.params), run.positions_W, run.normals_W);
    judged += run.judged().points();
    result.runs.push_back(std::move(run));
  }
  if (judged == 0) {
    throw UnusableInput("pseudo_truth.nothing", request.name,
                        "the dense half shows no surface at any point of the sparse half, so nothing can be judged",
                        "Check the poses, or use larger voxels (voxel_size_m)");
  }
  return result;
}

}  // namespace accessvdb::eval
