// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reading scans and clouds through ScanSequence on one thread, from the page cache: returns per second.
#include <benchmark/benchmark.h>
#include <stdlib.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <stdexcept>

#include "accessvdb/scan_io.h"

namespace accessvdb {
namespace {

constexpr int kScans = 8, kReturnsAScan = 500'000;

void put(std::string& bytes, const float* values, std::size_t count) {
  bytes.append(reinterpret_cast<const char*>(values), count * sizeof(float));
}

/// Scans, poses and a ray cloud in a folder of their own; removed at the end.
class Inputs {
 public:
  Inputs() {
    std::string pattern = (std::filesystem::temp_directory_path() / "accessvdb_bench_XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("no temporary folder");
    folder_ = pattern;
    std::filesystem::create_directory(folder_ / "scans");
    std::mt19937 random(1);
    std::uniform_real_distribution<float> metres(-30, 30);
    std::ofstream poses(folder_ / "poses.txt"), rays(folder_ / "rays.ply", std::ios::binary);
    rays << "ply\nformat binary_little_endian 1.0\nelement vertex " << kScans * kReturnsAScan << '\n';
    for (const char* const name : {"x", "y", "z", "nx", "ny", "nz"}) rays << "property float " << name << '\n';
    rays << "end_header\n";
    for (int scan = 0; scan < kScans; ++scan) {
      std::string points, with_origins;
      for (int i = 0; i < kReturnsAScan; ++i) {
        const float values[] = {metres(random), metres(random), metres(random), 1, 2, 0};
        put(points, values, 4);
        put(with_origins, values, 6);
      }
      std::ofstream(folder_ / "scans" / (std::to_string(scan) + ".pcd"), std::ios::binary)
          << "FIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH " << kReturnsAScan
          << "\nHEIGHT 1\nPOINTS " << kReturnsAScan << "\nDATA binary\n"
          << points;
      rays << with_origins;
      poses << scan << " 0 0 1 0 0 0\n";
    }
  }
  ~Inputs() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  [[nodiscard]] io::ScanInputOptions pcd() const {
    return {.scans = folder_ / "scans", .poses = folder_ / "poses.txt", .pose_format = io::PoseFormat::Hba};
  }
  [[nodiscard]] io::ScanInputOptions rays() const { return {.scans = folder_ / "rays.ply"}; }

 private:
  std::filesystem::path folder_;
};

void readAll(benchmark::State& state, const io::ScanInputOptions& options) {
  std::size_t returns = 0;
  for ([[maybe_unused]] auto _ : state) {
    io::ScanSequence scans = io::ScanSequence::open(options);
    for (std::size_t step = 0; step < scans.size(); ++step) {
      const io::ScanRecord record = scans.read(step);
      returns += record.points_S.size() + record.points_W.size();
      benchmark::DoNotOptimize(record.points_S.data());
    }
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(returns));
}

const Inputs& inputs() {
  static const Inputs inputs;
  return inputs;
}
void binaryPcd(benchmark::State& state) { readAll(state, inputs().pcd()); }
BENCHMARK(binaryPcd)->Unit(benchmark::kMillisecond);
void binaryRayCloud(benchmark::State& state) { readAll(state, inputs().rays()); }
BENCHMARK(binaryRayCloud)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace accessvdb

BENCHMARK_MAIN();
