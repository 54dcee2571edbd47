// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `live --rolling`: checkpoints, words and files of a live map in tiles.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "accessvdb/live_session.h"
#include "options/live_options.h"
#include "output/error_output.h"
#include "output/report.h"
#include "runs/rolling_words.h"
#include "runs/tile_job.h"

namespace accessvdb::tools {

class RollingLive {
 public:
  /// @param report  gets what an earlier run took, and the result
  /// @param settings  planSettings()
  RollingLive(const LiveRunOptions& options, PlanSettings settings, RunReport& report, Messages& messages);

  /// Before the session is made: whether both folders will do. @throws OutputError
  void prepare();
  /// Sets what the session needs. @throws InputError, OutputError where --rolling and --resume do not fit the folder
  void addTo(LiveOptions& options) const;
  /// Once the session is there. @throws UnusableInput if the folder is not that of a live run
  void begin(LiveSession& session);
  /// After each try of a step: a checkpoint when its time has come. @param taken  whether there was one
  void afterStep(LiveSession& session, bool taken);
  /// @throws OutputError
  void checkpoint(RollingField& field);
  /// Whether the run may go on after this failure of a step.
  [[nodiscard]] bool goesOnAfter(const Error& error);
  /// The last checkpoint, and the files. @pre it has points
  void finish(RollingField& field);

 private:
  /// With each checkpoint: whose folder it is, and the frame of its poses.
  [[nodiscard]] std::string note() const;
  void sayDisk(const std::string& problem);
  void sayFrame(const std::string& frame);
  void tryCheckpoint(RollingField& field);

  const LiveRunOptions& options_;
  PlanSettings settings_;
  RunReport& report_;
  Messages& messages_;
  RollingWords words_;
  double every_s_ = 0;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
  std::uint64_t saved_steps_ = 0;  ///< of the field, in its last checkpoint
  std::string frame_;              ///< of the poses, in this run or the one that it goes on with
  bool disk_failed_ = false, said_frame_ = false;
  int said_disk_ = 0;
};

/// @throws InvalidArgument "usage.rolling"
void requireRollingPossible(const LiveRunOptions& options);

}  // namespace accessvdb::tools
