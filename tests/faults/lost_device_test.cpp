// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The program when its GPU fails: exit code, the one line, the report, and what is saved. On a fake device, so the
// labels are meaningless; the points that they belong to are not.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "cli/program_run.h"

namespace accessvdb::cli_test {
namespace {

const std::vector<std::string> kAll = {"field.vdb", "field_points.vdb", "points.ply", "preview.png", "report.json"};

class LostDevice : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
  }
  void TearDown() override {
    unsetenv("ACCESSVDB_TEST_FAULT");
    ProgramTest::TearDown();
  }
  /// @param fault  "NTH CODE CALL|any [lost]", with codes of cudaError_t: 2 no memory, 209 no image, 719 launch failed
  ProgramResult runWith(const std::string& fault, const std::vector<std::string>& more) {
    fault.empty() ? unsetenv("ACCESSVDB_TEST_FAULT") : setenv("ACCESSVDB_TEST_FAULT", fault.c_str(), 1);
    return runProgram(mapArguments(more));
  }
  nlohmann::json report() const { return nlohmann::json::parse(readText("out/report.json")); }
  static int errorLines(const std::string& text) {
    int lines = 0;
    for (std::size_t at = text.find("error["); at != std::string::npos; at = text.find("error[", at + 1)) ++lines;
    return lines;
  }
};

TEST_F(LostDevice, TheFakeRunsThrough) {
  const ProgramResult result = runWith("", {"--device", "cuda"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(report().at("device"), "cuda:a fake");
  EXPECT_FALSE(report().contains("device_note"));
  EXPECT_EQ(listing("out"), kAll);
}

TEST_F(LostDevice, WhileScoringIsCodeSixAndSavesWhatWasFused) {
  ASSERT_EQ(runWith("", {"--device", "cpu"}).exit_code, 0);
  const auto on_cpu = report().at("counts");
  for (const char* device : {"cuda", "auto"}) {
    std::filesystem::remove_all(folder_ / "out");
    const ProgramResult result = runWith("1 719 cudaStreamWaitEvent lost", {"--device", device});
    EXPECT_EQ(result.exit_code, 6) << result.err;
    EXPECT_EQ(errorLines(result.err), 1) << result.err;
    EXPECT_NE(result.err.find("error[device.failed] cuda: "), std::string::npos) << result.err;
    EXPECT_NE(result.err.find("warning[device.unscored] saved what was fused of 4 of 4 scans"), std::string::npos)
        << result.err;
    EXPECT_EQ(listing("out"), kAll);
    EXPECT_EQ(report().at("exit_code"), 6);
    EXPECT_EQ(report().at("error").at("id"), "device.failed");
    EXPECT_EQ(report().at("device"), "cuda:a fake");
    const auto counts = report().at("counts");
    EXPECT_EQ(counts.at("scans"), 4);
    EXPECT_EQ(counts.at("points_used"), on_cpu.at("points_used"));
    EXPECT_EQ(counts.at("surface_points"), on_cpu.at("surface_points"));
    EXPECT_EQ(counts.at("unscored"), on_cpu.at("surface_points"));
    EXPECT_EQ(counts.at("accessible"), 0);
    EXPECT_EQ(counts.at("blocked"), 0);
    EXPECT_EQ(runProgram({"info", path("out")}).exit_code, 0);
  }
}

/// The device fails at its nth kernel: the first ones belong to the set-up, later ones to the scans.
TEST_F(LostDevice, WhileFusingSavesTheScansBefore) {
  bool fusing = false;
  for (int nth = 1; nth <= 40 && !fusing; ++nth) {
    SCOPED_TRACE(nth);
    std::filesystem::remove_all(folder_ / "out");
    const ProgramResult result = runWith(std::to_string(nth) + " 719 launch lost", {"--device", "cuda"});
    EXPECT_EQ(result.exit_code, 6) << result.err;
    EXPECT_EQ(errorLines(result.err), 1) << result.err;
    const auto counts = report().at("counts");
    EXPECT_EQ(listing("out"), counts.at("scans") > 0 ? kAll : std::vector<std::string>{"report.json"});
    EXPECT_EQ(counts.at("accessible"), 0);
    fusing = counts.at("scans") > 0 && counts.at("scans") < 4;
  }
  EXPECT_TRUE(fusing);
}

/// What is kept on the device is made again after a removal. Whichever of its allocations fails, the run says so.
TEST_F(LostDevice, WhileRemovingIsSaidAndSavesToo) {
  bool ended = false, saved = false;
  for (int nth = 1; nth <= 200 && !ended; ++nth) {
    SCOPED_TRACE(nth);
    std::filesystem::remove_all(folder_ / "out");
    const ProgramResult result =
        runWith(std::to_string(nth) + " 2 cuMemAddressReserve lost",
                {"--device", "cuda", "--remove", "box:1.9,-0.5,-0.5,2.1,0.5,0.5", "--width", "160", "--height", "120"});
    if (result.exit_code == 0) {
      ended = true;
      continue;
    }
    EXPECT_EQ(result.exit_code, 5) << result.signal << result.err;
    EXPECT_EQ(errorLines(result.err), 1) << result.err;
    const auto counts = report().at("counts");
    saved = counts.at("scans") == 4 && listing("out") == kAll;
  }
  EXPECT_TRUE(ended) << "more than 200 allocations";
  EXPECT_TRUE(saved) << "the last one does not belong to the removal";
}

TEST_F(LostDevice, FramesOfASequenceStay) {
  // Each update waits for an event four times: for flips and points, and for what follows from the flips; for what
  // moved, and for the map of busy leaves. On a fake device no point is ever due, so there is no search.
  const ProgramResult result = runWith("9 719 cudaStreamWaitEvent lost", {"--device", "cuda", "--sequence", "1"});
  EXPECT_EQ(result.exit_code, 6) << result.err;
  const std::vector<std::string> files = listing("out");
  EXPECT_NE(std::find(files.begin(), files.end(), "field_0002.vdb"), files.end());
  EXPECT_EQ(std::find(files.begin(), files.end(), "field_0003.vdb"), files.end());
  EXPECT_EQ(report().at("counts").at("scans"), 3);
}

TEST_F(LostDevice, WithoutMemoryInTheMiddleIsCodeFiveAndSavesToo) {
  const ProgramResult result = runWith("1 2 cudaStreamWaitEvent lost", {"--device", "cuda"});
  EXPECT_EQ(result.exit_code, 5) << result.err;
  EXPECT_NE(result.err.find("error[memory.device] cuda: "), std::string::npos) << result.err;
  EXPECT_EQ(listing("out"), kAll);
  EXPECT_EQ(report().at("counts").at("accessible"), 0);
}

TEST_F(LostDevice, WhatCannotBeSavedDoesNotHideTheLoss) {
  ProgramSetup setup;
  setup.arguments = mapArguments({"--device", "cuda"});
  setup.file_size_limit = 16384;  // room for the report, not for the field
  setenv("ACCESSVDB_TEST_FAULT", "1 719 cudaStreamWaitEvent lost", 1);
  const ProgramResult result = runProgram(setup);
  EXPECT_EQ(result.exit_code, 6) << result.err;
  EXPECT_NE(result.err.find("warning[device.not_saved]"), std::string::npos) << result.err;
  EXPECT_EQ(errorLines(result.err), 1) << result.err;
  EXPECT_EQ(listing("out"), std::vector<std::string>{"report.json"});
}

TEST_F(LostDevice, AtTheStartAutoGoesOnOnTheCpu) {
  for (const auto& [fault, id] : {std::pair{"1 209 cudaFuncGetAttributes", "device.architecture"},
                                  {"1 35 cudaGetDeviceCount", "device.old_driver"},
                                  {"1 2 cudaMalloc", "memory.device"},
                                  {"1 2 cuMemAddressReserve lost", "memory.device"},
                                  {"1 2 cudaEventCreateWithFlags", "device.memory"},
                                  {"1 719 cudaMemcpyAsync lost", "device.failed"}}) {
    SCOPED_TRACE(fault);
    const ProgramResult result = runWith(fault, {"--device", "auto"});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    EXPECT_NE(result.err.find(std::string("warning[") + id + "] device: cpu, because "), std::string::npos)
        << result.err;
    EXPECT_EQ(report().at("device"), "cpu");
    EXPECT_EQ(report().at("device_note").at("id"), id);
    EXPECT_GT(report().at("counts").at("accessible").get<int>() + report().at("counts").at("blocked").get<int>(), 0);
    const ProgramResult cuda = runWith(fault, {"--device", "cuda"});
    EXPECT_EQ(cuda.exit_code, std::string(id) == "memory.device" ? 5 : 6) << cuda.err;
    EXPECT_NE(cuda.err.find(std::string("error[") + id + "] cuda: "), std::string::npos) << cuda.err;
    EXPECT_EQ(errorLines(cuda.err), 1) << cuda.err;
  }
}

}  // namespace
}  // namespace accessvdb::cli_test
