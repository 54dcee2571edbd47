// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A run's predicted peak memory against its measured one.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

/// The whole prediction is accurate to a quarter; on these scans it was within 5 % when this was written. The bound
/// applies both ways, so that a prediction that grows with everything fails too.
constexpr double kTrusted = 0.15;

class MemoryMeasured : public ProgramTest {
 protected:
  /// @return predicted / measured
  double ratio(std::vector<std::string> arguments) {
    // On one thread: on several, the peak depends on which of them are at work at the same time.
    arguments.insert(arguments.end(), {"--device", "cpu", "--threads", "1", "--out", path("out")});
    const ProgramResult result = runProgram(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const auto memory = nlohmann::json::parse(readText("out/report.json")).at("memory");
    std::filesystem::remove_all(folder_ / "out");
    return memory.at("predicted_bytes").get<double>() / memory.at("host_peak_bytes").get<double>();
  }
};

TEST_F(MemoryMeasured, RecordedScansTakeWhatWasPredicted) {
  const char* given = std::getenv("ACCESSVDB_TEST_DATA");
  const std::string scans =
      (given != nullptr ? std::string(given) : std::string(ACCESSVDB_SOURCE_DIR) + "/../shared/data") +
      "/scans_poses_balm";
  if (!std::filesystem::exists(scans)) GTEST_SKIP() << "no test data: " << scans;
  std::vector<std::string> arguments = {"map",
                                        "--scans",
                                        scans,
                                        "--poses",
                                        scans + "/alidarPose.csv",
                                        "--tool",
                                        "builtin:pencil",
                                        "--allow-hidden-tool",
                                        "--directions",
                                        "4",
                                        "--voxel",
                                        "0.05"};
  EXPECT_NEAR(ratio(arguments), 1, kTrusted);
  arguments.back() = "0.02";
  // Every third scan, so that this one stays short.
  arguments.insert(arguments.end(), {"--every", "3", "--surface"});
  EXPECT_NEAR(ratio(arguments), 1, kTrusted);
}

/// A scan in the sensor's frame is fused at once, however many returns it has.
TEST_F(MemoryMeasured, AScanOfManyReturnsTakesWhatWasPredicted) {
  std::string points;
  constexpr int kReturns = 700'000;
  for (int n = 0; n < kReturns; ++n) {
    const float angle = 0.00917F * static_cast<float>(n);
    for (const float value :
         {10 * std::cos(angle), 10 * std::sin(angle), -3 + 6.0F * static_cast<float>(n) / kReturns, 0.0F})
      points.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  writeText("scan.bin", points);
  const std::vector<std::string> arguments = {"map",     "--scans", path("scan.bin"), "--tool", "builtin:pencil",
                                              "--voxel", "0.2",     "--directions",   "4",      "--allow-hidden-tool"};
  EXPECT_NEAR(ratio(arguments), 1, kTrusted);
}

/// A small patch, so that a large tool's tables dominate memory.
TEST_F(MemoryMeasured, ALargeToolTakesWhatWasPredicted) {
  std::string xyz;
  for (int n = 0; n < 400; ++n) {
    xyz += "2 " + std::to_string(-0.1 + 0.01 * (n % 20)) + " " + std::to_string(-0.1 + 0.01 * (n / 20)) + "\n";
  }
  writeText("scan.ply",
            "ply\nformat ascii 1.0\nelement vertex 400\nproperty float x\nproperty float y\nproperty float z\n"
            "end_header\n" +
                xyz);
  for (const auto& [voxel, directions] : {std::pair{"0.005", "90"}, std::pair{"0.002", "18"}}) {
    EXPECT_NEAR(ratio({"map", "--scans", path("scan.ply"), "--sensor-at", "0,0,0", "--tool", "builtin:pruner",
                       "--range-noise", "0", "--voxel", voxel, "--directions", directions}),
                1, kTrusted)
        << voxel;
  }
}

}  // namespace
}  // namespace accessvdb::cli_test
