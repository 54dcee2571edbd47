// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Agreement of labels by voxel, against hand-computed figures, and the whole measurement on small scans.
#include "runs/label_agreement.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;
using enum PointLabel;

constexpr double kVoxel_m = 0.05;

FieldSnapshot fieldOf(const Vector3d& origin_W, const std::vector<std::pair<Vector3d, PointLabel>>& points) {
  FieldSnapshot field;
  field.origin_W = origin_W;
  field.voxel_size_m = kVoxel_m;
  for (const auto& [position_W, label] : points) {
    SurfacePoint point;
    point.position_W = position_W;
    point.label = label;
    field.points.push_back(point);
  }
  return field;
}

/// Centre of voxel (i, j, k) of the world, moved by up to 0.4 voxels, differently for each.
Vector3d inVoxel(int i, int j, int k, double shift) {
  return kVoxel_m * Vector3d(i + 0.4 * shift, j - 0.4 * shift, k + 0.3 * shift);
}

TEST(Consistency, KappaAndSharesAreThoseOfTheTextbook) {
  // 20 accessible in both, 5 only in the first, 10 only in the second, 15 blocked in both: agreement 0.7, by chance
  // 0.5 * 0.6 + 0.5 * 0.4 = 0.5, so kappa 0.4 (the usual example of Cohen's kappa).
  std::vector<std::pair<Vector3d, PointLabel>> first, second;
  const auto add = [&](int count, PointLabel a, PointLabel b) {
    for (int n = 0; n < count; ++n) {
      const int i = static_cast<int>(first.size());
      first.emplace_back(inVoxel(i, -i, 7, 1), a);
      second.emplace_back(inVoxel(i, -i, 7, -1), b);
    }
  };
  add(20, Accessible, Accessible);
  add(5, Accessible, Blocked);
  add(10, Blocked, Accessible);
  add(15, Blocked, Blocked);
  add(3, Unscored, Accessible);
  add(4, Blocked, Unscored);
  first.emplace_back(inVoxel(900, 0, 0, 0), Accessible);
  first.emplace_back(inVoxel(-900, 0, 0, 0), Blocked);
  second.emplace_back(inVoxel(901, 0, 0, 0), Accessible);
  std::reverse(second.begin(), second.end());  // ids are irrelevant
  // Maps start at their first scan: different origins, the same voxels.
  const LabelAgreement agreement =
      compareByVoxel(fieldOf(kVoxel_m * Vector3d(3, -8, 1), first), fieldOf(kVoxel_m * Vector3d(-40, 2, 11), second));
  EXPECT_EQ(agreement.compared(), 50u);
  EXPECT_DOUBLE_EQ(agreement.agreementPercent(), 70);
  EXPECT_DOUBLE_EQ(agreement.accessiblePercentOfFirst(), 50);
  EXPECT_DOUBLE_EQ(agreement.accessiblePercentOfSecond(), 60);
  EXPECT_DOUBLE_EQ(agreement.precisionPercent(), 80);
  EXPECT_NEAR(agreement.recallPercent(), 100 * 20 / 30.0, 1e-12);
  ASSERT_TRUE(agreement.kappa().has_value());
  EXPECT_NEAR(*agreement.kappa(), 0.4, 1e-12);
  EXPECT_EQ(agreement.voxels[static_cast<std::size_t>(Unscored)][static_cast<std::size_t>(Accessible)], 3u);
  EXPECT_EQ(agreement.voxels[static_cast<std::size_t>(Blocked)][static_cast<std::size_t>(Unscored)], 4u);
  EXPECT_EQ(agreement.only_first, 2u);
  EXPECT_EQ(agreement.only_second, 1u);
}

TEST(Consistency, KappaIsOneForEqualAndNoneWhereItSaysNothing) {
  const FieldSnapshot both = fieldOf({0, 0, 0}, {{inVoxel(0, 0, 0, 0), Accessible}, {inVoxel(1, 0, 0, 0), Blocked}});
  EXPECT_DOUBLE_EQ(compareByVoxel(both, both).kappa().value(), 1);
  const FieldSnapshot one = fieldOf({0, 0, 0}, {{inVoxel(0, 0, 0, 0), Accessible}, {inVoxel(1, 0, 0, 0), Accessible}});
  EXPECT_FALSE(compareByVoxel(one, one).kappa().has_value());
  EXPECT_DOUBLE_EQ(compareByVoxel(one, one).agreementPercent(), 100);
  const LabelAgreement none = compareByVoxel(one, fieldOf({0, 0, 0}, {}));
  EXPECT_EQ(none.compared(), 0u);
  EXPECT_FALSE(none.kappa().has_value());
  EXPECT_EQ(none.agreementPercent(), 0);
  EXPECT_EQ(none.only_first, 2u);
  FieldSnapshot other = one;
  other.voxel_size_m = 0.1;
  EXPECT_THROW((void)compareByVoxel(one, other), InvalidArgument);
}

/// Scans of a wall with a post in front of it, as PCD with VIEWPOINT poses, in a separate folder.
class RecordedScans : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("accessvdb_consistency_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  void write(int scan) {
    const Vector3d q(0.1 * scan, 0.02 * scan, 0.03 * scan);
    std::vector<Vector3d> points;
    for (int i = -30; i <= 30; ++i) {
      for (int j = -20; j <= 20; ++j) {
        const Vector3d ray(2, i * 0.03 + 0.004 * scan, j * 0.03);
        const Vector3d hit = q + ray * ((2 - q.x()) / ray.x());
        const Vector3d at_post = q + ray * ((1.4 - q.x()) / ray.x());
        points.push_back((std::abs(at_post.y() - 0.3) < 0.1 ? at_post : hit) - q);
      }
    }
    std::ofstream file(folder_ / (std::to_string(scan) + ".pcd"));
    file << "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << points.size()
         << "\nHEIGHT 1\nVIEWPOINT " << q.x() << ' ' << q.y() << ' ' << q.z() << " 1 0 0 0\nPOINTS " << points.size()
         << "\nDATA ascii\n";
    for (const Vector3d& p : points) file << p.x() << ' ' << p.y() << ' ' << p.z() << '\n';
  }
  [[nodiscard]] io::ScanSequence scans() const {
    io::ScanInputOptions input;
    input.scans = folder_;
    input.pose_format = io::PoseFormat::Viewpoint;
    return io::ScanSequence::open(input);
  }
  [[nodiscard]] static FieldParams params() {
    FieldParams p;
    p.tsdf.voxel_size_m = kVoxel_m;
    return p;
  }

  fs::path folder_;
};

TEST_F(RecordedScans, HalvesAreMappedApartAndCompared) {
  for (int scan = 0; scan < 7; ++scan) write(scan);
  io::ScanSequence sequence = scans();
  ASSERT_EQ(sequence.size(), 7u);
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pruner");
  std::map<std::string, std::size_t> shown;
  ConsistencyHooks hooks;
  hooks.progress = [&](const std::string& part, std::size_t done, std::size_t total) {
    EXPECT_EQ(done, ++shown[part]);
    EXPECT_LE(done, total);
  };
  const auto result = measureConsistency(sequence, tool, params(), hooks);
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(shown, (std::map<std::string, std::size_t>{{"even scans", 4}, {"odd scans", 3}, {"all scans", 7}}));
  EXPECT_EQ(result->even.points_used + result->odd.points_used, result->all.points_used);

  // The same by hand: one field each, and the other's pointAt() at each point.
  AccessibilityField even(tool, params()), odd(tool, params());
  for (std::size_t n = 0; n < sequence.size(); ++n) {
    const io::ScanRecord record = sequence.read(n);
    (n % 2 == 0 ? even : odd).integrateScan(record.points_S, record.T_W_S);
  }
  even.update();
  odd.update();
  ASSERT_NE(even.origin_W(), odd.origin_W());
  LabelAgreement expected;
  const FieldSnapshot of_even = even.snapshot();
  for (const SurfacePoint& point : of_even.points) {
    const auto other = odd.pointAt(point.position_W);
    if (!other) {
      ++expected.only_first;
    } else {
      ++expected.voxels[static_cast<std::size_t>(point.label)][static_cast<std::size_t>(other->label)];
    }
  }
  EXPECT_EQ(result->even_odd.voxels, expected.voxels);
  EXPECT_EQ(result->even_odd.only_first, expected.only_first);
  EXPECT_EQ(result->even.labels[static_cast<std::size_t>(Accessible)], of_even.count(Accessible));
  EXPECT_GT(result->even_odd.compared(), 200u);
  EXPECT_GT(result->even_all.compared(), 200u);
  EXPECT_GT(expected.only_first, 10u);
  EXPECT_EQ(result->even_all.only_first, 0u) << "all scans hold every voxel of half of them";
  EXPECT_EQ(result->odd_all.only_first, 0u);
}

TEST_F(RecordedScans, OneScanOrNoReturnIsOneClearError) {
  write(0);
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pruner");
  {
    io::ScanSequence sequence = scans();
    EXPECT_THROW((void)measureConsistency(sequence, tool, params()), UnusableInput);
  }
  write(1);
  io::ScanSequence sequence = scans();
  FieldParams near = params();
  near.tsdf.max_range_m = 0.1;
  EXPECT_THROW((void)measureConsistency(sequence, tool, near), UnusableInput);
  ConsistencyHooks hooks;
  int asked = 0;
  hooks.stop = [&] { return ++asked > 1; };
  EXPECT_FALSE(measureConsistency(sequence, tool, params(), hooks).has_value());
}

}  // namespace
}  // namespace accessvdb::tools
