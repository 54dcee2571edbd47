// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How fast field.vdb is written, against plain openvdb::io::File::write of the same grids with the same compression.
///
/// Prints medians over rounds that run every way of writing in turn, first to last and then last to first, and
/// the speed of each as a percentage of the plain one:
///   plain      openvdb::io::File::write, ready grids, nothing checked, not synced to disk
///   plain+sync the same, then fsync of the file
///   ready      our writer, the same ready grids: checked writes, fsync, rename, fsync of the folder
///   whole      io::writeFieldVdb: the nine grids are made from the map as they are written
/// and file sizes and times per compression, for "whole". Options by environment: ACCESSVDB_BENCH_FRAMES (100),
/// ACCESSVDB_BENCH_VOXEL_MM (20), ACCESSVDB_BENCH_ROUNDS (9), TMPDIR for where the files go.
#include <fcntl.h>
#include <openvdb/openvdb.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/field_export.h"
#include "io/results/field_grids.h"
#include "support/walk_generator.h"

namespace accessvdb {
namespace {

namespace fs = std::filesystem;

int environment(const char* name, int fallback) {
  const char* value = std::getenv(name);
  return value == nullptr ? fallback : std::atoi(value);
}

double seconds(const std::function<void()>& job) {
  const auto begin = std::chrono::steady_clock::now();
  job();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

AccessibilityField walkedForest() {
  test::WalkOptions options;
  options.frames = environment("ACCESSVDB_BENCH_FRAMES", 100);
  options.rays_per_frame = 20000;
  options.range_noise_m = 0.02;
  options.length_m = 0.1 * options.frames;
  const test::WalkGenerator walk(options);
  FieldParams params;
  params.tsdf.voxel_size_m = 0.001 * environment("ACCESSVDB_BENCH_VOXEL_MM", 20);
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
  for (int frame = 0; frame < options.frames; ++frame) {
    const auto scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
  }
  field.update();
  return field;
}

void syncFile(const fs::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0 || ::fsync(fd) != 0) std::perror("fsync");
  ::close(fd);
}

struct Way {
  const char* name;
  std::function<void()> write;
  std::vector<double> seconds;
};

void compareWays(const AccessibilityField& field, const FieldSnapshot& points, const fs::path& folder, int rounds) {
  const fs::path plain = folder / "plain.vdb", ours = folder / "ours.vdb";
  io::writeFieldVdb(ours, field.volume(), points, {});
  openvdb::io::File reader(ours.string());
  reader.open(false);
  const openvdb::GridPtrVecPtr grids = reader.getGrids();
  reader.close();
  std::vector<internal::LazyGrid> ready;
  for (const auto& grid : *grids) {
    ready.push_back({grid->getName(), [grid] { return grid; }});
  }
  const auto writePlain = [&] { openvdb::io::File(plain.string()).write(*grids); };
  std::vector<Way> ways = {
      {"plain", writePlain, {}},
      {"plain+sync",
       [&] {
         writePlain();
         syncFile(plain);
       },
       {}},
      {"ready", [&] { io::writeFileDurably(ours, [&](std::ostream& s) { internal::writeGrids(s, ready, {}); }); }, {}},
      {"whole", [&] { io::writeFieldVdb(ours, field.volume(), points, {}); }, {}}};
  for (int round = -1; round < rounds; ++round) {  // the first one warms up
    for (std::size_t n = 0; n < ways.size(); ++n) {
      Way& way = ways[round % 2 == 0 ? n : ways.size() - 1 - n];
      const double taken = seconds(way.write);
      if (round >= 0) way.seconds.push_back(taken);
    }
  }
  const auto mebibytes = static_cast<double>(fs::file_size(ours)) / (1 << 20);
  std::printf("%zu surface points, %zu grids, field.vdb %.1f MiB (plain: %.1f MiB)\n", points.points.size(),
              grids->size(), mebibytes, static_cast<double>(fs::file_size(plain)) / (1 << 20));
  for (const Way& way : ways) {
    const double own = median(way.seconds);
    std::printf("%-11s %8.1f ms  %7.1f MiB/s  %6.1f %% of plain  %6.1f %% of plain+sync\n", way.name, 1000 * own,
                mebibytes / own, 100 * median(ways[0].seconds) / own, 100 * median(ways[1].seconds) / own);
  }
}

void compareCompressions(const AccessibilityField& field, const FieldSnapshot& points, const fs::path& folder,
                         int rounds) {
  const fs::path path = folder / "field.vdb";
  for (const bool half : {false, true}) {
    for (const auto& [name, compression] :
         {std::pair{"blosc", io::Compression::Blosc}, {"zip", io::Compression::Zip}, {"none", io::Compression::None}}) {
      io::WriteOptions options;
      options.half_float = half;
      options.compression = compression;
      std::vector<double> write, read;
      for (int round = 0; round < rounds; ++round) {
        write.push_back(seconds([&] { io::writeFieldVdb(path, field.volume(), points, {}, options); }));
        read.push_back(seconds([&] {
          openvdb::io::File file(path.string());
          file.open(false);
          static_cast<void>(file.getGrids());
        }));
      }
      std::printf("%-5s %-5s %8.1f MiB  written in %8.1f ms, read in %8.1f ms\n", name, half ? "half" : "float",
                  static_cast<double>(fs::file_size(path)) / (1 << 20), 1000 * median(write), 1000 * median(read));
    }
  }
  io::WriteOptions options;
  options.surface = true;
  std::vector<double> with_surface;
  for (int round = 0; round < rounds; ++round) {
    with_surface.push_back(seconds([&] { io::writeFieldVdb(path, field.volume(), points, {}, options); }));
  }
  std::printf("with surface %.1f MiB, written in %.1f ms\n", static_cast<double>(fs::file_size(path)) / (1 << 20),
              1000 * median(with_surface));
}

int run() {
  openvdb::initialize();
  std::string pattern = (fs::temp_directory_path() / "accessvdb_export_XXXXXX").string();
  if (::mkdtemp(pattern.data()) == nullptr) {
    std::perror("mkdtemp");
    return 1;
  }
  const int rounds = std::max(1, environment("ACCESSVDB_BENCH_ROUNDS", 9));
  const AccessibilityField field = walkedForest();
  const FieldSnapshot points = field.snapshot();
  compareWays(field, points, pattern, rounds);
  compareCompressions(field, points, pattern, std::max(1, rounds / 3));
  fs::remove_all(pattern);
  return 0;
}

}  // namespace
}  // namespace accessvdb

int main() { return accessvdb::run(); }
