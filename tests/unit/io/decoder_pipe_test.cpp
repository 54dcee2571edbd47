// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// LAZ through a command that writes LAS: small shell scripts that behave well or badly, and a real decoder.
#include "io/clouds/decoder_pipe.h"

#include <sys/wait.h>

#include <cstdlib>

#include "accessvdb/scan_io.h"
#include "unit/io/cloud_parts.h"
#include "unit/io/timed_cloud.h"

namespace accessvdb::io {
namespace {

using test::anyContains;
using test::expectError;
using test::TempFolder;

/// 0.8 MB: more than is read at once, so that going back means to start the command again.
constexpr int kSeveralWindows = 30'000;

std::string someLas(int points) {
  std::vector<test::TimedPoint> cloud;
  for (int i = 0; i < points; ++i) cloud.push_back({0.5 * i, {0.25 * i, 2, -1}});
  return test::timedLas(cloud);
}

/// A command that is a shell script; "$1" is the file.
std::string script(const TempFolder& folder, const std::string& name, const std::string& body) {
  const auto path = folder.write(name, "#!/bin/sh\n" + body + "\n");
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path.string();
}

class Path {
 public:
  explicit Path(const std::string& value) : before_(std::getenv("PATH")) { ::setenv("PATH", value.c_str(), 1); }
  Path(const Path&) = delete;
  Path& operator=(const Path&) = delete;
  ~Path() { ::setenv("PATH", before_.c_str(), 1); }

 private:
  std::string before_;
};

class WorkingFolder {
 public:
  explicit WorkingFolder(const std::filesystem::path& path) : before_(std::filesystem::current_path()) {
    std::filesystem::current_path(path);
  }
  WorkingFolder(const WorkingFolder&) = delete;
  WorkingFolder& operator=(const WorkingFolder&) = delete;
  ~WorkingFolder() { std::filesystem::current_path(before_); }

 private:
  std::filesystem::path before_;
};

PointCloud readLaz(const std::filesystem::path& path, const std::string& command) {
  return test::readInParts(path, ScanKind::Laz, {.laz_command = command});
}

TEST(DecoderPipe, ReadsWhatTheCommandWrites) {
  const TempFolder folder;
  const std::string copy = script(folder, "copy", "cat \"$1\"");
  for (const int points : {0, 1, 3, 4096, 20000}) {
    const PointCloud cloud = readLaz(folder.write("a.laz", someLas(points)), copy);
    ASSERT_EQ(cloud.points.size(), static_cast<std::size_t>(points));
    for (int i = 0; i < points; ++i) ASSERT_EQ(cloud.points[i], Eigen::Vector3d(0.25 * i, 2, -1));
  }
  // Bytes after the points, and much on stderr, which nobody must have to wait for.
  const auto longer = folder.write("b.laz", someLas(3) + std::string(1 << 20, 'x'));
  EXPECT_EQ(readLaz(longer, script(folder, "loud", "head -c 300000 /dev/zero >&2; cat \"$1\"")).points.size(), 3U);
}

TEST(DecoderPipe, TakesStepsInAnyOrder) {
  const TempFolder folder;
  const auto path = folder.write("a.laz", someLas(100));
  ScanSequence scans = ScanSequence::open({.scans = path,
                                           .sensor_at_W = Eigen::Vector3d::Zero(),
                                           .rays_per_step = 30,
                                           .laz_command = script(folder, "copy", "cat \"$1\"")});
  ASSERT_EQ(scans.size(), 4U);
  EXPECT_TRUE(anyContains(scans.notices(), "copy"));
  for (const std::size_t step : {3U, 0U, 2U, 2U, 1U}) {
    const ScanRecord record = scans.read(step);
    EXPECT_EQ(record.points_W.front(), Eigen::Vector3d(7.5 * static_cast<double>(step), 2, -1));
    EXPECT_EQ(record.points_W.size(), step == 3 ? 10U : 30U);
  }
}

TEST(DecoderPipe, PassesTheNameAsOneWordWithoutAShell) {
  const TempFolder folder;
  const std::string copy = script(folder, "copy", "test $# = 2 && test \"$1\" = -x && cat \"$2\"") + "  -x ";
  for (const char* const name :
       {"a b.laz", "$(touch owned).laz", "a;touch owned;.laz", "\"'`.laz", "*.laz", "a\nb.laz"})
    EXPECT_EQ(readLaz(folder.write(name, someLas(2)), copy).points.size(), 2U) << name;
  EXPECT_FALSE(std::filesystem::exists("owned"));
  // A name that looks like an option.
  (void)folder.write("-stdin.laz", someLas(2));
  const WorkingFolder inside(folder.path());
  EXPECT_EQ(readLaz("-stdin.laz", copy).points.size(), 2U);
}

TEST(DecoderPipe, NamesWhatTheCommandDidWrong) {
  const TempFolder folder;
  const auto path = folder.write("a.laz", someLas(3));
  int number = 0;
  const auto refuse = [&](const std::string& body, const std::string& id, const std::vector<std::string>& words) {
    const std::string command = script(folder, "c" + std::to_string(number++), body);
    for (const bool allow_truncated : {false, true})
      expectError(
          [&] { (void)readCloud(path, ScanKind::Laz, {.allow_truncated = allow_truncated, .laz_command = command}); },
          ErrorCode::Input, id, words);
  };
  refuse("echo no licence >&2; exit 3", "input.decoder", {"a.laz", "exit code 3", "no licence", "laz_command"});
  refuse("cat \"$1\"; exit 1", "input.decoder", {"exit code 1"});
  refuse("head -c 250 \"$1\"; exit 9", "input.decoder", {"exit code 9"});
  refuse("head -c 250 \"$1\"; kill -9 $$", "input.decoder", {"signal 9"});
  refuse("exit 0", "input.malformed", {"LASF"});
  refuse("echo LASF", "input.truncated", {"5 bytes"});
  refuse("echo \"usage: laszip ...................................\"", "input.malformed", {"LASF"});
  for (const auto& [command, words] : {std::pair<std::string, std::string>{"/nowhere/at/all -x", "cannot be started"},
                                       {"   ", "empty"},
                                       {folder.write("not_executable", "#!/bin/sh\n").string(), "cannot be started"}})
    expectError([&] { (void)readCloud(path, ScanKind::Laz, {.laz_command = command}); }, ErrorCode::Input,
                "input.decoder", {words});

  // Ends early, but says that all is well.
  const std::string half = script(folder, "half", "head -c 260 \"$1\"");
  expectError([&] { (void)readCloud(path, ScanKind::Laz, {.laz_command = half}); }, ErrorCode::Input, "input.truncated",
              {"1 complete"});
  const PointCloud kept = readCloud(path, ScanKind::Laz, {.allow_truncated = true, .laz_command = half});
  EXPECT_EQ(kept.points.size(), 1U);
  EXPECT_EQ(kept.truncated_points, 2U);

  // Still compressed.
  std::string packed = someLas(3);
  packed[104] = static_cast<char>(0x81);
  expectError(
      [&] {
        (void)readCloud(folder.write("p.laz", packed), ScanKind::Laz,
                        {.laz_command = script(folder, "copy", "cat \"$1\"")});
      },
      ErrorCode::Input, "input.unsupported", {"LAZ"});
  expectError([&] { (void)readCloud(folder.write("e.laz", ""), ScanKind::Laz, {.laz_command = half}); },
              ErrorCode::Input, "input.empty");
  expectError([&] { (void)readCloud(folder / "none.laz", ScanKind::Laz, {.laz_command = half}); }, ErrorCode::Input,
              "input.missing");
  expectError(
      [&] {
        (void)readCloud(folder.write("l.laz", "version https://git-lfs.github.com/spec/v1\n"), ScanKind::Laz,
                        {.laz_command = half});
      },
      ErrorCode::Input, "input.lfs_pointer");
}

TEST(DecoderPipe, SurvivesACutAnywhereAsAFileDoes) {
  const TempFolder folder;
  const std::string las = someLas(3);
  const auto path = folder.write("a.laz", las);
  for (std::size_t size = 0; size < las.size(); size += 9) {
    const std::string head = "head -c " + std::to_string(size);
    EXPECT_THROW((void)readCloud(path, ScanKind::Laz, {.laz_command = head}), InputError) << size;
    const ReadOptions allow = {.allow_truncated = true, .laz_command = head};
    if (size < 227) {
      EXPECT_THROW((void)readCloud(path, ScanKind::Laz, allow), InputError) << size;
      continue;
    }
    EXPECT_EQ(readCloud(path, ScanKind::Laz, allow).points.size(), (size - 227) / 28) << size;
    EXPECT_EQ(readCloud(path, ScanKind::Laz, allow).truncated_points, 3 - (size - 227) / 28) << size;
  }
}

TEST(DecoderPipe, NoticesThatTheSecondTimeIsDifferent) {
  const TempFolder folder;
  const auto path = folder.write("a.laz", someLas(kSeveralWindows));
  const std::string marker = (folder / "seen").string();
  const std::string command = script(
      folder, "once", "if [ -e " + marker + " ]; then head -c 300 \"$1\"; else touch " + marker + "; cat \"$1\"; fi");
  ScanSequence scans = ScanSequence::open(
      {.scans = path, .sensor_at_W = Eigen::Vector3d::Zero(), .rays_per_step = 4000, .laz_command = command});
  expectError([&] { (void)scans.read(0); }, ErrorCode::Input, "input.decoder", {"300 bytes", "the time before"});
}

TEST(DecoderPipe, LeavesNoProcessBehind) {
  const TempFolder folder;
  const auto path = folder.write("a.laz", someLas(kSeveralWindows));
  const std::string command = script(folder, "slow", "cat \"$1\"; exec sleep 1000");
  {
    const auto reader = openCloud(path, ScanKind::Laz, {.laz_command = command});
    EXPECT_EQ(reader->next(10).points.size(), 10U);
  }
  EXPECT_EQ(::waitpid(-1, nullptr, WNOHANG), -1) << "a child is left";
}

TEST(DecoderPipe, FindsTheUsualDecodersButNoneAmongTheScans) {
  const TempFolder folder;
  const auto path = folder.write("scans/a.laz", someLas(3));
  const TempFolder programs;
  const auto open = [&] {
    return ScanSequence::open({.scans = folder / "scans", .sensor_at_W = Eigen::Vector3d::Zero()});
  };
  // In the folder of the scans, which is also the current one, and which PATH names in every way that is not absolute.
  script(folder, "scans/laszip", "touch owned; cat \"$2\"");
  const WorkingFolder inside(folder / "scans");
  for (const std::string& relative : {std::string(), std::string(":"), std::string("."), std::string("./:../scans:")}) {
    const Path current(relative);
    EXPECT_EQ(findLazDecoder(), "");
    expectError([&] { (void)open(); }, ErrorCode::Input, "input.unsupported", {"a.laz", "laszip", "laz_command"});
    expectError(
        [&] {
          (void)ScanSequence::open(
              {.scans = path, .sensor_at_W = Eigen::Vector3d::Zero(), .laz_command = "laszip -stdout"});
        },
        ErrorCode::Input, "input.decoder", {"cannot be started"});
  }
  EXPECT_FALSE(std::filesystem::exists("owned"));
  script(programs, "las2las", "test \"$1\" = -stdout && /bin/cat \"$2\"");
  const Path absolute(".:" + programs.path().string());
  EXPECT_EQ(findLazDecoder(), "las2las -stdout");
  EXPECT_EQ(open().read(0).points_W.size(), 3U);
  script(programs, "laszip", "test \"$1\" = -stdout && /bin/cat \"$2\"");
  EXPECT_EQ(findLazDecoder(), "laszip -stdout");
}

/// The npm package laz-perf under node: $ACCESSVDB_LAZ_PERF, or where tools/setup_debian.sh --tests puts it.
std::string realDecoder() {
  const char* const given = std::getenv("ACCESSVDB_LAZ_PERF");
  const std::filesystem::path folder =
      given != nullptr ? std::filesystem::path(given)
                       : std::filesystem::path(ACCESSVDB_SOURCE_DIR) / "build" / "npm" / "node_modules" / "laz-perf";
  if (!std::filesystem::exists(folder) || std::system("node --version > /dev/null 2>&1") != 0) return {};
  return "node " ACCESSVDB_SOURCE_DIR "/tests/unit/io/laz_to_las.mjs " + folder.string();
}

class DecoderPipeReal : public ::testing::TestWithParam<const char*> {};

TEST_P(DecoderPipeReal, GivesThePointsOfTheUncompressedTwin) {
  ACCESSVDB_NEED_DATA(las, std::string("trees/") + GetParam() + ".las");
  ACCESSVDB_NEED_DATA(laz, std::string("trees/") + GetParam() + ".laz");
  const std::string command = realDecoder();
  if (command.empty()) GTEST_SKIP() << "node or the npm package laz-perf is missing: tools/setup_debian.sh --tests";
  const PointCloud packed = readCloud(laz, ScanKind::Laz, {.laz_command = command});
  const PointCloud plain = readCloud(las, ScanKind::Las, {});
  ASSERT_EQ(packed.points.size(), plain.points.size());
  test::expectPart(plain, packed, 0);
  EXPECT_EQ(packed.outside_points, plain.outside_points);

  const auto damaged = [&](std::size_t bytes) {
    std::ifstream in(laz, std::ios::binary);
    std::string text(bytes, '\0');
    in.read(text.data(), static_cast<std::streamsize>(bytes));
    return text;
  };
  const TempFolder folder;
  EXPECT_THROW((void)readCloud(folder.write("cut.laz", damaged(100)), ScanKind::Laz, {.laz_command = command}),
               InputError);
}
INSTANTIATE_TEST_SUITE_P(Files, DecoderPipeReal, ::testing::Values("pine", "pine_plot", "MLS_Clip"));

}  // namespace
}  // namespace accessvdb::io
