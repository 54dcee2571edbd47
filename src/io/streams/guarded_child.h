// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Runs code that may crash, hang or eat memory in a child process with limits.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>

namespace accessvdb::internal {

struct ChildLimits {
  std::chrono::seconds time{30};
  std::uint64_t extra_memory_bytes = std::uint64_t{1} << 30;  ///< beyond what this process has mapped
};

struct ChildResult {
  bool ok = false;
  std::string text;  ///< what the job returned, or why there is no result
};

/// Forks, runs `job` there, silently, and returns its text. A crash, a time-out or an exception becomes ok = false.
/// The child has none of this process's other threads, but every lock that they held, so a job must not need TBB:
/// no parallel function, and no OpenVDB tree with nodes may be freed (Tree::clear() is parallel, RootNode::clear() is
/// not). An exception that the job does not catch ends the child without unwinding, hence frees no tree either.
[[nodiscard]] ChildResult runInChild(const ChildLimits& limits, const std::function<std::string()>& job);

}  // namespace accessvdb::internal
