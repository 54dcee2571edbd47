// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A process that maps tile after tile for a parent: starting one for each tile costs more than many tiles do, most of
/// all where it has to make a context on a GPU.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

namespace accessvdb::tools {

/// Lines of standard input, as a parent writes them. When it ends, for whatever reason, a tile that is being mapped is
/// stopped as by SIGTERM, so that nothing outlives the parent.
class TileRequests {
 public:
  TileRequests();

  /// Waits for a line. @return nothing at the end of standard input, after a stop signal, or if none comes for `idle`:
  /// a parent that is elsewhere does not hold memory and GPU
  /// @throws InvalidArgument "usage.worker" if it ended with names that were not taken, or within one
  [[nodiscard]] std::optional<std::string> next(std::chrono::milliseconds idle);

 private:
  struct Lines {
    std::mutex mutex;
    std::condition_variable changed;
    std::deque<std::string> waiting;
    bool ended = false, cut_off = false, busy = false;
  };
  static void read(Lines& lines);

  std::shared_ptr<Lines> lines_;  ///< also of the thread, which waits for input until the process ends
};

}  // namespace accessvdb::tools
