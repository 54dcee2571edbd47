// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Who follows long-running work, and may stop it.
#pragma once

#include <functional>
#include <string>

namespace accessvdb::eval {

class StopRequested {};  ///< thrown if an Observer's `stop` requests it

/// Observes long-running work. Both are called from the thread that started it.
struct Observer {
  std::function<void(const std::string& line)> say = [](const std::string&) {};
  std::function<bool()> stop = [] { return false; };

  void checkStop() const {
    if (stop()) throw StopRequested();
  }
};

}  // namespace accessvdb::eval
