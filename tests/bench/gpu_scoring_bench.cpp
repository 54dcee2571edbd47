// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// GPU throughput: scoring and the mirror, on a map and points of a generated walk past trees.
///
///   accessvdb_bench_gpu [--voxel M] [--tau M] [--points N] [--frames N] [--repeats N] [--out FILE.json]
///                       [--orientations TEXT]
/// Every row is timed --repeats times after one warm-up run: device times by events, call times by the host's clock,
/// including transfers. All results are compared with the CPU's, field for field. With --orientations, in place of yaw,
/// a turned rod of 0.6 m is scored at 20 000 points.
#include <algorithm>
#include <cstring>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>

#include "accessvdb/error.h"
#include "cuda/cuda_backend.h"
#include "field/point_weights.h"
#include "field/tools/scoring_setup.h"
#include "launch/stopwatch.h"
#include "mirror/nanovdb_mirror.h"
#include "sample_scans/walk_generator.h"
#include "support/box_tool.h"
#include "tsdf/scan_integrator.h"
#include "update/point_scorer.h"

namespace accessvdb {
namespace {

using Json = nlohmann::ordered_json;
using kernels::SearchPath;

struct Options {
  double voxel_m = 0.01, tau_m = 0.1;
  std::size_t points = 1000000;
  int frames = 1000, repeats = 15;
  std::string out, orientations = "yaw";
};

Options parse(int argc, char** argv) {
  Options options;
  for (int n = 1; n + 1 < argc; n += 2) {
    const std::string name = argv[n], value = argv[n + 1];
    if (name == "--voxel") options.voxel_m = std::stod(value);
    if (name == "--tau") options.tau_m = std::stod(value);
    if (name == "--points") options.points = std::stoul(value);
    if (name == "--frames") options.frames = std::stoi(value);
    if (name == "--repeats") options.repeats = std::stoi(value);
    if (name == "--out") options.out = value;
    if (name == "--orientations") options.orientations = value;
  }
  return options;
}

Json spread(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double q) {
    return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
  };
  return {{"median", at(0.5)}, {"min", values.front()}, {"p95", at(0.95)}, {"max", values.back()}};
}

/// Round about its body: a prism of many sides.
ToolGeometry turnedRod() {
  constexpr std::uint32_t kSides = 48;
  constexpr float kLength_m = 0.6f, kRadius_m = 0.025f;
  std::vector<Eigen::Vector3f> vertices_T = {{0, 0, 0}, {kLength_m, 0, 0}};
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (const float x : {0.0f, kLength_m}) {
    for (std::uint32_t n = 0; n < kSides; ++n) {
      const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(n) / kSides;
      vertices_T.emplace_back(x, kRadius_m * std::sin(angle), kRadius_m * std::cos(angle));
    }
  }
  for (std::uint32_t n = 0; n < kSides; ++n) {
    const std::uint32_t a = 2 + n, b = 2 + (n + 1) % kSides, c = a + kSides, d = b + kSides;
    for (const std::array<std::uint32_t, 3>& triangle : {std::array{0u, b, a}, {1u, c, d}, {a, b, d}, {a, d, c}}) {
      triangles.push_back(triangle);
    }
  }
  return ToolGeometry::fromTriangles(vertices_T, triangles, "turned rod 0.6 m");
}

ToolGeometry rod() { return test::boxTool({0, -0.025f, -0.025f}, {0.5f, 0.025f, 0.025f}, "rod"); }

/// The map, mirrored for both backends, and the points with what scoring needs.
class World {
 public:
  World(const Options& options, const FieldParams& params, kernels::CudaBackend& cuda, kernels::Backend& cpu)
      : params_(params),
        map_(params.tsdf),
        store_(params, internal::ExpandedOrientations::of(params.approach).table()),
        cuda_mirror_(cuda.makeArena(), params.tsdf.voxel_size_m),
        cpu_mirror_(cpu.makeArena(), params.tsdf.voxel_size_m),
        cuda_points_(cuda, words()),
        cpu_points_(cpu, words()) {
    map_.setCollisionDistance(static_cast<float>(params.scoring.collision_distance_m));
    integrate(options, cuda);
    describePoints(cuda, cpu);
  }

  [[nodiscard]] int words() const { return (params_.approach.directionCount() + 63) / 64; }

  FieldParams params_;
  internal::PackedMap map_;
  internal::PointStore store_;
  internal::NanoVdbMirror cuda_mirror_, cpu_mirror_;
  internal::PointsOnDevice cuda_points_, cpu_points_;
  std::vector<std::uint32_t> ids_;  ///< with enough observations
  std::vector<double> mirror_ms_, apply_ms_, cpu_mirror_ms_, mirror_bytes_, mirror_leaves_;
  int frames_ = 0;

 private:
  void integrate(const Options& options, kernels::CudaBackend& cuda) {
    samples::WalkOptions walk_options;
    walk_options.frames = options.frames;
    walk_options.rays_per_frame = 30000;  // of which about 20 000 return
    walk_options.range_noise_m = 0.02;
    const samples::WalkGenerator walk(walk_options);
    internal::ScanIntegrator integrator(map_);
    for (int frame = 0; frame < options.frames && store_.size() < options.points; ++frame) {
      const samples::WalkFrame scan = walk.frame(frame);
      const Eigen::Vector3f q_L = scan.T_W_S.translation().cast<float>();
      std::vector<Eigen::Vector3f> p_L;
      for (const Eigen::Vector3f& p_S : scan.points_S) {
        if (!p_S.isZero(0) && p_L.size() < 20000) p_L.push_back((scan.T_W_S * p_S.cast<double>()).cast<float>());
      }
      const internal::IntegrationResult result = integrator.integrate(p_L, {&q_L, 1});
      store_.addReturns(p_L, {&q_L, 1});
      const kernels::Stopwatch watch;
      cuda_mirror_.applyLists(result.changes);
      apply_ms_.push_back(watch.milliseconds());
      cuda.finish();
      mirror_ms_.push_back(watch.milliseconds());
      mirror_bytes_.push_back(static_cast<double>(cuda_mirror_.lastTraffic().bytes_written));
      mirror_leaves_.push_back(
          static_cast<double>(cuda_mirror_.lastTraffic().leaves_added + cuda_mirror_.lastTraffic().leaves_patched));
      const kernels::Stopwatch cpu_watch;
      cpu_mirror_.applyLists(result.changes);
      cpu_mirror_ms_.push_back(cpu_watch.milliseconds());
      ++frames_;
    }
  }

  void describePoints(kernels::CudaBackend& cuda, kernels::Backend& cpu) {
    internal::PointScorer scorer(store_, params_, cpu, internal::makeMapReads(map_, store_, true));
    scorer.grow();
    ids_.resize(store_.size());
    std::iota(ids_.begin(), ids_.end(), 0u);
    scorer.refreshWeights(ids_);
    std::erase_if(ids_, [&](std::uint32_t id) { return !scorer.confidentEnough(id); });
    scorer.refreshNeighbourhoods(ids_);
    std::vector<kernels::PointInput> inputs;
    for (const std::uint32_t id : ids_) {
      kernels::PointInput& input = inputs.emplace_back();
      input.id = id;
      input.weight = scorer.record(id).weight;
      input.seen = scorer.record(id).seen;
      for (int axis = 0; axis < 3; ++axis) {
        input.position_L[axis] = store_.first_L(id)[axis];
        input.normal_L[axis] = scorer.record(id).normal_L[axis];
      }
    }
    for (auto* points : {&cuda_points_, &cpu_points_}) points->grow(store_.size());
    cuda.writePoints(cuda_points_.view(), inputs.data(), inputs.size());
    cpu.writePoints(cpu_points_.view(), inputs.data(), inputs.size());
    if (!store_.isWide()) return;
    const auto row = static_cast<std::size_t>(words());
    std::vector<std::uint64_t> seen;
    for (const std::uint32_t id : ids_) {
      const std::uint64_t* first = scorer.device().view().seen + row * id;
      seen.insert(seen.end(), first, first + row);
    }
    cuda.writeSeen(cuda_points_.view(), ids_.data(), seen.data(), ids_.size());
    cpu.writeSeen(cpu_points_.view(), ids_.data(), seen.data(), ids_.size());
  }
};

/// @param masked  also what is found on the way; of a wide set, where a count stops is up to the backend
bool same(const kernels::ScoreResult& a, const kernels::ScoreResult& b, bool masked) {
  const bool outcome = a.score == b.score && a.direction == b.direction && a.reason == b.reason &&
                       a.scored == b.scored && a.skipped == b.skipped && a.tests == b.tests && a.label == b.label;
  if (!masked) return outcome;
  return outcome && a.least_blocked == b.least_blocked &&
         std::memcmp(a.arm_blocked.word, b.arm_blocked.word, sizeof(a.arm_blocked)) == 0 &&
         std::memcmp(a.tool_blocked.word, b.tool_blocked.word, sizeof(a.tool_blocked)) == 0;
}

class Bench {
 public:
  Bench(const Options& options, World& world, kernels::CudaBackend& cuda, kernels::Backend& cpu)
      : options_(options), world_(world), cuda_(cuda), cpu_(cpu) {}

  /// The fastest way only, of any set of orientations.
  void oriented(const ToolGeometry& geometry) {
    internal::ScoringSetup on_gpu(geometry, world_.params_, cuda_), on_cpu(geometry, world_.params_, cpu_);
    const Json about = {{"tool", geometry.name()}, {"orientations", world_.params_.approach.orientations.text()}};
    for (const auto& [which, ids] : {std::pair{"recent", recent()}, {"scattered", scattered()}}) {
      scoreRow(about, which, ids, SearchPath::Fast, on_gpu, on_cpu);
    }
  }

  void tool(const std::string& name, const ToolGeometry& geometry, ToolForm form) {
    FieldParams params = world_.params_;
    params.scoring.form = form;
    params.scoring.surface_samples = 1000;
    internal::ScoringSetup on_gpu(geometry, params, cuda_), on_cpu(geometry, params, cpu_);
    const auto& kernel = on_gpu.tool();
    double items_a_point = 0;  // voxels or samples over all directions
    if (form == ToolForm::Voxels) {
      for (const std::uint32_t voxels : kernel.voxel_count) items_a_point += voxels;
    } else {
      items_a_point = static_cast<double>(kernel.samples.size()) / 3;
    }
    const Json about = {
        {"tool", name},
        {"form", form == ToolForm::Voxels ? "voxels" : "samples"},
        {"mean_items_per_direction", items_a_point / params.approach.num_directions},
        {"mean_columns_per_direction", static_cast<double>(kernel.columns.size()) / params.approach.num_directions}};
    const std::vector<std::uint32_t> recent = this->recent(), scattered = this->scattered();
    for (const SearchPath path : {SearchPath::Fast, SearchPath::Lowers, SearchPath::Tree}) {
      if (path != SearchPath::Fast && form == ToolForm::SurfaceSamples) continue;
      countRow(about, "recent", recent, path, on_gpu, items_a_point);
      if (path == SearchPath::Fast) countRow(about, "scattered", scattered, path, on_gpu, items_a_point);
    }
    for (const SearchPath path : {SearchPath::Fast, SearchPath::Lowers, SearchPath::Tree, SearchPath::Plain}) {
      scoreRow(about, "recent", recent, path, on_gpu, on_cpu);
      if (path == SearchPath::Fast) scoreRow(about, "scattered", scattered, path, on_gpu, on_cpu);
    }
    scoreRow(about, "all", world_.ids_, SearchPath::Fast, on_gpu, on_cpu);
  }

  Json rows = Json::array();
  std::uint64_t different = 0;

 private:
  [[nodiscard]] std::size_t few() const { return std::min<std::size_t>(20000, world_.ids_.size()); }
  [[nodiscard]] std::vector<std::uint32_t> recent() const {
    return {world_.ids_.end() - static_cast<std::ptrdiff_t>(few()), world_.ids_.end()};
  }
  [[nodiscard]] std::vector<std::uint32_t> scattered() const {
    std::vector<std::uint32_t> ids;
    for (std::size_t n = 0; n < few(); ++n) ids.push_back(world_.ids_[n * world_.ids_.size() / few()]);
    return ids;
  }
  static std::vector<kernels::ScoreItem> itemsOf(const std::vector<std::uint32_t>& ids, int directions) {
    std::vector<kernels::ScoreItem> items(ids.size());
    for (std::size_t n = 0; n < ids.size(); ++n) {
      items[n].id = ids[n];
      if (!kernels::isWide(directions)) items[n].candidates = kernels::allDirections(directions);
    }
    return items;
  }
  static kernels::ScoreRequest requestOf(const internal::ScoringSetup& setup, const internal::NanoVdbMirror& mirror,
                                         const internal::PointsOnDevice& points,
                                         const std::vector<kernels::ScoreItem>& items) {
    const internal::ScoringTables tables = setup.tables(mirror.grid());
    kernels::ScoreRequest request;
    request.map = tables.map;
    request.tool = tables.tool;
    request.approach = tables.approach;
    request.points = points.view();
    request.rule = tables.rule;
    request.items = items.data();
    request.count = items.size();
    return request;
  }
  static const char* nameOf(SearchPath path) {
    switch (path) {
      case SearchPath::Fast:
        return "fast";
      case SearchPath::Lowers:
        return "lowers";
      case SearchPath::Tree:
        return "tree";
      case SearchPath::Plain:
        return "plain";
    }
    return "";
  }

  template <class Call>
  Json timed(const Call& call) {
    call();
    std::vector<double> call_ms, order_ms, search_ms, update_ms;
    cuda_.setTiming(true);
    for (int n = 0; n < options_.repeats; ++n) {
      const kernels::Stopwatch watch;
      call();
      call_ms.push_back(watch.milliseconds());
      const kernels::DeviceTimes times = cuda_.lastTimes();
      order_ms.push_back(times.order_ms);
      search_ms.push_back(times.search_ms);
      update_ms.push_back(times.update_ms);
    }
    cuda_.setTiming(false);
    return {{"call_ms", spread(call_ms)},
            {"order_ms", spread(order_ms)},
            {"search_ms", spread(search_ms)},
            {"update_ms", spread(update_ms)}};
  }

  void add(Json row, const Json& times) {
    for (const auto& [key, value] : times.items()) row[key] = value;
    std::cerr << row.value("what", "") << " " << row.value("tool", "") << " " << row.value("form", "") << " "
              << row.value("points_of", "") << " " << row.value("path", "") << ": search " << row["search_ms"]["median"]
              << " ms, call " << row["call_ms"]["median"] << " ms";
    if (row.contains("different")) std::cerr << ", " << row["different"] << " differ, " << row["tests"] << " tests";
    std::cerr << "\n";
    rows.push_back(row);
  }

  void countRow(Json row, const char* which, const std::vector<std::uint32_t>& ids, SearchPath path,
                const internal::ScoringSetup& setup, double items_a_point) {
    cuda_.setPath(path);
    const int directions = world_.params_.approach.num_directions;
    const auto items = itemsOf(ids, directions);
    const auto request = requestOf(setup, world_.cuda_mirror_, world_.cuda_points_, items);
    std::vector<std::uint16_t> counts(ids.size() * static_cast<std::size_t>(directions));
    const Json times = timed([&] { cuda_.countCollisions(request, counts.data()); });
    row["what"] = "no filter, no early stop";
    row["points"] = ids.size();
    row["points_of"] = which;
    row["path"] = nameOf(path);
    row["collisions"] = std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
    row["giga_items_per_s"] =
        items_a_point * static_cast<double>(ids.size()) / times["search_ms"]["median"].get<double>() * 1e-6;
    add(row, times);
  }

  void scoreRow(Json row, const char* which, const std::vector<std::uint32_t>& ids, SearchPath path,
                const internal::ScoringSetup& on_gpu, const internal::ScoringSetup& on_cpu) {
    cuda_.setPath(path);
    const int directions = world_.params_.approach.directionCount();
    const auto items = itemsOf(ids, directions);
    auto request = requestOf(on_gpu, world_.cuda_mirror_, world_.cuda_points_, items);
    std::vector<kernels::ScoreResult> results(ids.size()), expected(ids.size());
    request.results = results.data();
    const Json times = timed([&] { cuda_.scorePoints(request); });
    auto host = requestOf(on_cpu, world_.cpu_mirror_, world_.cpu_points_, items);
    host.results = expected.data();
    const kernels::Stopwatch watch;
    cpu_.scorePoints(host);
    row["what"] = "filters and early stop";
    row["points"] = ids.size();
    row["points_of"] = which;
    row["path"] = nameOf(path);
    row["cpu_ms"] = watch.milliseconds();
    std::uint64_t differ = 0, tests = 0, accessible = 0;
    for (std::size_t n = 0; n < ids.size(); ++n) {
      differ += same(results[n], expected[n], !kernels::isWide(directions)) ? 0 : 1;
      tests += results[n].tests;
      accessible += results[n].label == PointLabel::Accessible ? 1 : 0;
    }
    row["tests"] = tests;
    row["accessible"] = accessible;
    row["different"] = differ;
    different += differ;
    add(row, times);
  }

  const Options& options_;
  World& world_;
  kernels::CudaBackend& cuda_;
  kernels::Backend& cpu_;
};

template <class T>
std::vector<T> lastHalf(const std::vector<T>& all) {
  return {all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2), all.end()};
}

int run(const Options& options) {
  FieldParams params;
  params.tsdf.voxel_size_m = options.voxel_m;
  params.tsdf.truncation_distance_m = options.tau_m;
  params.approach.orientations = OrientationSet::parse(options.orientations);
  params.approach.rolls = 1;
  params = params.resolved();
  const auto cuda = kernels::makeCudaBackend(kernels::CudaOptions{});
  const auto cpu = kernels::makeCpuBackend();
  World world(options, params, *cuda, *cpu);
  Bench bench(options, world, *cuda, *cpu);
  std::cerr << world.frames_ << " frames, " << world.ids_.size() << " scored points, " << world.cuda_mirror_.leafCount()
            << " mirrored leaves, mirror p95 " << spread(lastHalf(world.mirror_ms_))["p95"] << " ms\n";
  if (params.approach.orientations.kind == OrientationKind::Yaw) {
    bench.tool("rod 0.5 m", rod(), ToolForm::Voxels);
    bench.tool("rod 0.5 m", rod(), ToolForm::SurfaceSamples);
    bench.tool("builtin:pruner", ToolGeometry::builtin("builtin:pruner"), ToolForm::Voxels);
  } else {
    bench.oriented(turnedRod());
  }
  const Json json = {{"device", cuda->name()},
                     {"voxel_m", options.voxel_m},
                     {"tau_m", options.tau_m},
                     {"repeats", options.repeats},
                     {"directions", params.approach.directionCount()},
                     {"frames", world.frames_},
                     {"surface_points", world.store_.size()},
                     {"scored_points", world.ids_.size()},
                     {"mirror",
                      {{"frames", "last half"},
                       {"leaves", world.cuda_mirror_.leafCount()},
                       {"device_bytes", world.cuda_mirror_.committedBytes()},
                       {"changed_leaves_per_frame", spread(lastHalf(world.mirror_leaves_))},
                       {"bytes_per_frame", spread(lastHalf(world.mirror_bytes_))},
                       {"apply_ms", spread(lastHalf(world.apply_ms_))},
                       {"until_on_device_ms", spread(lastHalf(world.mirror_ms_))},
                       {"cpu_backend_ms", spread(lastHalf(world.cpu_mirror_ms_))}}},
                     {"device_peak_bytes", cuda->peakBytes()},
                     {"results_that_differ_from_cpu", bench.different},
                     {"rows", bench.rows}};
  if (options.out.empty()) {
    std::cout << json.dump(1) << "\n";
  } else {
    std::ofstream(options.out) << json.dump(1) << "\n";
  }
  return bench.different == 0 ? 0 : 1;
}

}  // namespace
}  // namespace accessvdb

int main(int argc, char** argv) {
  try {
    return accessvdb::run(accessvdb::parse(argc, argv));
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
