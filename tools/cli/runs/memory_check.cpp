// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/memory_check.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <thread>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/program/memory_prediction.h"
#include "accessvdb/tool_tables.h"
#include "options/tools_given.h"
#include "output/progress.h"
#include "output/stop_signal.h"

namespace accessvdb::tools {
namespace {

constexpr double kReturnsWithoutLimit = 3e6;   // about two seconds of prediction on two cores
constexpr std::size_t kReturnsAThread = 4096;  // fewer are not worth a thread
constexpr std::size_t kReturnsKept = 200'000;  // for trying other voxel sizes without reading the scans again
constexpr double kVoxelMax_m = 10;             // the library's own bound
constexpr double kVoxelStep = 1.25;

using Ray = std::pair<Eigen::Vector3f, Eigen::Vector3f>;  // sensor and return, relative to the first sensor position

/// An evenly spread sample of all rays, of bounded size: when full, every other ray is dropped.
class RaySample {
 public:
  void add(const Ray& ray) {
    if (count_++ % stride_ != 0) return;
    rays_.push_back(ray);
    if (rays_.size() < kReturnsKept) return;
    for (std::size_t i = 0; 2 * i < rays_.size(); ++i) rays_[i] = rays_[2 * i];
    rays_.resize(rays_.size() / 2);
    stride_ *= 2;
  }
  [[nodiscard]] const std::vector<Ray>& rays() const { return rays_; }
  [[nodiscard]] MemoryPrediction prediction(const std::vector<ToolSpec>& tools, const FieldParams& params) const {
    MemoryPredictor predictor(params.tsdf, rememberedDirections(tools, params));
    for (const auto& [o_L, p_L] : rays_) predictor.add(o_L.cast<double>(), p_L.cast<double>());
    return predictor.prediction();
  }

 private:
  std::vector<Ray> rays_;
  std::uint64_t count_ = 0, stride_ = 1;
};

/// The returns of a record, relative to the first sensor position of all.
class LocalRays {
 public:
  const std::vector<Ray>& of(const io::ScanRecord& record) {
    rays_.clear();
    const auto add = [&](const Eigen::Vector3d& o_W, const Eigen::Vector3d& p_W) {
      if (!p_W.allFinite() || !o_W.allFinite() || p_W == o_W) return;
      if (!origin_W_) origin_W_ = o_W;
      rays_.emplace_back((o_W - *origin_W_).cast<float>(), (p_W - *origin_W_).cast<float>());
    };
    for (std::size_t i = 0; i < record.points_W.size(); ++i) {
      add(record.origins_W.size() == 1 ? record.origins_W[0] : record.origins_W.at(i), record.points_W[i]);
    }
    for (const Eigen::Vector3f& p_S : record.points_S) {
      if (!p_S.isZero(0)) add(record.T_W_S.translation(), record.T_W_S * p_S.cast<double>());
    }
    return rays_;
  }

 private:
  std::vector<Ray> rays_;
  std::optional<Eigen::Vector3d> origin_W_;
};

/// One predictor per thread; the order of merging them does not matter.
class ParallelPredictor {
 public:
  ParallelPredictor(const std::vector<ToolSpec>& tools, const FieldParams& params, int threads)
      : predictors_(threads > 0 ? static_cast<std::size_t>(threads) : std::max(1u, std::thread::hardware_concurrency()),
                    MemoryPredictor(params.tsdf, rememberedDirections(tools, params))) {}
  void add(const std::vector<Ray>& rays) {
    const std::size_t parts = std::clamp<std::size_t>(rays.size() / kReturnsAThread, 1, predictors_.size());
    const auto part = [&](std::size_t k) {
      for (std::size_t i = k * rays.size() / parts; i < (k + 1) * rays.size() / parts; ++i) {
        predictors_[k].add(rays[i].first.cast<double>(), rays[i].second.cast<double>());
      }
    };
    std::vector<std::jthread> others;
    for (std::size_t k = 1; k < parts; ++k) others.emplace_back(part, k);
    part(0);
  }
  [[nodiscard]] MemoryPrediction prediction() const {
    MemoryPredictor all = predictors_.front();
    for (std::size_t k = 1; k < predictors_.size(); ++k) all.merge(predictors_[k]);
    return all.prediction();
  }

 private:
  std::vector<MemoryPredictor> predictors_;
};

/// Two digits, rounded up, so that the advice is sure to fit.
double roundedUp(double value) {
  const double unit = std::pow(10.0, std::floor(std::log10(value)) - 1);
  return std::ceil(value / unit - 1e-9) * unit;
}

/// @param all  prediction for all rays
double smallestFittingVoxel_m(MapOptions options, const std::vector<ToolSpec>& tools, std::optional<double> noise_m,
                              const RaySample& sample, RunOutput output, const MemoryPrediction& all, double limit) {
  const double start_m = options.voxel_m;
  const auto sampledBytes = [&](const FieldParams& params) {
    MemoryPrediction prediction = sample.prediction(tools, params);
    prediction.largest_step = all.largest_step;
    prediction.input_bytes = all.input_bytes;
    return prediction.bytes(output, options.mirror_distance);
  };
  // The sample touches fewer leaves than all rays do; the ratio at the requested voxel size corrects for that.
  const double ratio = all.bytes(output, options.mirror_distance) / sampledBytes(fieldParams(options, noise_m));
  const auto fits = [&](double voxel_m) {
    options.voxel_m = voxel_m;
    const FieldParams params = fieldParams(options, noise_m);
    const double rays = ratio * sampledBytes(params);
    return rays <= limit && peakBytes(rays, toolTableBytes(tools, params)) <= limit;
  };
  double low_m = start_m, high_m = start_m * kVoxelStep;
  while (high_m < kVoxelMax_m && !fits(high_m)) low_m = std::exchange(high_m, high_m * kVoxelStep);
  if (high_m >= kVoxelMax_m) return 0;
  for (int step = 0; step < 3; ++step) {
    const double middle_m = std::sqrt(low_m * high_m);
    (fits(middle_m) ? high_m : low_m) = middle_m;
  }
  // Where a flat surface lies on a face of leaves, a slightly larger voxel may need a little more.
  double voxel_m = roundedUp(high_m);
  while (voxel_m < kVoxelMax_m && !fits(voxel_m)) voxel_m = roundedUp(1.02 * voxel_m);
  return voxel_m;
}

/// The least STEP over the sphere, in whole quarters of a degree, with which the run fits at its voxel size.
/// @return 0 if none does, or no tool is tried over a sphere
double smallestFittingStep_deg(std::vector<ToolSpec> tools, const FieldParams& params, MemoryPrediction prediction,
                               const std::function<double(const MemoryPrediction&)>& bytesOf, double limit) {
  constexpr double kLargest_deg = 90, kGrowth = 1.2;
  double step_deg = kLargest_deg;
  for (const ToolSpec& tool : tools) {
    if (tool.orientations.kind == OrientationKind::Sphere) step_deg = std::min(step_deg, tool.orientations.step_deg);
  }
  while (step_deg < kLargest_deg) {
    step_deg = std::min(kLargest_deg, std::ceil(4 * kGrowth * step_deg) / 4);
    for (ToolSpec& tool : tools) {
      OrientationSet& set = tool.orientations;
      if (set.kind == OrientationKind::Sphere) set.step_deg = std::max(set.step_deg, step_deg);
    }
    prediction.remembered_directions = rememberedDirections(tools, params);
    if (peakBytes(bytesOf(prediction), toolTableBytes(tools, params)) <= limit) return step_deg;
  }
  return 0;
}

/// The largest tiles that fit, by the same sample. 0 if even the smallest do not.
class TileChoice {
 public:
  /// @param ratio  all rays' prediction by the sample's, without what an empty map takes
  TileChoice(const std::vector<ToolSpec>& tools, const FieldParams& params, const tiles::TileMargins& margins,
             const RaySample& sample, double ratio)
      : tools_(tools), params_(params), margins_(margins), sample_(sample), ratio_(ratio) {}

  [[nodiscard]] std::int32_t largestFitting(const ToolTableBytes& tables, double limit) const {
    std::int32_t edge = 0;
    if (MemoryPrediction{}.bytes(RunOutput::Field) > limit) return edge;  // the picture of all tiles
    for (std::int32_t larger = margins_.least_tile_voxels; larger <= kMostTileVoxels; larger *= 2) {
      const double fixed = MemoryPrediction{}.bytes(RunOutput::Tile);
      const double tile = fixed + kCaution * ratio_ * (largestTile(larger) - fixed);
      if (peakBytes(tile, tables) > limit) break;
      edge = larger;
      // The map begins in its middle, so four tiles cover it. Where they do not fit after all, quarters of much larger
      // ones would not be smaller.
      if (2 * edge >= widestVoxels()) break;
    }
    return edge;
  }

 private:
  static constexpr std::int32_t kMostTileVoxels = 1 << 16;
  /// What a tile turned out to need above this prediction: up to a third more in the tiles of recorded scans.
  static constexpr double kCaution = 1.4;

  /// The larger extent of the returns in x and y.
  [[nodiscard]] double widestVoxels() const {
    Eigen::AlignedBox2f box;
    for (const Ray& ray : sample_.rays()) box.extend(ray.second.head<2>());
    return box.isEmpty() ? 0 : box.sizes().maxCoeff() / params_.tsdf.voxel_size_m;
  }

  /// Predicted bytes of the tile that needs most of the sample's rays.
  [[nodiscard]] double largestTile(std::int32_t edge) const {
    const double voxel_m = params_.tsdf.voxel_size_m;
    std::map<std::pair<std::int64_t, std::int64_t>, std::vector<std::uint32_t>> rays_of;
    const auto tileOf = [&](double x_m, std::int32_t shift) {
      constexpr double kMostVoxels = 1e12;  // far beyond what a map holds
      return static_cast<std::int64_t>(std::floor(std::clamp(x_m / voxel_m + shift, -kMostVoxels, kMostVoxels) / edge));
    };
    const std::int32_t margin = margins_.returns_voxels;
    for (std::uint32_t n = 0; n < sample_.rays().size(); ++n) {
      const Eigen::Vector3d p_L = sample_.rays()[n].second.cast<double>();
      for (std::int64_t x = tileOf(p_L.x(), -margin); x <= tileOf(p_L.x(), margin); ++x) {
        for (std::int64_t y = tileOf(p_L.y(), -margin); y <= tileOf(p_L.y(), margin); ++y) {
          rays_of[{x, y}].push_back(n);
        }
      }
    }
    double most = 0;
    for (const auto& [tile, rays] : rays_of) {
      MemoryPredictor predictor(params_.tsdf, rememberedDirections(tools_, params_));
      for (const std::uint32_t n : rays) {
        predictor.add(sample_.rays()[n].first.cast<double>(), sample_.rays()[n].second.cast<double>());
      }
      most = std::max(most, predictor.prediction().bytes(RunOutput::Tile, false));
    }
    return most;
  }

  const std::vector<ToolSpec>& tools_;
  const FieldParams& params_;
  tiles::TileMargins margins_;
  const RaySample& sample_;
  double ratio_;
};

}  // namespace

std::optional<std::uint64_t> memoryLimit(const MapOptions& options) {
  if (!options.max_memory.empty()) return parseBytes("--max-memory", options.max_memory);
  return availableMemoryBytes();
}

std::optional<MemoryCheck> checkMemory(const MapOptions& options, const std::vector<ToolSpec>& tools, RunOutput output,
                                       io::ScanSequence& scans,
                                       const std::function<tiles::TileMargins()>& marginsOfTiles, Messages& messages) {
  const std::optional<double> noise_m = scans.recordedRangeNoise_m();
  const bool limited = !options.max_memory.empty();
  const FieldParams params = fieldParams(options, noise_m);
  const ToolTableBytes tables = toolTableBytes(tools, params);
  ParallelPredictor predictor(tools, params, options.common.threads);
  RaySample sample;
  LocalRays rays;
  std::size_t stride = 1, largest_step = 0;
  Progress progress(messages, "predicting memory", scans.size());
  for (std::size_t step = 0; step < scans.size(); step += stride) {
    if (stopSignal() != 0) return std::nullopt;
    const io::ScanRecord record = scans.read(step);
    const std::vector<Ray>& returns = rays.of(record);
    predictor.add(returns);
    largest_step = std::max(largest_step, returns.size());
    for (const Ray& ray : returns) sample.add(ray);
    if (step == 0 && !limited) {
      const double all =
          static_cast<double>(record.points_S.size() + record.points_W.size()) * static_cast<double>(scans.size());
      stride = static_cast<std::size_t>(std::max(1.0, std::ceil(all / kReturnsWithoutLimit)));
    }
    progress.show(std::min(step + stride, scans.size()));
  }
  progress.finish();

  MemoryPrediction prediction = predictor.prediction();
  prediction.largest_step = largest_step;
  prediction.input_bytes = scans.heldBytes();
  const double predicted = peakBytes(prediction.bytes(output, options.mirror_distance), tables);
  const std::optional<std::uint64_t> available = availableMemoryBytes();
  messages.notice("predicted peak memory: " + std::string(stride > 1 ? "at least " : "") + bytesInWords(predicted) +
                  (available ? ", available " + bytesInWords(static_cast<double>(*available)) : std::string()));
  MemoryCheck check;
  check.predicted_bytes = static_cast<std::uint64_t>(predicted);
  const std::optional<std::uint64_t> known_limit = memoryLimit(options);
  check.limit_bytes = known_limit.value_or(check.predicted_bytes);
  const auto limit = static_cast<double>(check.limit_bytes);
  if (!known_limit || predicted <= limit) return check;
  if (marginsOfTiles) {
    // The sample touches fewer leaves than all rays do.
    const double fixed = MemoryPrediction{}.bytes(output);
    const double ratio = (predictor.prediction().bytes(output) - fixed) /
                         std::max(1.0, sample.prediction(tools, params).bytes(output) - fixed);
    const tiles::TileMargins margins = marginsOfTiles();
    check.tile_voxels = TileChoice(tools, params, margins, sample, ratio).largestFitting(tables, limit);
    // Several are in memory at a time.
    if (check.tile_voxels > 0 && params.change.mode == ChangeMode::Full)
      check.tile_voxels = std::min(check.tile_voxels, tiles::edgeSideBySide(margins, params));
    if (check.tile_voxels > 0) return check;
  }
  const double voxel_m = smallestFittingVoxel_m(options, tools, noise_m, sample, output, prediction, limit);
  std::string advice = voxel_m > 0 ? "Use --voxel " + numberText(voxel_m) + " or larger, the smallest that fits" +
                                         (marginsOfTiles ? " in one piece" : "")
                                   : "No voxel size fits: allow more memory";
  const double step_deg = smallestFittingStep_deg(
      tools, params, prediction,
      [&](const MemoryPrediction& of_step) { return of_step.bytes(output, options.mirror_distance); }, limit);
  if (step_deg > 0) advice += ", or a STEP of " + numberText(step_deg) + " degrees in --orientations sphere";
  throw ResourceLimit("limit.memory", limited ? "--max-memory " + options.max_memory : std::string("memory"),
                      "the run needs about " + bytesInWords(predicted) + ", more than " + bytesInWords(limit), advice);
}

}  // namespace accessvdb::tools
