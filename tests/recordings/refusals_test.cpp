// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Recordings that cannot be used: one error each, that says what to do; and sizes that are not believed.
#include <sys/resource.h>

#include "recordings/container_bytes.h"
#include "recordings/flight.h"

namespace accessvdb::recordings_test {
namespace {

using io::ScanInputOptions;
using io::ScanSequence;
using io::test::expectError;

class RecordingRefusals : public FlightTest {
 protected:
  void expect(const ScanInputOptions& options, ErrorCode code, const std::string& id,
              const std::vector<std::string>& words = {}) {
    expectError([&] { (void)ScanSequence::open(options); }, code, id, words);
  }
  void expectBytes(const std::string& name, const std::string& bytes, const std::string& id,
                   const std::vector<std::string>& words = {}) {
    expect({.scans = folder_.write(name, bytes)}, ErrorCode::Input, id, words);
  }
};

TEST_F(RecordingRefusals, NamesTheTopicsToChooseFrom) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(3, 20);
  const fs::path two = write("two.mcap", "second=/other");
  expect({.scans = two}, ErrorCode::Unusable, "recording.several_clouds",
         {"/points", "/other", "ScanInputOptions::topic"});
  EXPECT_EQ(ScanSequence::open({.scans = two, .topic = "/other"}).size(), 3U);
  expect({.scans = two, .topic = "/third"}, ErrorCode::Input, "recording.topic", {"/third", "/points", "/other"});
  expect({.scans = two, .topic = "/Odometry"}, ErrorCode::Input, "recording.topic", {"nav_msgs/Odometry", "/points"});
  expect({.scans = two, .topic = "/points", .pose_topic = "/points"}, ErrorCode::Input, "recording.topic",
         {"/Odometry"});
  expect({.scans = write("none.mcap", "clouds=none")}, ErrorCode::Unusable, "recording.no_clouds", {"/Odometry"});
  expect({.scans = write("json.mcap", "encoding=json")}, ErrorCode::Unusable, "recording.no_clouds", {"/points"});
  expect({.scans = write("unposed.mcap", "poses=none")}, ErrorCode::Unusable, "poses.none",
         {"ScanInputOptions::poses"});
}

TEST_F(RecordingRefusals, NamesFramesThatDoNotConnect) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(3, 20);
  const fs::path bag = write("frames.mcap", "frame=livox_frame");
  expect({.scans = bag}, ErrorCode::Unusable, "recording.frames", {"livox_frame", "camera_init -> body"});
  expect({.scans = write("a.mcap", ""), .fixed_frame = "map"}, ErrorCode::Unusable, "recording.frames", {"map"});
  expect({.scans = write("still.mcap", "poses=tf frame=camera_init")}, ErrorCode::Unusable, "poses.none",
         {"does not move"});
}

TEST_F(RecordingRefusals, SaysWhatIsWrongWithThePoses) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(6, 20);
  const fs::path back = write("back.mcap", "poses=back");
  expect({.scans = back}, ErrorCode::Unusable, "poses.reversed", {"sort_poses", "1 times"});
  EXPECT_GT(ScanSequence::open({.scans = back, .sort_poses = true}).size(), 2U);
  const fs::path poses = folder_.write("other.txt", "5 0 0 0 0 0 0 1\n5.1 0 0 0 0 0 0 1\n");
  expect({.scans = write("a.mcap", ""), .poses = poses}, ErrorCode::Unusable, "poses.no_overlap",
         {"1700000000.000", "5.000"});
}

TEST_F(RecordingRefusals, NamesTheMessageThatCannotBeRead) {
  ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(3, 20);
  expect({.scans = write("big.mcap", "layout=big")}, ErrorCode::Input, "recording.big_endian",
         {"/points", "message 1"});
  expect({.scans = write("short.mcap", "layout=short")}, ErrorCode::Input, "recording.message",
         {"239 bytes of data for 20 x 1 points of 12"});
  expect({.scans = write("other.mcap", "compression=other")}, ErrorCode::Input, "recording.compression", {"other"});
}

TEST_F(RecordingRefusals, IsForRecordingsOnly) {
  writeFlight(3, 20);
  const fs::path scans = folder_.path() / "scans", poses = folder_.path() / "poses.txt";
  expect({.scans = scans, .poses = poses, .topic = "/points"}, ErrorCode::Usage, "usage.recording",
         {"ScanInputOptions::topic"});
  const fs::path bag = folder_.write("a.mcap", kMcapMagic);
  expect({.scans = bag, .trajectory = poses}, ErrorCode::Usage, "usage.recording");
  expect({.scans = bag, .sensor_at_W = Eigen::Vector3d::Zero()}, ErrorCode::Usage, "usage.recording");
}

TEST_F(RecordingRefusals, OfWhatIsNoRecording) {
  expectBytes("a.mcap", "", "input.empty");
  expectBytes("a.mcap", "x", "recording.format");
  expectBytes("a.bag", kMcapMagic, "recording.format", {"#ROSBAG V2.0"});
  expectBytes("a.bag", "#ROSBAG V1.2\n", "recording.format", {"1.2", "rosbag fix"});
  expectBytes("a.db3", "SQLite format 4", "recording.format", {"not an SQLite database"});
  expectBytes("a.db3", std::string(5000, 'x'), "recording.format");
  expect({.scans = folder_.path() / "missing.mcap"}, ErrorCode::Input, "input.missing");
}

TEST_F(RecordingRefusals, OfChunksThatAreNotWhatTheyDeclare) {
  const std::string text(1000, 'a');
  expectBytes("a.mcap", kMcapMagic + mcapChunk("", text, (std::uint64_t{1} << 30) + 1), "recording.chunk",
              {"1073741825", "1 GiB"});
  expectBytes("a.mcap", kMcapMagic + mcapChunk("", text, 999), "recording.chunk", {"declares 999 bytes and has 1000"});
  expectBytes("a.mcap", kMcapMagic + mcapChunk("", text, 1000, 1), "recording.chunk", {"checksum"});
  expectBytes("a.mcap", kMcapMagic + mcapChunk("zstd", text, 5000), "recording.chunk", {"damaged"});
  expectBytes("a.mcap", kMcapMagic + mcapChunk("gzip", text, 5000), "recording.compression", {"gzip"});
  expectBytes("a.mcap", kMcapMagic + mcapRecord(6, "short"), "recording.damaged");
  expectBytes("a.mcap", kMcapMagic + std::string(20, '\0'), "recording.damaged", {"byte 8", "allow_truncated"});
  expectBytes("a.mcap", kMcapMagic + mcapMessage(7, text), "recording.damaged", {"channel 7"});
  // 100 bytes, each of a method: zeros of 1 MiB by zstd and bzip2 (written by their programs).
  for (const auto& [word, program] : {std::pair("zstd", "zstd -c"),
                                      {"zstd", "zstd --stream-size=1048576 -c"},
                                      {"lz4", "lz4 -c"},
                                      {"bz2", "bzip2 -c"}}) {
    if (!runs(std::string("command -v ") + std::string(program).substr(0, std::string(program).find(' ')))) continue;
    const fs::path packed = folder_.path() / "packed";
    ASSERT_EQ(
        std::system(("head -c 1048576 /dev/zero | " + std::string(program) + " > '" + packed.string() + "'").c_str()),
        0);
    std::ifstream in(packed, std::ios::binary);
    std::ostringstream bytes;
    bytes << in.rdbuf();
    for (const std::uint64_t declared : {std::uint64_t{1} << 20, (std::uint64_t{1} << 20) + 1,
                                         (std::uint64_t{1} << 20) - 1, std::uint64_t{1} << 30, std::uint64_t{0}}) {
      const bool right = declared == std::uint64_t{1} << 20;
      // The right size is unpacked; then its zeros are read as records, of which the last is cut.
      expectBytes("a.mcap", kMcapMagic + mcapChunk(word, bytes.str(), declared),
                  right ? "recording.damaged" : "recording.chunk");
    }
  }
}

}  // namespace
}  // namespace accessvdb::recordings_test
