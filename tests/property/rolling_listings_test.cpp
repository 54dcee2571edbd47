// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A rolling field lists no folder of its own while it runs: what a step and a checkpoint cost depends on the tiles
/// that change, not on those that there are.
#include <dirent.h>
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <mutex>
#include <ostream>
#include <string>
#include <vector>

#include "accessvdb/field_io.h"
#include "accessvdb/rolling_field.h"
#include "rolling_walks.h"

namespace {

std::mutex listed_lock;
std::vector<std::filesystem::path> listed;

void noteListed(const std::filesystem::path& folder) {
  const std::scoped_lock lock(listed_lock);
  listed.push_back(folder);
}

std::ptrdiff_t timesListed(const std::filesystem::path& folder) {
  const std::scoped_lock lock(listed_lock);
  return std::count(listed.begin(), listed.end(), std::filesystem::canonical(folder));
}

}  // namespace

// In place of the C library's, for the library under test and the standard library alike.
extern "C" DIR* opendir(const char* name) {
  std::error_code error;
  noteListed(std::filesystem::canonical(name, error));
  return reinterpret_cast<DIR* (*)(const char*)>(dlsym(RTLD_NEXT, "opendir"))(name);
}
extern "C" DIR* fdopendir(int fd) {
  std::error_code error;
  noteListed(std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(fd), error));
  return reinterpret_cast<DIR* (*)(int)>(dlsym(RTLD_NEXT, "fdopendir"))(fd);
}

namespace accessvdb::test {
namespace {

TEST(RollingListings, AreNoneWhileAFieldRuns) {
  const Case test = {.name = "listings", .seed = 27};
  const std::vector<Step> steps = walk(test, 24);
  const ScratchFolder scratch;
  const RollingOptions options = tightOptions(test, steps, 0.5, scratch / "states");
  RollingField rolling(toolsOf(test), paramsOf(test), options);
  const auto before = timesListed(options.folder);
  EXPECT_GT(before, 0) << "the count does not see it";
  for (std::size_t n = 0; n < steps.size(); ++n) {
    integrate(rolling, steps[n], 0.1 * static_cast<double>(n));
    rolling.update();
    if (n % 5 == 4) rolling.checkpoint();
  }
  EXPECT_GT(rolling.status().saved, 4U);
  EXPECT_GT(rolling.status().loaded, 4U);
  EXPECT_EQ(timesListed(options.folder), before);
  rolling.write(scratch / "out");
  EXPECT_GT(rolling.status().tiles, 10U);
  EXPECT_LE(timesListed(scratch / "out" / "tiles"), 3) << "once for each tile";
}

/// Files of others, and leftovers of killed processes, are dealt with as before where the folder is not ours.
TEST(RollingListings, StillFindLeftoversElsewhere) {
  const ScratchFolder scratch;
  const auto leftover = scratch / ".file.0123456789abcdef.tmp", other = scratch / ".other.0123456789abcdef.tmp";
  writeBytes(leftover, "of a killed run");
  writeBytes(other, "of another file");
  io::writeFileDurably(scratch / "file", [](std::ostream& stream) { stream << "new"; });
  EXPECT_FALSE(std::filesystem::exists(leftover));
  EXPECT_TRUE(std::filesystem::exists(other));
  io::prepareOutputFolder(scratch / "");
  EXPECT_FALSE(std::filesystem::exists(other)) << "swept when it becomes ours";
}

}  // namespace
}  // namespace accessvdb::test
