// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The program as shipped, with the CUDA runtime, with all kinds of broken drivers (stub_driver.c).
#include <gtest/gtest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <ostream>

#include "cli/program_run.h"

namespace accessvdb::cli_test {
namespace {

struct Driver {
  const char* what;
  const char* version;  ///< STUB_DRIVER_VERSION
  const char* answer;   ///< STUB_DRIVER_INIT
  const char* id;
  const char* words;    ///< expected in the message
  bool warned;          ///< false: only a notice, because no GPU is expected
  bool loaded = false;  ///< the kernel has its part of the driver
};

void PrintTo(const Driver& driver, std::ostream* out) { *out << driver.what; }

constexpr Driver kDrivers[] = {
    {"none", "0", "0", "device.no_driver", "no NVIDIA driver is installed", false},
    {"without its library", "0", "0", "device.no_library",
     "the NVIDIA driver is loaded, but its library libcuda.so.1 is missing here", true, true},
    {"too old", "11040", "0", "device.old_driver", "the NVIDIA driver knows CUDA 11.4, this program needs ", true},
    {"no GPU", "99000", "100", "device.missing", "no NVIDIA GPU can be used here", true},
    {"not ready", "99000", "802", "device.failed", "the NVIDIA driver does not start", true},
    {"broken", "99000", "999", "device.failed", "the NVIDIA driver does not start", true},
    {"no memory", "99000", "2", "device.failed", "the NVIDIA driver does not start", true},
};

class StubDriver : public ProgramTest, public ::testing::WithParamInterface<Driver> {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans();
    writePoses();
    const char* before = std::getenv("LD_LIBRARY_PATH");
    before_ = before != nullptr ? before : "";
    setenv("LD_LIBRARY_PATH",
           (std::string(ACCESSVDB_STUB_DRIVER_FOLDER) + (before_.empty() ? "" : ":" + before_)).c_str(), 1);
    setenv("STUB_DRIVER_VERSION", GetParam().version, 1);
    setenv("STUB_DRIVER_INIT", GetParam().answer, 1);
    if (!GetParam().loaded) return;
    setenv("STUB_DRIVER_LOADED", "1", 1);
    setenv("LD_PRELOAD", ACCESSVDB_STUB_DRIVER_FOLDER "/libcuda.so.1", 1);
  }
  void TearDown() override {
    unsetenv("STUB_DRIVER_VERSION");
    unsetenv("STUB_DRIVER_INIT");
    unsetenv("STUB_DRIVER_LOADED");
    unsetenv("LD_PRELOAD");
    before_.empty() ? unsetenv("LD_LIBRARY_PATH") : setenv("LD_LIBRARY_PATH", before_.c_str(), 1);
    ProgramTest::TearDown();
  }
  nlohmann::json report() const { return nlohmann::json::parse(readText("out/report.json")); }
  static std::size_t count(const std::string& text, const std::string& what) {
    std::size_t found = 0;
    for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++found;
    return found;
  }
  std::string before_;
};

TEST_P(StubDriver, CudaEndsWithCodeSixAndOneLine) {
  const ProgramResult result = runProgram(mapArguments({"--device", "cuda"}));
  EXPECT_EQ(result.exit_code, 6) << result.err;
  EXPECT_EQ(count(result.err, "error["), 1u) << result.err;
  EXPECT_NE(result.err.find(std::string("error[") + GetParam().id + "] cuda: " + GetParam().words), std::string::npos)
      << result.err;
  EXPECT_NE(result.err.find("--device cpu"), std::string::npos) << result.err;
  EXPECT_EQ(listing("out"), std::vector<std::string>{"report.json"});
  EXPECT_EQ(report().at("exit_code"), 6);
  EXPECT_EQ(report().at("error").at("id"), GetParam().id);
}

TEST_P(StubDriver, AutoRunsOnTheCpuAndSaysWhy) {
  const ProgramResult result = runProgram(mapArguments({"--device", "auto"}));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(count(result.err, GetParam().words), 1u) << result.err;
  EXPECT_EQ(report().at("device"), "cpu");
  EXPECT_EQ(report().at("device_note").at("id"), GetParam().id);
  EXPECT_EQ(count(report().at("device_note").at("text"), GetParam().words), 1u);
  std::size_t warnings = 0;
  const nlohmann::json all = report();
  for (const auto& warning : all.at("warnings")) warnings += warning.at("id") == GetParam().id;
  EXPECT_EQ(warnings, GetParam().warned ? 1u : 0u) << result.err;
  EXPECT_GT(report().at("counts").at("accessible").get<int>() + report().at("counts").at("blocked").get<int>(), 0);
}

TEST_P(StubDriver, CpuDoesNotAskForADriver) {
  const ProgramResult result = runProgram(mapArguments({"--device", "cpu"}));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.err.find(GetParam().words), std::string::npos) << result.err;
  EXPECT_FALSE(report().contains("device_note"));
}

INSTANTIATE_TEST_SUITE_P(Drivers, StubDriver, ::testing::ValuesIn(kDrivers), [](const auto& driver) {
  std::string name = driver.param.what;
  std::erase(name, ' ');
  return name;
});

}  // namespace
}  // namespace accessvdb::cli_test
