// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What others may do to a live map on loopback: floods, crowds, senders that are killed inside a message, wrong types,
/// sizes at the limits, clocks that jump. The program lives, its memory is bounded, and every scan is accounted for.
///
/// ACCESSVDB_LIVE_SECONDS=60 makes floods and crowds of a minute.
#include <sys/stat.h>

#include <atomic>
#include <map>
#include <thread>

#include "live/dds_world.h"

namespace accessvdb::live_test {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000, kDay_ns = 86'400 * kSecond_ns;
/// A scan that waits takes 12 bytes per return, and 16 million returns may wait; a message comes in one of
/// 68 places, each of the size of --max-message (1 MB in these tests). The map of these scenes and the libraries take
/// the rest.
constexpr std::uint64_t kMostKiB = 16'000'000 / 1024 * 12 + 68 * 1024 + 200 * 1024;

int seconds(int otherwise) {
  const char* given = std::getenv("ACCESSVDB_LIVE_SECONDS");
  return given != nullptr ? std::atoi(given) : otherwise;
}

class HostileSenders : public LiveDds {
 protected:
  static void writeScan(std::ostream& out, std::int64_t stamp_ns, std::uint32_t points) {
    const auto write = [&](const auto& value) { out.write(reinterpret_cast<const char*>(&value), sizeof value); };
    write(stamp_ns);
    for (const double value : {0., 0., 0., 0., 0., 0., 1.}) write(value);
    write(points);
    std::vector<float> xyz;
    for (std::uint32_t n = 0; n < points; ++n) {
      const auto column = static_cast<float>(n % 60), row = static_cast<float>(n / 60 % 60);
      xyz.insert(xyz.end(), {2, 0.02F * column - 0.6F, 0.02F * row - 0.6F});
    }
    out.write(reinterpret_cast<const char*>(xyz.data()), static_cast<std::streamsize>(4 * xyz.size()));
  }
  /// The stream of the peer: a wall, one scan for each stamp.
  void writeStream(const std::vector<std::int64_t>& stamps_ns, const std::vector<std::uint32_t>& points) const {
    std::ofstream out(path("stream"), std::ios::binary);
    for (std::size_t n = 0; n < stamps_ns.size(); ++n) writeScan(out, stamps_ns[n], points[n % points.size()]);
  }
  void writePoseStamps(const std::vector<std::int64_t>& stamps_ns) const {
    std::ofstream(path("pose_stamps"), std::ios::binary)
        .write(reinterpret_cast<const char*>(stamps_ns.data()), static_cast<std::streamsize>(8 * stamps_ns.size()));
  }
  static std::vector<std::int64_t> steady(std::size_t count, std::int64_t from_ns = kFirst_ns) {
    std::vector<std::int64_t> stamps(count);
    for (std::size_t n = 0; n < count; ++n) stamps[n] = from_ns + static_cast<std::int64_t>(n) * 100'000'000;
    return stamps;
  }

  ProgramResult hostile(const std::vector<std::string>& peers, const std::string& max_message = "1M") {
    ProgramResult result = live(peers, {"--max-message", max_message, "--allow-hidden-tool"});
    EXPECT_EQ(result.signal, 0) << result.err;
    EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
    EXPECT_EQ(result.err.find("error["), std::string::npos) << result.err;
    EXPECT_LT(most_resident_KiB_, kMostKiB);
    EXPECT_GT(most_resident_KiB_, 0U);
    for (const std::string& name : listing("out")) EXPECT_NE(name.front(), '.') << "left " << name;
    EXPECT_FALSE(report_.is_null()) << result.err;
    if (!report_.is_null()) {
      expectAllAccountedFor(report_["live"]["published"]);
      expectLogSaysTheSame();
    }
    return result;
  }
  void expectLogSaysTheSame() const {
    std::map<std::string, std::uint64_t> lines;
    std::ifstream log(path("log"));
    for (std::string line; std::getline(log, line);) {
      std::istringstream words(line);
      std::string stamp, outcome;
      words >> stamp >> outcome;
      if (stamp != "#") ++lines[outcome];
    }
    for (const auto& [reason, count] : report_["live"]["dropped"].items()) EXPECT_EQ(lines[reason], count) << reason;
    EXPECT_EQ(lines["taken"] + lines["late"], report_["live"]["taken"]);
    EXPECT_EQ(lines["late"], report_["live"]["late"]);
  }
  /// How it goes, before all scans had come.
  static bool saysSomethingBefore(std::uint64_t last, const std::string& err) {
    for (std::size_t at = 0; (at = err.find(" scans taken, ", at)) != std::string::npos; ++at) {
      const std::size_t of = err.rfind(" of ", at);
      if (std::stoull(err.substr(of + 4, at - of - 4)) < last) return true;
    }
    return false;
  }
  std::uint64_t counted(const char* what) const { return report_["live"][what].get<std::uint64_t>(); }
  std::uint64_t dropped(const char* reason) const { return report_["live"]["dropped"][reason].get<std::uint64_t>(); }

  static std::string atOnce(const std::vector<std::string>& commands) {
    std::string all;
    for (const std::string& command : commands) all += "(" + command + ") & ";
    return all + "wait";
  }
  std::string crowd(int at_once, int for_s) const {
    return std::string(ACCESSVDB_CROWD_PEER) + " domain=" + own_domain_.number() +
           " at_once=" + std::to_string(at_once) + " seconds=" + std::to_string(for_s) + " >>'" + path("peers") +
           "' 2>&1";
  }
};

/// Scans come as fast as they can for so long, and are fused, or counted as dropped; status and words go on.
TEST_F(HostileSenders, AFloodIsFusedOrCountedAndTheStatusGoesOn) {
  for (const std::uint32_t points : {20000U, 0U}) {
    SCOPED_TRACE(points);
    const int for_s = seconds(points > 0 ? 7 : 2);
    fs::remove(path("stream"));
    ASSERT_EQ(mkfifo(path("stream").c_str(), 0600), 0);
    std::atomic<std::uint64_t> sent{0};
    std::thread sender([&] {
      std::ofstream out(path("stream"), std::ios::binary);
      const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(for_s);
      while (std::chrono::steady_clock::now() < end && out) {
        writeScan(out, kFirst_ns + static_cast<std::int64_t>(sent) * 1'000'000, points);
        ++sent;
      }
    });
    const ProgramResult result = hostile({peer("rate=0")});
    sender.join();
    expectPeersEndedWell();
    EXPECT_EQ(counted("published") + counted("lost"), sent);
    EXPECT_GT(counted("published"), 100U);
    if (for_s > 5) {
      EXPECT_TRUE(saysSomethingBefore(sent, result.err)) << result.err;
    }
    std::cout << sent << " scans of " << points << " returns in " << for_s << " s: " << report_["live"]["dropped"]
              << ", " << counted("taken") << " taken, " << counted("late") << " of them late; " << most_resident_KiB_
              << " KiB\n";
  }
}

TEST_F(HostileSenders, FiftyParticipantsComeAndGo) {
  writeStream(steady(20), {3000});
  const int for_s = seconds(5);
  const ProgramResult result = hostile({atOnce({crowd(50, for_s), "sleep 1; " + peer("rate=10")})});
  expectPeersEndedWell();
  EXPECT_EQ(counted("taken"), 20U) << result.err << readText("peers");
  EXPECT_EQ(counted("malformed"), 0U);
  EXPECT_EQ(readText("peers").find("nobody"), std::string::npos) << readText("peers");
  const std::string peers = readText("peers");
  EXPECT_GE(std::stol(peers.substr(peers.find("came ") + 5)), 50) << peers;
}

/// What they have begun to send holds places of messages until they are noticed to be gone.
TEST_F(HostileSenders, SendersThatAreKilledInsideAMessage) {
  writeStream(steady(10), {3000});
  for (const char* reliable : {"1", "0"}) {
    SCOPED_TRACE(reliable);
    std::vector<std::string> killed;
    for (int n = 0; n < 24; ++n)
      killed.push_back(garbage("bytes=900000 count=100000 reliable=" + std::string(reliable) +
                               " die_us=" + std::to_string(5000 + 900 * n)));
    const ProgramResult result = hostile({atOnce(killed), peer("rate=10")});
    EXPECT_EQ(peer_codes_.back(), 0) << readText("peers");
    EXPECT_EQ(counted("taken"), 10U) << result.err << readText("peers");
  }
}

/// The one who sends what is wanted is heard, whoever was found before.
TEST_F(HostileSenders, WrongTypesOnTheTopics) {
  writeStream(steady(10), {3000});
  const ProgramResult result = hostile({atOnce(
      {garbage("topic=cloud as=odom count=3000"), garbage("topic=odom as=cloud count=3000"), peer("rate=10")})});
  expectPeersEndedWell();
  EXPECT_EQ(counted("taken"), 10U) << result.err;
  EXPECT_EQ(counted("malformed"), 0U);
  EXPECT_NE(result.err.find("/livox/lidar is of type nav_msgs/Odometry, which is not read here"), std::string::npos)
      << result.err;
  EXPECT_NE(result.err.find("/Odometry is of type sensor_msgs/PointCloud2, which is not read here"), std::string::npos)
      << result.err;
}

/// Who takes over may send less reliably than who went.
TEST_F(HostileSenders, AnotherKindOfSenderTakesOver) {
  writeStream(steady(20), {3000});
  const ProgramResult result = hostile({peer("rate=10 count=10"), peer("rate=10 first=10 reliable=0")});
  expectPeersEndedWell();
  EXPECT_GE(counted("taken"), 15U) << result.err;
}

TEST_F(HostileSenders, SizesAtAndOverTheLimits) {
  // A cloud of n points takes 116 + 12 n bytes; a sender of larger ones loses them, and they are counted.
  writeStream(steady(9), {5997, 6000, 6001, 6002, 6000, 9000, 60, 0, 6000});
  for (const char* reliable : {"1", "0"}) {
    SCOPED_TRACE(reliable);
    const ProgramResult result = hostile({peer("rate=10 reliable=" + std::string(reliable))}, "72116");
    expectPeersEndedWell();
    EXPECT_EQ(counted("published") + counted("lost"), 9U) << report_["live"];
    if (*reliable == '1') {
      EXPECT_EQ(counted("taken"), 6U) << result.err;
    }
  }
  // If each is too large, none can be counted: the words say what to look at.
  writeStream(steady(12), {6001});
  const ProgramResult result = hostile({peer("rate=2")}, "72116");
  EXPECT_NE(result.err.find("nothing of /livox/lidar arrives: are its messages larger than --max-message 72116?"),
            std::string::npos)
      << result.err;
}

TEST_F(HostileSenders, StampsThatAreRepeatedOrGoBack) {
  std::vector<std::int64_t> stamps = steady(10);
  stamps.insert(stamps.begin() + 5, {stamps[4], stamps[4], stamps[2], stamps[4] - kDay_ns, 0, -5 * kSecond_ns, 7});
  writeStream(stamps, {3000});
  const ProgramResult result = hostile({peer("rate=20")});
  expectPeersEndedWell();
  EXPECT_EQ(counted("published"), 17U);
  EXPECT_EQ(counted("taken"), 10U) << result.err;
  EXPECT_EQ(dropped("unusable"), 2U);
  EXPECT_EQ(dropped("out_of_order"), 5U);
}

/// One scan from the future, where there are no poses, does not keep out those that follow.
TEST_F(HostileSenders, AScanFromTheFutureKeepsNobodyOut) {
  const std::vector<std::int64_t> poses = steady(12);
  std::vector<std::int64_t> scans = poses;
  scans[4] += 3 * kDay_ns;
  scans[7] += 11 * kSecond_ns;
  writeStream(scans, {3000});
  writePoseStamps(poses);
  const ProgramResult result = hostile({peer("rate=20 pose_stamps='" + path("pose_stamps") + "'")});
  expectPeersEndedWell();
  EXPECT_EQ(counted("taken"), 10U) << result.err;
  EXPECT_EQ(dropped("out_of_order"), 2U);
}

/// The clock of both jumps: forwards everything goes on; back, nothing does, and a warning says so.
TEST_F(HostileSenders, ClocksThatJump) {
  const std::int64_t last_ns = steady(10).back();
  for (const std::int64_t jump_ns : {kSecond_ns, 3600 * kSecond_ns, 5 * kDay_ns}) {
    SCOPED_TRACE(jump_ns);
    std::vector<std::int64_t> stamps = steady(10), after = steady(10, last_ns + jump_ns);
    stamps.insert(stamps.end(), after.begin(), after.end());
    writeStream(stamps, {3000});
    hostile({peer("rate=20")});
    expectPeersEndedWell();
    EXPECT_EQ(counted("taken"), 20U) << report_["live"];
  }
  std::vector<std::int64_t> stamps = steady(10), after = steady(30, kFirst_ns - 5 * kDay_ns);
  stamps.insert(stamps.end(), after.begin(), after.end());
  writeStream(stamps, {3000});
  const ProgramResult result = hostile({peer("rate=20")});
  EXPECT_EQ(counted("taken"), 10U);
  EXPECT_EQ(dropped("out_of_order"), 30U);
  EXPECT_NE(result.err.find("warning[live.clock]"), std::string::npos) << result.err;
}

/// That of the poses alone jumps, and back again.
TEST_F(HostileSenders, PosesWhoseClockJumps) {
  std::vector<std::int64_t> scans = steady(60), poses = scans;
  for (std::size_t n = 20; n < 50; ++n) poses[n] += 2 * kDay_ns;
  writeStream(scans, {500});
  writePoseStamps(poses);
  const ProgramResult result = hostile({peer("rate=20 pose_stamps='" + path("pose_stamps") + "'")});
  expectPeersEndedWell();
  EXPECT_EQ(counted("taken"), 30U) << result.err;
  EXPECT_EQ(dropped("no_pose"), 30U);
  EXPECT_NE(result.err.find("warning[live.no_pose]"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace accessvdb::live_test
