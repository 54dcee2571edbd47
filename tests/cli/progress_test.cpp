// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is shown of long jobs where stderr is no terminal.
#include "output/progress.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <thread>

namespace accessvdb::tools {
namespace {

template <typename Work>
std::string shown(const Work& work) {
  testing::internal::CaptureStderr();
  work();
  return testing::internal::GetCapturedStderr();
}

void makeTables(const TableProgress& progress, std::size_t total) {
  for (std::size_t done = 1; done <= total; ++done) progress(done, total);
}

TEST(Progress, TellsOfTheEndOfShortJobsUnlessToldNotTo) {
  const Messages messages(ErrorFormat::Text, false);
  EXPECT_EQ(shown([&] { Progress(messages, "counting", 3).show(3); }), "accessvdb: counting 3 of 3, 0 s left\n");
  EXPECT_EQ(shown([&] { Progress(messages, "counting", 3, ShowShort::No).show(3); }), "");
}

TEST(Progress, TablesThatAreMadeSoonAreNotMentioned) {
  const Messages messages(ErrorFormat::Text, false);
  EXPECT_EQ(shown([&] {
              const TableProgress progress = tableProgress(messages);
              for (const std::size_t total : {1, 180, 3228, 12}) makeTables(progress, total);
            }),
            "");
}

TEST(Progress, TablesThatTakeLongAreShownToTheirEnd) {
  const Messages text(ErrorFormat::Text, false), quiet(ErrorFormat::Text, true), json(ErrorFormat::Json, false);
  for (const Messages* messages : {&text, &quiet, &json}) {
    const std::string lines = shown([&] {
      const TableProgress progress = tableProgress(*messages);
      makeTables(progress, 100);  // of a tool before it
      progress(1, 200);
      std::this_thread::sleep_for(std::chrono::milliseconds(5100));
      progress(50, 200);
      progress(51, 200);
      progress(200, 200);
      makeTables(progress, 100);  // and of one after it
    });
    if (messages != &text) {
      EXPECT_EQ(lines, "");
      continue;
    }
    EXPECT_EQ(lines.find("accessvdb: making tables of the tool 50 of 200, "), 0u) << lines;
    EXPECT_NE(lines.find("\naccessvdb: making tables of the tool 200 of 200, 0 s left\n"), std::string::npos) << lines;
    EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 2) << lines;
  }
}

}  // namespace
}  // namespace accessvdb::tools
