// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A field looks only at points that may have changed, and tells exactly those that have: as a comparison of all
/// points.
#include "support/told_changes.h"

namespace accessvdb::test {
namespace {

class ToldChanges : public testing::TestWithParam<ToldCase> {};

TEST_P(ToldChanges, AreThoseOfAComparisonOfAllPoints) {
  ToldTally tally;
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u, 5u, 12u}) {
    SCOPED_TRACE(seed);
    expectToldAsCompared(GetParam(), seed, BackendKind::Cpu, tally);
  }
  expectAllKinds(GetParam(), tally);
}

INSTANTIATE_TEST_SUITE_P(Streams, ToldChanges, testing::ValuesIn(toldCases()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace accessvdb::test
