// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A budget takes access away, and gives none: after every update its accessible points are among those of the same
/// stream in a field without a budget. Points that wait are unscored, exactly those, and the others are equal.
#include "support/waiting_points.h"

namespace accessvdb::test {
namespace {

ToldArrays viewOf(const AccessibilityField& field) {
  const auto [position, normal, stability, score, direction, weight, label, reason, count, roll] =
      field.hostView().points;
  return {{label, label + count}, {reason, reason + count}, {score, score + count}, {direction, direction + count}};
}

class WaitingPoints : public testing::TestWithParam<WaitingCase> {};

TEST_P(WaitingPoints, AreUnscoredAndTheOthersAsWithoutABudget) {
  for (std::uint64_t seed = 1; seed <= 4 && !HasFailure(); ++seed) {
    SCOPED_TRACE(seed);
    expectOnlyWithheld(GetParam(), seed, BackendKind::Cpu, viewOf);
  }
}

INSTANTIATE_TEST_SUITE_P(Streams, WaitingPoints, testing::ValuesIn(waitingCases()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace accessvdb::test
