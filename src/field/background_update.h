// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Runs a field's update on a thread of its own, so that the field can take the next scan meanwhile.
///
/// An update passes two moments that others wait for: from "map free" on it reads neither the points nor the map on the
/// host any more, and at its end everything may change again.
#pragma once

#include <exception>
#include <functional>
#include <memory>

#include "accessvdb/update_ticket.h"
#include "field/work_thread.h"

namespace accessvdb::internal {

class BackgroundUpdate {
 public:
  using ReleaseMap = std::function<void()>;
  /// Calls its argument, from any thread, once it no longer reads the points and the map on the host; or never.
  using Work = std::function<UpdateStats(const ReleaseMap& release_map)>;

  /// Begins the work and returns; without memory for a thread, the work is done before. The destructor waits for it.
  /// @pre no update since the last take()
  [[nodiscard]] UpdateTicket start(Work work);
  /// Whether one was started since the last take().
  [[nodiscard]] bool begun() const { return running_ != nullptr; }
  /// Waits until the map is free or the update has ended.
  void waitForMap() const;
  /// Waits for the update started last, and forgets it. @return what it threw; null if nothing, or if there is none
  std::exception_ptr take();

 private:
  static void run(const Work& work, UpdateState& state);

  std::shared_ptr<UpdateState> running_;  ///< started and not yet taken; only for the field's own thread
  WorkThread thread_;
};

}  // namespace accessvdb::internal
