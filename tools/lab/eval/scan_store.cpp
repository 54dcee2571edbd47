// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/scan_store.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <iterator>
#include <sstream>
#include <utility>

#include "accessvdb/field_io.h"
#include "eval/scan_file.h"
#include "sim/scene_catalogue.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

/// Frames between checks of the stop flag.
constexpr int kFramesAtOnce = 64;

sim::LidarModel sensor(const ScanRequest& request) {
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = request.range_noise_m;
  return model;
}

std::string keyOf(const ScanRequest& request) {
  std::ostringstream key;
  key.precision(17);
  key << request.scene << ' ' << (request.scene == "ring" ? request.voxel_size_m : 0.0) << ' ' << request.frames << ' '
      << request.range_noise_m << ' ' << request.seed;
  return key.str();
}

StoredFrame castFrame(const sim::Simulator& simulator, int index) {
  const sim::SimulatedFrame frame = simulator.frame(index);
  StoredFrame stored;
  stored.T_W_S = frame.T_W_S;
  std::copy_if(frame.points_S.begin(), frame.points_S.end(), std::back_inserter(stored.hits_S),
               [](const Eigen::Vector3f& p_S) { return !p_S.isZero(0); });
  return stored;
}

bool same(const StoredFrame& a, const StoredFrame& b) {
  return a.T_W_S.matrix() == b.T_W_S.matrix() && a.hits_S == b.hits_S;
}

std::vector<StoredFrame> castAll(const sim::Simulator& simulator, const Observer& observer) {
  std::vector<StoredFrame> frames(static_cast<std::size_t>(simulator.frames()));
  for (int begin = 0; begin < simulator.frames(); begin += kFramesAtOnce) {
    observer.checkStop();
    tbb::parallel_for(begin, std::min(begin + kFramesAtOnce, simulator.frames()),
                      [&](int n) { frames[static_cast<std::size_t>(n)] = castFrame(simulator, n); });
  }
  return frames;
}

/// A file from another program version may match the key and still differ, so it is checked.
bool stillTrue(const sim::Simulator& simulator, const std::vector<StoredFrame>& frames) {
  if (frames.size() != static_cast<std::size_t>(simulator.frames())) return false;
  const auto fullest = std::max_element(frames.begin(), frames.end(), [](const StoredFrame& a, const StoredFrame& b) {
    return a.hits_S.size() < b.hits_S.size();
  });
  const auto index = static_cast<int>(fullest - frames.begin());
  return same(castFrame(simulator, index), *fullest) &&
         same(castFrame(simulator, simulator.frames() - 1), frames.back());
}

}  // namespace

std::vector<StoredFrame> simulateFrames(const sim::Scene& scene, const sim::Trajectory& trajectory,
                                        const sim::LidarModel& model, std::uint64_t seed, const Observer& observer) {
  return castAll(sim::Simulator(scene, model, trajectory, seed), observer);
}

ScanStore::ScanStore(std::filesystem::path folder, Observer observer)
    : folder_(std::move(folder)), observer_(std::move(observer)) {
  if (!folder_.empty()) io::prepareOutputFolder(folder_);
}

std::shared_ptr<const StoredScans> ScanStore::get(const ScanRequest& request) {
  const std::string key = keyOf(request);
  if (const auto found = scans_.find(key); found != scans_.end()) return found->second;

  auto scans = std::make_shared<StoredScans>();
  scans->benchmark = sim::benchmarkScene(request.scene, request.voxel_size_m, request.frames);
  const sim::LidarModel model = sensor(request);
  const sim::Simulator simulator(scans->benchmark.scene, model, scans->benchmark.trajectory, request.seed);
  if (folder_.empty()) {
    scans->frames = castAll(simulator, observer_);
  } else {
    const std::string fingerprint = fingerprintOf(scans->benchmark, model, request.seed);
    const std::filesystem::path path = folder_ / scanFileName(key);
    std::string why_not;
    scans->frames = readScanFile(path, fingerprint, why_not);
    if (why_not.empty() && !stillTrue(simulator, scans->frames)) why_not = "its frames are not those of this program";
    if (!why_not.empty()) {
      if (std::filesystem::exists(path))
        observer_.say(path.string() + " is not used: " + why_not + "; casting it again");
      scans->frames = castAll(simulator, observer_);
      writeScanFile(path, fingerprint, scans->frames);
    }
  }
  return scans_[key] = scans;
}

}  // namespace accessvdb::eval
