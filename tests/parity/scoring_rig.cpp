// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "parity/scoring_rig.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

namespace accessvdb::test {
namespace {

std::uint64_t word64(Random& random) {
  return static_cast<std::uint64_t>(random.below(1 << 30)) << 34 ^
         static_cast<std::uint64_t>(random.below(1 << 30)) << 17 ^ static_cast<std::uint64_t>(random.below(1 << 30));
}

/// Empty, sparse or dense, or a wall: roughly like a map, with everything that can go wrong with bits.
LeafBits randomBits(Random& random, int density) {
  LeafBits bits = {};
  if (density == 0) return bits;
  for (auto& word : bits) {
    word = word64(random);
    for (int n = density; n < 5; ++n) word &= word64(random);
  }
  return bits;
}

LeafBits without(const LeafBits& a, const LeafBits& b) {
  LeafBits out = {};
  for (std::size_t w = 0; w < a.size(); ++w) out[w] = a[w] & ~b[w];
  return out;
}

kernels::DirectionMask randomMask(Random& random, int directions, double share) {
  kernels::DirectionMask mask = {};
  for (int d = 0; d < directions; ++d) {
    if (random.uniform(0, 1) < share) mask.set(d);
  }
  return mask;
}

/// @param axis  of direction d
bool isAdmissible(const FieldParams& params, const kernels::PointInput& input, int d, const Eigen::Vector3d& axis) {
  if (!input.seen.test(d)) return false;
  const double cosine = axis.dot(Eigen::Vector3f(input.normal_L).cast<double>());
  return cosine > std::cos(params.approach.normal_cone_rad) + 1e-5;  // well inside, against float32's rounding
}

}  // namespace

ScoringCase randomCase(Random& random, const ToolGeometry& tool, const FieldParams& params, int points) {
  ScoringCase out{params.resolved(), tool, {}, {}, {}, {}};
  out.params.approach.rolls = internal::toolRolls(tool, out.params.approach).count;
  const double v = out.params.tsdf.voxel_size_m;
  const int reach = std::min(static_cast<int>(std::ceil(tool.reach_m() / v / 8)), 12);
  const int centre[3] = {random.below(40) - 20, random.below(40) - 20, random.below(40) - 20};  // leaves; also negative
  const int shade = random.below(3);
  std::vector<LeafChange> batch;
  for (int x = -reach; x <= reach; ++x) {
    for (int y = -reach; y <= reach; ++y) {
      for (int z = -std::min(reach, 4); z <= std::min(reach, 4); ++z) {
        if (random.below(4) == 0) continue;  // no leaf: tool free, arm blocked
        LeafChange change;
        change.origin_ijk = {8 * (centre[0] + x), 8 * (centre[1] + y), 8 * (centre[2] + z)};
        const int density = random.below(6) >= 3 + shade ? 1 + random.below(4) : 0;
        change.collides_on = randomBits(random, density);
        if (random.below(12) != 0) change.arm_free_on.fill(~std::uint64_t(0));
        change.arm_free_on = without(change.arm_free_on, change.collides_on);
        batch.push_back(change);
        if (batch.size() < 1000) continue;
        out.changes.push_back(std::move(batch));
        batch.clear();
      }
    }
  }
  out.changes.push_back(std::move(batch));

  const std::vector<ToolOrientation> orientations =
      out.params.approach.orientations.orientations(out.params.approach.num_directions);
  const int directions = static_cast<int>(orientations.size());
  const bool is_wide = kernels::isWide(directions);
  for (int n = 0; n < points; ++n) {
    kernels::PointInput input;
    input.id = static_cast<std::uint32_t>(n);
    input.weight = static_cast<std::uint16_t>(random.below(60));
    for (int axis = 0; axis < 3; ++axis) {
      input.position_L[axis] = static_cast<float>((8 * centre[axis] + random.uniform(-12, 20)) * v);
    }
    const double yaw = random.uniform(0, 6.4), pitch = random.uniform(-1.2, 1.2);
    if (random.below(50) != 0) {  // else it has no normal
      input.normal_L[0] = static_cast<float>(std::cos(pitch) * std::cos(yaw));
      input.normal_L[1] = static_cast<float>(std::cos(pitch) * std::sin(yaw));
      input.normal_L[2] = static_cast<float>(std::sin(pitch));
    }
    if (is_wide && random.below(20) == 0) {  // upwards: the cosines of all level directions tie
      input.normal_L[0] = input.normal_L[1] = 0;
      input.normal_L[2] = 1;
    } else if (random.below(20) == 0) {  // towards a direction, where cosines tie
      input.normal_L[0] = static_cast<float>(random.below(3) - 1);
      input.normal_L[1] = static_cast<float>(random.below(3) - 1);
      input.normal_L[2] = 0;
    }
    const double share_seen = random.below(10) == 0 ? 0.0 : random.uniform(0.2, 1.0);
    if (!is_wide) input.seen = randomMask(random, directions, share_seen);
    for (int d = 0; is_wide && d < directions; ++d) {
      if (d % 64 == 0) out.wide_seen.push_back(0);
      if (random.uniform(0, 1) < share_seen) out.wide_seen.back() |= std::uint64_t{1} << (d % 64);
    }
    out.inputs.push_back(input);

    if (random.below(10) == 0) continue;  // not requested
    kernels::ScoreItem item;
    item.id = input.id;
    if (is_wide) {
      if (random.below(2) == 0) {
        item.only_direction = random.below(directions);
        item.or_all = static_cast<std::uint8_t>(random.below(2));
        // Without or_all, a count above it would only be a lower bound.
        if (item.or_all != 0) item.known_score = static_cast<std::uint16_t>(random.below(20));
      }
      out.items.push_back(item);
      continue;
    }
    item.candidates = randomMask(random, directions, random.below(3) == 0 ? random.uniform(0, 1) : 2.0);
    if (random.below(2) == 0) item.skip = randomMask(random, directions, random.uniform(0, 0.7));
    const int known = random.below(directions);
    // The known result belongs to a direction that counts: otherwise results above it would only be lower bounds.
    if (random.below(2) == 0 &&
        isAdmissible(out.params, input, known, orientations[static_cast<std::size_t>(known)].R_WT.col(0)) &&
        item.candidates.test(known)) {
      item.known_direction = static_cast<std::uint16_t>(known);
      item.known_roll = static_cast<std::uint8_t>(random.below(out.params.approach.rolls));
      item.known_score = static_cast<std::uint16_t>(random.below(3) == 0 ? 0 : random.below(40));
    }
    out.items.push_back(item);
  }
  // Shuffled, so that no backend benefits from the order.
  for (std::size_t n = out.items.size(); n > 1; --n) {
    std::swap(out.items[n - 1], out.items[static_cast<std::size_t>(random.below(static_cast<int>(n)))]);
  }
  return out;
}

ScoringRig::ScoringRig(std::unique_ptr<kernels::Backend> backend, const ScoringCase& what)
    : backend_(std::move(backend)),
      setup_(what.tool, what.params, *backend_),
      mirror_(backend_->makeArena(), what.params.tsdf.voxel_size_m),
      points_(*backend_, (what.params.approach.directionCount() + 63) / 64, setup_.tool().rolls.count > 1) {
  for (const auto& batch : what.changes) mirror_.apply(batch);
  points_.grow(static_cast<std::uint32_t>(what.inputs.size()));
  backend_->writePoints(points_.view(), what.inputs.data(), what.inputs.size());
  if (what.wide_seen.empty()) return;
  std::vector<std::uint32_t> ids;
  for (const kernels::PointInput& input : what.inputs) ids.push_back(input.id);
  backend_->writeSeen(points_.view(), ids.data(), what.wide_seen.data(), ids.size());
}

kernels::ScoreRequest ScoringRig::request(bool keep_best) const {
  const internal::ScoringTables tables = setup_.tables(mirror_.grid());
  kernels::ScoreRequest request;
  request.map = tables.map;
  request.tool = tables.tool;
  request.approach = tables.approach;
  request.points = points_.view();
  request.rule = tables.rule;
  request.rule.keep_best = keep_best;
  return request;
}

std::vector<kernels::ScoreResult> ScoringRig::score(std::span<const kernels::ScoreItem> items, bool keep_best) {
  std::vector<kernels::ScoreResult> results(items.size());
  kernels::ScoreRequest asked = request(keep_best);
  asked.items = items.data();
  asked.results = results.data();
  asked.count = items.size();
  backend_->scorePoints(asked);
  return results;
}

StoredState ScoringRig::state() const {
  StoredState state;
  const kernels::PointStateView view = points_.view();
  const auto fetch = [&](auto& to, const auto* from) {
    to.resize(points_.size());
    backend_->download(to.data(), from, to.size() * sizeof(to[0]));
  };
  fetch(state.score, view.score);
  fetch(state.direction, view.direction);
  fetch(state.stability, view.stability);
  fetch(state.label, view.label);
  fetch(state.reason, view.reason);
  if (view.roll != nullptr) fetch(state.roll, view.roll);
  return state;
}

void expectSameResults(std::span<const kernels::ScoreResult> a, std::span<const kernels::ScoreResult> b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t n = 0; n < a.size(); ++n) {
    SCOPED_TRACE("item " + std::to_string(n));
    ASSERT_EQ(a[n].score, b[n].score);
    ASSERT_EQ(a[n].direction, b[n].direction);
    ASSERT_EQ(a[n].roll, b[n].roll);
    ASSERT_EQ(a[n].reason, b[n].reason);
    ASSERT_EQ(a[n].scored, b[n].scored);
    ASSERT_EQ(a[n].skipped, b[n].skipped);
    ASSERT_EQ(a[n].tests, b[n].tests);
    ASSERT_EQ(a[n].label, b[n].label);
    ASSERT_EQ(a[n].stored_score, b[n].stored_score);
    ASSERT_EQ(a[n].stored_direction, b[n].stored_direction);
    ASSERT_EQ(a[n].stored_roll, b[n].stored_roll);
    for (int w = 0; w < kernels::kMaxDirectionWords; ++w) {
      ASSERT_EQ(a[n].arm_blocked.word[w], b[n].arm_blocked.word[w]) << w;
    }
  }
}

void expectBlockedIsTrue(const ScoringRig& cpu, std::span<const kernels::ScoreItem> items,
                         std::span<const kernels::ScoreResult> results) {
  const kernels::ScoreRequest request = cpu.request(false);
  const kernels::OccupancyReader map(request.map);
  const kernels::ToolKernelView& tool = request.tool;
  constexpr int kNoStop = 1 << 30;
  for (std::size_t n = 0; n < results.size(); ++n) {
    const float* p = request.points.position_L + 3 * static_cast<std::size_t>(items[n].id);
    const float inverse = request.map.inverse_voxel_size;
    const auto ijk = kernels::voxelOf(p[0], p[1], p[2], inverse);
    bool any = false;
    for (int d = 0; d < request.approach.num_directions; ++d) {
      if (!results[n].tool_blocked.test(d)) continue;
      any = true;
      const auto countPart = [&](int part) {
        return tool.use_samples ? kernels::countSampleCollisions(map, tool, part, p, inverse, kNoStop)
                                : kernels::countVoxelCollisions(map, tool, part, ijk, kNoStop);
      };
      int count = countPart(d * tool.parts);
      if (tool.parts > 1) {
        int least = kNoStop;
        for (int part = 1; part < tool.parts; ++part) least = std::min(least, countPart(d * tool.parts + part));
        count += least;
      }
      ASSERT_GE(count, static_cast<int>(results[n].least_blocked)) << "item " << n << ", direction " << d;
    }
    ASSERT_EQ(any, results[n].least_blocked != kNoScore) << n;
    if (any) {
      ASSERT_GE(results[n].least_blocked, tool.collision_limit) << n;
    }
  }
}

void expectSameState(const StoredState& a, const StoredState& b) {
  ASSERT_EQ(a.score, b.score);
  ASSERT_EQ(a.direction, b.direction);
  ASSERT_EQ(a.roll, b.roll);
  ASSERT_EQ(a.label, b.label);
  ASSERT_EQ(a.reason, b.reason);
  ASSERT_EQ(a.stability.size(), b.stability.size());
  for (std::size_t n = 0; n < a.stability.size(); ++n) {
    ASSERT_EQ(std::bit_cast<std::uint32_t>(a.stability[n]), std::bit_cast<std::uint32_t>(b.stability[n])) << n;
  }
}

}  // namespace accessvdb::test
