// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a live run says while it goes on: how it goes, and what is likely not meant, each once.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "dds/participant.h"
#include "options/live_options.h"
#include "output/error_output.h"

namespace accessvdb::tools {

/// By dds::Input.
using LiveInputs = std::array<dds::TopicState, dds::kNumInputs>;

/// What --budget-ms came to, at the end; empty without it.
[[nodiscard]] std::string budgetInWords(const LiveStatus& status);

class LiveWords {
 public:
  LiveWords(const LiveRunOptions& options, Messages& messages) : options_(options), messages_(messages) {}

  /// Warnings and notices that follow from it.
  void tell(const LiveStatus& status);
  /// One line about how it goes, not kept for the report.
  void sayProgress(const LiveStatus& status, const dds::Participant& participant) const;
  [[nodiscard]] std::string progressInWords(const LiveStatus& status, const LiveInputs& inputs) const;

 private:
  void warnOfAllClosed(const LiveStatus& status);
  void warnOfNoneTaken(const LiveStatus& status);
  void sayFrames(const LiveStatus& status);

  const LiveRunOptions& options_;
  Messages& messages_;
  bool said_full_ = false, said_closed_ = false, said_imu_ = false, said_far_ = false, said_unconnected_ = false;
  std::string said_motion_, said_chain_;
  int changes_said_ = 0;
  // To see when no scan is taken any more: what was dropped when the last one was, and when looked at last.
  std::uint64_t taken_before_ = 0, times_dropped_ = 0;
  std::array<std::uint64_t, kNumScanDrops> dropped_before_ = {}, dropped_last_ = {};
  std::array<bool, kNumScanDrops> said_dropped_ = {};
};

}  // namespace accessvdb::tools
