// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Clouds of surveys: a trajectory, stations, LAZ. The same rays given in another form must give the same files.
#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>

#include "program_run.h"
#include "support/bytes.h"

namespace accessvdb::cli_test {
namespace {

constexpr double kBegin_s = 1.25e9;
constexpr int kSide = 60;

using test::put;

/// A wall 1 m x 1 m, 2 m in front of a sensor that moves along y. Everything is a multiple of 2^-10, so that integers
/// of LAS, decimal text and interpolation are exact.
struct Ray {
  double stamp_s, p[3], q[3];
};
std::vector<Ray> wall() {
  std::vector<Ray> rays;
  for (int row = 0; row < kSide; ++row)
    for (int column = 0; column < kSide; ++column) {
      const double since_s = static_cast<double>(rays.size()) / 1024;
      rays.push_back({kBegin_s + since_s, {2, column / 64.0, row / 64.0}, {0, since_s * 0.25, 0.5}});
    }
  return rays;
}

class SurveyInputs : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeText("walk.las", las(0));
    writeText("walk.ply", rayCloud());
    std::string text = "%time x y z\n";
    for (int i = 0; i <= 64; ++i) {
      char line[100];
      std::snprintf(line, sizeof line, "%.4f 0 %.10f 0.5\n", kBegin_s + i / 16.0, 0.25 * i / 16.0);
      text += line;
    }
    writeText("walk.txt", text);
  }

  /// LAS 1.2, point format 1, whose times are less by `clock_s`.
  static std::string las(double clock_s) {
    const std::vector<Ray> rays = wall();
    std::string file("LASF", 4);
    file.resize(24, '\0');
    file += "\1\2";
    file.resize(94, '\0');
    put(file, std::uint16_t{227});
    put(file, std::uint32_t{227});
    put(file, std::uint32_t{0});
    file += '\1';
    put(file, std::uint16_t{28});
    put(file, static_cast<std::uint32_t>(rays.size()));
    file.resize(131, '\0');
    for (int axis = 0; axis < 3; ++axis) put(file, 1.0 / 1024);
    file.resize(179, '\0');
    for (int axis = 0; axis < 3; ++axis) {
      put(file, 100.0);
      put(file, -100.0);
    }
    for (const Ray& ray : rays) {
      for (const double p : ray.p) put(file, static_cast<std::int32_t>(p * 1024));
      file.append(8, '\0');
      put(file, ray.stamp_s - clock_s);
    }
    return file;
  }
  static std::string rayCloud() {
    const std::vector<Ray> rays = wall();
    std::string file = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(rays.size()) + "\n";
    for (const char* const name : {"x", "y", "z", "nx", "ny", "nz"})
      file += "property double " + std::string(name) + "\n";
    file += "end_header\n";
    for (const Ray& ray : rays) {
      for (const double p : ray.p) put(file, p);
      for (int axis = 0; axis < 3; ++axis) put(file, ray.q[axis] - ray.p[axis]);
    }
    return file;
  }
  /// Runs `map` into folder `out`. @return points.ply
  std::string pointsOf(const std::string& out, std::vector<std::string> arguments) {
    const ProgramResult result = map(out, std::move(arguments));
    EXPECT_EQ(result.exit_code, 0) << result.err;
    std::string points = readText(out + "/points.ply");
    EXPECT_GT(points.size(), 10'000U);
    return points;
  }
  ProgramResult map(const std::string& out, std::vector<std::string> arguments) {
    for (const std::string& word :
         {std::string("--tool"), std::string("builtin:pencil"), std::string("--voxel"), std::string("0.05"),
          std::string("--directions"), std::string("8"), std::string("--device"), std::string("cpu"),
          std::string("--allow-hidden-tool"), std::string("--out"), path(out)})
      arguments.push_back(word);
    arguments.insert(arguments.begin(), "map");
    return runProgram(arguments);
  }
  void expectFailure(int code, const std::string& words, std::vector<std::string> arguments) {
    const ProgramResult result = map("failed", std::move(arguments));
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_NE(result.err.find(words), std::string::npos) << result.err;
    EXPECT_FALSE(std::filesystem::exists(path("failed/points.ply")));
  }
};

TEST_F(SurveyInputs, TrajectoryGivesTheFilesOfTheRayCloud) {
  const std::string rays = pointsOf("rays", {"--scans", path("walk.ply")});
  EXPECT_EQ(pointsOf("las", {"--scans", path("walk.las"), "--trajectory", path("walk.txt")}), rays);
  const auto report = nlohmann::json::parse(readText("las/report.json"));
  EXPECT_EQ(report.at("parameters").at("trajectory"), path("walk.txt"));
  bool hashed = false;
  for (const auto& input : report.at("inputs")) hashed = hashed || input.at("path") == path("walk.txt");
  EXPECT_TRUE(hashed);

  writeText("adjusted.las", las(1e9));
  const std::vector<std::string> adjusted = {"--scans", path("adjusted.las"), "--trajectory", path("walk.txt")};
  expectFailure(4, "Use --time-offset 1000000000,", adjusted);
  std::vector<std::string> offset = adjusted;
  offset.insert(offset.end(), {"--time-offset", "1000000000"});
  EXPECT_EQ(pointsOf("adjusted", offset), rays);
  EXPECT_EQ(nlohmann::json::parse(readText("adjusted/report.json")).at("parameters").at("time_offset"), 1e9);
}

TEST_F(SurveyInputs, StationsGiveTheFilesOfOneSensorPosition) {
  const std::string one = pointsOf("one", {"--scans", path("walk.las"), "--sensor-at", "0,0.25,0.5"});
  writeText("stations.txt", "walk.las 0 0.25 0.5\n");
  EXPECT_EQ(pointsOf("stations", {"--scans", path("."), "--stations", path("stations.txt")}), one);
  writeText("stations.txt", "other.las 0 0.25 0.5\n");
  expectFailure(3, "error[input.missing]", {"--scans", path("."), "--stations", path("stations.txt")});
}

TEST_F(SurveyInputs, LazGivesTheFilesOfLas) {
  const std::string plain = pointsOf("las", {"--scans", path("walk.las"), "--trajectory", path("walk.txt")});
  writeText("walk 1.laz", las(0));
  std::vector<std::string> arguments = {"--scans",        path("walk 1.laz"), "--trajectory",
                                        path("walk.txt"), "--laz-command",    "cat"};
  EXPECT_EQ(pointsOf("laz", arguments), plain);
  arguments.back() = "false";
  expectFailure(3, "error[input.decoder]", arguments);
  arguments.back() = "/nowhere";
  expectFailure(3, "error[input.decoder]", arguments);
}

TEST_F(SurveyInputs, ACheckpointIsOfOneTrajectoryAndClock) {
  const auto run = [&](const std::string& trajectory, const std::string& offset, const std::string& verb) {
    return runProgram({"map", "--scans", path("walk.las"), "--trajectory", path(trajectory), "--time-offset", offset,
                       "--tool", "builtin:pencil", "--voxel", "0.05", "--allow-hidden-tool", "--out", path("out"), verb,
                       path("cp")});
  };
  const ProgramResult first = run("walk.txt", "0", "--checkpoint");
  ASSERT_EQ(first.exit_code, 0) << first.err;
  const ProgramResult clock = run("walk.txt", "0.0009765625", "--resume");
  EXPECT_EQ(clock.exit_code, 4) << clock.err;
  EXPECT_NE(clock.err.find("time_offset was \"0\" and is now \"0.0009765625\""), std::string::npos) << clock.err;
  writeText("other.txt", readText("walk.txt") + "# another\n");
  const ProgramResult other = run("other.txt", "0", "--resume");
  EXPECT_EQ(other.exit_code, 4) << other.err;
  EXPECT_NE(other.err.find("other.txt has different content"), std::string::npos) << other.err;
  EXPECT_EQ(run("walk.txt", "0", "--resume").exit_code, 0);
}

TEST_F(SurveyInputs, RefusesWhatExcludesEachOther) {
  expectFailure(2, "error[usage.trajectory]",
                {"--scans", path("walk.las"), "--trajectory", path("walk.txt"), "--sensor-at", "0,0,0"});
  expectFailure(2, "error[usage.time_offset]", {"--scans", path("walk.ply"), "--time-offset", "18"});
  expectFailure(2, "error[usage.stations]",
                {"--scans", path("walk.las"), "--trajectory", path("walk.txt"), "--stations", path("walk.txt")});
}

}  // namespace
}  // namespace accessvdb::cli_test
