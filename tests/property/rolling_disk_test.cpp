// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tiles that are read and written beside the steps of a rolling field: nothing depends on how fast the disk is.
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <future>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/tiles.h"
#include "io/streams/sha256.h"
#include "rolling_walks.h"
#include "tiles/disk_thread.h"

namespace accessvdb::test {
namespace {

std::string sha256Of(const std::string& bytes) {
  internal::Sha256 sha256;
  sha256.update(bytes.data(), bytes.size());
  return internal::hexOf(sha256.digest());
}

/// All files of a folder, by name.
std::map<std::string, std::string> hashesOf(const std::filesystem::path& folder) {
  std::map<std::string, std::string> hashes;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    hashes[entry.path().filename().string()] = sha256Of(bytesOf(entry.path()));
  return hashes;
}

/// What a walk gave, step by step.
struct Course {
  std::vector<std::vector<std::uint64_t>> status;
  std::vector<FieldSnapshot> labels;
  std::vector<std::map<std::string, std::string>> files;  ///< after each checkpoint
  RollingStatus at_the_end;
};

Course courseOf(const Case& test, const std::vector<Step>& steps, std::uint64_t limit_bytes, Pace pace) {
  const WithPace with(pace);
  const ScratchFolder scratch;
  RollingOptions options;
  options.folder = scratch / "states";
  options.memory_limit_bytes = limit_bytes;
  options.tile_voxels = kTile_voxels;
  RollingField rolling(toolsOf(test), paramsOf(test), options);
  Course course;
  for (std::size_t n = 0; n < steps.size(); ++n) {
    integrate(rolling, steps[n], 0.1 * static_cast<double>(n));
    if (test.update_every > 0 && n % static_cast<std::size_t>(test.update_every) == 0) rolling.update();
    const RollingStatus now = rolling.status();
    course.status.push_back({now.points, now.tiles, now.tiles_in_memory, now.saved, now.loaded, now.saved_ahead,
                             now.loaded_ahead, now.memory_bytes, now.left_out_returns, now.memory_short ? 1U : 0U});
    if (n % 5 == 4) course.labels.push_back(rolling.snapshot());
    if (n % 7 != 6) continue;
    rolling.checkpoint();
    course.files.push_back(hashesOf(options.folder));
  }
  rolling.update();
  course.labels.push_back(rolling.snapshot());
  course.at_the_end = rolling.status();
  return course;
}

void expectTheSame(const Course& a, const Course& b) {
  EXPECT_EQ(a.status, b.status);
  EXPECT_EQ(a.files, b.files);
  ASSERT_EQ(a.labels.size(), b.labels.size());
  for (std::size_t n = 0; n < a.labels.size(); ++n) {
    const auto &one = a.labels[n].points, &other = b.labels[n].points;
    ASSERT_EQ(one.size(), other.size()) << n;
    for (std::size_t k = 0; k < one.size(); ++k) {
      ASSERT_TRUE(one[k].id == other[k].id && sameVerdict(one[k], other[k]))
          << n << ", " << text(one[k]) << " and " << text(other[k]);
    }
  }
}

/// A disk that is done at once, one that never comes to it by itself, and whatever this machine makes of it.
TEST(RollingDisk, GivesTheSameHoweverFastItIs) {
  for (const auto& [seed, update_every, share] :
       {std::tuple{21, 1, 0.7}, std::tuple{22, 0, 0.5}, std::tuple{23, 3, 0.3}}) {
    SCOPED_TRACE(seed);
    const Case test = {.name = "pace",
                       .seed = static_cast<std::uint64_t>(seed),
                       .change = ChangeMode::Block,
                       .update_every = update_every};
    const std::vector<Step> steps = walk(test, 56);
    const auto limit = static_cast<std::uint64_t>(share * static_cast<double>(bytesOfAll(test, steps)));
    const Course at_once = courseOf(test, steps, limit, Pace::AtOnce);
    EXPECT_GT(at_once.at_the_end.saved_ahead, 0U);
    EXPECT_TRUE(at_once.at_the_end.loaded_ahead > 0 || share <= 0.3);
    EXPECT_EQ(at_once.at_the_end.left_out_returns > 0, share <= 0.3);
    EXPECT_TRUE(at_once.at_the_end.lost_tiles.empty());
    expectTheSame(at_once, courseOf(test, steps, limit, Pace::WhenNeeded));
    expectTheSame(at_once, courseOf(test, steps, limit, Pace::Beside));
  }
}

/// The state of a field with other parameters, whose tables are not ours, is as good as a damaged one.
TEST(RollingLoss, IsATileOfAFieldWithOtherParameters) {
  const Case test = {.name = "other", .seed = 25};
  const std::vector<Step> steps = walk(test, 24);
  const ScratchFolder scratch;
  RollingOptions options;
  options.memory_limit_bytes = bytesOfAll(test, steps) / 2;
  options.tile_voxels = kTile_voxels;
  FieldParams others = paramsOf(test);
  others.scoring.self_exclusion_voxels += 1;
  options.folder = scratch / "ours";
  RollingField ours(toolsOf(test), paramsOf(test), options);
  options.folder = scratch / "theirs";
  RollingField theirs(toolsOf(test), others, options);
  for (std::size_t n = 0; n < 14; ++n) {  // to the east end, and some way back
    integrate(ours, steps[n], 0.1 * static_cast<double>(n));
    integrate(theirs, steps[n], 0.1 * static_cast<double>(n));
  }
  ours.checkpoint();
  theirs.checkpoint();
  const auto our_file = westernmost(scratch / "ours"), their_file = westernmost(scratch / "theirs");
  ASSERT_EQ(tileOf(our_file), tileOf(their_file));
  writeBytes(our_file, bytesOf(their_file));
  for (std::size_t n = 14; n < steps.size(); ++n) integrate(ours, steps[n], 0.1 * static_cast<double>(n));
  ours.update();
  static_cast<void>(ours.snapshot());
  EXPECT_EQ(ours.status().lost_tiles, std::vector<std::string>{tileOf(our_file)});
}
/// A process that was killed before its first checkpoint has left files, and nothing to go on from: it begins again.
/// What only has a name like ours stays.
TEST(RollingResume, BeginsAgainWhereThereWasNoCheckpoint) {
  const Case test = {.name = "early", .seed = 27};
  const std::vector<Step> steps = walk(test, 24);
  const ScratchFolder scratch;
  const RollingOptions options = tightOptions(test, steps, 0.5, scratch / "tiles");
  {
    RollingField killed(toolsOf(test), paramsOf(test), options);
    for (std::size_t n = 0; n < 14; ++n) integrate(killed, steps[n], 0.1 * static_cast<double>(n));
    EXPECT_GT(killed.status().saved, 0U);
  }
  const auto states = [&] {
    std::size_t count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(options.folder))
      count += entry.path().extension() == ".state" ? 1 : 0;
    return count;
  };
  EXPECT_GT(states(), 0U);
  writeBytes(options.folder / "3_4.77.state", "mine");
  std::filesystem::create_directory(options.folder / "5_5.78.ids");
  RollingField again = RollingField::resume(toolsOf(test), paramsOf(test), options);
  EXPECT_EQ(again.status().steps, 0U);
  EXPECT_EQ(states(), 1U) << "mine";
  EXPECT_TRUE(std::filesystem::exists(options.folder / "5_5.78.ids"));
  AccessibilityField unlimited(toolsOf(test), paramsOf(test));
  for (std::size_t n = 0; n < steps.size(); ++n) {
    integrate(unlimited, steps[n], 0.1 * static_cast<double>(n));
    integrate(again, steps[n], 0.1 * static_cast<double>(n));
  }
  unlimited.update();
  again.update();
  EXPECT_EQ(differences(unlimited.snapshot(), again.snapshot()), 0U);
}

/// Also where everything is scored at the end: memory stays below the limit all the way.
TEST(RollingUpdate, OfAllTilesAtOnceKeepsTheLimit) {
  const Case test = {.name = "at_once", .seed = 28, .change = ChangeMode::Block};
  const std::vector<Step> steps = walk(test);
  const ScratchFolder scratch;
  const RollingOptions options = tightOptions(test, steps, 0.7, scratch / "tiles");
  AccessibilityField unlimited(toolsOf(test), paramsOf(test));
  RollingField rolling(toolsOf(test), paramsOf(test), options);
  for (std::size_t n = 0; n < steps.size(); ++n) {
    integrate(unlimited, steps[n], 0.1 * static_cast<double>(n));
    integrate(rolling, steps[n], 0.1 * static_cast<double>(n));
  }
  unlimited.update();
  rolling.update();
  const RollingStatus status = rolling.status();
  EXPECT_LE(status.memory_bytes, options.memory_limit_bytes);
  // The tile that is being scored comes beside.
  EXPECT_LE(status.peak_memory_bytes, options.memory_limit_bytes / 10 * 11);
  EXPECT_EQ(differences(unlimited.snapshot(), rolling.snapshot()), 0U);
}

/// Tiles leave earlier, and nothing else changes: also where memory is short.
TEST(RollingTighten, ChangesNoResult) {
  for (const double memory_share : {0.7, 0.3}) {
    SCOPED_TRACE(memory_share);
    const Case test = {.name = "tight", .seed = 29, .change = ChangeMode::Block};
    const std::vector<Step> steps = walk(test);
    const ScratchFolder scratch;
    RollingOptions options;
    options.memory_limit_bytes =
        static_cast<std::uint64_t>(memory_share * static_cast<double>(bytesOfAll(test, steps)));
    options.tile_voxels = kTile_voxels;
    options.folder = scratch / "loose";
    RollingField loose(toolsOf(test), paramsOf(test), options);
    options.folder = scratch / "tight";
    RollingField tight(toolsOf(test), paramsOf(test), options);
    for (std::size_t n = 0; n < steps.size(); ++n) {
      if (n % 10 == 5) tight.tighten(0.9 - 0.02 * static_cast<double>(n));
      for (RollingField* field : {&loose, &tight}) {
        integrate(*field, steps[n], 0.1 * static_cast<double>(n));
        field->update();
      }
      ASSERT_EQ(tight.status().memory_short, loose.status().memory_short) << n;
      ASSERT_EQ(tight.status().left_out_returns, loose.status().left_out_returns) << n;
      ASSERT_EQ(differences(loose.snapshot(), tight.snapshot()), 0U) << "step " << n;
    }
    EXPECT_EQ(loose.status().left_out_returns > 0, memory_share < 0.5);
    // Where even the tiles of one scan do not fit, all others have left anyway.
    EXPECT_TRUE(memory_share < 0.5 || tight.status().saved > loose.status().saved);
  }
}

/// What is written beside the steps and cannot be, is tried again when the tile has to leave. Nothing is lost.
TEST(RollingDisk, ThatIsFullIsSaidByTheStepThatNeedsIt) {
  for (const Pace pace : {Pace::AtOnce, Pace::WhenNeeded, Pace::Beside}) {
    const WithPace with(pace);
    const Case test = {.name = "full", .seed = 26};
    const std::vector<Step> steps = walk(test, 40);
    const ScratchFolder scratch;
    const RollingOptions options = tightOptions(test, steps, 0.5, scratch / "states");
    AccessibilityField unlimited(toolsOf(test), paramsOf(test));
    RollingField rolling(toolsOf(test), paramsOf(test), options);
    std::size_t refused = 0;
    for (std::size_t n = 0; n < steps.size(); ++n) {
      const double stamp_s = 0.1 * static_cast<double>(n);
      integrate(unlimited, steps[n], stamp_s);
      unlimited.update();
      // Away from the sixth step of ten on until a step is refused: it stays away beside the steps, too.
      if (n % 10 == 5) std::filesystem::rename(options.folder, scratch / "away");
      try {
        integrate(rolling, steps[n], stamp_s);
      } catch (const Error& error) {
        EXPECT_TRUE(error.id().starts_with("output.") || error.id().starts_with("input.")) << error.id();
        ++refused;
        std::filesystem::rename(scratch / "away", options.folder);
        integrate(rolling, steps[n], stamp_s);
      }
      if (n % 10 == 4 && std::filesystem::exists(scratch / "away"))
        std::filesystem::rename(scratch / "away", options.folder);
      if (!std::filesystem::exists(options.folder)) continue;
      rolling.update();
      EXPECT_LE(rolling.status().memory_bytes, options.memory_limit_bytes);
    }
    if (std::filesystem::exists(scratch / "away")) std::filesystem::rename(scratch / "away", options.folder);
    rolling.update();
    EXPECT_TRUE(refused > 0 || pace == Pace::Beside) << "which may have written enough before";
    EXPECT_TRUE(rolling.status().lost_tiles.empty());
    EXPECT_EQ(differences(unlimited.snapshot(), rolling.snapshot()), 0U);
  }
}

TEST(DiskThread, DoesOnePieceAfterTheOther) {
  DiskThread disk;
  std::vector<int> done;  // no lock: pieces do not overlap
  std::vector<DiskThread::Handle> work;
  for (int n = 0; n < 100; ++n) work.push_back(disk.begin([&done, n] { done.push_back(n); }));
  for (const auto& piece : work) {
    while (!disk.hasEnded(piece)) std::this_thread::yield();
  }
  ASSERT_EQ(done.size(), 100U);
  for (int n = 0; n < 100; ++n) EXPECT_EQ(done[static_cast<std::size_t>(n)], n);
}

/// While the thread is kept busy, the rest waits: finish() does it here, cancel() never.
TEST(DiskThread, LeavesWhatHasNotBegunToTheCaller) {
  std::promise<void> begun, go_on;
  std::vector<std::thread::id> by;
  bool cancelled = false;
  {
    DiskThread disk;
    const auto busy = disk.begin([&] {
      begun.set_value();
      go_on.get_future().wait();
    });
    begun.get_future().wait();
    const auto here = disk.begin([&] { by.push_back(std::this_thread::get_id()); });
    const auto never = disk.begin([&] { cancelled = true; });
    EXPECT_FALSE(disk.hasEnded(busy));
    EXPECT_TRUE(disk.finish(here));
    EXPECT_FALSE(disk.cancel(never));
    EXPECT_FALSE(disk.finish(never)) << "it never does";
    const auto fails = disk.begin([] { throw std::runtime_error("full"); });
    EXPECT_FALSE(disk.finish(fails));
    EXPECT_TRUE(disk.hasEnded(fails));
    std::thread release([&] { go_on.set_value(); });
    EXPECT_TRUE(disk.finish(busy)) << "waits";
    release.join();
  }
  EXPECT_EQ(by, std::vector<std::thread::id>{std::this_thread::get_id()});
  EXPECT_FALSE(cancelled);
}

TEST(DiskThread, WaitsAtItsEndForWhatHasBegunAndForgetsTheRest) {
  std::promise<void> begun, go_on;
  bool ended = false, forgotten = false;
  std::thread release;
  {
    DiskThread disk;
    static_cast<void>(disk.begin([&] {
      begun.set_value();
      go_on.get_future().wait();
      ended = true;
    }));
    begun.get_future().wait();
    const WithPace nobody(Pace::WhenNeeded);
    DiskThread idle;
    static_cast<void>(idle.begin([&] { forgotten = true; }));
    release = std::thread([&] { go_on.set_value(); });
  }
  release.join();
  EXPECT_TRUE(ended);
  EXPECT_FALSE(forgotten);
}

TEST(DiskThread, FailsWithoutHarm) {
  for (const Pace pace : {Pace::AtOnce, Pace::WhenNeeded, Pace::Beside}) {
    const WithPace with(pace);
    DiskThread disk;
    const auto fails = disk.begin([] { throw std::runtime_error("full"); });
    const auto fine = disk.begin([] {});
    EXPECT_FALSE(disk.finish(fails));
    EXPECT_TRUE(disk.finish(fine));
    EXPECT_TRUE(disk.hasEnded(fails));
  }
}

}  // namespace
}  // namespace accessvdb::test
