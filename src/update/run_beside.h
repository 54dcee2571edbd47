// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Runs two steps of a frame concurrently.
#pragma once

#include <tbb/task_group.h>

#include <exception>

namespace accessvdb::internal {

/// Runs `here` on the calling thread and `beside` on any free thread, or afterwards on this one if none is free. Both
/// run to completion even if the other fails: otherwise TBB would cancel the other step's loops half-way, and that step
/// would continue with unfinished data. Rethrows what `beside` threw, else what `here` threw: when the backend's step
/// is `here`, a failure of the host must not be hidden.
template <typename Here, typename Beside>
void runBeside(const Here& here, const Beside& beside) {
  std::exception_ptr failed_here, failed_beside;
  const auto kept = [](const auto& step, std::exception_ptr& failed) noexcept {
    try {
      step();
    } catch (...) {
      failed = std::current_exception();
    }
  };
  tbb::task_group group;
  group.run([&] { kept(beside, failed_beside); });
  kept(here, failed_here);
  group.wait();
  if (failed_beside) std::rethrow_exception(failed_beside);
  if (failed_here) std::rethrow_exception(failed_here);
}

}  // namespace accessvdb::internal
