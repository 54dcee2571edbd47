// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb-lab simulate: scans of a scene, as a recorder would write them.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "lab_verbs.h"
#include "options/options.h"
#include "output/json_text.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "output/stop_signal.h"
#include "sim/mesh_ply.h"
#include "sim/recording.h"
#include "sim/simulator.h"
#include "simulate_options.h"

namespace accessvdb::tools {
namespace {

using nlohmann::ordered_json;

/// Every parameter, so that the recording can be reproduced; no dates, so that it stays byte-identical.
ordered_json describe(const SimulateOptions& options, const SceneView& view, const sim::LidarModel& model,
                      const SimulatedPath& path, int frames) {
  const sim::Scene& scene = view.scene;
  ordered_json out = {
      {"schema", 1},
      {"version", ACCESSVDB_VERSION},
      {"scene",
       {{"name", scene.name},
        {"description", scene.description},
        {"centre_m", {scene.centre_W.x(), scene.centre_W.y(), scene.centre_W.z()}},
        {"triangles", scene.mesh.triangles.size()},
        {"tessellation_error_m", scene.tessellation_error_m},
        {"distance_known", scene.distance != nullptr},
        {"distance_note", scene.distance_note}}},
      {"sensor",
       {{"name", options.sensor},
        {"rays_per_frame", model.rays_per_frame},
        {"frame_period_s", model.frame_period_s},
        {"range_noise_m", model.range_noise_m},
        {"dropout", model.dropout},
        {"min_range_m", model.min_range_m},
        {"max_range_m", std::isfinite(model.max_range_m) ? ordered_json(model.max_range_m) : ordered_json(nullptr)}}},
      {"trajectory", path.description},
      {"frames", path.poses.size() - (model.moves ? 1 : 0)},
      {"frames_written", frames},
      {"seed", options.seed}};
  if (model.moves) out["sensor"]["moves"] = true;
  if (scene.distance) out["scene"]["distance_error_m"] = scene.distance->errorBound_m();
  if (scene.name == "ring") out["scene"]["voxel_m"] = options.voxel_m;
  return out;
}

/// An earlier recording is replaced, which scene.json tells from scans of a real sensor.
void requireOwnRecording(const SimulateOptions& options) {
  namespace fs = std::filesystem;
  const fs::path out = options.out;
  Paths outputs = inFolder(out, {"poses.txt", "times.txt", "range_noise.txt", "scene.ply"});
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(out / "scans", error)) {
    if (!entry.path().filename().string().starts_with(".")) outputs.push_back(entry.path());
  }
  const fs::path manifest = out / "scene.json";
  requireNoInputs(joined(outputs, {manifest}), {options.scene, options.trajectory, options.common.config});
  requireOwn({manifest});
  if (isOwn(manifest) && !fs::is_symlink(out / "scans", error)) {
    // Numbered scans alone are replaced; one that is a link leads elsewhere.
    const auto scan = std::ranges::find_if(outputs, [&](const fs::path& output) {
      return output.parent_path() == out / "scans" && fs::is_symlink(output, error);
    });
    if (scan == outputs.end()) return;
  }
  for (const fs::path& output : outputs) {
    if (!fs::exists(fs::symlink_status(output, error))) continue;
    throw OutputError(
        "output.foreign", output.string(),
        "would be replaced, but is no file that accessvdb simulated (without scene.json, or through a link)",
        "Choose another output folder, or move this file away; nothing was changed");
  }
}

}  // namespace

int runSimulate(const Arguments& arguments, Messages& messages) {
  SimulateOptions options;
  FlagParser flags(kLab);
  addSimulateOptions(flags, options);
  if (!parseCommandLine(flags, arguments, options.common, messages)) return 0;
  checkSimulateOptions(options);
  requireOwnRecording(options);
  watchStopSignals();

  const sim::LidarModel model = lidarModel(options);
  const SceneView view = sceneView(options);
  messages.notice("scene: " + printable(view.scene.description));
  if (!view.scene.distance) messages.warning("sim.no_truth", printable(view.scene.distance_note));
  const SimulatedPath path = simulatedPath(options, view, model);
  const sim::Simulator simulator(view.scene, model, path.poses, options.seed);
  simulator.requireClearPath(path.stations);

  const std::filesystem::path out = options.out;
  io::prepareOutputFolder(out);
  // First, so that what a killed run leaves is known to be a recording of ours.
  const auto writeDescription = [&](int frames) {
    io::writeFileDurably(out / "scene.json", [&](std::ostream& stream) {
      stream << jsonText(describe(options, view, model, path, frames), 2) << "\n";
    });
  };
  writeDescription(0);
  const auto start = std::chrono::steady_clock::now();
  Progress progress(messages, "simulating scans", static_cast<std::size_t>(simulator.frames()));
  sim::SimulatedRecordingOptions recording{model.range_noise_m, options.common.threads, {}};
  recording.proceed = [&](int done) {
    if (done > 0) progress.show(static_cast<std::size_t>(done));
    return stopSignal() == 0;
  };
  const int frames = sim::writeRecording(out, simulator, recording);
  progress.finish();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  sim::writeMeshPly(out / "scene.ply", view.scene.mesh);
  writeDescription(frames);

  const double rays = static_cast<double>(frames) * model.rays_per_frame;
  messages.notice("wrote " + std::to_string(frames) + " scans, " + numberText(rays / 1e6) + " M rays in " +
                  numberText(std::round(seconds * 100) / 100) + " s (" + numberText(rays / 1e6 / seconds) +
                  " M rays/s), poses.txt, range_noise.txt, scene.ply and scene.json into " + out.string());
  const int signal = stopSignal();
  if (signal == 0) return 0;
  messages.notice(std::string("stopped by ") + stopSignalName() + " after " + std::to_string(frames) + " of " +
                  std::to_string(simulator.frames()) + " scans");
  return 128 + signal;
}

}  // namespace accessvdb::tools
