// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A child of a process with busy threads never waits for a lock that one of them held.
#include "io/streams/guarded_child.h"

#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <thread>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "io/results/field_grids.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using internal::ChildLimits;
using internal::runInChild;
using test::kVoxel_m;
using test::ScratchFolder;
using namespace std::chrono_literals;

/// A thread that starts short parallel loops all the time, as updates beside a reading thread do.
class BusyThreads {
 public:
  ~BusyThreads() {
    stop_ = true;
    thread_.join();
  }

 private:
  void work() {
    while (!stop_) {
      tbb::parallel_for(0, 64, [](int i) {
        volatile double x = i;
        for (int step = 0; step < 200; ++step) x = x * 1.0001 + 1;
      });
      std::this_thread::sleep_for(50us);
    }
  }

  std::atomic<bool> stop_ = false;
  std::thread thread_{&BusyThreads::work, this};
};

/// Map grids of many leaves, which OpenVDB frees in parallel.
void writeField(const ScratchFolder& folder) {
  const auto grid = [](auto background, auto value) {
    auto made = openvdb::Grid<typename openvdb::tree::Tree4<decltype(value), 5, 4, 3>::Type>::create(background);
    made->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel_m));
    for (int i = -5; i < 5; ++i) {
      for (int j = -5; j < 5; ++j) made->tree().setValueOn({8 * i, 8 * j, 8 * i * j}, value);
    }
    return made;
  };
  const FieldSnapshot field = test::sampleField();
  const internal::VolumeGrids volume = {[&] { return grid(0.08f, 0.031f); }, [&] { return grid(0.0f, 17.0f); },
                                        [&] { return grid(false, true); }};
  internal::writeFieldGrids(folder / "field.vdb", volume, SnapshotPoints(field), {});
  io::writePointsPly(folder / "points.ply", field, {});
}

/// A child that hangs is only ended after 30 s.
template <typename Work>
void expectPrompt(const Work& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 20s);
}

TEST(GuardedChild, ReadsWhileOtherThreadsWork) {
  const ScratchFolder folder;
  writeField(folder);
  const io::VdbSummary alone = io::summarizeVdb(folder / "field.vdb");
  const BusyThreads busy;
  for (int i = 0; i < 100 && !HasFailure(); ++i) {
    expectPrompt([&] {
      EXPECT_EQ(io::StoredField::open(folder.path()).points().points.size(), test::sampleField().points.size());
    });
    expectPrompt([&] {
      const io::VdbSummary summary = io::summarizeVdb(folder / "field.vdb");
      ASSERT_EQ(summary.grids.size(), alone.grids.size());
      EXPECT_EQ(summary.grids.front().active_voxels, alone.grids.front().active_voxels);
    });
  }
}

/// OpenVDB throws in the middle of a tree.
TEST(GuardedChild, RefusesDamagedFilesWhileOtherThreadsWork) {
  const ScratchFolder folder;
  writeField(folder);
  const auto whole = std::filesystem::file_size(folder / "field.vdb");
  const BusyThreads busy;
  for (std::uintmax_t i = 0; i < 100 && !HasFailure(); ++i) {
    std::filesystem::resize_file(folder / "field.vdb", whole - (whole / 2 + i * whole / 1000));
    expectPrompt([&] { EXPECT_THROW(static_cast<void>(io::StoredField::open(folder.path())), InputError); });
    expectPrompt([&] { EXPECT_THROW(static_cast<void>(io::summarizeVdb(folder / "field.vdb")), InputError); });
  }
}

TEST(GuardedChild, SaysWhyThereIsNoResult) {
  EXPECT_EQ(runInChild({}, [] { return std::string("text"); }).text, "text");
  const auto thrown = runInChild({}, []() -> std::string { throw std::runtime_error("the reason"); });
  EXPECT_FALSE(thrown.ok);
  EXPECT_EQ(thrown.text, "the reason");
  const auto odd = runInChild({}, []() -> std::string { throw 1; });
  EXPECT_FALSE(odd.ok);
  EXPECT_EQ(odd.text, "unknown error");
  const auto crashed = runInChild({}, []() -> std::string { std::abort(); });
  EXPECT_FALSE(crashed.ok);
  EXPECT_EQ(crashed.text, "the library that reads it crashed on it");
  const auto hungry = runInChild({}, []() -> std::string { return std::string(std::size_t{3} << 30, 'x'); });
  EXPECT_FALSE(hungry.ok);
  const auto slow = runInChild({1s, 64 << 20}, []() -> std::string {
    std::this_thread::sleep_for(60s);
    return {};
  });
  EXPECT_FALSE(slow.ok);
  EXPECT_EQ(slow.text, "reading it took too long");
}

}  // namespace
}  // namespace accessvdb
