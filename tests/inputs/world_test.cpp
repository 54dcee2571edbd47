// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The scene of these tests, given as it is: what the others are compared with.
#include "inputs/field_world.h"

namespace accessvdb::inputs_test {
namespace {

TEST_F(InputTest, TheSceneItselfIsRight) {
  writeNumberedScans(worldScans());
  const MapOutcome outcome = map({"--scans", path("scans"), "--poses", path("poses.txt")});
  expectRight(outcome);
  EXPECT_EQ(outcome.program.err.find("warning["), std::string::npos) << outcome.program.err;
}

TEST_F(InputTest, PhantomsAreCounted) {
  std::vector<WorldScan> scans = worldScans();
  for (WorldScan& scan : scans)
    for (Eigen::Vector3d& p : scan.points_W) p.x() += 0.3;
  writeNumberedScans(scans);
  EXPECT_GT(map({"--scans", path("scans"), "--poses", path("poses.txt")}).phantoms, 0u);
}

}  // namespace
}  // namespace accessvdb::inputs_test
