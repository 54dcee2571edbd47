// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Progress of a long job: a bar on a terminal, an occasional plain line elsewhere, nothing with --quiet or JSON.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

#include "accessvdb/table_progress.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// Whether a job that is done soon shows anything.
enum class ShowShort { Yes, No };

[[nodiscard]] inline double secondsSince(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}
/// "12.3 s"
[[nodiscard]] std::string secondsInWords(double seconds);

class Progress {
 public:
  Progress(const Messages& messages, std::string label, std::size_t total, ShowShort show_short = ShowShort::Yes);
  ~Progress() { finish(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void show(std::size_t done, const std::string& detail = {});
  /// Ends the bar's line; other output may follow.
  void finish();

 private:
  using Clock = std::chrono::steady_clock;
  bool enabled_, terminal_, wait_, open_line_ = false;
  std::string label_;
  std::size_t total_;
  Clock::time_point start_, last_;
};

/// Shows tables of tools that take long. @param messages  must outlive it
[[nodiscard]] TableProgress tableProgress(const Messages& messages);

}  // namespace accessvdb::tools
