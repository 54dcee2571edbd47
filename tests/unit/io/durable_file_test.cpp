// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Whole or not at all: success, errors of the body, full disks, limits, bad folders, two processes.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <ostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "io/streams/whole_file.h"
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

TEST(WholeFile, IsThereOrNotAndCanBeBroughtToTheDisk) {
  const ScratchFolder folder;
  io::writeFileWhole(folder / "a.txt", [](std::ostream& stream) { stream << "old"; });
  const auto fail = [&] {
    io::writeFileWhole(folder / "a.txt", [](std::ostream& stream) {
      stream << "new";
      throw OutputError("test.body", "", "failed", "");
    });
  };
  EXPECT_EQ(outputErrorOf(fail), "test.body");
  EXPECT_EQ(contentOf(folder / "a.txt"), "old");
  EXPECT_EQ(folder.names(), std::vector<std::string>{"a.txt"});
  EXPECT_EQ(outputErrorOf([&] { io::bringToDisk(folder / "a.txt"); }), "no error");
  EXPECT_NE(outputErrorOf([&] { io::bringToDisk(folder / "b.txt"); }), "no error");
  EXPECT_EQ(outputErrorOf([] { io::writeFileWhole("/dev/full", [](std::ostream& stream) { stream << "x"; }); }),
            outputErrorOf([] { io::writeFileDurably("/dev/full", [](std::ostream& stream) { stream << "x"; }); }));
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

/// Its folder may be anybody's, so only what belongs to this very file goes.
TEST(DurableFile, WhatAKilledRunLeftOfTheSameFileIsRemoved) {
  const ScratchFolder folder;
  const std::string own = ".a.ply.0123456789abcdef.tmp", busy = ".a.ply.1123456789abcdef.tmp",
                    others = ".b.ply.0123456789abcdef.tmp", longer = ".a.ply.x.0123456789abcdef.tmp";
  for (const std::string& name : {own, busy, others, longer}) std::ofstream(folder / name) << "half";
  const int fd = ::open((folder / busy).c_str(), O_WRONLY | O_CLOEXEC);
  ASSERT_EQ(::flock(fd, LOCK_EX | LOCK_NB), 0);
  io::writeFileDurably(folder / "a.ply", [](std::ostream& stream) { stream << "whole"; });
  ::close(fd);
  std::vector<std::string> names = folder.names(), expected = {longer, busy, others, "a.ply"};
  std::sort(names.begin(), names.end());
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(names, expected);
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

TEST(OutputFolder, OnlyTemporaryFilesOfOursAreRemoved) {
  const ScratchFolder folder;
  const std::vector<std::string> ours = {".field.vdb.0123456789abcdef.tmp", ".p.fedcba9876543210.tmp"},
                                 foreign = {"notes.tmp", ".x.tmp", ".field.vdb.0123456789abcdeg.tmp",
                                            "field.vdb.0123456789abcdef.tmp"};
  for (const auto& list : {ours, foreign}) {
    for (const auto& name : list) std::ofstream(folder / name) << "x";
  }
  io::prepareOutputFolder(folder.path());
  for (const auto& name : ours) EXPECT_FALSE(std::filesystem::exists(folder / name)) << name;
  for (const auto& name : foreign) EXPECT_TRUE(std::filesystem::exists(folder / name)) << name;
}

/// Temporary files of ours in a folder.
std::size_t temporaryFiles(const std::filesystem::path& folder) {
  std::size_t count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    count += entry.path().extension() == ".tmp" ? 1 : 0;
  }
  return count;
}

/// A process that is in the middle of a file, without the folder's lock. It goes on when it is told to.
struct Writer {
  explicit Writer(const std::filesystem::path& file) {
    if (::pipe(ready) != 0 || ::pipe(go_on) != 0) throw std::runtime_error("pipe");
    child = ::fork();
    if (child == 0) {
      io::writeFileDurably(file, [&](std::ostream& stream) {
        char byte = 'x';
        stream << "half";
        stream.flush();
        if (::write(ready[1], &byte, 1) != 1 || ::read(go_on[0], &byte, 1) != 1) ::_exit(1);
        stream << " whole";
      });
      ::_exit(0);
    }
    char byte = 0;
    if (::read(ready[0], &byte, 1) != 1) throw std::runtime_error("read");
  }
  int wait() const {
    int status = 1;
    ::waitpid(child, &status, 0);
    return status;
  }
  int ready[2], go_on[2];
  pid_t child = -1;
};

TEST(OutputFolder, WhatAKilledRunLeftIsRemovedAtOnce) {
  const ScratchFolder folder;
  const Writer writer(folder / "field.vdb");
  ::kill(writer.child, SIGKILL);
  writer.wait();
  ASSERT_EQ(temporaryFiles(folder.path()), 1u);
  io::prepareOutputFolder(folder.path());
  EXPECT_EQ(temporaryFiles(folder.path()), 0u);
  EXPECT_FALSE(std::filesystem::exists(folder / "field.vdb"));
}

TEST(OutputFolder, AFileThatIsBeingWrittenIsLeftAlone) {
  const ScratchFolder folder;
  const Writer writer(folder / "picture.png");
  io::prepareOutputFolder(folder.path());
  EXPECT_EQ(temporaryFiles(folder.path()), 1u);
  const char byte = 'x';
  ASSERT_EQ(::write(writer.go_on[1], &byte, 1), 1);
  EXPECT_EQ(writer.wait(), 0);
  std::ifstream file(folder / "picture.png");
  std::string text((std::istreambuf_iterator<char>(file)), {});
  EXPECT_EQ(text, "half whole");
  EXPECT_EQ(temporaryFiles(folder.path()), 0u);
}

}  // namespace
}  // namespace accessvdb
