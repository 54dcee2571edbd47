// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb-lab bench: a simulated flight among pines, with every stage of every frame timed.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <sstream>
#include <thread>
#include <utility>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/memory_prediction.h"
#include "bench_options.h"
#include "bench_record.h"
#include "lab_verbs.h"
#include "options/tools_given.h"
#include "output/json_text.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "output/report.h"
#include "output/stop_signal.h"
#include "runs/gpu_fallback.h"
#include "sim/simulator.h"

namespace accessvdb::tools {
namespace {

using Clock = std::chrono::steady_clock;
using Json = nlohmann::ordered_json;

/// Scans simulated at a time, before the clock starts: too few to affect the memory figures.
constexpr int kScansAhead = 32;

Json jsonOf(const MemoryUse& memory) {
  Json json = {{"device_peak_bytes", memory.device_peak_bytes},
               {"map_bytes", memory.map_bytes},
               {"mirror_bytes", memory.mirror_bytes},
               {"point_host_bytes", memory.point_host_bytes},
               {"point_device_bytes", memory.point_device_bytes}};
  if (memory.distance_mirror_bytes > 0) json["distance_mirror_bytes"] = memory.distance_mirror_bytes;
  return json;
}

double secondsSince(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

sim::Simulator makeSimulator(const BenchOptions& options, std::string& description) {
  sim::Forest forest = sim::makeForest(benchForest(options));
  description = forest.description;
  const sim::LidarModel sensor = benchSensor(options);
  sim::RayCaster caster(std::move(forest.meshes), forest.placed);
  return {std::move(caster), "forest", sensor, benchTrajectory(options), options.seed};
}

class BenchRun {
 public:
  BenchRun(const BenchOptions& options, Messages& messages)
      : options_(options), messages_(messages), record_(options.map.mirror_distance) {}
  int run();

 private:
  void replay(const sim::Simulator& simulator, AccessibilityField& field);
  void takeScan(const sim::SimulatedFrame& scan, AccessibilityField& field);
  /// Until the next timed frame is due, with --scans-per-second.
  void waitForScan();
  /// Waits for the update of the scan before, with --pipelined.
  void finishFrame();
  [[nodiscard]] bool finished() const;
  [[nodiscard]] bool timedPartBegins() const;
  void noteTimedBegin(const AccessibilityField& field);
  [[nodiscard]] bool updatesNext() const;
  /// Scans that the field has; the update of the last one may be running.
  [[nodiscard]] std::size_t taken() const { return record_.frames() + (running_.valid() ? 1 : 0); }
  /// Of the frames so far: if the stream stopped early, those since the timed part began.
  [[nodiscard]] std::size_t timedFrames() const {
    const auto most = static_cast<std::size_t>(options_.timed_frames);
    return std::min(most, timed_from_ ? record_.frames() - *timed_from_ : record_.frames());
  }
  [[nodiscard]] std::uint64_t pointsAtTimedBegin() const {
    return record_.surfacePointsBefore(record_.frames() - timedFrames());
  }
  [[nodiscard]] bool enoughPoints(std::size_t frames) const {
    return record_.surfacePointsBefore(frames) >= options_.min_surface_points;
  }
  /// Share of new points over as many frames before the n-th as are timed; none if there are not as many.
  [[nodiscard]] std::optional<double> newPercentBefore(std::size_t n) const {
    const auto window = static_cast<std::size_t>(options_.timed_frames);
    if (n < window) return std::nullopt;
    return record_.newPercent(n - window, n);
  }
  [[nodiscard]] Json density() const;
  [[nodiscard]] Json describe(const AccessibilityField& field) const;
  void write(const Json& json) const;

  const BenchOptions& options_;
  Messages& messages_;
  BenchRecord record_;
  std::optional<Clock::time_point> next_scan_;  ///< with --scans-per-second: when the next timed frame is due
  // With --pipelined:
  UpdateTicket running_;
  BenchFrame running_frame_;            ///< whose update is running
  Clock::time_point frame_began_ = {};  ///< when the frame before ended
  std::string scene_;
  double simulation_s_ = 0;
  std::uint64_t host_before_bytes_ = 0;       ///< when the stream begins: the simulator's memory
  std::optional<std::size_t> settling_from_;  ///< first frame of those from which on each has an update
  std::optional<std::size_t> timed_from_;     ///< first frame of the timed part, once it is known
  Json memory_at_timed_begin_ = nullptr;
};

/// @return whether the stream is long enough
bool BenchRun::finished() const {
  return options_.shortest && timed_from_ && taken() >= *timed_from_ + static_cast<std::size_t>(options_.timed_frames);
}

bool BenchRun::timedPartBegins() const {
  if (!options_.shortest) {
    return taken() + static_cast<std::size_t>(options_.timed_frames) == static_cast<std::size_t>(options_.frames);
  }
  if (options_.begin_by && taken() >= static_cast<std::size_t>(*options_.begin_by)) return true;
  const std::size_t frames = record_.frames();
  if (!enoughPoints(frames)) return false;
  if (!options_.max_new_percent) return true;
  const std::optional<double> share = newPercentBefore(frames);
  return share && *share <= *options_.max_new_percent;
}

/// Whether an update follows the next scan. Long before the timed part only every n-th has one. The last frames always
/// have, in case that the timed part never begins.
bool BenchRun::updatesNext() const {
  const std::size_t scans = taken() + 1,
                    last = static_cast<std::size_t>(options_.timed_frames + settlingFrames(options_));
  return settling_from_ || scans + last > static_cast<std::size_t>(options_.frames) ||
         scans % static_cast<std::size_t>(options_.warm_up_update_every) == 0;
}

/// Begins the frames that settle, then the timed part, and notes memory there: with --min-surface-points, that is at
/// the requested map size.
void BenchRun::noteTimedBegin(const AccessibilityField& field) {
  if (timed_from_) return;
  if (!settling_from_) {
    if (!timedPartBegins()) return;
    settling_from_ = taken();
  }
  if (taken() < *settling_from_ + static_cast<std::size_t>(settlingFrames(options_))) return;
  finishFrame();
  timed_from_ = record_.frames();
  const MemoryUse memory = field.memoryUse();
  memory_at_timed_begin_ = jsonOf(memory);
  memory_at_timed_begin_["surface_points"] = record_.surfacePointsBefore(record_.frames());
  memory_at_timed_begin_["host_bytes"] = residentMemoryBytes();
  frame_began_ = Clock::now();
}

void BenchRun::replay(const sim::Simulator& simulator, AccessibilityField& field) {
  Progress progress(messages_, "replaying", static_cast<std::size_t>(options_.frames));
  for (int begin = 0; begin < options_.frames; begin += kScansAhead) {
    const auto simulating = Clock::now();
    const std::vector<sim::SimulatedFrame> scans =
        simulator.framesOfReturns(begin, std::min(options_.frames, begin + kScansAhead), options_.points_per_frame);
    simulation_s_ += secondsSince(simulating);
    frame_began_ = Clock::now();
    if (next_scan_) *next_scan_ += frame_began_ - simulating;  // the scanner stands still meanwhile
    for (const sim::SimulatedFrame& scan : scans) {
      if (stopSignal() != 0 || finished()) break;
      noteTimedBegin(field);
      waitForScan();
      takeScan(scan, field);
      if (record_.frames() == 0) continue;
      const BenchFrame& last = record_.last();
      progress.show(record_.frames(), numberText(static_cast<double>(last.integration.surface_points) * 1e-6) +
                                          " M points, " + numberText(std::round(10 * last.frame_ms) / 10) + " ms");
    }
    finishFrame();  // before the clock stops for the next scans
    if (stopSignal() != 0 || finished()) return;
  }
}

/// A frame that took longer than there was time is followed at once, until the frames have caught up with the scanner.
void BenchRun::waitForScan() {
  if (options_.scans_per_second == 0 || !timed_from_) return;
  constexpr auto kLook = std::chrono::milliseconds(100);  // whether the run is to stop
  const auto period =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / options_.scans_per_second));
  if (!next_scan_) next_scan_ = Clock::now();
  while (stopSignal() == 0 && Clock::now() < *next_scan_) {
    std::this_thread::sleep_until(std::min(*next_scan_, Clock::now() + kLook));
  }
  *next_scan_ += period;
}

/// Pipelined, the time of a frame is that from one end of an update to the next, so that all of them add up to the
/// stream's.
void BenchRun::takeScan(const sim::SimulatedFrame& scan, AccessibilityField& field) {
  BenchFrame frame;
  const auto start = Clock::now();
  frame.integration = field.integrateScan(scan.points_S, scan.T_W_S, scan.stamp_s);
  if (options_.pipelined) {
    finishFrame();
    running_frame_ = frame;
    running_ = field.updateAsync();
    return;
  }
  if (updatesNext()) frame.update = field.update();
  frame.frame_ms = 1e3 * secondsSince(start);
  record_.add(frame);
}

void BenchRun::finishFrame() {
  if (!running_.valid()) return;
  running_frame_.update = std::exchange(running_, {}).wait();
  const auto now = Clock::now();
  running_frame_.frame_ms = 1e3 * std::chrono::duration<double>(now - frame_began_).count();
  frame_began_ = now;
  record_.add(running_frame_);
}

/// How often the stream sees the same places.
Json BenchRun::density() const {
  const std::size_t begin = record_.frames() - timedFrames();
  const std::optional<double> before = newPercentBefore(begin);
  const bool share_reached = !options_.max_new_percent || (before && *before <= *options_.max_new_percent);
  return {{"new_percent", record_.newPercent(begin, record_.frames())},
          {"new_percent_before", before ? Json(*before) : Json(nullptr)},
          {"new_percent_wanted", options_.max_new_percent ? Json(*options_.max_new_percent) : Json(nullptr)},
          {"reached", enoughPoints(begin) && share_reached},
          {"hits_per_voxel",
           {{"timed_begin", record_.hitsPerVoxelBefore(begin)},
            {"timed_end", record_.hitsPerVoxelBefore(record_.frames())}}}};
}

Json BenchRun::describe(const AccessibilityField& field) const {
  const MemoryUse memory = field.memoryUse();
  const FieldParams& params = field.params();
  // Taken before the snapshot below, which only this program needs.
  const std::uint64_t host_peak_bytes = peakMemoryBytes();
  Json parameters = Json::object();
  std::istringstream lines(params.describe());
  for (std::string line; std::getline(lines, line);) {
    const auto space = line.find(' ');
    if (space != std::string::npos) parameters[line.substr(0, space)] = line.substr(space + 1);
  }
  parameters["mirror_distance"] = params.mirror_distance;
  parameters["fuse_on_host"] = params.fuse_on_host;
  parameters["device_cache_bytes"] = params.device_cache_bytes;
  const std::size_t timed = timedFrames();
  Json json = {{"schema", 1},
               {"version", ACCESSVDB_VERSION},
               {"complete", stopSignal() == 0},
               {"device", field.deviceName()},
               {"backend", isGpu(field.deviceName()) ? "cuda" : "cpu"},
               {"threads", options_.map.common.threads > 0 ? options_.map.common.threads
                                                           : static_cast<int>(std::thread::hardware_concurrency())},
               {"voxel_m", params.tsdf.voxel_size_m},
               {"tau_m", params.tsdf.truncation_distance_m},
               {"tool", field.tools().size() == 1 ? field.tool().name() : namesOf(field.tools())},
               {"tool_reach_m", field.tool().reach_m()},
               {"policy", params.update.policy == UpdatePolicy::Exact ? "exact" : "paper"},
               {"budget_points", params.update.budget_points},
               {"pipelined", options_.pipelined},
               {"scans_per_second", options_.scans_per_second},
               {"warm_up_update_every", options_.warm_up_update_every},
               {"frames", record_.frames()},
               {"timed_frames", timed},
               {"points_per_frame", options_.points_per_frame},
               {"surface_points",
                {{"timed_begin", pointsAtTimedBegin()},
                 {"timed_end", record_.surfacePointsBefore(record_.frames())},
                 {"required", options_.min_surface_points}}},
               {"density", density()},
               {"timing_ms", record_.timing_ms(timed)},
               {"frames_per_second", record_.framesPerSecond(timed)},
               {"timing_all_frames_ms", record_.timing_ms(record_.frames())},
               {"per_frame", record_.counters(timed)},
               {"backlog", record_.backlog(timed)},
               {"memory", {{"host_peak_bytes", host_peak_bytes}, {"host_before_bytes", host_before_bytes_}}},
               {"memory_at_timed_begin", memory_at_timed_begin_},
               {"map", {{"leaves", memory.leaves}, {"active_voxels", memory.active_voxels}}},
               {"stream",
                {{"scene", scene_},
                 {"path", options_.path},
                 {"sensor", "mid360"},
                 {"sensor_rate_hz", options_.sensor_rate_hz},
                 {"speed_m_s", benchSpeed_m_s(options_)},
                 {"path_m", benchSpeed_m_s(options_) / options_.sensor_rate_hz * static_cast<double>(record_.frames())},
                 {"range_noise_m", options_.range_noise_m},
                 {"min_range_m", options_.min_range_m},
                 {"max_range_m", options_.max_range_m},
                 {"solid_foliage_m", options_.solid_foliage_m},
                 {"seed", options_.seed},
                 {"simulation_s", simulation_s_}}},
               {"parameters", parameters}};
  json["memory"].update(jsonOf(memory));
  const FieldSnapshot snapshot = field.snapshot();
  json["labels_at_end"] = {{"accessible", snapshot.count(PointLabel::Accessible)},
                           {"blocked", snapshot.count(PointLabel::Blocked)},
                           {"unscored", snapshot.count(PointLabel::Unscored)}};
  return json;
}

void BenchRun::write(const Json& json) const {
  const std::string text = jsonText(json, 2) + "\n";
  if (!options_.per_frame.empty()) {
    io::writeFileDurably(options_.per_frame, [&](std::ostream& out) { out << record_.csv(); });
  }
  if (options_.out.empty()) {
    printData(text);
  } else {
    io::writeFileDurably(options_.out, [&](std::ostream& out) { out << text; });
  }
}

int BenchRun::run() {
  checkBenchOptions(options_);
  watchStopSignals();
  requireNoInputs({options_.out, options_.per_frame}, namedInputs(options_.map));
  const std::vector<ToolSpec> tools = loadTools(options_.map);
  sayToolsNotes(options_.map, tools, messages_);
  const FieldParams params = benchFieldParams(options_);

  // Makes the field before the forest, so that a missing device fails before the time to grow it is spent.
  AccessibilityField field(tools, params, tableProgress(messages_));
  sayWhyNotOnGpu(field, messages_);
  sayWhatNeedsGpu(options_.map, &field, messages_);
  const auto simulating = Clock::now();
  const sim::Simulator simulator = makeSimulator(options_, scene_);
  simulation_s_ = secondsSince(simulating);
  host_before_bytes_ = residentMemoryBytes();
  messages_.notice("scene: " + scene_);
  replay(simulator, field);

  const int signal = stopSignal();
  if (record_.frames() == 0) return 128 + signal;
  const Json json = describe(field);
  write(json);
  const Json& ms = json["timing_ms"];
  const auto text = [](const Json& value) { return numberText(std::round(100 * value.get<double>()) / 100); };
  std::string line = "the last " + std::to_string(timedFrames()) + " of " + std::to_string(record_.frames()) +
                     " frames on " + field.deviceName() + (options_.pipelined ? ", pipelined" : "") + ": mean " +
                     text(ms["frame"]["mean"]) + " ms (p95 " + text(ms["frame"]["p95"]) + ")";
  for (const char* stage : {"integrate", "mirror", "update", "score"}) {
    line += std::string(", ") + stage + " " + text(ms[stage]["mean"]) + " (" + text(ms[stage]["p95"]) + ")";
  }
  if (options_.map.mirror_distance) {
    line += ", mirror of distances " + text(ms["distance_mirror"]["mean"]) + " (" + text(ms["distance_mirror"]["p95"]) +
            ")";
  }
  const std::uint64_t begin = pointsAtTimedBegin();
  messages_.notice(line);
  messages_.notice("surface points " + std::to_string(begin) + " to " +
                   std::to_string(record_.surfacePointsBefore(record_.frames())) + ", " +
                   text(json["density"]["new_percent"]) + " % of the returns new; host memory at most " +
                   bytesInWords(json["memory"]["host_peak_bytes"].get<double>()) + " (" +
                   bytesInWords(static_cast<double>(host_before_bytes_)) + " of it the simulator's), on the device " +
                   bytesInWords(json["memory"]["device_peak_bytes"].get<double>()));
  if (signal != 0) {
    messages_.notice("stopped after " + std::to_string(record_.frames()) + " of " + std::to_string(options_.frames) +
                     " frames; the figures cover these");
    return 128 + signal;
  }
  if (begin < options_.min_surface_points && !options_.begin_by) {
    throw UnusableInput("bench.too_few_points", "--min-surface-points",
                        "the timed part began with " + std::to_string(begin) + " surface points, not " +
                            std::to_string(options_.min_surface_points),
                        "Use more --frames");
  }
  return 0;
}

}  // namespace

int runBench(const Arguments& arguments, Messages& messages) {
  BenchOptions options;
  FlagParser flags(kLab);
  addBenchOptions(flags, options);
  if (!parseCommandLine(flags, arguments, options.map.common, messages)) return 0;
  if (!flags.isSet("timed-frames") && !options.shortest)
    options.timed_frames = std::min(options.timed_frames, options.frames);
  return BenchRun(options, messages).run();
}

}  // namespace accessvdb::tools
