// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A live session measures whether its scans agree, as `map` does before it maps.
#include <cmath>
#include <numbers>

#include "accessvdb/live_session.h"
#include "accessvdb/program/scan_agreement.h"
#include "accessvdb/tool_geometry.h"
#include "inputs/field_world.h"

namespace accessvdb::inputs_test {
namespace {

io::ScanAgreement agreementOf(const std::vector<WorldScan>& scans, const Eigen::Isometry3d& error) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.1;
  params.tsdf.range_noise_m = 0.01;
  LiveSession session(ToolGeometry::builtin("builtin:pruner"), params);
  for (const WorldScan& scan : scans) {
    const auto stamp_ns = static_cast<std::int64_t>(std::llround(scan.stamp_s * 1e9));
    const Eigen::Isometry3d T = scan.T_W_S * error;
    session.addPose({stamp_ns, T.translation(), Eigen::Quaterniond(T.linear())});
    LiveScan live = {stamp_ns};
    for (const Eigen::Vector3d& p_S : scan.points_S()) live.points.push_back(p_S.cast<float>());
    session.addScan(std::move(live));
    EXPECT_TRUE(session.step());
  }
  return session.agreement();
}

TEST(LiveAgreement, IsUsualWherePosesAreRight) {
  const io::ScanAgreement agreement = agreementOf(worldScans(), Eigen::Isometry3d::Identity());
  EXPECT_EQ(agreement.verdict, io::AgreementVerdict::Usual);
  EXPECT_GT(agreement.scans, 2u);
}

TEST(LiveAgreement, NamesASensorThatIsTurned) {
  const io::ScanAgreement agreement =
      agreementOf(worldScans(), Eigen::Isometry3d(Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitX())));
  EXPECT_EQ(agreement.verdict, io::AgreementVerdict::Disagree);
  ASSERT_TRUE(agreement.cure);
  EXPECT_EQ(agreement.cure->fault, io::PoseFault::Turned);
  EXPECT_EQ(agreement.cure->axis, 0);
  EXPECT_EQ(agreement.cure->value, -90);
}

TEST(LiveAgreement, GoesOnAfterTheFirstScans) {
  // A flight that is right at first: the answer is of the latest scans that were compared.
  std::vector<WorldScan> scans;
  for (int lap = 0; lap < 5; ++lap) {
    for (WorldScan scan : worldScans(600, 1700000000 + 10 * lap)) {
      if (lap >= 2) scan.T_W_S = scan.T_W_S * Eigen::AngleAxisd(-std::numbers::pi / 2, Eigen::Vector3d::UnitZ());
      scans.push_back(std::move(scan));
    }
  }
  // What the sensor measures does not change with the poses that are said of it.
  const std::vector<WorldScan> right = worldScans(600);
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const std::vector<Eigen::Vector3d> seen_S = right[i % 8].points_S();
    for (std::size_t k = 0; k < seen_S.size(); ++k) scans[i].points_W[k] = scans[i].T_W_S * seen_S[k];
  }
  const io::ScanAgreement agreement = agreementOf(scans, Eigen::Isometry3d::Identity());
  EXPECT_NE(agreement.verdict, io::AgreementVerdict::Usual);
}

}  // namespace
}  // namespace accessvdb::inputs_test
