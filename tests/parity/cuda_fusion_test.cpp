// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fusion on the GPU gives the bits of the map on the host: values, weights, what was cleared, votes, flips and counts
/// of every leaf of every scan.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "parity/gpu_test.h"
#include "parity/scan_on_device.h"
#include "sample_scans/walk_generator.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::test {
namespace {

using internal::PackedMap;
using internal::ScanIntegrator;

struct TwinScan {
  std::vector<Eigen::Vector3f> p_L;
  Eigen::Vector3f q_L;
};

/// What a stream had to offer: a comparison of nothing proves nothing.
struct StreamTotals {
  std::uint64_t leaves = 0, wide_leaves = 0, news = 0, voted_leaves = 0, updates = 0, flips = 0;
  std::uint64_t on_host = 0,
                leaves_read = 0;  ///< with a limit: most leaves without values here, and those that came back
  void expectAtLeast(const StreamTotals& least) const {
    EXPECT_GE(leaves, least.leaves);
    EXPECT_GE(wide_leaves, least.wide_leaves);
    EXPECT_GE(news, least.news);
    EXPECT_GE(voted_leaves, least.voted_leaves);
    EXPECT_GE(updates, least.updates);
    EXPECT_GE(flips, least.flips);
  }
};

class FusionTwin : public GpuTest {
 protected:
  void SetUp() override {
    GpuTest::SetUp();
    if (!IsSkipped() && !HasFatalFailure()) backend_ = kernels::makeCudaBackend(kernels::CudaOptions{});
  }

  static std::unique_ptr<PackedMap> makeMap(const TsdfParams& params, double far_m) {
    auto map = std::make_unique<PackedMap>(params);
    map->setCollisionDistance(static_cast<float>(0.5 * params.voxel_size_m));
    if (far_m > 0) map->blockNewThings(static_cast<float>(far_m));
    return map;
  }

  /// Fuses a stream on both, scan by scan. @param far_m  of news; 0: nothing votes  @param cache_bytes  0: no limit
  /// @param again_every  so many scans a device begins with the map that is there; 0: never
  StreamTotals compare(const TsdfParams& params, const std::vector<TwinScan>& scans, double far_m,
                       std::uint64_t cache_bytes = 0, std::size_t again_every = 0) {
    const std::unique_ptr<PackedMap> made = makeMap(params, far_m);
    PackedMap& map = *made;
    ScanIntegrator integrator(map);
    integrator.hashFlips(true);
    MapBehind behind(makeMap(params, far_m), 4);
    ScanOnDevice twin(*backend_, map, behind, cache_bytes);
    StreamTotals totals;
    for (std::size_t n = 0; n < scans.size(); ++n) {
      SCOPED_TRACE("scan " + std::to_string(n));
      if (again_every > 0 && n % again_every == again_every - 1) twin.beginAgain(map);
      twin.fuse(map, scans[n].p_L, {&scans[n].q_L, 1});
      const internal::IntegrationResult result = integrator.integrate(scans[n].p_L, {&scans[n].q_L, 1});
      const FusionDifferences found = twin.compare(map, result);
      EXPECT_EQ(found.leaves, 0u);
      EXPECT_EQ(found.facts, 0u);
      EXPECT_EQ(found.values, 0u);
      EXPECT_EQ(found.cleared, 0u);
      EXPECT_EQ(found.votes, 0u);
      EXPECT_EQ(found.weights, 0u);
      EXPECT_EQ(found.flips, 0u);
      EXPECT_EQ(found.counts, 0u);
      if (HasFailure()) return totals;
      totals.leaves += result.touched_leaves;
      totals.wide_leaves += twin.wideLeafCount();
      totals.news += twin.newsCount();
      totals.voted_leaves += map.votedLeafCount();
      totals.updates += result.counts.distance_updates;
      totals.flips += result.counts.flipped_voxels;
      totals.on_host = std::max(totals.on_host, twin.leavesOnHost());
    }
    totals.leaves_read = behind.leavesRead();
    return totals;
  }

  std::unique_ptr<kernels::CudaBackend> backend_;
};

std::vector<TwinScan> walk(int frames, int rays) {
  samples::WalkOptions options;
  options.frames = frames;
  options.rays_per_frame = rays;
  options.range_noise_m = 0.02;
  const samples::WalkGenerator generator(options);
  std::vector<TwinScan> scans;
  for (int n = 0; n < frames; ++n) {
    const samples::WalkFrame frame = generator.frame(n);
    TwinScan& scan = scans.emplace_back();
    scan.q_L = frame.T_W_S.translation().cast<float>();
    for (const Eigen::Vector3f& p_S : frame.points_S) {
      if (!p_S.isZero(0)) scan.p_L.push_back((frame.T_W_S * p_S.cast<double>()).cast<float>());
    }
  }
  return scans;
}

TsdfParams paramsOf(double voxel_size_m, double tau_m) {
  TsdfParams params;
  params.voxel_size_m = voxel_size_m;
  params.truncation_distance_m = tau_m;
  return params;
}

double farOf(const TsdfParams& params) { return 0.5 * params.voxel_size_m + 2.5 * params.voxel_size_m; }

TEST_F(FusionTwin, AWalkPastTreesAt20mm) {
  const TsdfParams params = paramsOf(0.02, 0.1);
  compare(params, walk(8, 32000), farOf(params)).expectAtLeast({100000, 0, 1000, 100, 1000000, 100000});
}

TEST_F(FusionTwin, AWalkPastTreesAt10mm) {
  const TsdfParams params = paramsOf(0.01, 0.1);
  compare(params, walk(4, 32000), farOf(params)).expectAtLeast({200000, 0, 100, 10, 10000000, 100000});
}

TEST_F(FusionTwin, AWalkPastTreesAt5mm) {
  const TsdfParams params = paramsOf(0.005, 0.1);
  compare(params, walk(2, 16000), 0).expectAtLeast({200000, 0, 0, 0, 10000000, 100000});
}

/// A sheet of a few leaves, seen many times: more returns in a leaf than a word of the sums can count, and weights at
/// their cap. It moves back and forth by more than the margin of news, so that things appear, stay and go.
std::vector<TwinScan> movingSheet(int scans, int returns, double voxel_size_m) {
  std::vector<TwinScan> list;
  std::mt19937 random(5);
  const auto uniform = [&random](double low, double high) {
    return low + (high - low) * static_cast<double>(random()) / static_cast<double>(std::mt19937::max());
  };
  for (int n = 0; n < scans; ++n) {
    TwinScan& scan = list.emplace_back();
    scan.q_L = {0.3f, 0.1f * static_cast<float>(n), 2.0f};
    const double shift = n < 6 ? 0 : n / 8 % 2 == 0 ? 3.5 : -3;
    for (int k = 0; k < returns; ++k) {
      const double x = uniform(-20, 20), y = uniform(-20, 20);
      const double z = 4 * std::sin(0.3 * x) + 3 * std::cos(0.2 * y) + uniform(-1, 1) + (k % 3 == 0 ? 0 : shift);
      scan.p_L.push_back((Eigen::Vector3d(x, y, z) * voxel_size_m).cast<float>());
    }
  }
  return list;
}

TEST_F(FusionTwin, MoreReturnsInALeafThanItsSumsCanHold) {
  TsdfParams params = paramsOf(0.01, 0.06);
  compare(params, movingSheet(16, 8000, 0.01), farOf(params)).expectAtLeast({1000, 100, 1000, 100, 1000000, 10000});
}

/// All returns are in one voxel, so that each of the warps that share a leaf has to empty its sums.
TEST_F(FusionTwin, MoreReturnsInAVoxelThanTheSumsOfAllWarpsCanHold) {
  std::vector<TwinScan> scans;
  std::mt19937 random(6);
  for (int n = 0; n < 3; ++n) {
    TwinScan& scan = scans.emplace_back();
    scan.q_L = {0.3f, 0.2f * static_cast<float>(n), 2.0f};
    for (int k = 0; k < 5000; ++k) {
      const auto off = [&] { return 0.004f * (static_cast<float>(random() % 1001) / 500.0f - 1); };
      scan.p_L.emplace_back(0.03f + off(), 0.02f + off(), 0.05f + off());
    }
  }
  TsdfParams params = paramsOf(0.01, 0.06);
  compare(params, scans, farOf(params)).expectAtLeast({12, 3, 0, 0, 500000, 100});
}

TEST_F(FusionTwin, WeightsAtTheirCap) {
  for (const std::uint32_t cap : {1u, 20u, 4095u}) {
    SCOPED_TRACE(cap);
    TsdfParams params = paramsOf(0.01, 0.06);
    params.max_weight = cap;
    compare(params, movingSheet(24, cap == 4095 ? 20000 : 1500, 0.01), farOf(params))
        .expectAtLeast({1000, 0, 1000, 100, 1000000, 1000});
  }
}

/// Returns whose rays, distances and places lie on the borders of what is decided: on faces of voxels, along axes and
/// diagonals, at the cone's own angle.
TEST_F(FusionTwin, BordersOfTheCone) {
  constexpr double kVoxel_m = 0.0078125;  // 2^-7: borders are numbers
  std::vector<TwinScan> scans;
  for (int dx = -2; dx <= 2; ++dx) {
    for (int dy = -2; dy <= 2; ++dy) {
      for (int dz = -2; dz <= 2; ++dz) {
        if (dx == 0 && dy == 0 && dz == 0) continue;
        TwinScan& scan = scans.emplace_back();
        scan.q_L = (Eigen::Vector3d(dx, dy, dz) * 100 * kVoxel_m).cast<float>();
        for (int n = 0; n < 27; ++n) {
          const Eigen::Vector3d place(n % 3 * 0.5 + 3, n / 3 % 3 * 0.5 - 5, n / 9 * 0.5 + 7);
          scan.p_L.push_back((place * kVoxel_m).cast<float>());
        }
      }
    }
  }
  for (const double cosine : {0.5, 0.8, 0.95}) {
    SCOPED_TRACE(cosine);
    TsdfParams params = paramsOf(kVoxel_m, 8 * kVoxel_m);
    params.cone_cos_min = cosine;
    params.cleared_radius_voxels = 2;
    compare(params, scans, farOf(params)).expectAtLeast({1000, 0, 0, 0, 100000, 10000});
  }
}

/// Back and forth: values leave and come back, while the map on the host is up to four scans behind.
TEST_F(FusionTwin, ValuesThatLeaveAndComeBack) {
  std::vector<TwinScan> scans = walk(8, 8000);
  for (int n = 7; n-- > 0;) scans.push_back(scans[static_cast<std::size_t>(n)]);
  const TsdfParams params = paramsOf(0.02, 0.1);
  for (const std::uint64_t cache_bytes : {std::uint64_t{1}, std::uint64_t{1} << 23, std::uint64_t{1} << 26}) {
    SCOPED_TRACE(cache_bytes);
    const StreamTotals totals = compare(params, scans, farOf(params), cache_bytes);
    if (HasFailure()) return;
    EXPECT_GT(totals.on_host, 10000u);
    EXPECT_GT(totals.leaves_read, 10000u);
  }
}

/// Values come back as scans reach them; votes are there at once.
TEST_F(FusionTwin, BeginsWithTheMapOfTheHost) {
  TsdfParams params = paramsOf(0.01, 0.06);
  const StreamTotals sheet = compare(params, movingSheet(24, 1500, 0.01), farOf(params), 0, 3);
  sheet.expectAtLeast({1000, 0, 1000, 100, 1000000, 1000});
  EXPECT_GT(sheet.leaves_read, 1000u);
  if (HasFailure()) return;
  params = paramsOf(0.02, 0.1);
  EXPECT_GT(compare(params, walk(6, 8000), farOf(params), std::uint64_t{1} << 23, 2).leaves_read, 10000u);
}

TEST_F(FusionTwin, ThePapersRegion) {
  TsdfParams params = paramsOf(0.01, 0.08);
  params.region = UpdateRegion::FullCube;
  for (const double radius : {2.5, 0.0}) {  // 0: a thin band
    params.cleared_radius_voxels = radius;
    compare(params, movingSheet(8, 800, 0.01), 0).expectAtLeast({1000, 1, 0, 0, 1000000, 1000});
  }
}

int numberFrom(const char* variable, int otherwise) {
  const char* given = std::getenv(variable);
  return given == nullptr ? otherwise : std::atoi(given);
}

/// Streams of all kinds of maps. ACCESSVDB_FUSION_STREAMS: how many (30), from number ACCESSVDB_FUSION_FIRST (0) on.
TEST_F(FusionTwin, RandomStreams) {
  const int first = numberFrom("ACCESSVDB_FUSION_FIRST", 0), streams = numberFrom("ACCESSVDB_FUSION_STREAMS", 30);
  std::uint64_t votes = 0, wide = 0;
  for (int number = first; number < first + streams; ++number) {
    SCOPED_TRACE("stream " + std::to_string(number));
    std::mt19937 random(static_cast<unsigned>(number) + 1);
    const auto uniform = [&random](double low, double high) {
      return low + (high - low) * static_cast<double>(random()) / static_cast<double>(std::mt19937::max());
    };
    const double v = std::exp(uniform(std::log(0.002), std::log(0.2)));
    TsdfParams params = paramsOf(v, uniform(2.5, 14) * v);
    params.max_weight = std::vector<std::uint32_t>{1, 7, 100, 2000, 4095}[random() % 5];
    params.cone_cos_min = uniform(0.6, 0.99);
    params.clamp_min_m = random() % 2 == 0 ? 0 : -params.truncation_distance_m;
    params.cleared_radius_voxels = random() % 5 == 0 ? 0 : uniform(0.3, 4);
    params.cleared_begin_tau = uniform(0.2, 1.2);
    params.cleared_end_tau = uniform(1.3, 4);
    if (number % 3 == 0) params.clear_rays_m = number % 2 == 0 ? uniform(10, 400) * v : 1e9;
    if (number % 4 == 1) params.platform_radius_m = uniform(0.3, 20) * v;
    std::vector<TwinScan> scans;
    Eigen::Vector3d centre(uniform(-2000, 2000), uniform(-2000, 2000), uniform(-2000, 2000));
    const double spread = uniform(3, 40);
    for (int n = 0; n < 12; ++n) {
      TwinScan& scan = scans.emplace_back();
      const Eigen::Vector3d sensor = centre + Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(0.3, 1)) * 300;
      scan.q_L = (sensor * v).cast<float>();
      if (n == 6) centre.z() += uniform(-6, 6);  // something came or went
      const int returns = 20 + static_cast<int>(random() % 2000);
      for (int k = 0; k < returns; ++k) {
        const Eigen::Vector3d place(uniform(-1, 1), uniform(-1, 1), uniform(-0.1, 0.1));
        scan.p_L.push_back(((centre + spread * place) * v).cast<float>());
      }
    }
    const double far_m = random() % 4 == 0 ? 0 : uniform(1, 4) * v;
    // Where lines are cleared, what the host need not look at is seen in values.
    const std::uint64_t cache_bytes = params.clear_rays_m > 0 || random() % 2 == 0 ? 0 : random() % (1u << 22);
    const std::size_t again_every = params.clear_rays_m == 0 && random() % 3 == 0 ? 2 + random() % 8 : 0;
    const StreamTotals totals = compare(params, scans, far_m, cache_bytes, again_every);
    if (HasFailure()) return;
    votes += totals.voted_leaves;
    wide += totals.wide_leaves;
  }
  EXPECT_GT(votes, 10u);
  EXPECT_GT(wide, 10u);
}

}  // namespace
}  // namespace accessvdb::test
