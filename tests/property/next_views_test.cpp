// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where to look next, at a ball in a room: against every voxel by hand, and against the view itself, cast by formula.
#include "accessvdb/next_views.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/known_leaves.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tsdf_volume.h"
#include "field/query/known_space.h"
#include "property/ball_world.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

constexpr double kCell_m = 0.05, kBall_m = 0.5, kHalfRoom_m = 3, kBody_m = 0.25;

/// To the first of a ball at the origin and the walls of a cube around it.
double rangeAt(const Eigen::Vector3d& from_W, const Eigen::Vector3d& along) {
  double wall_m = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    if (along[axis] == 0) continue;
    wall_m = std::min(wall_m, (std::copysign(kHalfRoom_m, along[axis]) - from_W[axis]) / along[axis]);
  }
  const double middle = -from_W.dot(along), height2 = from_W.squaredNorm() - middle * middle;
  if (middle > 0 && height2 < kBall_m * kBall_m) return middle - std::sqrt(kBall_m * kBall_m - height2);
  return wall_m;
}

/// Rays evenly over azimuth and elevation, another set for each number.
std::vector<Eigen::Vector3f> scanOfRoom(const Eigen::Isometry3d& T_W_S, int rays, unsigned number) {
  std::mt19937 engine(number);
  std::uniform_real_distribution<double> share(0, 1);
  std::vector<Eigen::Vector3f> points_S;
  for (int n = 0; n < rays; ++n) {
    const double azimuth = 2 * M_PI * share(engine), elevation = (-7 + 59 * share(engine)) * M_PI / 180;
    const Eigen::Vector3d along_S(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                                  std::sin(elevation));
    points_S.push_back((rangeAt(T_W_S.translation(), T_W_S.linear() * along_S) * along_S).cast<float>());
  }
  return points_S;
}

Eigen::Isometry3d poseAt(double x, double y, double z) {
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  T_W_S.translation() = Eigen::Vector3d(x, y, z);
  return T_W_S;
}

FieldParams roomParams(int threads = 2) {
  FieldParams params;
  params.tsdf.voxel_size_m = kCell_m;
  params.tsdf.range_noise_m = 0;
  params.tsdf.clear_rays_m = std::numeric_limits<double>::infinity();
  params.tsdf.platform_radius_m = 0.4;
  params.approach.num_directions = 60;
  params.threads = threads;
  params.backend = BackendKind::Cpu;
  return params;
}

/// A few scans from one side of the ball.
AccessibilityField roomField(int threads = 2, int budget_points = 0) {
  FieldParams params = roomParams(threads);
  params.update.budget_points = budget_points;
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
  for (unsigned n = 0; n < 6; ++n) {
    const Eigen::Isometry3d T_W_S = poseAt(2, -1 + 0.4 * n, -0.8);
    field.integrateScan(scanOfRoom(T_W_S, 20000, n), T_W_S);
  }
  field.update();
  return field;
}

bool isOpen(const SurfacePoint& point) {
  return point.reason == PointReason::Confidence || point.reason == PointReason::Unseen ||
         point.reason == PointReason::Unknown;
}

std::string refusalOf(const AccessibilityField& field, const ViewOptions& options) {
  try {
    return std::to_string(nextViews(field, options).views.size()) + " views";
  } catch (const Error& error) {
    return error.id();
  }
}

class KnownVoxels {
 public:
  explicit KnownVoxels(const AccessibilityField& field) : origin_W_(field.origin_W()) {
    forEachKnownLeaf(field, [this](const KnownLeaf& leaf) { leaves_[leaf.origin_ijk] = leaf; });
  }
  enum class Is { Unknown, Free, Colliding };
  [[nodiscard]] Is at(const std::array<int, 3>& ijk) const {
    const auto found = leaves_.find({ijk[0] & ~7, ijk[1] & ~7, ijk[2] & ~7});
    if (found == leaves_.end()) return Is::Unknown;
    const auto x = static_cast<std::size_t>(ijk[0] & 7);
    const int bit = (ijk[1] & 7) << 3 | (ijk[2] & 7);
    if ((found->second.collides[x] >> bit & 1) != 0) return Is::Colliding;
    return (found->second.free[x] >> bit & 1) != 0 ? Is::Free : Is::Unknown;
  }
  /// Every voxel whose centre is in the ball.
  [[nodiscard]] bool ballIsFree(const Eigen::Vector3d& centre_W, double radius_m) const {
    const Eigen::Vector3d c = (centre_W - origin_W_) / kCell_m;
    const int reach = static_cast<int>(radius_m / kCell_m) + 1;
    for (int x = -reach; x <= reach; ++x)
      for (int y = -reach; y <= reach; ++y)
        for (int z = -reach; z <= reach; ++z) {
          const std::array<int, 3> ijk = {int(std::lround(c.x())) + x, int(std::lround(c.y())) + y,
                                          int(std::lround(c.z())) + z};
          const bool inside = (Eigen::Vector3d(ijk[0], ijk[1], ijk[2]) - c).norm() * kCell_m <= radius_m;
          if (inside && at(ijk) != Is::Free) return false;
        }
    return true;
  }

 private:
  std::map<std::array<std::int32_t, 3>, KnownLeaf> leaves_;
  Eigen::Vector3d origin_W_;
};

TEST(NextViews, ResolveWhatTheySayWhereTheBodyIsFree) {
  AccessibilityField field = roomField();
  const KnownVoxels known(field);
  const std::vector<SurfacePoint> before = field.snapshot().points;
  const NextViews found =
      nextViews(field, {.most = 4, .body_radius_m = kBody_m, .from_W = Eigen::Vector3d(2, 1, -0.8)});
  std::uint64_t open = 0;
  for (const SurfacePoint& point : before) open += isOpen(point) ? 1 : 0;
  EXPECT_EQ(found.unresolved(), open);
  ASSERT_GE(found.views.size(), 2U);
  Eigen::Vector3d at_W(2, 1, -0.8);
  for (const NextView& view : found.views) {
    EXPECT_TRUE(known.ballIsFree(view.T_W_S.translation(), kBody_m)) << view.why;
    EXPECT_NEAR(view.travel_m, (view.T_W_S.translation() - at_W).norm(), 1e-9);
    EXPECT_NEAR(view.resolves, view.of_confidence + view.of_unseen + view.of_unknown, 1e-6);
    at_W = view.T_W_S.translation();
  }
  // Now go there: ten scans of 20000 rays are the 200000 of a view.
  const NextView& first = found.views.front();
  for (unsigned n = 0; n < 10; ++n) field.integrateScan(scanOfRoom(first.T_W_S, 20000, 100 + n), first.T_W_S);
  field.update();
  const std::vector<SurfacePoint> after = field.snapshot().points;
  double resolved = 0;
  for (const SurfacePoint& point : before) resolved += isOpen(point) && !isOpen(after[point.id]) ? 1 : 0;
  EXPECT_GT(resolved, 0.1 * static_cast<double>(open));
  EXPECT_NEAR(first.resolves, resolved, 0.3 * resolved);
}

TEST(NextViews, AreTheSameForAnyNumberOfThreads) {
  const ViewOptions options = {.most = 3, .body_radius_m = kBody_m};
  EXPECT_EQ(io::viewsJson(nextViews(roomField(1), options)), io::viewsJson(nextViews(roomField(2), options)));
}

/// Points that only wait for their turn are told as unscored with the same reason.
TEST(NextViews, DoNotCountOnPointsThatWait) {
  const ViewOptions options = {.most = 1, .body_radius_m = kBody_m};
  const NextViews of_all = nextViews(roomField(), options), of_some = nextViews(roomField(2, 100), options);
  ASSERT_GT(of_some.confidence, 2 * of_all.unresolved());
  EXPECT_LT(of_some.views.front().resolves, 1.5 * static_cast<double>(of_all.unresolved()));
}

/// A sensor that sees little resolves less; one whose view is turned away from all that is open, nothing.
TEST(NextViews, DependOnTheFieldOfView) {
  const AccessibilityField field = roomField();
  ViewOptions options = {.most = 1, .body_radius_m = kBody_m};
  const double all_around = nextViews(field, options).views.front().resolves;
  options.sensor.azimuth_rad = 0.5;
  const NextViews narrow = nextViews(field, options);
  ASSERT_EQ(narrow.views.size(), 1U);
  // As many rays in a twelfth of the width see each point of it better, but far fewer points.
  EXPECT_LT(narrow.views.front().resolves, all_around);
  options.sensor.max_range_m = 0.1;
  EXPECT_TRUE(nextViews(field, options).views.empty());
}

TEST(NextViews, AreRefusedWithoutAnyToPropose) {
  const AccessibilityField field = roomField();
  EXPECT_EQ(refusalOf(field, {.most = 1, .body_radius_m = kBody_m}), "1 views");
  EXPECT_EQ(refusalOf(field, {.body_radius_m = 2}), "views.no_free_space");
  EXPECT_EQ(refusalOf(field, {.body_radius_m = -1}), "views.options");
  EXPECT_EQ(refusalOf(field, {.body_radius_m = NAN}), "views.options");
  EXPECT_EQ(refusalOf(field, {.within_m = 3}), "views.options");
  EXPECT_EQ(refusalOf(field, {.travel_m = -1}), "views.options");
  EXPECT_EQ(refusalOf(field, {.from_W = Eigen::Vector3d(NAN, 0, 0)}), "views.options");
  EXPECT_EQ(refusalOf(field, {.body_radius_m = kBody_m, .from_W = Eigen::Vector3d(50, 0, 0), .within_m = 3}),
            "views.no_free_space");
  const auto with = [&](auto&& change) {
    ViewOptions options;
    change(options.sensor);
    return refusalOf(field, options);
  };
  EXPECT_EQ(with([](ViewSensor& s) { s.azimuth_rad = 0; }), "views.field_of_view");
  EXPECT_EQ(with([](ViewSensor& s) { s.azimuth_rad = 7; }), "views.field_of_view");
  EXPECT_EQ(with([](ViewSensor& s) { s.elevation_max_rad = s.elevation_min_rad; }), "views.field_of_view");
  EXPECT_EQ(with([](ViewSensor& s) { s.elevation_min_rad = NAN; }), "views.field_of_view");
  EXPECT_EQ(with([](ViewSensor& s) { s.pitches_rad = {}; }), "views.field_of_view");
  EXPECT_EQ(with([](ViewSensor& s) { s.rays = 0; }), "views.field_of_view");
  EXPECT_EQ(with([](ViewSensor& s) { s.max_range_m = 0; }), "views.field_of_view");
  const AccessibilityField empty(ToolGeometry::builtin("builtin:pencil"), roomParams());
  EXPECT_EQ(refusalOf(empty, {}), "views.no_map");
}

/// What rays meet, and balls, against every voxel by hand.
TEST(KnownSpace, AnswersAsItsVoxelsDo) {
  const AccessibilityField field = roomField();
  const KnownVoxels known(field);
  const internal::KnownSpace space(field.volume().packed());
  const internal::KnownSpace::Reader reader(space);
  ball_world::Random random;
  int met = 0, free_balls = 0;
  for (int n = 0; n < 2000; ++n) {
    const Eigen::Vector3d from(random.uniform(-60, 20), random.uniform(-60, 60), random.uniform(-30, 60));
    const Eigen::Vector3d along = random.direction();
    const std::array<double, 3> ends = {10, 30, 90};
    std::array<int, 3> expected = {};
    std::optional<std::array<int, 3>> last;
    for (double t = 0; t <= ends[2]; t += 0.002) {  // a corner that is cut by less is not met
      const Eigen::Vector3d p = from + t * along;
      const std::array<int, 3> ijk = {int(std::floor(p.x())), int(std::floor(p.y())), int(std::floor(p.z()))};
      if (last == ijk) continue;
      last = ijk;
      if (known.at(ijk) == KnownVoxels::Is::Colliding) ++expected[t < ends[0] ? 0 : t < ends[1] ? 1 : 2];
    }
    const std::array<int, 3> counted = reader.collidingOn(from, along, ends, 1 << 20);
    for (std::size_t part = 0; part < 3; ++part) ASSERT_NEAR(counted[part], expected[part], 1 + 0.05 * expected[part]);
    met += counted[0] + counted[1] + counted[2];
    const double radius = random.uniform(1, 12);
    if (!reader.ballIsFree(from, radius)) continue;
    ++free_balls;
    const Eigen::Vector3d centre_W = field.origin_W() + kCell_m * (from - Eigen::Vector3d::Constant(0.5));
    ASSERT_TRUE(known.ballIsFree(centre_W, kCell_m * radius));
  }
  EXPECT_GT(met, 1000);
  EXPECT_GT(free_balls, 20);
}

TEST(NextViews, AreWrittenAsFiles) {
  const AccessibilityField field = roomField();
  const NextViews found = nextViews(field, {.most = 3, .body_radius_m = kBody_m});
  const ScratchFolder folder;
  io::writeViews(folder.path(), found);
  for (const char* name : {"views.json", "views.csv", "views.ply"})
    EXPECT_TRUE(std::filesystem::exists(folder.path() / name)) << name;
}

}  // namespace
}  // namespace accessvdb::test
