// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The predicted peak of a run against the peak that the run then had.
#include <gtest/gtest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

/// The whole prediction is to be trusted to a quarter; on these scans it came within 5 % when this was written. The
/// bound is held both ways, so that a prediction that grows with everything fails too.
constexpr double kTrusted = 0.15;

class MemoryMeasured : public ProgramTest {
 protected:
  /// @return predicted / measured
  double ratio(const std::string& scans, const std::string& voxel, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {
        "map",    "--scans",        scans,          "--poses", scans + "/alidarPose.csv",
        "--tool", "builtin:pencil", "--directions", "4",       "--device",
        "cpu",    "--voxel",        voxel,          "--out",   path("out")};
    arguments.insert(arguments.end(), more.begin(), more.end());
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
  // Every third scan, so that the finer run stays short.
  EXPECT_NEAR(ratio(scans, "0.05", {}), 1, kTrusted);
  EXPECT_NEAR(ratio(scans, "0.02", {"--every", "3", "--surface"}), 1, kTrusted);
}

}  // namespace
}  // namespace accessvdb::cli_test
