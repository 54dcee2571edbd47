// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The projective baseline against a plain loop in double over every voxel, and what it reports as changed.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <vector>

#include "accessvdb/error.h"
#include "hostdev/flips_hash.h"
#include "tsdf/projective_integrator.h"
#include "tsdf/scan_integrator.h"
#include "unit/tsdf/loop_tsdf.h"

namespace accessvdb::internal {
namespace {

using Eigen::Vector3d;
using Ijk = std::array<std::int32_t, 3>;

using std::numbers::pi;
constexpr double kBin_rad = 0.25 * pi / 180;
constexpr float kCollisionDistance_m = 0.005f;
/// A column of 1 440 has a float step of 1.2e-4 bins, and the angle's polynomial is off by as much at most.
constexpr double kBinMargin = 1e-3;
constexpr double kLengthMargin_voxels = 1e-3;

struct Scan {
  std::vector<Eigen::Vector3f> p_L;
  Eigen::Vector3f q_L;
  Eigen::Matrix3d R_W_S;
};

/// docs/PAPER_MAP.md, "Baselines", with its variants, one voxel at a time; lengths in voxels. Shares nothing with the
/// integrator.
class LoopProjective {
 public:
  explicit LoopProjective(const TsdfParams& params) : params_(params), tau_(tauOf(params)) {}

  struct Voxel {
    double sum = 0;
    std::uint32_t count = 0;
    double margin = 1;  ///< smallest distance of any decision from the opposite one, in units of the margins above
  };
  std::map<Ijk, Voxel> voxels;

  struct Bins {
    double column, row;
  };
  static Bins binsOf(const Vector3d& x_S) {
    return {(std::atan2(x_S.y(), x_S.x()) + pi) / kBin_rad, (std::asin(x_S.z() / x_S.norm()) + pi / 2) / kBin_rad};
  }

  void integrate(const Scan& scan, const Ijk& low, const Ijk& high) {
    const double v = params_.voxel_size_m;
    const Vector3d q = scan.q_L.cast<double>() / v;
    image_.clear();
    for (const auto& p : scan.p_L) {
      const Vector3d p_S = scan.R_W_S.transpose() * (p.cast<double>() / v - q);
      const Bins bins = binsOf(p_S);
      const auto [found, fresh] = image_.try_emplace({floorOf(bins.column), floorOf(bins.row)}, p_S.norm());
      if (!fresh) found->second = std::min(found->second, p_S.norm());
    }
    for (std::int32_t i = low[0]; i <= high[0]; ++i) {
      for (std::int32_t j = low[1]; j <= high[1]; ++j) {
        for (std::int32_t k = low[2]; k <= high[2]; ++k) {
          visit(scan.R_W_S.transpose() * (Vector3d(i, j, k) - q), {i, j, k});
        }
      }
    }
  }

 private:
  static double tauOf(const TsdfParams& params) { return params.truncation_distance_m / params.voxel_size_m; }
  static int floorOf(double value) { return static_cast<int>(std::floor(value)); }
  static double edgeMargin(double value) { return std::abs(value - std::round(value)) / kBinMargin; }
  [[nodiscard]] double rangeAt(int column, int row) const {
    const auto found = image_.find({(column + 1440) % 1440, row});
    return found == image_.end() ? 0 : found->second;
  }

  void visit(const Vector3d& x_S, const Ijk& ijk) {
    const ProjectiveParams& variant = params_.projective;
    const Bins bins = binsOf(x_S);
    double margin = std::min(edgeMargin(bins.column), edgeMargin(bins.row));
    double r = rangeAt(floorOf(bins.column), floorOf(bins.row));
    double d = tau_;
    bool counts = true;
    if (r == 0) {
      const double elevation = bins.row * kBin_rad - pi / 2;
      margin = std::min({margin, std::abs(elevation - variant.elevation_min_rad) / kBin_rad / kBinMargin,
                         std::abs(elevation - variant.elevation_max_rad) / kBin_rad / kBinMargin});
      counts = variant.empty_is_free && elevation >= variant.elevation_min_rad && elevation < variant.elevation_max_rad;
    } else {
      if (variant.guarded) counts = guard(bins, x_S, r, margin);
      d = r - x_S.norm();
      margin = std::min({margin, std::abs(d + tau_) / kLengthMargin_voxels, std::abs(d - tau_) / kLengthMargin_voxels});
      counts = counts && d >= -tau_ && (d <= tau_ || variant.in_front);
    }
    // Only those neighbours of a decision matter that could be written at all.
    if (!counts && margin >= 1) return;
    Voxel& voxel = voxels[ijk];
    voxel.margin = std::min(voxel.margin, margin);
    if (!counts) return;
    voxel.sum += std::clamp(d, params_.clamp_min_m / params_.voxel_size_m, tau_);
    ++voxel.count;
  }

  /// nvblox: between four centres, else the own bin near its ray. @return false: skipped; else r is the range to use
  bool guard(const Bins& bins, const Vector3d& x_S, double& r, double& margin) const {
    margin = std::min({margin, edgeMargin(bins.column - 0.5), edgeMargin(bins.row - 0.5)});
    const int column = floorOf(bins.column - 0.5), row = floorOf(bins.row - 0.5);
    const double a = bins.column - 0.5 - column, b = bins.row - 0.5 - row;
    const std::array<double, 4> p = {rangeAt(column, row), rangeAt(column + 1, row), rangeAt(column, row + 1),
                                     rangeAt(column + 1, row + 1)};
    if (*std::min_element(p.begin(), p.end()) > 0) {
      const double mixed = (1 - a) * (1 - b) * p[0] + a * (1 - b) * p[1] + (1 - a) * b * p[2] + a * b * p[3];
      double step = 0;
      for (const double corner : p) step = std::max(step, std::abs(corner - mixed));
      // One bin margin moves the interpolated range by up to a margin's share of the difference between corners.
      margin = std::min(margin, std::abs(step - 2) / (4 * kLengthMargin_voxels + 4 * kBinMargin * step));
      if (step <= 2) {
        r = mixed;
        return true;
      }
    }
    const double azimuth = (floorOf(bins.column) + 0.5) * kBin_rad - pi;
    const double elevation = (floorOf(bins.row) + 0.5) * kBin_rad - pi / 2;
    const Vector3d ray(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                       std::sin(elevation));
    const double off_ray = x_S.cross(ray).norm();
    margin = std::min(margin, std::abs(off_ray - 0.5) / kLengthMargin_voxels);
    return off_ray <= 0.5;
  }

  TsdfParams params_;
  double tau_;
  std::map<std::array<int, 2>, double> image_;
};

/// Three scans of a wavy sheet in different attitudes; no return is so near to a bin's edge that rounding could move
/// it.
std::vector<Scan> threeScans(double voxel_size_m) {
  const auto v = static_cast<float>(voxel_size_m);
  std::vector<Scan> scans;
  // The second looks across the seam of its image, the third is rolled, so that its bins are skewed.
  const std::array<Eigen::Vector3f, 3> sensors = {Eigen::Vector3f(31, -12, 300) * v, Eigen::Vector3f(290, 3.3f, 70) * v,
                                                  Eigen::Vector3f(-260, 8, -33) * v};
  const std::array<Eigen::Matrix3d, 3> attitudes = {
      Eigen::AngleAxisd(1.3, Vector3d::UnitY()).toRotationMatrix(), Eigen::Matrix3d::Identity(),
      (Eigen::AngleAxisd(0.4, Vector3d::UnitZ()) * Eigen::AngleAxisd(0.7, Vector3d::UnitX())).toRotationMatrix()};
  for (std::size_t n = 0; n < sensors.size(); ++n) {
    Scan scan{{}, sensors[n], attitudes[n]};
    for (const auto& p : test::wavySheet(2500, voxel_size_m, static_cast<unsigned>(n) + 1)) {
      const auto bins = LoopProjective::binsOf(scan.R_W_S.transpose() * (p - scan.q_L).cast<double>());
      const auto edge = [](double value) { return std::abs(value - std::round(value)); };
      if (edge(bins.column) > kBinMargin && edge(bins.row) > kBinMargin) scan.p_L.push_back(p);
    }
    scans.push_back(std::move(scan));
  }
  return scans;
}

TsdfParams tenMillimetres() {
  TsdfParams params;
  params.voxel_size_m = 0.01;
  params.truncation_distance_m = 0.04;
  params.region = UpdateRegion::Projective;
  params.projective.box_min_W_m = {-0.22, -0.25, -0.13};
  params.projective.box_max_W_m = {0.20, 0.22, 0.15};
  params.projective.elevation_min_rad = -0.14;  // cuts through the sheet as two of the sensors see it
  return params;
}

struct Case {
  const char* name;
  TsdfParams params;
};

std::vector<Case> cases() {
  TsdfParams band = tenMillimetres();
  TsdfParams unclamped = band;
  unclamped.clamp_min_m = -0.04;
  TsdfParams in_front = band;
  in_front.projective.in_front = true;
  TsdfParams free = band;
  free.projective.empty_is_free = true;
  TsdfParams guarded = band;
  guarded.projective.guarded = true;
  TsdfParams everything = band;
  everything.projective.in_front = everything.projective.empty_is_free = everything.projective.guarded = true;
  return {{"Band", band},        {"Unclamped", unclamped}, {"InFront", in_front},
          {"EmptyIsFree", free}, {"Guarded", guarded},     {"Everything", everything}};
}

class ProjectiveAgainstLoop : public testing::TestWithParam<Case> {};

TEST_P(ProjectiveAgainstLoop, WeightsAreEqualAndDistancesWithinAStep) {
  const TsdfParams& params = GetParam().params;
  PackedMap map(params);
  ScanIntegrator integrator(map);
  LoopProjective loop(params);
  const Vector3d origin_W(0.5, -1.25, 3.0);
  TsdfParams shifted = params;  // the same box, with the map's origin elsewhere
  for (std::size_t axis = 0; axis < 3; ++axis) {
    shifted.projective.box_min_W_m[axis] += origin_W[static_cast<Eigen::Index>(axis)];
    shifted.projective.box_max_W_m[axis] += origin_W[static_cast<Eigen::Index>(axis)];
  }
  PackedMap shifted_map(shifted);
  ScanIntegrator shifted_integrator(shifted_map);
  const bool boxed = params.projective.in_front || params.projective.empty_is_free;
  // -0.22 m is voxel -22, in the leaf from -24; 0.20 m is voxel 20, in the leaf up to 23; and so on.
  const Ijk low = boxed ? Ijk{-24, -32, -16} : Ijk{-48, -48, -40}, high = boxed ? Ijk{23, 23, 15} : Ijk{48, 48, 40};
  for (const Scan& scan : threeScans(params.voxel_size_m)) {
    integrator.integrate(scan.p_L, {&scan.q_L, 1}, {scan.R_W_S, Vector3d::Zero()});
    shifted_integrator.integrate(scan.p_L, {&scan.q_L, 1}, {scan.R_W_S, origin_W});
    loop.integrate(scan, low, high);
  }
  const double step_m = (params.truncation_distance_m - params.clamp_min_m) / kSampleSteps;
  // Ranges of 300 voxels in float32 are off by 1.5e-5 each, and so are the sums behind them. Interpolated ranges follow
  // the angle, which is off by up to a margin; ranges of neighbours differ by 4 voxels at most.
  const double tolerance_m = step_m + (params.projective.guarded ? 4 * kBinMargin : 1e-4) * params.voxel_size_m;
  std::size_t observed = 0, left_out = 0;
  for (const auto& [ijk, expected] : loop.voxels) {
    if (expected.margin < 1) {
      left_out += expected.count > 0 ? 1u : 0u;
      continue;
    }
    const VoxelState state = map.at({ijk[0], ijk[1], ijk[2]});
    ASSERT_EQ(state.weight, expected.count) << ijk[0] << ' ' << ijk[1] << ' ' << ijk[2];
    ASSERT_EQ(shifted_map.at({ijk[0], ijk[1], ijk[2]}).weight, expected.count);
    if (expected.count == 0) continue;
    ++observed;
    ASSERT_NEAR(state.distance_m, expected.sum / expected.count * params.voxel_size_m, tolerance_m);
  }
  EXPECT_GT(observed, 4000u);
  EXPECT_LT(left_out, observed / 10);
  std::uint64_t beyond = 0, seen = 0, cleared = 0;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      const openvdb::Coord ijk = leaf->offsetToGlobalCoord(n);
      const VoxelState state = map.at(ijk);
      cleared += state.cleared ? 1u : 0u;
      seen += state.weight > 0 ? 1u : 0u;
      if (state.weight > 0 && loop.voxels.count({ijk.x(), ijk.y(), ijk.z()}) == 0) ++beyond;
    }
  }
  EXPECT_EQ(beyond, 0u) << "voxels that the loop does not know";
  EXPECT_EQ(cleared, 0u);
  EXPECT_EQ(seen, map.observed_voxels);
}
INSTANTIATE_TEST_SUITE_P(Tsdf, ProjectiveAgainstLoop, testing::ValuesIn(cases()),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST(Projective, VariantsDiffer) {
  // Otherwise the comparison above would compare the same thing six times.
  std::map<std::string, std::uint64_t> observed;
  for (const Case& c : cases()) {
    PackedMap map(c.params);
    ScanIntegrator integrator(map);
    for (const Scan& scan : threeScans(0.01)) integrator.integrate(scan.p_L, {&scan.q_L, 1}, {scan.R_W_S, {0, 0, 0}});
    observed[c.name] = map.observed_voxels;
  }
  EXPECT_EQ(observed["Unclamped"], observed["Band"]);
  EXPECT_GT(observed["InFront"], observed["Band"] * 5 / 4);
  EXPECT_GT(observed["EmptyIsFree"], observed["Band"] * 5 / 4);
  EXPECT_LT(observed["Guarded"], observed["Band"] * 9 / 10);
  EXPECT_GT(observed["Everything"], observed["EmptyIsFree"]);
}

TEST(Projective, ClearedBandIsThatOfTheReturns) {
  TsdfParams params = tenMillimetres();
  params.projective.cleared_band = true;
  TsdfParams cone = params;
  cone.region = UpdateRegion::DoubleCone;
  PackedMap map(params), reference(cone);
  ScanIntegrator integrator(map), reference_integrator(reference);
  std::uint64_t cleared = 0;
  for (const Scan& scan : threeScans(0.01)) {
    const auto result = integrator.integrate(scan.p_L, {&scan.q_L, 1}, {scan.R_W_S, {0, 0, 0}});
    const auto expected = reference_integrator.integrate(scan.p_L, {&scan.q_L, 1});
    EXPECT_EQ(result.counts.cleared_updates, expected.counts.cleared_updates);
  }
  for (auto leaf = reference.tree().cbeginLeaf(); leaf; ++leaf) {
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      const openvdb::Coord ijk = leaf->offsetToGlobalCoord(n);
      ASSERT_EQ(map.at(ijk).cleared, reference.at(ijk).cleared) << ijk;
      cleared += reference.at(ijk).cleared ? 1u : 0u;
    }
  }
  EXPECT_GT(cleared, 1000u);
}

struct Facts {
  bool collides = false, arm_free = false;
};
Facts factsOf(const VoxelState& state) {
  const bool collides = state.weight > 0 && !(state.distance_m >= kCollisionDistance_m);
  return {collides, state.weight > 0 ? !collides : state.cleared};
}
using FactMap = std::map<Ijk, std::array<Facts, 512>>;
FactMap allFacts(const PackedMap& map) {
  FactMap facts;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    auto& of_leaf = facts[{leaf->origin().x(), leaf->origin().y(), leaf->origin().z()}];
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) of_leaf[n] = factsOf(map.at(leaf->offsetToGlobalCoord(n)));
  }
  return facts;
}
bool bitOf(const LeafBits& bits, std::size_t n) { return (bits[n >> 6] >> (n & 63) & 1) != 0; }

/// Both passes together: the reported changes are the difference of the facts before and after.
TEST(Projective, ChangesAreTheDifferenceOfTheFacts) {
  TsdfParams params = tenMillimetres();
  params.projective.cleared_band = true;
  params.cleared_begin_tau = 0;  // so that many voxels are cleared by one pass and observed by the other
  PackedMap map(params);
  map.setCollisionDistance(kCollisionDistance_m);
  ScanIntegrator integrator(map);
  integrator.hashFlips(true);
  std::array<std::size_t, 4> kinds = {};
  std::vector<Scan> scans = threeScans(0.01);
  scans.push_back(scans[0]);
  for (auto& p : scans.back().p_L) p.z() -= 0.03f;
  scans.push_back(scans[0]);
  scans.push_back(scans[0]);
  for (const Scan& scan : scans) {
    const FactMap before = allFacts(map);
    const IntegrationResult result = integrator.integrate(scan.p_L, {&scan.q_L, 1}, {scan.R_W_S, {0, 0, 0}});
    std::map<Ijk, LeafChange> changes;
    std::uint64_t flips_hash = 0;
    for (const auto& span : result.changes) {
      for (const LeafChange& change : span) {
        ASSERT_TRUE(changes.emplace(change.origin_ijk, change).second) << "a leaf twice in one scan";
        flips_hash += kernels::flipsHash(change);
      }
    }
    EXPECT_EQ(result.flips_hash, flips_hash);
    for (const auto& [origin, now] : allFacts(map)) {
      const auto found = before.find(origin);
      const bool listed = changes.count(origin) > 0;
      const LeafChange change = listed ? changes.at(origin) : LeafChange{};
      std::size_t flips = 0;
      for (std::size_t n = 0; n < 512; ++n) {
        const Facts old = found == before.end() ? Facts{} : found->second[n];
        const std::array<bool, 4> expected = {!old.collides && now[n].collides, old.collides && !now[n].collides,
                                              !old.arm_free && now[n].arm_free, old.arm_free && !now[n].arm_free};
        const std::array<bool, 4> reported = {bitOf(change.collides_on, n), bitOf(change.collides_off, n),
                                              bitOf(change.arm_free_on, n), bitOf(change.arm_free_off, n)};
        ASSERT_EQ(reported, expected) << origin[0] << ' ' << origin[1] << ' ' << origin[2] << " voxel " << n;
        for (std::size_t kind = 0; kind < 4; ++kind) {
          kinds[kind] += expected[kind] ? 1u : 0u;
          flips += expected[kind] ? 1u : 0u;
        }
      }
      EXPECT_EQ(listed, flips > 0) << "leaves without a flip are not listed";
      changes.erase(origin);
    }
    EXPECT_TRUE(changes.empty());
  }
  for (const std::size_t count : kinds) EXPECT_GT(count, 50u);
}

/// Everything in a map, in canonical order.
std::map<Ijk, std::vector<std::uint32_t>> contentsOf(const PackedMap& map) {
  std::map<Ijk, std::vector<std::uint32_t>> contents;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    auto& values = contents[{leaf->origin().x(), leaf->origin().y(), leaf->origin().z()}];
    LeafValues::Room room;
    if (const std::uint32_t* packed = LeafValues(*leaf).all(room)) values.assign(packed, packed + PackedLeaf::SIZE);
    for (openvdb::Index w = 0; w < 16; ++w) values.push_back(leaf->getValueMask().getWord<openvdb::Index32>(w));
  }
  return contents;
}

TEST(Projective, ThreadsAndTheOrderOfPointsDoNotMatter) {
  TsdfParams params = tenMillimetres();
  params.projective.guarded = params.projective.cleared_band = true;
  std::map<Ijk, std::vector<std::uint32_t>> expected;
  std::mt19937 random(5);
  for (const int threads : {1, 2, 4, 16}) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    arena.execute([&] {
      PackedMap map(params);
      ScanIntegrator integrator(map);
      for (Scan& scan : threeScans(0.01)) {
        if (threads > 1) std::shuffle(scan.p_L.begin(), scan.p_L.end(), random);
        integrator.integrate(scan.p_L, {&scan.q_L, 1}, {scan.R_W_S, {0, 0, 0}});
      }
      if (threads == 1) expected = contentsOf(map);
      EXPECT_TRUE(contentsOf(map) == expected) << threads << " threads";
    });
  }
  EXPECT_GT(expected.size(), 50u);
}

TEST(Projective, AnglesAreRightAllAround) {
  const RangeImage image(kBin_rad);
  ASSERT_EQ(image.columns(), 1440);
  ASSERT_EQ(image.rows(), 720);
  std::mt19937 random(3);
  const auto uniform = [&] { return 2.0 * static_cast<double>(random()) / 4294967295.0 - 1; };
  LeafProjection seen;
  for (int n = 0; n < 300; ++n) {
    // Leaves around the sensor, including the axes and the poles, and some with the sensor inside.
    const Eigen::Vector3f first =
        Vector3d(60 * uniform(), 60 * uniform(), 60 * uniform()).cast<float>() * (n % 3 == 0 ? 0.1f : 1.0f);
    image.project(first, Eigen::Matrix3f::Identity(), seen);
    for (int voxel = 0; voxel < 512; ++voxel) {
      const Vector3d x = first.cast<double>() + Vector3d(voxel >> 6, voxel >> 3 & 7, voxel & 7);
      if (x.head<2>().norm() < 1e-3) continue;
      const auto expected = LoopProjective::binsOf(x);
      const auto at = static_cast<std::size_t>(voxel);
      const double turn = std::abs(seen.column[at] - expected.column);
      ASSERT_LT(std::min(turn, 1440 - turn), kBinMargin / 2) << x.transpose();
      // asin() loses digits near the poles, so compare the sine.
      ASSERT_NEAR(std::sin(seen.row[at] * kBin_rad - pi / 2), x.z() / x.norm(), 1e-6);
      ASSERT_NEAR(seen.range[at], x.norm(), 3e-5);  // four steps of a float of that size
    }
  }
  // Straight up and down, at the sensor, and on the seam.
  const std::array<Eigen::Vector3f, 4> corners = {Eigen::Vector3f(0, 0, 5), Eigen::Vector3f(0, 0, -12),
                                                  Eigen::Vector3f(0, 0, 0), Eigen::Vector3f(-9, 0, 0)};
  for (const auto& first : corners) {
    image.project(first, Eigen::Matrix3f::Identity(), seen);
    for (std::size_t n = 0; n < 512; ++n) {
      ASSERT_TRUE(seen.column[n] >= 0 && seen.column[n] < 1440) << seen.column[n];
      ASSERT_TRUE(seen.row[n] >= 0 && seen.row[n] < 720) << seen.row[n];
    }
  }
}

TEST(Projective, RayCloudsAreRefusedBeforeAnythingChanges) {
  PackedMap map(tenMillimetres());
  ScanIntegrator integrator(map);
  const Scan scan = threeScans(0.01)[0];
  const std::vector<Eigen::Vector3f> sensors(scan.p_L.size(), scan.q_L);
  EXPECT_THROW(integrator.integrate(scan.p_L, sensors), InvalidArgument);
  EXPECT_EQ(map.leaf_count, 0u);
}

}  // namespace
}  // namespace accessvdb::internal
