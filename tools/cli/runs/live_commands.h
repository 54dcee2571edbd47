// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Commands to a live run: JSON from whoever can send, in bounded numbers; and what each was answered.
///
///     {"id": 7, "command": "remove", "box": [1.2, 0, 0.5, 1.6, 0.4, 1.1], "as": "free"}
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/region.h"
#include "output/report.h"

namespace accessvdb::tools {

enum class LiveCommandKind { Save, Checkpoint, Reset, Remove, Pause, Resume };

struct LiveCommand {
  LiveCommandKind kind = LiveCommandKind::Save;
  std::string id = "null";                                                           ///< as JSON
  Eigen::Vector3d min_W = Eigen::Vector3d::Zero(), max_W = Eigen::Vector3d::Zero();  ///< of Remove
  RemovedAs removed_as = RemovedAs::Unknown;
};

class LiveCommands {
 public:
  /// From threads of the middleware. What is no command is answered in words.
  void receive(const std::string& text);
  /// The oldest that has no answer yet.
  [[nodiscard]] std::optional<LiveCommand> next();
  /// @param words  what was done, or why not
  void answer(const LiveCommand& command, bool done, const std::string& words);
  /// Of all so far, with the latest answers; and whether there are answers that were not asked for before.
  [[nodiscard]] LiveCommandReport report() const;
  [[nodiscard]] bool takeNews();

 private:
  void add(LiveAnswer answer);

  mutable std::mutex lock_;
  std::deque<LiveCommand> waiting_;
  LiveCommandReport report_;
  bool news_ = false;
};

}  // namespace accessvdb::tools
