// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The output of a run: files, report, what the other verbs print about it, and what remains after a signal.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "checkpoint_world.h"
#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

using nlohmann::json;

const std::vector<std::string> kOutputs = {"field.vdb", "field_points.vdb", "points.ply", "preview.png", "report.json"};

class MapOutputs : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
  }
  json report() const { return json::parse(readText("out/report.json")); }

  /// Enough scans of one large file that a signal arrives in the middle.
  void writeLongRun() {
    writeWallScans(1, 160);
    const std::filesystem::path first = folder_ / "scans" / "000100.000000.pcd";
    for (int scan = 1; scan < 600; ++scan) {
      char name[64];
      std::snprintf(name, sizeof name, "%06d.000000.pcd", 100 + scan);
      const std::filesystem::path copy = folder_ / "scans" / name;
      std::filesystem::remove(copy);
      std::filesystem::create_hard_link(first, copy);
    }
    writePoses(600);
  }
  /// The signals arrive together, in the middle of fusing.
  ProgramResult runWithSignals(std::vector<int> signals, int after_ms = 300) {
    ProgramSetup setup;
    setup.arguments = mapArguments();
    setup.signal_after = "predicted peak memory";
    setup.act = [signals, after_ms](pid_t process) {
      usleep(static_cast<useconds_t>(after_ms) * 1000);
      kill(process, SIGSTOP);
      for (const int number : signals) kill(process, number);
      kill(process, SIGCONT);
    };
    return runProgram(setup);
  }
};

/// Scans that do not agree: --fresh deletes nothing for them.
TEST_F(MapOutputs, OfARunThatIsRefusedAreNotDeleted) {
  std::filesystem::remove_all(folder_ / "scans");
  writeScansOf({}, folder_ / "scans", 0, 20);
  writePoses(20);
  ASSERT_EQ(runProgram(mapArguments({"--tiles", "12.8", "--allow-disagreement"})).exit_code, 0);
  const std::string plan = readText("out/plan.json");
  const ProgramResult refused = runProgram(mapArguments({"--tiles", "12.8", "--fresh"}));
  EXPECT_EQ(refused.exit_code, 4) << refused.err;
  EXPECT_NE(refused.err.find("poses.disagree"), std::string::npos) << refused.err;
  EXPECT_EQ(readText("out/plan.json"), plan);
  const ProgramResult planned =
      runProgram({"tile", "plan", path("out"), "--scans", path("scans"), "--poses", path("poses.txt"), "--tool",
                  "builtin:pruner", "--voxel", "0.05", "--device", "cpu", "--fresh"});
  EXPECT_EQ(planned.exit_code, 4) << planned.err;
  EXPECT_NE(planned.err.find("poses.disagree"), std::string::npos) << planned.err;
  EXPECT_EQ(readText("out/plan.json"), plan);
}

/// A tool that is thinner than a voxel, and too little memory: the same.
TEST_F(MapOutputs, OfARunThatIsRefusedLateAreNotDeleted) {
  ASSERT_EQ(runProgram(mapArguments({"--tiles", "12.8"})).exit_code, 0);
  const std::string plan = readText("out/plan.json");
  const std::vector<std::string> inputs = {"--scans", path("scans"), "--poses", path("poses.txt"), "--voxel",
                                           "0.05",    "--device",    "cpu",     "--fresh"};
  const auto refused = [&](std::vector<std::string> command, const std::vector<std::string>& more) {
    command.insert(command.end(), inputs.begin(), inputs.end());
    command.insert(command.end(), more.begin(), more.end());
    const ProgramResult result = runProgram(command);
    EXPECT_NE(result.exit_code, 0);
    EXPECT_EQ(readText("out/plan.json"), plan) << result.err;
    return result.err;
  };
  const std::vector<std::string> map = {"map", "--out", path("out")}, tile = {"tile", "plan", path("out")},
                                 thin = {"--tool", "builtin:pencil"};
  for (const std::vector<std::string>& command : {map, tile}) {
    for (const std::string tiles : {"off", "12.8"}) {
      if (command == tile && tiles == "off") continue;
      std::vector<std::string> with = thin;
      with.insert(with.end(), {"--tiles", tiles});
      EXPECT_NE(refused(command, with).find("error[tool.hidden]"), std::string::npos);
    }
  }
  EXPECT_NE(
      refused(map, {"--tool", "builtin:pruner", "--tiles", "off", "--max-memory", "1M"}).find("error[limit.memory]"),
      std::string::npos);
}

TEST_F(MapOutputs, OfOrientationsSayHowTheToolIsHeld) {
  const ProgramResult result = runProgram(mapArguments({"--orientations", "sphere:30"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(report().at("parameters").at("orientations"), "sphere:30");
  const std::string ply = readText("out/points.ply");
  EXPECT_NE(ply.find("\ncomment orientations sphere:30\n"), std::string::npos);
  EXPECT_NE(ply.find("\nproperty float yaw\nproperty float qw\nproperty float qx\nproperty float qy\n"
                     "property float qz\nproperty ushort orientation\nproperty float access_probability\nend_header\n"),
            std::string::npos);
  // A list with a twin: a notice, and the one orientation that it has. Everything that has a direction has this one.
  writeText("list.txt", "yaw pitch roll\n180 30 90\n180 30 90\n");
  const ProgramResult listed = runProgram(mapArguments({"--orientations", "list:" + path("list.txt")}));
  ASSERT_EQ(listed.exit_code, 0) << listed.err;
  EXPECT_NE(listed.err.find("1 is in the list already"), std::string::npos) << listed.err;
  const ProgramResult query = runProgram({"query", "--map", path("out"), "--at", "2,0.1,0", "--json"});
  ASSERT_EQ(query.exit_code, 0) << query.err;
  const json point = json::parse(query.out).at(0).at("point");
  EXPECT_NEAR(point.at("pitch_deg").get<double>(), 30, 1e-4);
  EXPECT_NEAR(point.at("yaw_deg").get<double>(), 180, 1e-4);
  // Rz(180) Ry(-30) Rx(90) as a product of quaternions, up to its sign.
  const double c15 = std::cos(0.2617993877991494), s15 = std::sin(0.2617993877991494), half = std::sqrt(0.5);
  const std::array<double, 4> expected = {half * s15, half * s15, half * c15, half * c15};
  for (std::size_t n = 0; n < 4; ++n) {
    EXPECT_NEAR(std::abs(point.at("orientation").at(n).get<double>()), expected[n], 1e-6) << query.out;
  }
  const ProgramResult config = runProgram(mapArguments({"--print-config", "--orientations", "sphere:15"}));
  EXPECT_NE(config.out.find("orientations = 'sphere:15'"), std::string::npos) << config.out;
}

TEST_F(MapOutputs, OfRollsNameThem) {
  const std::vector<std::string> rolling = {"--orientations", "sphere:30", "--rolls", "3"};
  std::vector<std::string> saved = rolling;
  saved.insert(saved.end(), {"--checkpoint", path("state")});
  ASSERT_EQ(runProgram(mapArguments(saved)).exit_code, 0);
  EXPECT_EQ(report().at("parameters").at("rolls"), 3);
  const std::string ply = readText("out/points.ply");
  EXPECT_NE(ply.find("\ncomment orientations sphere:30\ncomment rolls 3\n"), std::string::npos);
  EXPECT_NE(
      ply.find("\nproperty ushort orientation\nproperty uchar roll\nproperty float access_probability\nend_header\n"),
      std::string::npos);
  const ProgramResult info = runProgram({"info", path("out/field.vdb")});
  EXPECT_NE(info.out.find("best_roll"), std::string::npos) << info.out;
  // The same again, from the state; with another number of rolls it is another field.
  const std::string points = readText("out/points.ply");
  std::vector<std::string> resumed = rolling;
  resumed.insert(resumed.end(), {"--resume", path("state")});
  const ProgramResult again = runProgram(mapArguments(resumed));
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(readText("out/points.ply"), points);
  resumed[3] = "4";
  const ProgramResult other = runProgram(mapArguments(resumed));
  EXPECT_EQ(other.exit_code, 4) << other.err;
  EXPECT_NE(other.err.find("rolls was 3"), std::string::npos) << other.err;
  // By rule the pencil, which is turned, has none.
  ASSERT_EQ(runProgram(mapArguments({"--orientations", "sphere:30"})).exit_code, 0);
  EXPECT_FALSE(report().at("parameters").contains("rolls"));
  EXPECT_EQ(runProgram({"info", path("out/field.vdb")}).out.find("best_roll"), std::string::npos);
  const ProgramResult config = runProgram(mapArguments({"--print-config", "--rolls", "4"}));
  EXPECT_NE(config.out.find("rolls = 4"), std::string::npos) << config.out;
}

/// Indices above a byte in the files, in a saved state and in the answers.
TEST_F(MapOutputs, OfMoreDirectionsThanAMaskHolds) {
  const std::vector<std::string> wide = {"--orientations", "sphere:5", "--device", "cpu"};
  std::vector<std::string> saved = wide;
  saved.insert(saved.end(), {"--checkpoint", path("state")});
  const ProgramResult first = runProgram(mapArguments(saved));
  ASSERT_EQ(first.exit_code, 0) << first.err;
  const std::string ply = readText("out/points.ply"),
                    end = "\nproperty ushort orientation\nproperty float access_probability\nend_header\n";
  const std::size_t body = ply.find(end);
  ASSERT_NE(body, std::string::npos);
  const std::size_t count = std::stoul(ply.substr(ply.find("element vertex ") + 15));
  const std::size_t each = (ply.size() - body - end.size()) / count;
  ASSERT_EQ(body + end.size() + count * each, ply.size());
  std::size_t beyond = 0;
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t at = body + end.size() + (n + 1) * each - 6;  // the last column but one, little endian
    const unsigned orientation =
        static_cast<unsigned char>(ply[at]) | static_cast<unsigned>(static_cast<unsigned char>(ply[at + 1])) << 8;
    EXPECT_TRUE(orientation < 1666 || orientation == 65535) << orientation;
    beyond += orientation > 255 && orientation < 1666 ? 1 : 0;
  }
  EXPECT_GT(beyond, 10u);
  std::vector<std::string> resumed = wide;
  resumed.insert(resumed.end(), {"--resume", path("state")});
  ASSERT_EQ(runProgram(mapArguments(resumed)).exit_code, 0);
  EXPECT_EQ(readText("out/points.ply"), ply);
  const std::vector<std::string> arguments = mapArguments();
  const std::string tool = *(std::find(arguments.begin(), arguments.end(), "--tool") + 1);
  const ProgramResult why = runProgram({"query", "--map", path("state"), "--device", "cpu", "--tool", tool, "--at",
                                        "2,0.1,0", "--access-map", path("why.png"), "--json"});
  ASSERT_EQ(why.exit_code, 0) << why.err;
  EXPECT_EQ(json::parse(why.out).at("directions").size(), 1666u);
}

TEST_F(MapOutputs, AccessMapSaysWhatStopsEachDirection) {
  ASSERT_EQ(runProgram(mapArguments({"--orientations", "sphere:30", "--checkpoint", path("state")})).exit_code, 0);
  const auto query = [&](const std::string& map, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"query", "--map", path(map), "--device", "cpu"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return runProgram(arguments);
  };
  const std::vector<std::string> arguments = mapArguments();
  const std::string tool = *(std::find(arguments.begin(), arguments.end(), "--tool") + 1);
  const ProgramResult plain = query("out", {"--at", "2,0.1,0", "--json"});
  ASSERT_EQ(plain.exit_code, 0) << plain.err;
  const json point = json::parse(plain.out).at(0).at("point");
  const std::string at = std::to_string(point.at("position")[0].get<double>()) + "," +
                         std::to_string(point.at("position")[1].get<double>()) + "," +
                         std::to_string(point.at("position")[2].get<double>());
  const ProgramResult drawn = query("state", {"--tool", tool, "--at", at, "--access-map", path("why.png"), "--json"});
  ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
  const json map = json::parse(drawn.out);
  EXPECT_EQ(map.at("point"), point.at("id"));
  EXPECT_EQ(map.at("label"), point.at("label"));
  EXPECT_EQ(map.at("directions").size(), 54u);  // of sphere:30
  std::size_t free = 0;
  for (const json& direction : map.at("directions")) {
    const double cosine = direction.at("direction")[0].get<double>() * map.at("normal")[0].get<double>() +
                          direction.at("direction")[1].get<double>() * map.at("normal")[1].get<double>() +
                          direction.at("direction")[2].get<double>() * map.at("normal")[2].get<double>();
    if (std::abs(cosine - std::cos(1.2217304763960306)) < 1e-3) continue;  // on the edge of the cone, by rounding
    EXPECT_EQ(direction.at("outcome") == "normal", cosine < std::cos(1.2217304763960306));
    free += direction.at("outcome") == "free" ? 1 : 0;
  }
  EXPECT_EQ(free > 0, point.at("label") == "accessible");
  EXPECT_EQ(readText("why.png").substr(1, 3), "PNG");
  const ProgramResult words = query("state", {"--tool", tool, "--at", at, "--access-map", path("why.png")});
  EXPECT_NE(words.out.find(" directions normal\n"), std::string::npos) << words.out;

  const auto expectRefused = [&](const ProgramResult& result, int code, const std::string& id) {
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
  };
  // The tool in the voxel of that point, and far from everything.
  writeText("poses.txt", "2 0.1 0 0 0 0 1\n500 0 0 1 0 0 0\n");
  const ProgramResult fits = query("state", {"--tool", tool, "--fits", path("poses.txt"), "--contact"});
  ASSERT_EQ(fits.exit_code, 0) << fits.err;
  EXPECT_EQ(fits.out.find("collisions,collision_limit,unknown_voxels,collision,unknown,valid,free\n"), 0U) << fits.out;
  EXPECT_EQ(std::count(fits.out.begin(), fits.out.end(), '\n'), 3) << fits.out;
  const ProgramResult as_json = query("state", {"--tool", tool, "--fits", path("poses.txt"), "--json"});
  const json answers = json::parse(as_json.out);
  ASSERT_EQ(answers.size(), 2U);
  EXPECT_EQ(answers[1]["collision"], false);
  EXPECT_EQ(answers[1]["unknown"], true);
  EXPECT_EQ(answers[1]["free"], false);
  const ProgramResult along = query("state", {"--tool", tool, "--fits", path("poses.txt"), "--along"});
  EXPECT_EQ(along.exit_code, 0) << along.err;
  expectRefused(query("out", {"--tool", tool, "--fits", path("poses.txt")}), 2, "usage.fits");
  expectRefused(query("state", {"--tool", tool, "--fits", path("poses.txt"), "--at", at}), 2, "usage.fits");
  expectRefused(query("state", {"--tool", tool, "--fits", path("poses.txt"), "--along", "--contact"}), 2, "usage.fits");
  expectRefused(query("state", {"--tool", tool, "--fits", path("none.txt")}), 3, "input.missing");
  expectRefused(query("out", {"--tool", tool, "--at", at, "--access-map", path("no.png")}), 2, "usage.access_map");
  expectRefused(query("state", {"--at", at, "--access-map", path("no.png")}), 2, "usage.missing");
  expectRefused(query("state", {"--tool", tool, "--at", at, "--at", at, "--access-map", path("no.png")}), 2,
                "usage.access_map");
  const char* const other = tool == "builtin:pencil" ? "builtin:pruner" : "builtin:pencil";
  expectRefused(query("state", {"--tool", other, "--at", at, "--access-map", path("no.png")}), 4, "state.tool");
  expectRefused(query("state", {"--tool", tool, "--at", "50,0,0", "--access-map", path("no.png")}), 3,
                "query.no_point");
  EXPECT_FALSE(std::filesystem::exists(path("no.png")));
}

TEST_F(MapOutputs, ApproachesComeFromACheckpointWithItsMargins) {
  const ProgramResult mapped = runProgram(mapArguments({"--margins", "0.05,0.1", "--checkpoint", path("state")}));
  ASSERT_EQ(mapped.exit_code, 0) << mapped.err;
  ASSERT_EQ(report().at("tools").size(), 3U);
  EXPECT_EQ(report().at("tools")[2].at("margin_m"), 0.1);
  EXPECT_NE(
      readText("out/points.ply")
          .find(
              "\nproperty float margin_m\nproperty float free_arc_deg\nproperty float access_probability\nend_header"),
      std::string::npos);
  const std::vector<std::string> arguments = mapArguments();
  const std::string tool = *(std::find(arguments.begin(), arguments.end(), "--tool") + 1);
  const auto approaches = [&](const std::vector<std::string>& more) {
    std::vector<std::string> all = {"approaches", "--map", path("state"), "--device", "cpu", "--tool", tool};
    all.insert(all.end(), more.begin(), more.end());
    return runProgram(all);
  };
  const ProgramResult found =
      approaches({"--margins", "0.05,0.1", "--allow-unknown", "--most", "3", "--json", "--out", path("ways")});
  ASSERT_EQ(found.exit_code, 0) << found.err;
  const json targets = json::parse(found.out).at("targets");
  ASSERT_GT(targets.size(), 0U);
  ASSERT_LE(targets.size(), 3U);
  for (const json& target : targets) EXPECT_GE(target.at("approaches").size(), 1U);
  EXPECT_EQ(listing("ways"), (std::vector<std::string>{"approaches.csv", "approaches.json", "approaches.ply"}));
  EXPECT_EQ(readText("ways/approaches.json"), found.out);
  // Written again over our own, and never over what is not.
  EXPECT_EQ(approaches({"--margins", "0.05,0.1", "--allow-unknown", "--out", path("ways")}).exit_code, 0);
  writeText("ways/approaches.csv", "of the user\n");
  const auto expectRefused = [&](const std::vector<std::string>& more, int code, const std::string& id) {
    const ProgramResult result = approaches(more);
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << result.err;
  };
  expectRefused({"--margins", "0.05,0.1", "--allow-unknown", "--out", path("ways")}, 7, "output.foreign");
  EXPECT_EQ(readText("ways/approaches.csv"), "of the user\n");
  expectRefused({}, 4, "state.tool");
  expectRefused({"--margins", "0.05,0.1", "--most", "-1"}, 2, "usage.number");
  expectRefused({"--margins", "0.05,0.1", "--spacing", "0.001"}, 2, "approaches.options");
  expectRefused({"--margins", "0.05,0.1", "--within", "2"}, 2, "approaches.options");
  expectRefused({"--margins", "0.05,x"}, 2, "usage.margins");
  expectRefused({"--margins", "0.05,9"}, 2, "tool.margin");
}

TEST_F(MapOutputs, ReportHasTheDocumentedSchema) {
  const ProgramResult result = runProgram(mapArguments());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, "") << "stdout carries data only";
  EXPECT_EQ(listing("out"), kOutputs);

  const json all = report();
  EXPECT_EQ(all.at("schema"), 1);
  EXPECT_TRUE(all.at("version").is_string());
  EXPECT_EQ(all.at("exit_code"), 0);
  const std::string device = all.at("device");
  EXPECT_TRUE(device == "cpu" || device.rfind("cuda:", 0) == 0) << device;
  EXPECT_EQ(all.at("parameters").at("tool"), "builtin:pencil");
  EXPECT_EQ(all.at("inputs").size(), 5u) << "four scans and the poses";
  for (const json& input : all.at("inputs")) EXPECT_EQ(input.at("sha256").get<std::string>().size(), 64u);

  const json& counts = all.at("counts");
  EXPECT_EQ(counts.at("scans"), 4);
  EXPECT_EQ(counts.at("points_in"), 4 * 1600);
  EXPECT_EQ(counts.at("points_used"), 4 * 1600);
  for (const char* reason : {"no_return", "non_finite", "below_min_range", "beyond_max_range", "out_of_bounds"}) {
    EXPECT_EQ(counts.at("dropped").at(reason), 0);
  }
  const std::uint64_t points = counts.at("surface_points");
  // The wall is one voxel layer of 1.0 m x 1.3 m in 5 cm cells, give or take a row at the rims.
  EXPECT_NEAR(static_cast<double>(points), 20 * 26, 2 * (20 + 26) + 4);
  EXPECT_EQ(counts.at("accessible").get<std::uint64_t>() + counts.at("blocked").get<std::uint64_t>() +
                counts.at("unscored").get<std::uint64_t>(),
            points);
  std::uint64_t reasons = 0;
  for (const char* reason : {"tool", "arm", "unknown", "normal", "unseen", "confidence"}) {
    reasons += counts.at("reasons").at(reason).get<std::uint64_t>();
  }
  EXPECT_EQ(reasons + counts.at("accessible").get<std::uint64_t>(), points) << "every other point has a reason";
  for (const char* stage : {"frame", "integrate", "mirror", "update", "score"}) {
    const json& times = all.at("timing_ms").at(stage);
    EXPECT_LE(times.at("p50"), times.at("p95"));
    EXPECT_LE(times.at("p95"), times.at("p99"));
    EXPECT_LE(times.at("p99"), times.at("max"));
    EXPECT_LE(times.at("mean"), times.at("max"));
  }
  EXPECT_GT(all.at("timing_ms").at("frame").at("max"), 0);
  EXPECT_GT(all.at("memory").at("host_peak_bytes"), 1 << 20);
  EXPECT_EQ(all.at("memory").at("device_peak_bytes") == 0, device == "cpu");
  EXPECT_GT(all.at("memory").at("predicted_bytes"), 1 << 20);
  EXPECT_GT(all.at("map").at("leaves"), 0);
  EXPECT_GT(all.at("map").at("active_voxels"), 0);
  EXPECT_GT(all.at("map").at("bytes"), 0);
}

TEST_F(MapOutputs, TheMirrorOfDistancesShowsInTheReportAndNowhereElse) {
  ASSERT_EQ(runProgram(mapArguments()).exit_code, 0);
  const json without = report();
  const std::string points = readText("out/points.ply");
  std::vector<std::string> arguments = mapArguments();
  arguments.push_back("--mirror-distance");
  const ProgramResult result = runProgram(arguments);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json with = report();
  EXPECT_EQ(readText("out/points.ply"), points);
  EXPECT_EQ(without.at("parameters").at("mirror_distance"), false);
  EXPECT_EQ(with.at("parameters").at("mirror_distance"), true);
  for (const json& all : {without, with}) {
    EXPECT_GT(all.at("per_scan").at("changed_leaves").at("mean"), 0);
    EXPECT_GT(all.at("per_scan").at("mirror_bytes").at("mean"), all.at("per_scan").at("changed_leaves").at("mean"));
    EXPECT_GT(all.at("memory").at("mirror_bytes"), 0);
  }
  EXPECT_FALSE(without.at("per_scan").contains("distance_leaves"));
  EXPECT_GT(with.at("per_scan").at("distance_leaves").at("mean"), 0);
  EXPECT_GT(with.at("per_scan").at("distance_mirror_bytes").at("mean"),
            with.at("per_scan").at("mirror_bytes").at("mean"));
  EXPECT_GT(with.at("timing_ms").at("distance_mirror").at("max"), 0);
  EXPECT_GT(with.at("memory").at("distance_mirror_bytes"), with.at("memory").at("mirror_bytes"));
  EXPECT_GT(with.at("memory").at("predicted_bytes"), without.at("memory").at("predicted_bytes"));
}

/// The mode is in the report and in every file's metadata; without it, nothing says that there is one.
TEST_F(MapOutputs, NewThingsBlockUnlessTheWorldIsStill) {
  ASSERT_EQ(runProgram(mapArguments()).exit_code, 0);
  EXPECT_EQ(report().at("parameters").at("change"), "block");
  EXPECT_NE(readText("out/points.ply").find("change block"), std::string::npos);
  std::vector<std::string> still;
  for (const std::vector<std::string>& flags : {std::vector<std::string>{"--static"}, {"--change", "off"}}) {
    ASSERT_EQ(runProgram(mapArguments(flags)).exit_code, 0);
    EXPECT_FALSE(report().at("parameters").contains("change"));
    still.push_back(readText("out/points.ply") + readText("out/field.vdb") + readText("out/field_points.vdb"));
  }
  EXPECT_EQ(still[0], still[1]);
  EXPECT_EQ(still[0].find("change block"), std::string::npos);
}

/// Free space ages by the scans' times, which these have; what is likely not meant is said.
TEST_F(MapOutputs, FreeSpaceAgesByTheScansTimes) {
  ASSERT_EQ(runProgram(mapArguments({"--change", "full"})).exit_code, 0);
  EXPECT_EQ(report().at("parameters").at("change"), "full");
  EXPECT_EQ(report().at("parameters").at("free_for_s"), "inf");
  const ProgramResult run = runProgram(mapArguments({"--change", "full", "--free-for", "5"}));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(report().at("parameters").at("free_for_s"), 5);
  EXPECT_NE(run.err.find("change.short"), std::string::npos) << run.err;
  for (const char* bad : {"0", "nan", "soon", "1e999"}) {
    const ProgramResult refused = runProgram(mapArguments({"--change", "full", "--free-for", bad}));
    EXPECT_EQ(refused.exit_code, 2) << bad;
    EXPECT_NE(refused.err.find("usage.free_for"), std::string::npos) << refused.err;
  }
  EXPECT_EQ(runProgram(mapArguments({"--free-for", "60"})).exit_code, 2);
}

TEST_F(MapOutputs, SummaryIsSaidUnlessQuiet) {
  const std::string loud = runProgram(mapArguments()).err;
  for (const char* part : {"4 scans, 6400 returns, 100.0 % used", "surface points: accessible", "tool builtin:pencil",
                           "axis", "done in"}) {
    EXPECT_NE(loud.find(part), std::string::npos) << part << "\n" << loud;
  }
  EXPECT_EQ(runProgram(mapArguments({"--quiet"})).err.find("surface points: "), std::string::npos);
}

/// Of points of the surface, shares are of those that are there to be scored.
TEST_F(MapOutputs, SummaryCountsPointsBesideTheSurfaceApart) {
  const ProgramResult run = runProgram(mapArguments({"--points", "surface", "--point-spacing", "0.2"}));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json counts = report().at("counts");
  const auto all = counts.at("surface_points").get<int>(), accessible = counts.at("accessible").get<int>(),
             blocked = counts.at("blocked").get<int>(), beside = counts.at("reasons").at("beside_surface").get<int>();
  ASSERT_GT(beside, 10);
  ASSERT_GT(accessible, 10);
  const std::string said = std::to_string(all) + " surface points, " + std::to_string(beside) +
                           " of them beside the surface; the others: accessible " + std::to_string(accessible) + " (";
  const auto at = run.err.find(said);
  ASSERT_NE(at, std::string::npos) << said << "\n" << run.err;
  EXPECT_NEAR(std::stod(run.err.substr(at + said.size())), 100.0 * accessible / (all - beside), 0.051);
  EXPECT_NE(run.err.find(", unscored " + std::to_string(all - beside - accessible - blocked) + " ("), std::string::npos)
      << run.err;
}

TEST_F(MapOutputs, FlagsForAGpuAreNamedWhereTheyChangeNothing) {
  const ProgramResult on_cpu = runProgram(mapArguments({"--host-fusion"}));
  ASSERT_EQ(on_cpu.exit_code, 0) << on_cpu.err;
  EXPECT_NE(on_cpu.err.find("--host-fusion has no effect without a GPU"), std::string::npos) << on_cpu.err;
  EXPECT_EQ(on_cpu.err.find("--max-device-memory"), std::string::npos) << on_cpu.err;
  EXPECT_FALSE(report().contains("scans_fused_on_device"));
  const ProgramResult in_tiles = runProgram(mapArguments({"--max-device-memory", "1G", "--tiles", "12.8", "--fresh"}));
  ASSERT_EQ(in_tiles.exit_code, 0) << in_tiles.err;
  EXPECT_NE(in_tiles.err.find("--max-device-memory has no effect in tiles"), std::string::npos) << in_tiles.err;
}

TEST_F(MapOutputs, UpdatingEachScanChangesNoLabel) {
  ASSERT_EQ(runProgram(mapArguments()).exit_code, 0);
  const json once = report();
  ASSERT_EQ(runProgram(mapArguments({"--update-every", "1"})).exit_code, 0);
  EXPECT_EQ(report().at("counts"), once.at("counts"));
}

TEST_F(MapOutputs, RangesAndEveryAreHonoured) {
  // The wall is 2 m ahead; its corners are 2.12 m away.
  ASSERT_EQ(runProgram(mapArguments({"--max-range", "2.05", "--every", "2"})).exit_code, 0);
  const json counts = report().at("counts");
  EXPECT_EQ(counts.at("scans"), 2);
  EXPECT_GT(counts.at("dropped").at("beyond_max_range"), 0);
  EXPECT_EQ(counts.at("points_used").get<int>() + counts.at("dropped").at("beyond_max_range").get<int>(), 2 * 1600);
}

TEST_F(MapOutputs, ToolReadInTheWrongUnitIsWarnedAbout) {
  writeBoxTool(5, 0.5);  // a tool of 5 mm ... read as metres
  const ProgramResult result = runProgram(mapArguments({"--tool", path("tool.obj"), "--tool-unit", "m"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("accessvdb: warning[tool.unit]"), std::string::npos) << result.err;
  EXPECT_NE(result.err.find("accessvdb: warning[tool.larger_than_scene]"), std::string::npos) << result.err;
  EXPECT_GE(report().at("warnings").size(), 2u);
}

TEST_F(MapOutputs, NegativeVectorsParse) {
  writeBoxTool(150, 10);
  const ProgramResult result = runProgram(
      mapArguments({"--tool", path("tool.obj"), "--tool-unit", "mm", "--tool-tip", "-10,0,0", "--view", "-1,0,0.5"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("tip -10,0,0"), std::string::npos) << result.err;
}

TEST_F(MapOutputs, ATipOffTheToolIsWarnedAboutInTheReport) {
  writeBoxTool(150, 10);
  const ProgramResult wrong =
      runProgram(mapArguments({"--tool", path("tool.obj"), "--tool-unit", "mm", "--tool-tip", "150,0,0"}));
  ASSERT_EQ(wrong.exit_code, 0) << wrong.err;
  EXPECT_NE(wrong.err.find("accessvdb: warning[tool.pose]"), std::string::npos) << wrong.err;
  EXPECT_NE(wrong.err.find("--tool-axis=-1,0,0"), std::string::npos) << wrong.err;
  EXPECT_NE(report().at("warnings").dump().find("far side of the tip"), std::string::npos);
  for (const char* axis : {"--tool-axis=-x", "--tool-axis=-1,0,0"}) {
    const ProgramResult right =
        runProgram(mapArguments({"--tool", path("tool.obj"), "--tool-unit", "mm", "--tool-tip", "150,0,0", axis}));
    ASSERT_EQ(right.exit_code, 0) << right.err;
    EXPECT_EQ(right.err.find("tool.pose"), std::string::npos) << right.err;
  }
  const ProgramResult none =
      runProgram(mapArguments({"--tool", path("tool.obj"), "--tool-unit", "mm", "--tool-axis=-w"}));
  EXPECT_EQ(none.exit_code, 2) << none.err;
  EXPECT_NE(none.err.find("--tool-axis"), std::string::npos) << none.err;
}

TEST_F(MapOutputs, ColourByReasonChangesThePreviewOnly) {
  ASSERT_EQ(runProgram(mapArguments()).exit_code, 0);
  const std::string by_label = readText("out/preview.png"), points = readText("out/points.ply");
  ASSERT_EQ(runProgram(mapArguments({"--colour", "reason"})).exit_code, 0);
  const std::string by_reason = readText("out/preview.png");
  EXPECT_NE(by_reason, by_label);
  EXPECT_EQ(readText("out/points.ply"), points);
  ASSERT_EQ(runProgram({"render", "--map", path("out"), "--out", path("a.png"), "--colour", "reason"}).exit_code, 0);
  EXPECT_EQ(readText("a.png"), by_reason);
  const ProgramResult other = runProgram({"render", "--map", path("out"), "--out", path("b.png"), "--colour", "red"});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("Use label or reason"), std::string::npos) << other.err;
}

TEST_F(MapOutputs, OtherVerbsReadIt) {
  ASSERT_EQ(runProgram(mapArguments()).exit_code, 0);
  const ProgramResult info = runProgram({"info", path("out"), "--json"});
  ASSERT_EQ(info.exit_code, 0) << info.err;
  const json inside = json::parse(info.out);
  EXPECT_EQ(inside.at("report"), report());
  ASSERT_EQ(inside.at("files").size(), 2u);
  EXPECT_EQ(inside.at("files")[0].at("grids").size(), 9u);
  const ProgramResult words = runProgram({"info", path("out/field.vdb")});
  EXPECT_EQ(words.exit_code, 0) << words.err;
  EXPECT_NE(words.out.find("grid distance: Tree_float"), std::string::npos) << words.out;

  const ProgramResult query =
      runProgram({"query", "--map", path("out"), "--at", "2,0.1,0", "--at", "-9,0,0", "--json"});
  ASSERT_EQ(query.exit_code, 0) << query.err;
  const json answers = json::parse(query.out);
  ASSERT_EQ(answers.size(), 2u);
  ASSERT_TRUE(answers[0].at("point").is_object());
  EXPECT_NEAR(answers[0].at("point").at("position")[0].get<double>(), 2.0, 1e-5);
  EXPECT_EQ(answers[0].at("voxel"), "observed");
  EXPECT_EQ(answers[1].at("voxel"), "unknown");
  EXPECT_TRUE(answers[1].at("point").is_null());
  if (!answers[0].at("point").at("direction").is_null()) {
    const json& d = answers[0].at("point").at("direction");
    const double yaw = answers[0].at("point").at("yaw_deg");
    EXPECT_NEAR(std::cos(yaw * M_PI / 180), d[0].get<double>(), 1e-4);
    EXPECT_NEAR(std::sin(yaw * M_PI / 180), d[1].get<double>(), 1e-4);
  }
  writeText("points.txt", "2 0.1 0\n-9,0,0\n");
  EXPECT_EQ(runProgram({"query", "--map", path("out"), "--points", path("points.txt"), "--json"}).out, query.out);

  EXPECT_EQ(runProgram({"render", "--map", path("out"), "--out", path("top.png"), "--view", "top"}).exit_code, 0);
  EXPECT_EQ(readText("top.png").substr(1, 3), "PNG");
  EXPECT_EQ(runProgram({"render", "--tool", "builtin:pruner", "--out", path("tool.png")}).exit_code, 0);
  EXPECT_EQ(readText("tool.png").substr(1, 3), "PNG");
}

TEST_F(MapOutputs, FirstSignalSavesWhatWasFinished) {
  writeLongRun();
  for (const int number : {SIGINT, SIGTERM}) {
    ProgramResult result = runWithSignals({number});
    for (int after_ms = 600; after_ms < 5000 && report().at("counts").at("scans") == 0; after_ms *= 2) {
      result = runWithSignals({number}, after_ms);  // a busy machine, which had not fused any yet
    }
    EXPECT_EQ(result.exit_code, 128 + number) << result.err;
    EXPECT_EQ(listing("out"), kOutputs);
    EXPECT_EQ(report().at("exit_code"), 128 + number);
    EXPECT_GT(report().at("counts").at("scans"), 0);
    EXPECT_LT(report().at("counts").at("scans"), 600);
    EXPECT_GT(report().at("counts").at("surface_points"), 0);
    EXPECT_EQ(runProgram({"info", path("out")}).exit_code, 0);
    std::filesystem::remove_all(folder_ / "out");
  }
}

TEST_F(MapOutputs, SecondSignalEndsAtOnce) {
  writeLongRun();
  const ProgramResult result = runWithSignals({SIGINT, SIGTERM});
  // Both are pending: different threads may take them in either order.
  EXPECT_TRUE(result.signal == SIGTERM || result.signal == SIGINT) << result.exit_code << result.err;
}

}  // namespace
}  // namespace accessvdb::cli_test
