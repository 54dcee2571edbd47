// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is left out blocks on a GPU, too, as it does on the CPU.
#include "parity/gpu_test.h"
#include "support/limited_worlds.h"

namespace accessvdb::test {
namespace {

class CudaLeftOut : public GpuTest {};

TEST_F(CudaLeftOut, LabelsAreThoseOfTheCpuAndAmongThoseOfAFieldThatGrows) {
  LimitCounts counts;
  const std::uint64_t worlds = worldCount(100);
  for (std::uint64_t number = 0; number < worlds; ++number) {
    SCOPED_TRACE("world " + std::to_string(number));
    expectContained(number, BackendKind::Cuda, counts);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(counts.left_out, 100 * worlds);
  EXPECT_GT(counts.limited, counts.steps);
}

}  // namespace
}  // namespace accessvdb::test
