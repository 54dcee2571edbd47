// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reading scans, clouds and recordings through ScanSequence on one thread, from the page cache: returns per second,
/// and of recordings the unpacked bytes per second.
#include <benchmark/benchmark.h>
#include <stdlib.h>
#include <zlib.h>
#include <zstd.h>

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

template <typename T>
void put(std::string& bytes, T value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  bytes.append(raw, sizeof value);
}
void putText(std::string& bytes, const std::string& text) {
  put(bytes, static_cast<std::uint32_t>(text.size()));
  bytes += text;
}
/// A CDR string, after which the next number is aligned to 4.
void putCdrText(std::string& bytes, const std::string& text) {
  putText(bytes, text + '\0');
  bytes.resize((bytes.size() + 3) / 4 * 4);
}
void putRecord(std::string& bytes, char opcode, const std::string& content) {
  bytes += opcode;
  put(bytes, std::uint64_t{content.size()});
  bytes += content;
}

/// A message of MCAP: channel, sequence, two times, data.
std::string message(std::uint16_t channel, const std::string& cdr) {
  std::string content;
  put(content, channel);
  content.append(20, '\0');
  return content + std::string("\0\1\0\0", 4) + cdr;
}
std::string header(int scan, const std::string& frame) {
  std::string cdr;
  put(cdr, std::int32_t{1'700'000'000 + scan / 10});
  put(cdr, static_cast<std::uint32_t>(scan % 10 * 100'000'000));
  putCdrText(cdr, frame);
  return cdr;
}
std::string odometry(int scan) {
  std::string cdr = header(scan, "map");
  putCdrText(cdr, "body");
  cdr.resize((cdr.size() + 7) / 8 * 8);
  for (const double value : {0.0, 0.1 * scan, 1.0, 0.0, 0.0, 0.0, 1.0}) put(cdr, value);
  return message(1, cdr);
}
/// 20000 points of 32 bytes on a wall, with noise in the last digits as of real ranges.
std::string cloud(int scan, std::mt19937& random) {
  constexpr std::uint32_t kPoints = 20'000, kPointBytes = 32;
  std::normal_distribution<float> noise_m(0, 0.02F);
  std::string cdr = header(scan, "body");
  put(cdr, std::uint32_t{1});
  put(cdr, kPoints);
  const char* const names[] = {"x", "y", "z", "intensity"};
  put(cdr, std::uint32_t{4});
  for (std::uint32_t i = 0; i < 4; ++i) {
    putCdrText(cdr, names[i]);
    put(cdr, i == 3 ? std::uint32_t{16} : 4 * i);
    cdr += std::string("\7\0\0\0", 4);
    put(cdr, std::uint32_t{1});
  }
  cdr += std::string(4, '\0');
  put(cdr, kPointBytes);
  put(cdr, kPoints * kPointBytes);
  put(cdr, kPoints * kPointBytes);
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const float y = -5 + 0.01F * static_cast<float>(i % 1000), z = 0.05F * static_cast<float>(i / 1000);
    const float values[] = {
        4 + noise_m(random), y + noise_m(random), z + noise_m(random), 0, static_cast<float>(random() % 100), 0, 0, 0};
    put(cdr, values, 8);
  }
  cdr += '\1';
  return message(2, cdr);
}

struct Recording {
  std::filesystem::path file;
  std::uint64_t unpacked_bytes = 0;
};

/// Scans, poses, a ray cloud and a recording in a folder of their own; removed at the end.
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
    writeRecording();
  }
  ~Inputs() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  [[nodiscard]] io::ScanInputOptions pcd() const {
    return {.scans = folder_ / "scans", .poses = folder_ / "poses.txt", .pose_format = io::PoseFormat::Hba};
  }
  [[nodiscard]] const Recording& recording() const { return recording_; }
  [[nodiscard]] io::ScanInputOptions rays() const { return {.scans = folder_ / "rays.ply"}; }

 private:
  /// MCAP in chunks of 4 MiB, zstd at its usual level, with checksums.
  void writeRecording() {
    constexpr int kClouds = 200, kCloudsAChunk = 6;
    recording_.file = folder_ / "flight.mcap";
    std::string bytes("\x89MCAP0\r\n", 8), chunk;
    std::uint16_t id = 1;
    for (const auto& [topic, type] :
         {std::pair("/odometry", "nav_msgs/msg/Odometry"), std::pair("/cloud", "sensor_msgs/msg/PointCloud2")}) {
      std::string schema, channel;
      put(schema, id);
      for (const char* const text : {type, "ros2msg", ""}) putText(schema, text);
      put(channel, id);
      put(channel, id);
      for (const char* const text : {topic, "cdr", ""}) putText(channel, text);
      putRecord(bytes, 3, schema);
      putRecord(bytes, 4, channel);
      ++id;
    }
    std::mt19937 random(1);
    for (int scan = 0; scan < kClouds; ++scan) {
      putRecord(chunk, 5, odometry(scan));
      putRecord(chunk, 5, cloud(scan, random));
      if (scan % kCloudsAChunk != kCloudsAChunk - 1 && scan + 1 < kClouds) continue;
      std::string packed(ZSTD_compressBound(chunk.size()), '\0'), content(16, '\0');
      packed.resize(ZSTD_compress(packed.data(), packed.size(), chunk.data(), chunk.size(), ZSTD_CLEVEL_DEFAULT));
      put(content, std::uint64_t{chunk.size()});
      put(content,
          static_cast<std::uint32_t>(::crc32_z(0, reinterpret_cast<const Bytef*>(chunk.data()), chunk.size())));
      putText(content, "zstd");
      put(content, std::uint64_t{packed.size()});
      putRecord(bytes, 6, content + packed);
      recording_.unpacked_bytes += chunk.size();
      chunk.clear();
    }
    putRecord(bytes, 15, std::string(4, '\0'));
    std::ofstream(recording_.file, std::ios::binary) << bytes;
  }

  std::filesystem::path folder_;
  Recording recording_;
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

/// All of it, from opening to the last point.
void zstdRecording(benchmark::State& state) {
  readAll(state, {.scans = inputs().recording().file});
  state.SetBytesProcessed(static_cast<std::int64_t>(inputs().recording().unpacked_bytes) * state.iterations());
}
BENCHMARK(zstdRecording)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace accessvdb

BENCHMARK_MAIN();
