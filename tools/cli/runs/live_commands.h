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

#include "accessvdb/approaches.h"
#include "accessvdb/next_views.h"
#include "accessvdb/region.h"
#include "output/report.h"

namespace accessvdb::tools {

enum class LiveCommandKind { Save, Checkpoint, Reset, Remove, Pause, Resume, Approaches, Views };

struct LiveCommand {
  LiveCommandKind kind = LiveCommandKind::Save;
  std::string id = "null";                                                           ///< as JSON
  Eigen::Vector3d min_W = Eigen::Vector3d::Zero(), max_W = Eigen::Vector3d::Zero();  ///< of Remove
  RemovedAs removed_as = RemovedAs::Unknown;
  ApproachOptions approach = {};  ///< of Approaches
  ViewOptions view = {};          ///< of Views
};

class LiveCommands {
 public:
  /// From threads of the middleware. What is no command is answered in words.
  void receive(const std::string& text);
  /// From now on next() gives those that wait now, and no more than a few: scans have their turn, too.
  void beginTurn();
  static constexpr std::size_t kMostOfTurn = 8;
  /// The oldest that has no answer yet, as long as the turn goes on.
  [[nodiscard]] std::optional<LiveCommand> next();
  /// @param words  what was done, or why not
  void answer(const LiveCommand& command, bool done, const std::string& words);
  /// Of all so far, with the latest kOfPage answers.
  [[nodiscard]] LiveCommandReport report() const;
  /// The same to be published, as often as it takes until each answer that was not was in one.
  [[nodiscard]] std::vector<LiveCommandReport> takePages();
  /// Whether there are answers that were not in one.
  [[nodiscard]] bool hasNews() const;
  static constexpr std::size_t kOfPage = 32;

 private:
  void add(LiveAnswer answer);
  void forgetOld();
  [[nodiscard]] LiveCommandReport page(std::size_t end) const;

  mutable std::mutex lock_;
  std::deque<LiveCommand> waiting_;
  std::size_t of_turn_ = 0;
  LiveCommandReport report_;        ///< without answers
  std::deque<LiveAnswer> answers_;  ///< the last ones have not been published
  std::size_t unpublished_ = 0;
};

}  // namespace accessvdb::tools
