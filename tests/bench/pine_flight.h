// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// For benchmarks of single stages: the scans of `accessvdb-lab bench --scene pine` with its defaults, options from the
/// environment, and clocks.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/params.h"
#include "sim/forest.h"
#include "sim/simulator.h"

namespace accessvdb::bench {

inline constexpr int kFlightReturns = 20000;    ///< per scan
inline constexpr double kFlightNoise_m = 0.02;  ///< sigma of the ranges
inline constexpr double kFlightPeriod_s = 0.1;  ///< of the scans
inline constexpr double kFlightTau_m = 0.1;     ///< truncation distance of the published figures

/// Parameters of a field that maps the flight, resolved.
inline FieldParams flightParams(double voxel_size_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.tsdf.truncation_distance_m = kFlightTau_m;
  params.tsdf.range_noise_m = kFlightNoise_m;
  return params.resolved();
}

/// A scan in the local frame, metres.
struct FlightScan {
  Eigen::Vector3f q_L;
  std::vector<Eigen::Vector3f> p_L;  ///< [kFlightReturns]
};

/// Gives one scan per frame.
inline sim::Simulator flightSimulator(int frames) {
  constexpr double kSpeed_m_s = 1, kView_m = 30;
  sim::ForestParams params;
  params.path_length_m = kSpeed_m_s * kFlightPeriod_s * frames;
  params.view_m = kView_m;
  params.solid_foliage_m = 0.05;
  sim::Forest forest = sim::makeForest(params);
  sim::LidarModel sensor = sim::LidarModel::named("mid360");
  sensor.rays_per_frame = 8 * kFlightReturns;
  sensor.frame_period_s = kFlightPeriod_s;
  sensor.range_noise_m = kFlightNoise_m;
  sensor.min_range_m = 0.2;
  sensor.max_range_m = kView_m;
  return {sim::RayCaster(std::move(forest.meshes), forest.placed), "forest", sensor,
          sim::forestFlight(kSpeed_m_s, kFlightPeriod_s, frames), 1};
}

/// The frame is that of the first pose, as in ScanGate.
inline std::vector<FlightScan> simulateFlight(int frames) {
  constexpr int kFramesAhead = 16;
  const sim::Simulator simulator = flightSimulator(frames);
  std::vector<FlightScan> scans;
  Eigen::Vector3d origin_W = Eigen::Vector3d::Zero();
  for (int begin = 0; begin < frames; begin += kFramesAhead) {
    const int end = std::min(frames, begin + kFramesAhead);
    for (const sim::SimulatedFrame& frame : simulator.framesOfReturns(begin, end, kFlightReturns)) {
      if (scans.empty()) origin_W = frame.T_W_S.translation().array().round();
      FlightScan& scan = scans.emplace_back();
      const auto local = [&](const Eigen::Vector3d& p_W) -> Eigen::Vector3f { return (p_W - origin_W).cast<float>(); };
      scan.q_L = local(frame.T_W_S.translation());
      for (const Eigen::Vector3f& p_S : frame.points_S) {
        if (!p_S.isZero(0)) scan.p_L.push_back(local(frame.T_W_S * p_S.cast<double>()));
      }
    }
  }
  return scans;
}

/// The same from a file, rewritten if it has fewer frames: simulating takes longer than most stages.
inline std::vector<FlightScan> keptFlight(const std::string& file, int frames) {
  std::vector<FlightScan> scans;
  std::ifstream in(file, std::ios::binary);
  FlightScan scan;
  scan.p_L.resize(kFlightReturns);
  const auto bytes = static_cast<std::streamsize>(kFlightReturns * sizeof(Eigen::Vector3f));
  while (static_cast<int>(scans.size()) < frames && in.read(reinterpret_cast<char*>(&scan.q_L), sizeof(scan.q_L)) &&
         in.read(reinterpret_cast<char*>(scan.p_L.data()), bytes)) {
    scans.push_back(scan);
  }
  if (static_cast<int>(scans.size()) == frames) return scans;
  scans = simulateFlight(frames);
  std::ofstream out(file, std::ios::binary);
  for (const FlightScan& made : scans) {
    out.write(reinterpret_cast<const char*>(&made.q_L), sizeof(made.q_L));
    out.write(reinterpret_cast<const char*>(made.p_L.data()), bytes);
  }
  return scans;
}

inline int environment(const char* name, int fallback) {
  const char* value = std::getenv(name);
  return value == nullptr ? fallback : std::atoi(value);
}

/// ACCESSVDB_BENCH_SCANS: a file that keeps the scans.
inline std::vector<FlightScan> flightFromEnvironment(int frames) {
  const char* file = std::getenv("ACCESSVDB_BENCH_SCANS");
  return file == nullptr ? simulateFlight(frames) : keptFlight(file, frames);
}

/// Wall-clock and processor time over all threads.
struct Moment {
  double clock_ms = 0, processor_ms = 0;
  static Moment now() {
    timespec used = {};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
    const auto since = std::chrono::steady_clock::now().time_since_epoch();
    return {std::chrono::duration<double, std::milli>(since).count(),
            1e3 * static_cast<double>(used.tv_sec) + 1e-6 * static_cast<double>(used.tv_nsec)};
  }
};

}  // namespace accessvdb::bench
