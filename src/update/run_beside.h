// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Two steps of a frame at the same time.
#pragma once

#include <tbb/task_group.h>

#include <exception>

namespace accessvdb::internal {

/// Runs `here` on the calling thread and `beside` on whichever thread has time, on this one afterwards where none has.
/// Both run to their ends, also where the other one fails: TBB would cancel the loops of the other half-way, which then
/// goes on with what they left undone. Throws what `beside` threw, else what `here` threw: where the backend's step is
/// here, a failure of the host is the one that must not be hidden.
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
