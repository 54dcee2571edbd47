// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The machine's limits for the operations that the stages of a frame consist of: how near the stages come to them is
/// in docs/benchmarks/README.md, "What bounds a frame".
///
///   accessvdb_bench_ceilings [FILE.json] [GB]
/// GB: amount of memory written for the page rate; default 4.
#include <sys/mman.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iostream>
#include <memory>
#include <new>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "bench/device_ceilings.h"
#include "launch/stopwatch.h"

namespace accessvdb {
namespace {

using Json = nlohmann::ordered_json;
constexpr int kRepeats = 9;

/// A leaf of the map: 512 voxels of four bytes. About as many leaves as the map of the flight through pines has at
/// 10 mm and 3.2 million points.
constexpr std::size_t kWordsOfLeaf = 256, kLeaves = std::size_t{5} << 19, kTouched = std::size_t{1} << 18;

template <typename Work>
double secondsOf(const Work& work) {
  const kernels::Stopwatch watch;
  work();
  return 1e-3 * watch.milliseconds();
}

template <typename Work>
Rate measure(const char* name, const char* unit, double amount, const Work& work) {
  Rate rate = {name, unit, amount, {}};
  work();  // warms up
  for (int n = 0; n < kRepeats; ++n) rate.seconds.push_back(secondsOf(work));
  return rate;
}

constexpr std::size_t kHugePage = std::size_t{2} << 20;

/// Seconds until every page of fresh memory is written to, on all threads; huge pages if the system grants them.
double secondsOfFreshPages(std::size_t bytes) {
  constexpr std::size_t kPage = 4096;
  void* const fresh = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (fresh == MAP_FAILED) throw std::bad_alloc();
  madvise(fresh, bytes, MADV_HUGEPAGE);
  const double seconds = secondsOf([&] {
    tbb::parallel_for(std::size_t{0}, bytes / kHugePage, [&](std::size_t part) {
      volatile auto* const at = static_cast<unsigned char*>(fresh) + part * kHugePage;
      for (std::size_t offset = 0; offset < kHugePage; offset += kPage) at[offset] = 1;
    });
  });
  munmap(fresh, bytes);
  return seconds;
}

/// What the system gives to a growing map. A virtual machine may get its memory from its own host only when it is
/// first written to, once for everything that runs afterwards.
std::vector<Rate> pageCeilings(double gigabytes) {
  const auto bytes = static_cast<std::size_t>(1e9 * gigabytes) / kHugePage * kHugePage;
  Rate first = {"pages of the host, the first time", "GB/s", gigabytes, {secondsOfFreshPages(bytes)}};
  Rate again = {"pages of the host", "GB/s", gigabytes, {}};
  for (int n = 0; n < 3; ++n) again.seconds.push_back(secondsOfFreshPages(bytes));
  return {first, again};
}

/// Measured on all threads.
std::vector<Rate> hostCeilings() {
  const std::size_t words = kLeaves * kWordsOfLeaf;
  const auto leaves = std::make_unique_for_overwrite<std::uint64_t[]>(words);
  const tbb::blocked_range<std::size_t> all(0, kLeaves, 1024), half(0, kLeaves / 2, 1024);
  tbb::parallel_for(all, [&](const auto& range) {
    std::fill(&leaves[range.begin() * kWordsOfLeaf], &leaves[range.end() * kWordsOfLeaf], 1);
  });
  std::vector<Rate> rates;
  const double gigabytes = 1e-9 * static_cast<double>(words * sizeof(std::uint64_t));
  rates.push_back(measure("host copy, read and written", "GB/s", gigabytes, [&] {
    tbb::parallel_for(half, [&](const auto& range) {
      std::memcpy(&leaves[(kLeaves / 2 + range.begin()) * kWordsOfLeaf], &leaves[range.begin() * kWordsOfLeaf],
                  range.size() * kWordsOfLeaf * sizeof(std::uint64_t));
    });
  }));
  // Random leaves, each read and written as a whole: an update of every voxel at no computing cost.
  std::uint64_t seed = 0;
  rates.push_back(measure("leaves of 2 KB updated anywhere on the host", "million leaves/s", 1e-6 * kTouched, [&] {
    ++seed;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, kTouched, 256), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const std::uint64_t mixed = (n + 1) * 0x9e3779b97f4a7c15ull + seed * 0xd1342543de82ef95ull;
        const std::size_t leaf = (mixed >> 32) * kLeaves >> 32;
        for (std::uint64_t& word : std::span(&leaves[leaf * kWordsOfLeaf], kWordsOfLeaf)) word += n;
      }
    });
  }));
  return rates;
}

Json toJson(const Rate& rate) {
  std::vector<double> rates;
  for (const double seconds : rate.seconds) rates.push_back(rate.amount / seconds);
  std::ranges::sort(rates);
  return {{"what", rate.name},    {"unit", rate.unit},   {"median", rates[rates.size() / 2]},
          {"min", rates.front()}, {"max", rates.back()}, {"runs", rates.size()}};
}

int run(int argc, char** argv) {
  Json rows = Json::array();
  for (const Rate& rate : pageCeilings(argc > 2 ? std::stod(argv[2]) : 4)) rows.push_back(toJson(rate));
  for (const Rate& rate : hostCeilings()) rows.push_back(toJson(rate));
  for (const Rate& rate : deviceCeilings(kRepeats)) rows.push_back(toJson(rate));
  const Json ceilings = {{"threads", tbb::this_task_arena::max_concurrency()}, {"rows", rows}};
  for (const Json& row : rows) {
    std::cout << row["what"].get<std::string>() << ": " << row["median"].get<double>() << " "
              << row["unit"].get<std::string>() << "\n";
  }
  if (argc < 2) return 0;
  std::ofstream file(argv[1]);
  file << ceilings.dump(1) << "\n";
  file.close();
  return file ? 0 : 1;
}

}  // namespace
}  // namespace accessvdb

int main(int argc, char** argv) {
  try {
    return accessvdb::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << "\n";
    return 1;
  }
}
