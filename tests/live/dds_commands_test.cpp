// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Commands to a live map over Cyclone DDS: each is answered with its id, in time, also under load; what is none is
/// refused in words, and changes nothing.
#include <map>
#include <set>

#include "live/dds_world.h"
#include "runs/live_commands.h"

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
  const std::vector<std::string> round = {R"({"id":%d,"command":"save"})",
                                          R"({"id":%d,"command":"pause"})",
                                          R"({"id":%d,"command":"checkpoint"})",
                                          R"({"id":%d,"command":"checkpoint"})",
                                          R"({"id":%d,"command":"resume"})",
                                          R"({"id":%d,"command":"remove","box":[-100,-100,-100,-99,-99,-99]})",
                                          R"({"id":%d,"command":"fly"})",
                                          R"({"id":%d})",
                                          R"({"id":%d,"command":"remove","box":[0,0,0,1,1,"x"]})",
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
  const bool done[] = {true, true, true, true, true, false, false, false, false, true, true};
  double worst_ms = 0;
  for (const auto& [n, answer] : got) {
    const auto kind = static_cast<std::size_t>(n) % round.size();
    worst_ms = std::max(worst_ms, answer.ms);
    EXPECT_LT(answer.ms, 1000) << answer.said;
    EXPECT_EQ(answer.said["id"], n);
    EXPECT_FALSE(answer.said["words"].get<std::string>().empty());
    if (kind == 0 && n > 0) continue;  // after a reset there may be nothing to save yet
    if (kind == 9) continue;           // nor to remove
    EXPECT_EQ(answer.said["done"], done[kind]) << answer.said;
  }
  std::cout << "answers to " << lines.size() << " commands at 10 per second took at most " << worst_ms << " ms\n";
  EXPECT_NE(got.at(6).said["words"].get<std::string>().find("is not known; there are save,"), std::string::npos);
  EXPECT_NE(got.at(8).said["words"].get<std::string>().find("six numbers"), std::string::npos);
  EXPECT_NE(got.at(0).said["words"].get<std::string>().find(path("out")), std::string::npos) << got.at(0).said;
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
  EXPECT_NE(got.at(4).said["words"].get<std::string>().find("--checkpoint"), std::string::npos);
  EXPECT_NE(got.at(6).said["words"].get<std::string>().find("has no"), std::string::npos);
  EXPECT_GE(report_["live"]["lost"], 1) << "the long one is counted";
  EXPECT_LT(most_resident_KiB_, 700U * 1024);
  expectLabelsOfMap();
}

TEST(LiveCommands, AreBoundedAndReadStrictly) {
  tools::LiveCommands commands;
  for (int n = 0; n < 150; ++n) commands.receive(R"({"id":"a)" + std::to_string(n) + R"(","command":"pause"})");
  int waiting = 0;
  while (const auto command = commands.next()) EXPECT_EQ(command->id, "\"a" + std::to_string(waiting++) + "\"");
  EXPECT_EQ(waiting, 100);
  EXPECT_EQ(commands.report().refused, 50U);
  EXPECT_TRUE(commands.takeNews());
  EXPECT_FALSE(commands.takeNews());
  for (const char* bad :
       {"", "{", "null", R"({"command":"Save"})", R"({"command":"remove"})", R"({"command":"remove","box":[1,2,3]})",
        R"({"command":"remove","box":[0,0,0,1,1,1],"as":"gone"})", R"({"command":"remove","box":[0,0,0,1,1,null]})"}) {
    const auto refused = commands.report().refused;
    commands.receive(bad);
    EXPECT_FALSE(commands.next()) << bad;
    EXPECT_EQ(commands.report().refused, refused + 1) << bad;
    EXPECT_FALSE(commands.report().answers.back().done);
  }
  commands.receive(R"({"id":1.5,"command":"remove","box":[0,1,2,3,4,5],"as":"free"})");
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
}

}  // namespace
}  // namespace accessvdb::live_test
