// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// "There is nothing" is only said where the system says so. This program has its own stat() and lstat(), which refuse
/// to look at paths with the name of an error in them.
#include "accessvdb/program/path_facts.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <fstream>

#include "accessvdb/scan_io.h"
#include "support/scratch_folder.h"

namespace {

constexpr std::pair<const char*, int> kRefusals[] = {
    {"REFUSED_EIO", EIO}, {"REFUSED_EACCES", EACCES}, {"REFUSED_EMFILE", EMFILE}, {"REFUSED_ESTALE", ESTALE}};
bool times_refused = false;

int refusal(const char* path) {
  for (const auto& [name, error] : kRefusals) {
    if (std::strstr(path, name) != nullptr) return error;
  }
  return times_refused && std::strstr(path, "times.txt") != nullptr ? EIO : 0;
}

int look(const char* path, struct stat* to, int flags) {
  const int error = refusal(path);
  if (error == 0) return ::fstatat(AT_FDCWD, path, to, flags);
  errno = error;
  return -1;
}

}  // namespace

extern "C" int stat(const char* path, struct stat* to) noexcept { return look(path, to, 0); }
extern "C" int lstat(const char* path, struct stat* to) noexcept { return look(path, to, AT_SYMLINK_NOFOLLOW); }

namespace accessvdb::io {
namespace {

namespace fs = std::filesystem;

class PathFacts : public ::testing::Test {
 protected:
  [[nodiscard]] fs::path path(const std::string& name) const { return folder_.path() / name; }
  void write(const std::string& name, const std::string& text) const {
    fs::create_directories(path(name).parent_path());
    std::ofstream(path(name)) << text;
  }

  test::ScratchFolder folder_;
};

TEST_F(PathFacts, WhatIsThereIsNamed) {
  write("file", "text");
  fs::create_symlink(path("file"), path("link"));
  fs::create_symlink(path("nowhere"), path("loose"));
  EXPECT_TRUE(isFile(path("file")) && isFile(path("link")) && isThere(path("file")) && isTaken(path("link")));
  EXPECT_TRUE(isFolder(folder_.path()) && isThere(folder_.path()) && !isFile(folder_.path()));
  EXPECT_TRUE(!isThere(path("loose")) && isTaken(path("loose")));
  EXPECT_EQ(contentAt(path("file")), "text");
  EXPECT_EQ(contentAt(path("file"), 3), "") << "too large";
  EXPECT_EQ(contentAt(folder_.path()), "");
  EXPECT_EQ(beginningAt(path("file"), 3), "tex");
  EXPECT_EQ(beginningAt(path("file"), 30), "text");
  EXPECT_EQ(beginningAt(folder_.path(), 3), "");
}

TEST_F(PathFacts, NothingIsNoError) {
  write("file", "");
  fs::create_symlink(path("round"), path("round"));
  const std::string far_too_long(5000, 'x');
  for (const fs::path& nothing :
       {path("none"), path("file") / "below", path("round"), path(far_too_long), fs::path(far_too_long), fs::path()}) {
    SCOPED_TRACE(nothing.string().substr(0, 100));
    EXPECT_FALSE(isThere(nothing) || isFile(nothing) || isFolder(nothing));
    EXPECT_EQ(contentAt(nothing), "");
  }
}

TEST_F(PathFacts, NotToBeAbleToLookIsAnError) {
  for (const auto& [name, error] : kRefusals) {
    write(name, "text");
    SCOPED_TRACE(name);
    for (const auto& ask : {isFile, isFolder, isThere, isTaken}) {
      EXPECT_THROW(static_cast<void>(ask(path(name), ErrorCode::Output)), OutputError);
      try {
        static_cast<void>(ask(path(name), ErrorCode::Input));
        ADD_FAILURE() << "said something";
      } catch (const InputError& refused) {
        EXPECT_EQ(refused.id(), "input.unreadable");
        EXPECT_NE(refused.problem().find(std::strerror(error)), std::string::npos) << refused.what();
        EXPECT_EQ(refused.advice().find("ulimit -n") != std::string::npos, error == EMFILE) << refused.what();
      }
    }
    EXPECT_THROW(static_cast<void>(contentAt(path(name))), InputError);
    EXPECT_THROW(static_cast<void>(beginningAt(path(name), 1)), InputError);
  }
}

/// Stamps of KITTI poses: without them the scans would be matched in another way.
TEST_F(PathFacts, TimesThatCannotBeLookedAtAreNotPassedOver) {
  write("scans/000000.bin", std::string(16, '\0'));
  write("scans/000001.bin", std::string(16, '\0'));
  write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 0\n");
  write("times.txt", "0\n1\n");
  const ScanInputOptions options = {.scans = path("scans"), .poses = path("poses.txt")};
  EXPECT_EQ(ScanSequence::open(options).size(), 2u);
  times_refused = true;
  EXPECT_THROW(static_cast<void>(ScanSequence::open(options)), InputError);
  times_refused = false;
}

}  // namespace
}  // namespace accessvdb::io
