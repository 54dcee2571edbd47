// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Memory and time of a rolling field along a flight through the forest of `accessvdb-lab bench`, out and back: a table
/// with a row per 100 m. Options by environment: ACCESSVDB_BENCH_METRES (400; the way out and back together),
/// ACCESSVDB_BENCH_VOXEL_MM (50), ACCESSVDB_BENCH_LIMIT_MB (2000; 0 = none), ACCESSVDB_BENCH_PROCESS_MB (0 = none; like
/// --max-memory, with this program's own memory, and RSS and peak then have it, too), ACCESSVDB_BENCH_RANGE_M (30),
/// ACCESSVDB_BENCH_FULL (0; 1 = --change full), ACCESSVDB_BENCH_TILE (0 = rule; voxels), ACCESSVDB_BENCH_THREADS (0 =
/// all), ACCESSVDB_BENCH_SPHERE_DEG (0 = yaw), ACCESSVDB_BENCH_RESUME_EVERY_M (0 = never; otherwise the field is saved
/// and closed after so many metres, opened again from its folder and goes on), ACCESSVDB_BENCH_UPDATE_EVERY (1; labels
/// follow every so many scans), ACCESSVDB_BENCH_CUDA (0; 1 = on the GPU), ACCESSVDB_BENCH_DEVICE_MB (0 = the rule),
/// TMPDIR for where tiles go.
#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/rolling_field.h"
#include "bench/pine_flight.h"

namespace accessvdb {
namespace {

namespace fs = std::filesystem;
using bench::environment;
using bench::Moment;

constexpr double kStep_m = 0.5, kMetresPerRow = 100;

std::uint64_t residentBytes(const char* what) {
  std::ifstream status("/proc/self/status");
  std::uint64_t kibibytes = 0;
  for (std::string word; status >> word;)
    if (word == what) status >> kibibytes;
  return 1024 * kibibytes;
}

struct Scan {
  std::vector<Eigen::Vector3f> points_S;
  Eigen::Isometry3d T_W_S;
};

/// Scans each half a metre along the lane, made when they are asked for.
class Flight {
 public:
  Flight(double out_m, double range_m) : frames_(static_cast<int>(out_m / kStep_m)), simulator_(make(range_m)) {}
  [[nodiscard]] int frames() const { return frames_; }
  [[nodiscard]] Scan at(int frame) const {
    const auto frames = simulator_.framesOfReturns(frame, frame + 1, bench::kFlightReturns);
    return {frames.front().points_S, frames.front().T_W_S};
  }

 private:
  [[nodiscard]] sim::Simulator make(double range_m) const {
    sim::ForestParams params;
    params.path_length_m = std::max(kStep_m * frames_, 1.0);
    params.view_m = range_m;
    params.solid_foliage_m = 0.05;
    sim::Forest forest = sim::makeForest(params);
    sim::LidarModel sensor = sim::LidarModel::named("mid360");
    sensor.rays_per_frame = 8 * bench::kFlightReturns;
    sensor.frame_period_s = bench::kFlightPeriod_s;
    sensor.range_noise_m = bench::kFlightNoise_m;
    sensor.min_range_m = 0.2;
    sensor.max_range_m = range_m;
    return {sim::RayCaster(std::move(forest.meshes), forest.placed), "forest", sensor,
            sim::forestFlight(kStep_m / bench::kFlightPeriod_s, bench::kFlightPeriod_s, frames_), 1};
  }

  int frames_;
  sim::Simulator simulator_;
};

double at(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

/// A field that is stopped now and then and resumed from its folder: what it counts goes on.
class ResumedField {
 public:
  ResumedField(const ToolSpec& tool, const FieldParams& params, const RollingOptions& options)
      : tools_{tool}, params_(params), options_(options), field_(std::in_place, tools_, params, options) {}
  RollingField* operator->() { return &*field_; }
  void resume() {
    const Moment start = Moment::now();
    field_->checkpoint();
    const RollingStatus status = field_->status();
    saved_ += status.saved;
    loaded_ += status.loaded;
    field_.reset();
    field_.emplace(RollingField::resume(tools_, params_, options_));
    ++resumed_;
    resumed_ms_ += Moment::now().clock_ms - start.clock_ms;
  }
  [[nodiscard]] RollingStatus status() const {
    RollingStatus status = field_->status();
    status.saved += saved_;
    status.loaded += loaded_;
    return status;
  }
  /// Since the last call.
  [[nodiscard]] std::string takeResumed() {
    const int times = std::exchange(resumed_, 0);
    const double ms = std::exchange(resumed_ms_, 0);
    if (times == 0) return {};
    return "  resumed " + std::to_string(times) + " x, " + std::to_string(std::lround(ms / times)) + " ms each";
  }

 private:
  std::vector<ToolSpec> tools_;
  FieldParams params_;
  RollingOptions options_;
  std::optional<RollingField> field_;
  std::uint64_t saved_ = 0, loaded_ = 0;  ///< by those before
  int resumed_ = 0;
  double resumed_ms_ = 0;
};

int run() {
  std::string folder = (fs::temp_directory_path() / "accessvdb_rolling_XXXXXX").string();
  if (::mkdtemp(folder.data()) == nullptr) return 1;
  const double metres = environment("ACCESSVDB_BENCH_METRES", 400),
               range_m = environment("ACCESSVDB_BENCH_RANGE_M", 30);
  const Flight flight(metres / 2, range_m);
  FieldParams params = bench::flightParams(0.001 * environment("ACCESSVDB_BENCH_VOXEL_MM", 50));
  params.tsdf.truncation_distance_m = 0;  // by the rule
  params.tsdf.max_range_m = range_m;
  params.backend = environment("ACCESSVDB_BENCH_CUDA", 0) != 0 ? BackendKind::Cuda : BackendKind::Cpu;
  if (environment("ACCESSVDB_BENCH_FULL", 0) != 0) params.change.mode = ChangeMode::Full;
  params.threads = environment("ACCESSVDB_BENCH_THREADS", 0);
  RollingOptions options;
  options.folder = folder + "/tiles";
  options.memory_limit_bytes =
      std::uint64_t{1000000} * static_cast<std::uint64_t>(environment("ACCESSVDB_BENCH_LIMIT_MB", 2000));
  options.process_limit_bytes =
      std::uint64_t{1000000} * static_cast<std::uint64_t>(environment("ACCESSVDB_BENCH_PROCESS_MB", 0));
  if (options.process_limit_bytes > 0) options.memory_limit_bytes = 0;
  options.device_limit_bytes =
      std::uint64_t{1000000} * static_cast<std::uint64_t>(environment("ACCESSVDB_BENCH_DEVICE_MB", 0));
  options.tile_voxels = environment("ACCESSVDB_BENCH_TILE", 0);
  const std::uint64_t program = residentBytes("VmRSS:"), before = options.process_limit_bytes > 0 ? 0 : program;
  const int sphere_deg = environment("ACCESSVDB_BENCH_SPHERE_DEG", 0);
  const OrientationSet orientations = sphere_deg > 0 ? OrientationSet::sphere(sphere_deg) : OrientationSet::yaw();
  const Moment making = Moment::now();
  ResumedField field({ToolGeometry::builtin("builtin:pruner"), orientations}, params, options);
  const double made_ms = Moment::now().clock_ms - making.clock_ms;
  const RollingStatus begin = field.status();
  std::printf("tables of the tool: %.0f ms, %.1f MB\n", made_ms, 1e-6 * static_cast<double>(begin.memory_bytes));
  std::printf("tiles of %d voxels, %.1f m, margin %.1f m; simulator and program %.0f MB\n", begin.tile_voxels,
              begin.tile_voxels * params.tsdf.voxel_size_m, begin.margin_voxels * params.tsdf.voxel_size_m,
              1e-6 * static_cast<double>(program));
  std::printf("%6s %6s %9s %9s %9s %9s | %8s %8s %8s | %6s %6s %10s\n", "m", "tiles", "in memory", "counts MB",
              "RSS MB", "peak MB", "median", "p99", "most ms", "saved", "loaded", "points");
  std::vector<double> step_ms;
  const int steps = 2 * flight.frames(), row = static_cast<int>(kMetresPerRow / kStep_m);
  const int resume_every = static_cast<int>(environment("ACCESSVDB_BENCH_RESUME_EVERY_M", 0) / kStep_m);
  const int update_every = std::max(environment("ACCESSVDB_BENCH_UPDATE_EVERY", 1), 1);
  for (int n = 0; n < steps; ++n) {
    if (resume_every > 0 && n > 0 && n % resume_every == 0) field.resume();
    const Scan scan = flight.at(n < flight.frames() ? n : steps - 1 - n);
    const Moment start = Moment::now();
    field->integrateScan(scan.points_S, scan.T_W_S, bench::kFlightPeriod_s * n);
    if ((n + 1) % update_every == 0 || n + 1 == steps) field->update();
    step_ms.push_back(Moment::now().clock_ms - start.clock_ms);
    if ((n + 1) % row != 0 && n + 1 != steps) continue;
    const RollingStatus status = field.status();
    std::printf("%6.0f %6lu %9lu %9.0f %9.0f %9.0f | %8.0f %8.0f %8.0f | %6lu %6lu %10lu%s%s\n", kStep_m * (n + 1),
                static_cast<unsigned long>(status.tiles), static_cast<unsigned long>(status.tiles_in_memory),
                1e-6 * static_cast<double>(status.memory_bytes),
                1e-6 * static_cast<double>(residentBytes("VmRSS:") - before),
                1e-6 * static_cast<double>(residentBytes("VmHWM:") - before), at(step_ms, 0.5), at(step_ms, 0.99),
                at(step_ms, 1), static_cast<unsigned long>(status.saved), static_cast<unsigned long>(status.loaded),
                static_cast<unsigned long>(status.points), status.memory_short ? "  memory short" : "",
                field.takeResumed().c_str());
    std::fflush(stdout);
    step_ms.clear();
  }
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  return 0;
}

}  // namespace
}  // namespace accessvdb

int main() { return accessvdb::run(); }
