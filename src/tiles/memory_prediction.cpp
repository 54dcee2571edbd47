// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/program/memory_prediction.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>

#include "hostdev/mixed_bits.h"

namespace accessvdb {
namespace {

// Bytes per item. A run first fuses, then writes one file after another; each writer makes copies and frees them. So
// the peak is what is held between them plus the largest copy. Calibrated with the resident memory of `map` in each
// phase: BALM's 12 scans at 100, 50, 30, 20 and 12 mm (0.16 M points and 0.33 GB to 0.82 M and 3.3 GB) and KITTI's 5 at
// 100 and 50 mm, on two cores. The predictor finds 12 % fewer leaves than there are, so these are 12 % more bytes than
// a leaf has.
constexpr double kFixedBytes = 74e6;  // program and libraries: a map of 400 returns takes 185 MB with its picture
// Buffers of a scan and of the threads: 85 MB with the scans above, nothing with one of 400 returns.
constexpr double kBufferBytesPerReturn = 850, kMostBufferBytes = 85e6;
// A step of many returns: one scan of 1 and of 8 M returns took 373 and 378 bytes a return more than the same returns
// in steps of 20 000.
constexpr double kStepBytesPerReturn = 380;
constexpr double kConeLeafBytes = 2500;                  // authored leaf with distances and weights, tree included
constexpr double kBandLeafBytes = 300;                   // authored leaf with cleared flags only
constexpr double kMirrorLeafBytes = 400;                 // NanoVDB leaf of the mirror, slack of its growth included
constexpr double kNodeBytes = 33.8e3 + 33.9e3 + 16.9e3;  // node above leaves: authored, mirror, the host's copy of it
// A surface point with its state, in the store and its indices, and what it remembers of each direction. BALM at 100,
// 50, 30 and 20 mm takes 90 to 96 % of what is predicted then.
constexpr double kStoredPointBytes = 340, kRememberedDirectionBytes = 1.4;
// Mirror of distances, from its layout alone: leaf and the host's stamp of it, node and the host's copy of it.
constexpr double kDistanceLeafBytes = 2144 + 4, kDistanceNodeBytes = 33.9e3 + 16.9e3;
// field.vdb: one float grid at a time, and the points in the order of its leaves. `surface` has several leaves per leaf
// with a point.
constexpr double kExportLeafBytes = 2350, kExportNodeBytes = 33.8e3, kLevelSetLeafBytes = 5900, kSortedPointBytes = 42;
// field_points.vdb: OpenVDB's index of the points and its grid of them, at once.
constexpr double kPointLeafBytes = 6600, kPointColumnsBytes = 44;
constexpr double kPictureBytes = 111e6, kDrawnPointBytes = 38;  // preview.png: canvas, image, file
// A surface point with three snapshots and no writer: BALM's 12 scans at 50 and 20 mm took 0.50 and 1.11 GB, of which
// this predicts 1.08 and 1.01. While scans are fused, 65 MB more are in use than afterwards.
constexpr double kLabelledPointBytes = 500, kFusingBytes = 65e6;
// Program and libraries while the tool's tables are made: 133 to 138 MB of the peak of three runs with one scan of 300
// returns and builtin:pruner at 10, 5 and 2 mm.
constexpr double kFixedBeforeScansBytes = 142e6;

constexpr double kLeafVoxels = 8, kNodesPerLeaf = 1.0 / 16;
// A voxel's cell is half a voxel around its sample, so leaf k begins at voxel coordinate 8 k - 0.5.
constexpr double kLeafShift = 0.5 / kLeafVoxels;
// The cone and the band are cut into slabs this thick along the ray, and a leaf counts when a slab comes this near to
// its outermost voxel centres. Among 2.5 .. 4.5 and 0 .. 0.5 this pair is nearest to exact counts: -3 .. +10 %.
constexpr double kSlabVoxels = 3.5;
constexpr double kReachVoxels = 0.25;
// Makes truncation of a coordinate a floor, for every coordinate that the map can hold.
constexpr double kOffset = 1099511627776.0;  // 2^40

std::int64_t cell(double x) { return static_cast<std::int64_t>(x + kOffset); }

std::uint64_t hashOf(std::int64_t x, std::int64_t y, std::int64_t z) {
  return kernels::mixedBits(static_cast<std::uint64_t>(x) * 0x9e3779b97f4a7c15ULL +
                            static_cast<std::uint64_t>(y) * 0xc2b2ae3d27d4eb4fULL +
                            static_cast<std::uint64_t>(z) * 0x165667b19e3779f9ULL);
}

std::optional<std::uint64_t> readNumber(const char* path) {
  std::ifstream in(path);
  std::uint64_t value = 0;
  if (in >> value) return value;
  return std::nullopt;
}

}  // namespace

void DistinctCounter::merge(const DistinctCounter& other) {
  for (std::size_t i = 0; i < registers_.size(); ++i) registers_[i] = std::max(registers_[i], other.registers_[i]);
}

double DistinctCounter::estimate() const {
  double sum = 0;
  std::size_t zeros = 0;
  for (const std::uint8_t rank : registers_) {
    sum += std::ldexp(1.0, -rank);
    zeros += rank == 0;
  }
  constexpr auto kCount = static_cast<double>(kRegisters);
  const double raw = 0.7213 / (1 + 1.079 / kCount) * kCount * kCount / sum;
  if (raw <= 2.5 * kCount && zeros > 0) return kCount * std::log(kCount / static_cast<double>(zeros));
  return raw;
}

double MemoryPrediction::bytes(RunOutput output, bool with_distances) const {
  const double distances = with_distances ? cone_leaves * kDistanceLeafBytes + nodes * kDistanceNodeBytes : 0;
  const double buffers = std::max(std::min(kBufferBytesPerReturn * static_cast<double>(returns), kMostBufferBytes),
                                  kStepBytesPerReturn * static_cast<double>(largest_step));
  const double map = kFixedBytes + static_cast<double>(input_bytes) + buffers +
                     cone_leaves * (kConeLeafBytes + kMirrorLeafBytes) +
                     band_leaves * (kBandLeafBytes + kMirrorLeafBytes) + nodes * kNodeBytes + distances;
  if (output == RunOutput::Labels) return map + kFusingBytes + surface_points * kLabelledPointBytes;
  const double level_set = output == RunOutput::FieldWithSurface ? surface_leaves * kLevelSetLeafBytes : 0;
  const double field_vdb = std::max(cone_leaves * kExportLeafBytes + nodes * kExportNodeBytes, level_set) +
                           surface_points * kSortedPointBytes;
  const double points_vdb = surface_leaves * kPointLeafBytes + surface_points * kPointColumnsBytes;
  const double picture = output == RunOutput::Tile ? 0 : kPictureBytes + surface_points * kDrawnPointBytes;
  const double point = kStoredPointBytes + remembered_directions * kRememberedDirectionBytes;
  return map + surface_points * point + std::max({field_vdb, points_vdb, picture});
}

double peakBytes(double without_tool, const ToolTableBytes& tool) {
  return std::max(kFixedBeforeScansBytes + static_cast<double>(tool.making),
                  without_tool + static_cast<double>(tool.held));
}

namespace {

int rememberedOf(const FieldParams& params) {
  const bool remembered = params.update.policy == UpdatePolicy::Exact && params.backend != BackendKind::Cuda;
  const int directions = params.approach.directionCount();
  // With more directions than a mask has, a point has two bits each and nothing else; one of the two is in an array
  // that grows by a quarter.
  constexpr double kBitsEach = 2.25;
  if (directions > OrientationSet::kMostRemembered) {
    return static_cast<int>(directions * kBitsEach / 8 / kRememberedDirectionBytes);
  }
  // A byte of each is in whole cache lines, the rest in words of eight.
  const auto roundUp = [&](int to) { return (directions + to - 1) / to * to; };
  return remembered ? directions + static_cast<int>((roundUp(64) - roundUp(8)) / kRememberedDirectionBytes) : 0;
}

}  // namespace

int rememberedDirections(const std::vector<ToolSpec>& tools, const FieldParams& params) {
  // Record and state of a point for a tool; and its position, sums, views and block once more for tools that are tried
  // in other directions than the first.
  constexpr int kStateBytes = 136, kViewBytes = 144;
  constexpr int kCarried = 3;  // the 4.1 bytes of an attribute, in this unit
  int bytes = kCarried * static_cast<int>(params.carry.size());
  for (std::size_t k = 0; k < tools.size(); ++k) {
    FieldParams of_tool = params;
    of_tool.approach.orientations = tools[k].orientations;
    bytes += rememberedOf(of_tool);
    if (k == 0) continue;
    bytes += kStateBytes;
    const OrientationSet &own = tools[k].orientations, &first = tools.front().orientations;
    if (own.kind != first.kind || own.step_deg != first.step_deg || own.list.size() != first.list.size()) {
      bytes += kViewBytes;  // or nearly so: it is an estimate
    }
  }
  return bytes;
}

MemoryPredictor::MemoryPredictor(const TsdfParams& params, int remembered_directions)
    : params_(params),
      remembered_directions_(remembered_directions),
      per_leaf_(1.0 / (kLeafVoxels * params.voxel_size_m)) {}

/// Counts the node of the middle only: pieces are small compared with a node.
void MemoryPredictor::touchNode(const Eigen::Vector3d& centre) {
  const Eigen::Vector3d node = ((centre * per_leaf_).array() + kLeafShift) * kNodesPerLeaf;
  nodes_.add(hashOf(cell(node.x()), cell(node.y()), cell(node.z())));
}

void MemoryPredictor::touchBox(const Eigen::Vector3d& centre, const Eigen::Vector3d& half, DistinctCounter& counter) {
  touchNode(centre);
  const Eigen::Vector3d low = ((centre - half) * per_leaf_).array() + kLeafShift;
  const Eigen::Vector3d high = ((centre + half) * per_leaf_).array() + kLeafShift;
  for (std::int64_t x = cell(low.x()); x <= cell(high.x()); ++x) {
    for (std::int64_t y = cell(low.y()); y <= cell(high.y()); ++y) {
      for (std::int64_t z = cell(low.z()); z <= cell(high.z()); ++z) counter.add(hashOf(x, y, z));
    }
  }
}

void MemoryPredictor::touchSlab(const Eigen::Vector3d& centre, const Eigen::Vector3d& u, double radius,
                                DistinctCounter& counter) {
  touchNode(centre);
  const double v = params_.voxel_size_m, thick = 0.5 * kSlabVoxels * v;
  const Eigen::Vector3d half = (1.0 - u.array().square()).max(0.0).sqrt().matrix() * radius + u.cwiseAbs() * thick;
  const Eigen::Vector3d low = ((centre - half) * per_leaf_).array() + kLeafShift;
  const Eigen::Vector3d high = ((centre + half) * per_leaf_).array() + kLeafShift;
  const std::int64_t x0 = cell(low.x()), x1 = cell(high.x()), y0 = cell(low.y()), y1 = cell(high.y()),
                     z0 = cell(low.z()), z1 = cell(high.z());
  if (x0 == x1 && y0 == y1 && z0 == z1) {
    counter.add(hashOf(x0, y0, z0));
    return;
  }
  const double edge = 1.0 / per_leaf_, span = edge - (1 - 2 * kReachVoxels) * v;
  for (std::int64_t x = x0; x <= x1; ++x) {
    for (std::int64_t y = y0; y <= y1; ++y) {
      for (std::int64_t z = z0; z <= z1; ++z) {
        const Eigen::Vector3d first =
            Eigen::Vector3d(static_cast<double>(x) - kOffset, static_cast<double>(y) - kOffset,
                            static_cast<double>(z) - kOffset) *
                edge -
            Eigen::Vector3d::Constant(kReachVoxels * v);
        const Eigen::Vector3d nearest = centre.cwiseMax(first).cwiseMin((first.array() + span).matrix()) - centre;
        const double s = nearest.dot(u);
        if (std::abs(s) <= thick && nearest.squaredNorm() - s * s <= radius * radius) counter.add(hashOf(x, y, z));
      }
    }
  }
}

void MemoryPredictor::add(const Eigen::Vector3d& o_L, const Eigen::Vector3d& p_L) {
  const Eigen::Vector3d towards = o_L - p_L;
  const double range = towards.norm();
  if (!(range >= std::max(params_.min_range_m, 1e-9) && range <= params_.max_range_m)) return;
  if (!(p_L.cwiseAbs().maxCoeff() < params_.voxel_size_m * kOffset / 2)) return;  // the map drops it, too
  ++returns_;
  const double v = params_.voxel_size_m, tau = params_.truncation_distance_m, slab = kSlabVoxels * v;
  const Eigen::Vector3d u = towards / range;
  const std::int64_t x = cell(p_L.x() / v + 0.5), y = cell(p_L.y() / v + 0.5), z = cell(p_L.z() / v + 0.5);
  surface_.add(hashOf(x, y, z));
  surface_leaves_.add(hashOf(x >> 3, y >> 3, z >> 3));

  if (params_.region == UpdateRegion::FullCube) {
    touchBox(p_L, Eigen::Vector3d::Constant(tau), cone_leaves_);
  } else {
    const double sine = std::sqrt(1.0 - params_.cone_cos_min * params_.cone_cos_min);
    const double spread = sine / params_.cone_cos_min;
    for (double s = 0.5 * slab; s < tau + 0.5 * slab; s += slab) {
      const double middle = std::min(s, std::max(tau - 0.5 * slab, 0.0));  // the last slab ends at tau
      const double radius = std::min(spread * middle, sine * tau);
      if (middle < range) touchSlab(p_L + u * middle, u, radius, cone_leaves_);
      touchSlab(p_L - u * middle, u, radius, cone_leaves_);
    }
  }
  const double end = std::min(params_.cleared_end_tau * tau, range);
  for (double s = params_.cleared_begin_tau * tau + 0.5 * slab; s < end + 0.5 * slab; s += slab) {
    touchSlab(p_L + u * std::min(s, end - 0.5 * slab), u, params_.cleared_radius_voxels * v, band_leaves_);
  }
  const double line_end = std::min(params_.clear_rays_m, range), half_leaf = 0.5 * kLeafVoxels * v;
  for (double s = end; s < line_end; s += half_leaf) touchBox(p_L + u * s, Eigen::Vector3d::Zero(), band_leaves_);
}

void MemoryPredictor::merge(const MemoryPredictor& other) {
  cone_leaves_.merge(other.cone_leaves_);
  band_leaves_.merge(other.band_leaves_);
  nodes_.merge(other.nodes_);
  surface_.merge(other.surface_);
  surface_leaves_.merge(other.surface_leaves_);
  returns_ += other.returns_;
}

MemoryPrediction MemoryPredictor::prediction() const {
  MemoryPrediction result;
  result.returns = returns_;
  result.remembered_directions = remembered_directions_;
  result.surface_points = surface_.estimate();
  result.surface_leaves = surface_leaves_.estimate();
  result.nodes = nodes_.estimate();
  result.cone_leaves = cone_leaves_.estimate();
  DistinctCounter both = band_leaves_;
  both.merge(cone_leaves_);
  result.band_leaves = std::max(0.0, both.estimate() - result.cone_leaves);
  return result;
}

std::optional<std::uint64_t> availableMemoryBytes() {
  std::uint64_t best = std::numeric_limits<std::uint64_t>::max();
  std::ifstream meminfo("/proc/meminfo");
  for (std::string key; meminfo >> key;) {
    std::uint64_t kib = 0;
    std::string rest;
    if (key == "MemAvailable:" && meminfo >> kib) best = kib * 1024;
    std::getline(meminfo, rest);
  }
  // Version 2, then version 1 of control groups, as a container sees its own.
  for (const auto& [limit, used] :
       {std::pair{"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"},
        std::pair{"/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"}}) {
    const auto most = readNumber(limit);
    const auto now = readNumber(used);
    if (most && now && *most > *now) best = std::min(best, *most - *now);
  }
  if (best == std::numeric_limits<std::uint64_t>::max()) return std::nullopt;
  return best;
}

std::uint64_t residentMemoryBytes() {
  std::uint64_t mapped = 0, resident = 0;  // [pages]
  std::ifstream("/proc/self/statm") >> mapped >> resident;
  return resident * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

std::uint64_t peakMemoryBytes() {
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;  // Linux counts in KiB
}

}  // namespace accessvdb
