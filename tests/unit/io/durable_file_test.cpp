// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whole or not at all: success, errors of the body, full disks, limits, bad folders, two processes.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <utime.h>

#include <ctime>
#include <fstream>
#include <functional>
#include <iterator>
#include <ostream>
#include <stdexcept>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using test::ScratchFolder;

std::string contentOf(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Id of the OutputError that `job` throws, or what else happened.
std::string outputErrorOf(const std::function<void()>& job) {
  try {
    job();
  } catch (const OutputError& error) {
    return error.id();
  } catch (const std::exception& error) {
    return std::string("other: ") + error.what();
  }
  return "no error";
}

/// Runs `job` in a child process; true if it returns true.
bool inChild(const std::function<bool()>& job) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(job() ? 0 : 1);
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

TEST(DurableFile, WritesManyMegabytesExactly) {
  const ScratchFolder folder;
  std::string expected;
  for (int i = 0; i < 2000000; ++i) expected += std::to_string(i) + " ";  // about 14 MB, beyond any buffer
  io::writeFileDurably(folder / "a.bin", [&](std::ostream& stream) {
    stream.write(expected.data(), 10);
    for (std::size_t i = 10; i < 5000; ++i) stream.put(expected[i]);
    stream.write(expected.data() + 5000, static_cast<std::streamsize>(expected.size() - 5000));
  });
  EXPECT_TRUE(contentOf(folder / "a.bin") == expected);
  EXPECT_EQ(folder.names(), std::vector<std::string>{"a.bin"});
}

TEST(DurableFile, SeekingBackOverwritesInPlace) {
  const ScratchFolder folder;
  io::writeFileDurably(folder / "a.bin", [](std::ostream& stream) {
    stream << "????" << std::string(6 << 20, 'x');
    const auto end = stream.tellp();
    ASSERT_EQ(end, std::ostream::pos_type(4 + (6 << 20)));
    stream.seekp(0) << "head";
    stream.seekp(end) << "tail";
  });
  EXPECT_TRUE(contentOf(folder / "a.bin") == "head" + std::string(6 << 20, 'x') + "tail");
}

TEST(DurableFile, FollowsTheUmask) {
  const ScratchFolder folder;
  const mode_t before = ::umask(027);
  io::writeFileDurably(folder / "a.txt", [](std::ostream& stream) { stream << "a"; });
  ::umask(before);
  struct stat info;
  ASSERT_EQ(::stat((folder / "a.txt").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0640u);
}

TEST(DurableFile, ErrorOfTheBodyLeavesTheOldFile) {
  const ScratchFolder folder;
  io::writeFileDurably(folder / "a.txt", [](std::ostream& stream) { stream << "old"; });
  EXPECT_THROW(io::writeFileDurably(folder / "a.txt",
                                    [](std::ostream& stream) {
                                      stream << "new";
                                      throw std::domain_error("stop");
                                    }),
               std::domain_error);
  EXPECT_EQ(contentOf(folder / "a.txt"), "old");
  EXPECT_EQ(folder.names(), std::vector<std::string>{"a.txt"});
}

TEST(DurableFile, FullDeviceIsAnError) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  EXPECT_EQ(outputErrorOf([] { io::writeFileDurably("/dev/full", [](std::ostream& stream) { stream << "a"; }); }),
            "output.disk_full");
}

TEST(DurableFile, BodyThatSwallowsTheFailureIsAnErrorToo) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  const auto body = [](std::ostream& stream) {
    stream.exceptions(std::ios_base::goodbit);
    stream << std::string(10 << 20, 'x');
    stream.clear();
  };
  EXPECT_EQ(outputErrorOf([&] { io::writeFileDurably("/dev/full", body); }), "output.disk_full");
}

TEST(DurableFile, FileSizeLimitIsAnErrorAndNoSignal) {
  const ScratchFolder folder;
  io::writeFileDurably(folder / "a.bin", [](std::ostream& stream) { stream << "old"; });
  EXPECT_TRUE(inChild([&] {
    const rlimit limit = {100000, 100000};
    if (::setrlimit(RLIMIT_FSIZE, &limit) != 0) return false;
    return outputErrorOf([&] {
             io::writeFileDurably(folder / "a.bin", [](std::ostream& s) { s << std::string(1 << 20, 'x'); });
           }) == "output.too_large";
  }));
  EXPECT_EQ(contentOf(folder / "a.bin"), "old");
  EXPECT_EQ(folder.names(), std::vector<std::string>{"a.bin"});
}

TEST(DurableFile, UnusableTargetsAreErrors) {
  const ScratchFolder folder;
  const auto write = [](const std::filesystem::path& path) {
    return outputErrorOf([&] { io::writeFileDurably(path, [](std::ostream& stream) { stream << "a"; }); });
  };
  EXPECT_EQ(write(folder / "file"), "no error");
  EXPECT_EQ(write(folder / "file/below.txt"), "output.write");
  EXPECT_EQ(write(folder / "missing/a.txt"), "output.write");
  EXPECT_EQ(write(folder.path()), "output.is_folder");
  EXPECT_EQ(write(folder.path().string() + "/"), "output.name");
}

TEST(DurableFile, SymbolicLinkIsReplacedNotFollowed) {
  const ScratchFolder folder;
  io::writeFileDurably(folder / "precious", [](std::ostream& stream) { stream << "keep"; });
  std::filesystem::create_symlink(folder / "precious", folder / "link");
  io::writeFileDurably(folder / "link", [](std::ostream& stream) { stream << "new"; });
  EXPECT_EQ(contentOf(folder / "precious"), "keep");
  EXPECT_FALSE(std::filesystem::is_symlink(folder / "link"));
}

TEST(OutputFolder, IsMadeAndLeftEmpty) {
  const ScratchFolder folder;
  io::prepareOutputFolder(folder / "a/b/");
  EXPECT_TRUE(std::filesystem::is_empty(folder / "a/b"));
  io::prepareOutputFolder(folder / "a/b");  // again, by the same process
}

TEST(OutputFolder, BelowAFileIsAnError) {
  const ScratchFolder folder;
  io::writeFileDurably(folder / "file", [](std::ostream& stream) { stream << "a"; });
  EXPECT_EQ(outputErrorOf([&] { io::prepareOutputFolder(folder / "file"); }).rfind("output.", 0), 0u);
  EXPECT_EQ(outputErrorOf([&] { io::prepareOutputFolder(folder / "file/out"); }).rfind("output.", 0), 0u);
}

TEST(OutputFolder, SecondProcessIsRefused) {
  const ScratchFolder folder;
  const std::filesystem::path out = folder / "out";
  std::filesystem::create_directory(out);
  int ready[2], done[2];
  ASSERT_EQ(::pipe(ready), 0);
  ASSERT_EQ(::pipe(done), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    char byte = 'x';
    io::prepareOutputFolder(out);
    if (::write(ready[1], &byte, 1) != 1 || ::read(done[0], &byte, 1) != 1) ::_exit(1);
    ::_exit(0);
  }
  char byte = 0;
  ASSERT_EQ(::read(ready[0], &byte, 1), 1);
  EXPECT_EQ(outputErrorOf([&] { io::prepareOutputFolder(out); }), "output.locked");
  ASSERT_EQ(::write(done[1], &byte, 1), 1);
  int status = 1;
  ::waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(outputErrorOf([&] { io::prepareOutputFolder(out); }), "no error");
}

TEST(OutputFolder, OnlyOldTemporaryFilesOfOursAreRemoved) {
  const ScratchFolder folder;
  const std::string stale = ".field.vdb.0123456789abcdef.tmp", fresh = ".field.vdb.fedcba9876543210.tmp",
                    foreign = "notes.tmp";
  for (const auto& name : {stale, fresh, foreign}) std::ofstream(folder / name) << "x";
  const utimbuf old = {std::time(nullptr) - 7200, std::time(nullptr) - 7200};
  ::utime((folder / stale).c_str(), &old);
  ::utime((folder / foreign).c_str(), &old);
  io::prepareOutputFolder(folder.path());
  EXPECT_FALSE(std::filesystem::exists(folder / stale));
  EXPECT_TRUE(std::filesystem::exists(folder / fresh));
  EXPECT_TRUE(std::filesystem::exists(folder / foreign));
}

}  // namespace
}  // namespace accessvdb
