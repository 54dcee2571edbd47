// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A recording that is replayed through DDS gives the labels that map gives on the recording itself: times of points,
/// frames, poses and the messages' bytes mean the same in both.
#include <sys/wait.h>

#include "live/dds_world.h"
#include "recordings/writers.h"

namespace accessvdb::live_test {
namespace {

class LiveReplay : public LiveDds {
 protected:
  static constexpr int kScans = 8;

  /// A flight around a box, with the times of its points, and poses every 5 ms.
  void fly() {
    const ProgramResult result =
        runLab({"simulate", "--scene", "box", "--moving", "--frames", std::to_string(kScans), "--out", path("flight")});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    std::string times;
    for (int n = 0; n < kScans; ++n) times += std::to_string(0.1 * n) + "\n";
    writeText("flight/times.txt", times);
  }
  /// @param options  of the writer
  void expectLabelsOfMap(const std::string& options, const std::string& cloud, std::uint64_t by_times) {
    SCOPED_TRACE(options);
    const std::string recording = path("flight.mcap");
    fs::remove(recording);
    recordings_test::writeRecording(path("flight"), recording, options);
    peer_codes_.clear();
    cloud_topic_ = cloud;
    const ProgramResult heard = live({std::string(ACCESSVDB_LIVE_REPLAY) + " '" + recording + "' --domain " +
                                      own_domain_.number() + " --rate 0.2 >>'" + path("peers") + "' 2>&1"},
                                     {});
    EXPECT_EQ(heard.exit_code, 128 + SIGINT) << heard.err;
    expectPeersEndedWell();
    std::vector<std::string> arguments = {"map",     "--scans", recording,        "--out", path("expected"),
                                          "--tiles", "off",     "--update-every", "1"};
    for (const std::string& flag : fieldFlags()) arguments.push_back(flag);
    for (const char* flag : {"--change", "full", "--free-for", "60"}) arguments.emplace_back(flag);
    const ProgramResult mapped = runProgram(arguments);
    ASSERT_EQ(mapped.exit_code, 0) << mapped.err;
    EXPECT_EQ(report_["live"]["taken"], kScans) << report_["live"] << heard.err << mapped.err;
    EXPECT_EQ(report_["live"]["by_times"], by_times);
    EXPECT_EQ(report_["live"]["malformed"], 0);
    EXPECT_GT(report_["counts"]["accessible"], 20) << heard.err;
    EXPECT_TRUE(readText("out/points.ply") == readText("expected/points.ply") || report_["live"]["late"] > 0)
        << heard.err << mapped.err;
    const FieldSnapshot got = io::readPointsPly(path("out/points.ply")),
                        expected = io::readPointsPly(path("expected/points.ply"));
    ASSERT_EQ(got.points.size(), expected.points.size());
    for (std::size_t n = 0; n < got.points.size(); ++n) {
      ASSERT_EQ(got.points[n].position_W, expected.points[n].position_W) << n;
      ASSERT_EQ(got.points[n].label, expected.points[n].label) << n;
    }
  }
};

TEST_F(LiveReplay, HasTheLabelsOfMapOnTheRecording) {
  ACCESSVDB_NEED_ROS2_WRITER();
  fly();
  // Poses end with the last scan, or in it: it is used as it is then, by both.
  expectLabelsOfMap("clouds=livox", "/livox/lidar", kScans);
  expectLabelsOfMap("times=t", "/points", kScans);
  expectLabelsOfMap("clouds=world times=t", "/cloud_registered", kScans);
}

TEST_F(LiveReplay, SaysWhatItCannotDo) {
  const auto codeOf = [&](const std::string& arguments) {
    const int status =
        std::system((std::string(ACCESSVDB_LIVE_REPLAY) + " " + arguments + " >'" + path("said") + "' 2>&1").c_str());
    return WEXITSTATUS(status);
  };
  EXPECT_EQ(codeOf(""), 2);
  EXPECT_EQ(codeOf("a.mcap --rate x"), 2);
  EXPECT_EQ(codeOf("a.mcap --domain 233"), 2);
  EXPECT_EQ(codeOf("'" + path("nowhere.mcap") + "'"), 3);
  EXPECT_NE(readText("said").find("error["), std::string::npos) << readText("said");
}

}  // namespace
}  // namespace accessvdb::live_test
