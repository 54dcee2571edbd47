// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Commands to a live map over Cyclone DDS: each is answered with its id, in time, also under load; what is none is
/// refused in words, and changes nothing.
#include <map>
#include <set>

#include "live/dds_world.h"
#include "runs/checkpoint.h"
#include "runs/live_commands.h"
#include "runs/live_words.h"
#include "support/determinism_support.h"

namespace accessvdb::live_test {
namespace {

struct Answer {
  double ms = 0;
  json said;
};

class LiveCommandsDds : public LiveDds {
 protected:
  /// One line each; "%d" becomes its number.
  std::string commands(const std::vector<std::string>& lines, const std::string& more = "") const {
    std::string text;
    for (const std::string& line : lines) text += line + "\n";
    writeText("commands", text);
    return std::string(ACCESSVDB_COMMAND_PEER) + " domain=" + own_domain_.number() + " commands='" + path("commands") +
           "' answers='" + path("answers") + "' " + more + " >>'" + path("peers") + "' 2>&1";
  }
  std::map<int, Answer> answers() const {
    std::map<int, Answer> all;
    std::istringstream lines(readText("answers"));
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      int n = 0;
      Answer answer;
      words >> n >> answer.ms;
      answer.said = json::parse(line.substr(line.find('{')));
      all[n] = answer;
    }
    return all;
  }
};

TEST_F(LiveCommandsDds, EachIsAnsweredInTimeUnderLoad) {
  simulate(scanCount(80));
  // What takes long comes after the pause: else it and resume may be read at once, with no scan between them.
  const std::vector<std::string> round = {R"({"id":%d,"command":"pause"})",
                                          R"({"id":%d,"command":"remove","box":[-100,-100,-100,-99,-99,-99]})",
                                          R"({"id":%d,"command":"fly"})",
                                          R"({"id":%d})",
                                          R"({"id":%d,"command":"remove","box":[0,0,0,1,1,"x"]})",
                                          R"({"id":%d,"command":"resume"})",
                                          R"({"id":%d,"command":"save"})",
                                          R"({"id":%d,"command":"checkpoint"})",
                                          R"({"id":%d,"command":"checkpoint"})",
                                          R"({"id":%d,"command":"remove","box":[-1,-1,1,1,1,2],"as":"free"})",
                                          R"({"id":%d,"command":"reset"})"};
  std::vector<std::string> lines;
  for (int n = 0; n < 4; ++n) lines.insert(lines.end(), round.begin(), round.end());
  const ProgramResult result =
      live({"(" + commands(lines, "rate=10 pause_s=1.5") + ") & " + peer("rate=10") + "; wait"},
           {"--checkpoint", path("checkpoint")});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  expectPeersEndedWell();
  expectAllAccountedFor(sent_.size());
  const std::map<int, Answer> got = answers();
  ASSERT_EQ(got.size(), lines.size()) << readText("peers");
  const bool done[] = {true, false, false, false, false, true, true, true, true, true, true};
  double worst_ms = 0;
  for (const auto& [n, answer] : got) {
    const auto kind = static_cast<std::size_t>(n) % round.size();
    worst_ms = std::max(worst_ms, answer.ms);
    EXPECT_LT(answer.ms, 1000) << answer.said;
    EXPECT_EQ(answer.said["id"], n);
    EXPECT_FALSE(answer.said["words"].get<std::string>().empty());
    if (kind >= 6 && kind <= 8 && n > 10) continue;  // after a reset there may be nothing to save yet
    if (kind == 9) continue;                         // nor to remove
    EXPECT_EQ(answer.said["done"], done[kind]) << answer.said;
  }
  std::cout << "answers to " << lines.size() << " commands at 10 per second took at most " << worst_ms << " ms\n";
  EXPECT_NE(got.at(2).said["words"].get<std::string>().find("is not known; there are save,"), std::string::npos);
  EXPECT_NE(got.at(4).said["words"].get<std::string>().find("six numbers"), std::string::npos);
  EXPECT_NE(got.at(6).said["words"].get<std::string>().find(path("out")), std::string::npos) << got.at(6).said;
  EXPECT_EQ(report_["live"]["commands"]["received"], lines.size());
  EXPECT_EQ(report_["live"]["commands"]["done"].get<std::size_t>() +
                report_["live"]["commands"]["refused"].get<std::size_t>(),
            lines.size());
  EXPECT_EQ(report_["live"]["answers"].size(), 32U) << "memory is bounded";
  EXPECT_EQ(report_["live"]["resets"], 4);
  EXPECT_GT(report_["live"]["dropped"]["paused"], 0);
  std::set<std::string> outputs;
  for (const auto& output : report_["outputs"])
    EXPECT_TRUE(outputs.insert(output["path"].get<std::string>()).second) << "listed twice: " << output;
  // What was saved and left is read back.
  EXPECT_TRUE(fs::exists(path("checkpoint/state.json")));
  const ProgramResult cut = runProgram({"whatif", path("checkpoint"), "--tool", "builtin:pruner", "--remove",
                                        "box:-9,-9,-9,9,9,9", "--out", path("cut"), "--device", "cpu"});
  EXPECT_EQ(cut.exit_code, 0) << cut.err;
}

TEST_F(LiveCommandsDds, WhatIsNoneIsRefusedAndChangesNothing) {
  simulate(10);
  const std::string long_one = R"({"id":%d,"command":"reset","pad":")" + std::string(1'000'000, 'x') + "\"}";
  const std::vector<std::string> lines = {"no JSON",
                                          "[[[[[[",
                                          "7",
                                          long_one,
                                          R"({"id":%d,"command":"checkpoint"})",
                                          R"({"id":{"a":1},"command":"jump"})",
                                          R"({"id":%d,"command":7})"};
  const ProgramResult result = live({"(" + commands(lines, "rate=10") + ") & (" + garbage("topic=command count=100") +
                                     ") & " + peer("rate=5") + "; wait"});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  EXPECT_EQ(report_["live"]["taken"], 10) << report_["live"];
  EXPECT_EQ(report_["live"]["resets"], 0);
  EXPECT_EQ(report_["live"]["commands"]["done"], 0);
  const std::map<int, Answer> got = answers();
  ASSERT_EQ(got.size(), 2U) << "the long one is not accepted, and the others have no id";
  EXPECT_EQ(got.at(4).said["words"], "cannot be done: the program was started without --checkpoint");
  EXPECT_NE(got.at(6).said["words"].get<std::string>().find("has no"), std::string::npos);
  EXPECT_GE(report_["live"]["lost"], 1) << "the long one is counted";
  EXPECT_LT(most_resident_KiB_, 700U * 1024);
  expectLabelsOfMap();
}

/// Asked for, the best approaches come as poses; those of the state that is left at the same moment.
TEST_F(LiveCommandsDds, ApproachesComeAsPoses) {
  simulate(20);
  const std::vector<std::string> lines = {
      R"({"id":%d,"command":"approaches","most":0})", R"({"id":%d,"command":"approaches","from":[1,2]})",
      R"({"id":%d,"command":"approaches","within":5})",
      R"({"id":%d,"command":"approaches","most":4,"allow_unknown":true})", R"({"id":%d,"command":"checkpoint"})"};
  const ProgramResult result = live(
      {"(" + commands(lines, "rate=2 pause_s=6 poses='" + path("poses") + "'") + ") & " + peer("rate=10") + "; wait"},
      {"--checkpoint", path("checkpoint"), "--clear-rays", "20", "--platform-radius", "0.4"});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  const std::map<int, Answer> got = answers();
  ASSERT_EQ(got.size(), lines.size()) << readText("peers");
  for (const int refused : {0, 1, 2}) EXPECT_FALSE(got.at(refused).said["done"].get<bool>()) << refused;
  EXPECT_TRUE(got.at(3).said["done"].get<bool>()) << got.at(3).said;
  const ProgramResult again = runProgram({"approaches", "--map", path("checkpoint"), "--tool", "builtin:pruner",
                                          "--most", "4", "--allow-unknown", "--device", "cpu", "--json"});
  ASSERT_EQ(again.exit_code, 0) << again.err;
  const json found = json::parse(again.out);
  std::istringstream poses(readText("poses"));
  std::string frame, stamp;
  poses >> frame >> stamp;
  EXPECT_FALSE(frame.empty());
  ASSERT_GT(found["targets"].size(), 0U) << again.out;
  for (const json& target : found["targets"]) {
    const json& contact = target["approaches"][0]["contact"];
    double p[3], q[4];
    for (double& number : p) ASSERT_TRUE(poses >> number);
    for (double& number : q) ASSERT_TRUE(poses >> number);
    for (std::size_t axis = 0; axis < 3; ++axis) EXPECT_NEAR(p[axis], contact["position"][axis].get<double>(), 1e-9);
    double dot = 0;
    for (std::size_t n = 0; n < 4; ++n) dot += q[n] * contact["orientation_wxyz"][(n + 1) % 4].get<double>();
    EXPECT_NEAR(std::abs(dot), 1, 1e-9);
  }
  std::string more;
  EXPECT_FALSE(poses >> more);
}

/// The same of views: those of the state that is left at the same moment.
TEST_F(LiveCommandsDds, ViewsComeAsPoses) {
  simulate(20);
  const std::vector<std::string> lines = {R"({"id":%d,"command":"views","most":0})",
                                          R"({"id":%d,"command":"views","allow_unknown":true})",
                                          R"({"id":%d,"command":"views","body":-1})",
                                          R"({"id":%d,"command":"views","body":50})",
                                          R"({"id":%d,"command":"views","most":3,"body":0.3})",
                                          R"({"id":%d,"command":"checkpoint"})"};
  const ProgramResult result =
      live({"(" + commands(lines, "rate=2 pause_s=6 poses_of=views poses='" + path("poses") + "'") + ") & " +
            peer("rate=10") + "; wait"},
           {"--checkpoint", path("checkpoint"), "--clear-rays", "20", "--platform-radius", "0.4"});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  const std::map<int, Answer> got = answers();
  ASSERT_EQ(got.size(), lines.size()) << readText("peers");
  for (const int refused : {0, 1, 2, 3}) EXPECT_FALSE(got.at(refused).said["done"].get<bool>()) << refused;
  EXPECT_TRUE(got.at(4).said["done"].get<bool>()) << got.at(4).said;
  const ProgramResult again = runProgram({"views", "--map", path("checkpoint"), "--tool", "builtin:pruner", "--most",
                                          "3", "--body", "0.3", "--device", "cpu", "--json"});
  ASSERT_EQ(again.exit_code, 0) << again.err;
  const json found = json::parse(again.out);
  std::istringstream poses(readText("poses"));
  std::string frame, stamp;
  poses >> frame >> stamp;
  ASSERT_GT(found["views"].size(), 0U) << again.out;
  for (const json& view : found["views"]) {
    double numbers[7];
    for (double& number : numbers) ASSERT_TRUE(poses >> number);
    for (std::size_t axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(numbers[axis], view["pose"]["position"][axis].get<double>(), 1e-9);
  }
  std::string more;
  EXPECT_FALSE(poses >> more);
}

/// Refused before the domain is joined.
TEST_F(LiveCommandsDds, AFileOfOthersInThePlaceOfAnyOutputIsKept) {
  fs::create_directories(path("out"));
  for (const char* file : {"points.las", "points.ply"}) {
    writeText(std::string("out/") + file, "not ours");
    for (const bool no_clobber : {true, false}) {
      std::vector<std::string> arguments = {
          "live", "--cloud", "/cloud",   "--odom", "/odom", "--domain", own_domain_.number(), "--points-format",
          "las",  "--out",   path("out")};
      for (const std::string& flag : fieldFlags()) arguments.push_back(flag);
      if (no_clobber) arguments.emplace_back("--no-clobber");
      const ProgramResult result = runProgram(arguments);
      EXPECT_EQ(result.exit_code, 7) << result.err;
      EXPECT_NE(result.err.find(no_clobber ? "output.exists" : "output.foreign"), std::string::npos) << result.err;
      EXPECT_EQ(readText(std::string("out/") + file), "not ours");
    }
    fs::remove(path("out/" + std::string(file)));
  }
}

/// As the state says by its name, which is another one each time.
TEST_F(LiveCommandsDds, CheckpointsAndReportsAreOfTheMapAsItIs) {
  simulate(5);
  const std::string early = commands({R"({"id":%d,"command":"checkpoint"})"}, "rate=10 wait_s=1"),
                    late = commands({R"({"id":%d,"command":"checkpoint"})"}, "rate=10 wait_s=4");
  writeText("later", R"({"command":"pause"}
{"id":%d,"command":"checkpoint"}
{"id":%d,"command":"checkpoint"}
{"id":%d,"command":"save"}
{"id":%d,"command":"reset"}
)");
  const ProgramResult result = live(
      {early,
       "cp '" + path("answers") + "' '" + path("early") + "'; cp '" + path("later") + "' '" + path("commands") + "'",
       peer("rate=10"), late},
      {"--checkpoint", path("checkpoint")});
  EXPECT_EQ(result.exit_code, 128 + SIGINT) << result.err;
  EXPECT_NE(readText("early").find("cannot be done: there is no scan in the map"), std::string::npos)
      << readText("early");
  EXPECT_NE(readText("early").find("\"done\":false"), std::string::npos) << readText("early");
  const std::map<int, Answer> got = answers();
  for (int n = 1; n < 5; ++n) {
    ASSERT_TRUE(got.contains(n)) << readText("peers");
    EXPECT_EQ(got.at(n).said["done"], true) << got.at(n).said;
  }
  EXPECT_TRUE(fs::exists(path("checkpoint/state-2.avst"))) << "both are written";
  // The map that was saved is not that of the end.
  EXPECT_TRUE(fs::exists(path("out/points.ply")));
  EXPECT_EQ(report_["live"]["taken"], 5);
  EXPECT_TRUE(report_["outputs"].empty()) << report_["outputs"];
  EXPECT_EQ(report_["counts"]["surface_points"], 0) << report_["counts"];
  EXPECT_EQ(report_["counts"]["scans"], 0) << report_["counts"];
  EXPECT_EQ(report_["counts"]["accessible"], 0) << report_["counts"];
}

TEST_F(LiveCommandsDds, TheHelpNamesThem) {
  const ProgramResult help = runProgram({"live", "--help"});
  EXPECT_EQ(help.exit_code, 0);
  for (const char* word : {"/accessvdb/command", "save", "checkpoint", "reset", "remove", "pause", "resume"})
    EXPECT_NE(help.out.find(word), std::string::npos) << word;
}

TEST(LiveWords, SayWhatScansWaitFor) {
  tools::LiveRunOptions options;
  options.cloud = "/cloud";
  options.odom = "/odom";
  options.imu = "/imu";
  tools::Messages messages(tools::ErrorFormat::Text, true);
  const tools::LiveWords words(options, messages);
  tools::LiveInputs inputs;
  for (dds::TopicState& state : inputs) state.senders = 1;
  LiveStatus status;
  const auto says = [&](const std::string& text) {
    return words.progressInWords(status, inputs).find(text) != std::string::npos;
  };
  EXPECT_FALSE(says("/imu"));
  status.waits_for_level = true;
  EXPECT_TRUE(says("scans wait until /imu says what is level"));
  EXPECT_FALSE(says("nobody publishes"));
  inputs[static_cast<std::size_t>(dds::Input::Imu)].senders = 0;
  EXPECT_TRUE(says("nobody publishes /imu"));
}

/// A sender that is faster than the map does not get all of its turns.
TEST(LiveCommands, ThatGoOnArrivingWaitForTheNextTurn) {
  tools::LiveCommands commands;
  const auto receive = [&] { commands.receive(R"({"command":"pause"})"); };
  receive();
  commands.beginTurn();
  std::size_t carried_out = 0;
  for (; carried_out < 1000 && commands.next(); ++carried_out) receive();
  EXPECT_EQ(carried_out, 1U);
  for (int n = 0; n < 50; ++n) receive();
  commands.beginTurn();
  for (carried_out = 0; carried_out < 1000 && commands.next(); ++carried_out) receive();
  EXPECT_EQ(carried_out, tools::LiveCommands::kMostOfTurn);
}

TEST_F(LiveCommandsDds, ACheckpointThatFailsIsWarnedOfOnce) {
  tools::MapOptions options;
  options.checkpoint = path("folder");
  tools::Messages messages(tools::ErrorFormat::Text, true);
  tools::Checkpoints checkpoints(options, messages);
  checkpoints.prepare();
  FieldParams params;
  params.backend = BackendKind::Cpu;
  params.tsdf.voxel_size_m = 0.1;
  AccessibilityField field(test::armTool(), params);
  field.integrateScan(std::vector<Eigen::Vector3f>{{2, 0, 0}}, Eigen::Isometry3d::Identity());
  static_cast<void>(field.update());
  tools::RunProgress progress;
  EXPECT_FALSE(checkpoints.write(field, progress)) << "of no scan";
  fs::remove_all(path("folder"));
  writeText("folder", "in its place");
  for (progress.next_step = 1; progress.next_step < 20; ++progress.next_step)
    EXPECT_FALSE(checkpoints.write(field, progress));
  EXPECT_EQ(messages.warnings().size(), 1U);
}

TEST(LiveCommands, AreBoundedAndReadStrictly) {
  tools::LiveCommands commands;
  for (int n = 0; n < 150; ++n) commands.receive(R"({"id":"a)" + std::to_string(n) + R"(","command":"pause"})");
  EXPECT_FALSE(commands.next()) << "no turn has begun";
  int waiting = 0;
  for (int turn = 0; turn < 20; ++turn) {
    commands.beginTurn();
    while (const auto command = commands.next()) EXPECT_EQ(command->id, "\"a" + std::to_string(waiting++) + "\"");
  }
  EXPECT_EQ(waiting, 100);
  EXPECT_EQ(commands.report().refused, 50U);
  EXPECT_TRUE(commands.hasNews());
  std::set<std::string> published;
  for (const tools::LiveCommandReport& page : commands.takePages()) {
    EXPECT_LE(page.answers.size(), 32U);
    for (const tools::LiveAnswer& answer : page.answers) published.insert(answer.id);
  }
  EXPECT_EQ(published.size(), 50U) << "each was in one";
  EXPECT_FALSE(commands.hasNews());
  ASSERT_EQ(commands.takePages().size(), 1U);
  EXPECT_EQ(commands.takePages()[0].answers.back().id, "\"a149\"") << "whoever comes later sees the latest";
  for (const char* bad :
       {"", "{", "null", R"({"command":"Save"})", R"({"command":"remove"})", R"({"command":"remove","box":[1,2,3]})",
        R"({"command":"remove","box":[0,0,0,1,1,1],"as":"gone"})", R"({"command":"remove","box":[0,0,0,1,1,null]})"}) {
    const auto refused = commands.report().refused;
    commands.receive(bad);
    commands.beginTurn();
    EXPECT_FALSE(commands.next()) << bad;
    EXPECT_EQ(commands.report().refused, refused + 1) << bad;
    EXPECT_FALSE(commands.report().answers.back().done);
  }
  commands.receive(R"({"command":"remove","box":[0,0,0,1,1,1e999]})");
  EXPECT_EQ(commands.report().answers.back().words, "has a number that does not fit");
  commands.receive("[1]");
  EXPECT_EQ(commands.report().answers.back().words, "is no JSON object");
  commands.receive(R"({"id":1.5,"command":"remove","box":[0,1,2,3,4,5],"as":"free"})");
  commands.beginTurn();
  const auto command = commands.next();
  ASSERT_TRUE(command);
  EXPECT_EQ(command->id, "1.5");
  EXPECT_EQ(command->min_W, Eigen::Vector3d(0, 1, 2));
  EXPECT_EQ(command->max_W, Eigen::Vector3d(3, 4, 5));
  EXPECT_EQ(command->removed_as, RemovedAs::Free);
  // Ids that are large or no scalar are none; words are printable.
  commands.receive(R"({"id":")" + std::string(1000, 'i') + R"(","command":"x\u0007y"})");
  EXPECT_EQ(commands.report().answers.back().id, "null");
  EXPECT_EQ(commands.report().answers.back().command.find('\a'), std::string::npos);
  commands.receive(std::string(100'000, '['));
  EXPECT_LE(commands.report().answers.size(), 32U);
  // What is not published is kept, to a limit; beyond, it is said how many had no answer.
  static_cast<void>(commands.takePages());
  for (int n = 0; n < 1000; ++n)
    commands.receive(R"({"id":)" + std::to_string(n) + R"(,"command":")" + std::string(500, '\\') + "\"}");
  published.clear();
  const std::vector<tools::LiveCommandReport> pages = commands.takePages();
  for (const tools::LiveCommandReport& page : pages) {
    for (const tools::LiveAnswer& answer : page.answers) published.insert(answer.id);
    tools::LiveReport report;
    report.commands = page;
    EXPECT_LT(tools::liveJson(report).size(), std::size_t{60} << 10);
  }
  for (int n = 0; n < 200; ++n) EXPECT_TRUE(published.contains(std::to_string(n))) << n;
  EXPECT_EQ(pages.back().unanswered, 800U);
  EXPECT_LE(pages.size(), 7U);
}

}  // namespace
}  // namespace accessvdb::live_test
