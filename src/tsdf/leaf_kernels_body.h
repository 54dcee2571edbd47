// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The kernels in terms of sixteen lanes. Included inside a namespace by leaf_kernels.cpp after one of the lanes_*.h,
// hence no include guard.

alignas(64) constexpr float kLaneZ[16] = {0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7};
alignas(64) constexpr float kLaneY[16] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1};

/// Parts of s and |e|^2 that depend on y and z only, for the four pairs of rows of a slab.
struct Slab {
  Floats s[4], e2[4];
  Mask in_cube[4];
};

/// Slabs inside the region's box, first and last. Rows are not cut: a loop of fixed length costs less than it saves.
struct Reach {
  int x0, x1;
};

inline int floorOf(float value) {
  const int n = static_cast<int>(value);
  return n - (static_cast<float>(n) > value ? 1 : 0);
}

inline Reach reachOf(const ReturnInLeaf& ray) {
  const float x = ray.leaf[0] - ray.offset[0];
  const int x0 = -floorOf(x - ray.box_x.low), x1 = floorOf(ray.box_x.high - x);
  return {x0 > 0 ? x0 : 0, x1 < 7 ? x1 : 7};
}

inline void setSlab(const ReturnInLeaf& ray, float tau, Slab& slab) {
  const Floats ez = sub(add(all(ray.leaf[2]), loadFloats(kLaneZ)), all(ray.offset[2]));
  const Floats sz = mul(ez, all(ray.to_sensor[2])), ez2 = mul(ez, ez);
  const Mask in_z = atMost(absolute(ez), all(tau));
  for (int pair = 0; pair < 4; ++pair) {
    const Floats y = add(all(static_cast<float>(2 * pair)), loadFloats(kLaneY));
    const Floats ey = sub(add(all(ray.leaf[1]), y), all(ray.offset[1]));
    slab.s[pair] = add(mul(ey, all(ray.to_sensor[1])), sz);
    slab.e2[pair] = add(mul(ey, ey), ez2);
    slab.in_cube[pair] = both(in_z, atMost(absolute(ey), all(tau)));
  }
}

inline float offsetX(const ReturnInLeaf& ray, int x) { return (ray.leaf[0] + static_cast<float>(x)) - ray.offset[0]; }

/// d = R - |x - q|, without the cancellation of two large numbers, clamped and in steps.
inline Ints sampleOf(Floats two_rs, Floats e2, Floats to_sensor, Floats range, const KernelConstants& c) {
  const Floats d = div(sub(two_rs, e2), add(range, to_sensor));
  const Floats clamped = least(most(d, all(c.clamp_low)), all(c.clamp_high));
  return truncate(add(mul(sub(clamped, all(c.clamp_low)), all(c.sample_scale)), all(0.5f)));
}

inline void addSamples(std::uint32_t inside, Ints sample, int pair, LeafSums& sums) {
  std::uint32_t* distance = sums.distance.data() + 16 * pair;
  std::uint32_t* samples = sums.samples.data() + 16 * pair;
  store(distance, addInts(loadInts(distance), choose(inside, sample, allInts(0))));
  store(samples, addInts(loadInts(samples), choose(inside, allInts(1), allInts(0))));
}

inline std::uint32_t addDoubleCone(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums) {
  const Reach reach = reachOf(ray);
  Slab slab;
  setSlab(ray, c.tau, slab);
  const Floats cos2 = all(c.cone_cos_squared), one = all(1.0f);
  std::uint32_t touched = 0;
  std::uint32_t inside[kPairs];
  for (int x = reach.x0; x <= reach.x1; ++x) {
    const float ex = offsetX(ray, x);
    if (!(std::fabs(ex) <= c.tau)) continue;
    const Floats sx = all(ex * ray.to_sensor[0]), ex2 = all(ex * ex);
    for (int y = 0; y < 4; ++y) {
      const Floats s = add(sx, slab.s[y]), e2 = add(ex2, slab.e2[y]);
      const Mask in_cone = either(greater(mul(s, s), mul(cos2, e2)), atMost(e2, one));
      const int pair = 4 * x + y;
      inside[pair] = both(in_cone, slab.in_cube[y]);
      touched |= (inside[pair] != 0 ? 1u : 0u) << pair;
    }
  }
  const Floats range = all(ray.range), range_squared = mul(range, range), zero = all(0.0f);
  for (std::uint32_t left = touched; left != 0; left &= left - 1) {
    const int pair = std::countr_zero(left);
    const float ex = offsetX(ray, pair >> 2);
    const Floats s = add(all(ex * ray.to_sensor[0]), slab.s[pair & 3]), e2 = add(all(ex * ex), slab.e2[pair & 3]);
    const Floats two_rs = mul(all(2.0f), mul(range, s));
    const Floats to_sensor = squareRoot(most(add(sub(range_squared, two_rs), e2), zero));
    addSamples(inside[pair], sampleOf(two_rs, e2, to_sensor, range, c), pair, sums);
  }
  return touched;
}

inline std::uint32_t addFullCube(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums) {
  const Reach reach = reachOf(ray);
  Slab slab;
  setSlab(ray, c.tau, slab);
  const Floats range = all(ray.range), range_squared = mul(range, range), zero = all(0.0f);
  std::uint32_t touched = 0;
  for (int x = reach.x0; x <= reach.x1; ++x) {
    const float ex = offsetX(ray, x);
    if (!(std::fabs(ex) <= c.tau)) continue;
    const Floats sx = all(ex * ray.to_sensor[0]), ex2 = all(ex * ex);
    for (int y = 0; y < 4; ++y) {
      if (slab.in_cube[y] == 0) continue;
      const Floats s = add(sx, slab.s[y]), e2 = add(ex2, slab.e2[y]);
      const Floats two_rs = mul(all(2.0f), mul(range, s));
      const Floats to_sensor = squareRoot(most(add(sub(range_squared, two_rs), e2), zero));
      const std::uint32_t inside = slab.in_cube[y] & greater(sub(range, s), mul(all(c.cone_cos), to_sensor));
      if (inside == 0) continue;
      const int pair = 4 * x + y;
      addSamples(inside, sampleOf(two_rs, e2, to_sensor, range, c), pair, sums);
      touched |= 1u << pair;
    }
  }
  return touched;
}

inline std::uint32_t markBand(const ReturnInLeaf& ray, const KernelConstants& c, LeafBits& passed) {
  const Reach reach = reachOf(ray);
  Slab slab;
  setSlab(ray, c.tau, slab);
  const Floats begin = all(c.band_begin), end = all(c.band_end < ray.range ? c.band_end : ray.range);
  const Floats radius2 = all(c.band_radius_squared);
  std::uint32_t count = 0;
  for (int x = reach.x0; x <= reach.x1; ++x) {
    const float ex = offsetX(ray, x);
    const Floats sx = all(ex * ray.to_sensor[0]), ex2 = all(ex * ex);
    std::uint64_t word = 0;
    for (int y = 0; y < 4; ++y) {
      const Floats s = add(sx, slab.s[y]), e2 = add(ex2, slab.e2[y]);
      const std::uint32_t inside = both(both(greater(s, begin), atMost(s, end)), atMost(sub(e2, mul(s, s)), radius2));
      word |= static_cast<std::uint64_t>(inside) << (16 * y);
    }
    passed[static_cast<std::size_t>(x)] |= word;
    count += static_cast<std::uint32_t>(std::popcount(word));
  }
  return count;
}

/// Facts of a leaf before and after a fold, as far as they were looked at; a bit a voxel.
struct LeafFacts {
  LeafBits old_observed = {}, now_observed = {}, old_collides = {}, now_collides = {};
};

inline void setPair(LeafBits& bits, int pair, std::uint32_t rows) {
  bits[static_cast<std::size_t>(pair >> 2)] |= static_cast<std::uint64_t>(rows) << (16 * (pair & 3));
}

/// Folds one pair of rows with samples.
inline void foldPair(const LeafTarget& leaf, LeafSums& sums, const KernelConstants& c, int pair, LeafFacts& facts,
                     Ints& sample_total) {
  std::uint32_t* packed = leaf.packed + 16 * pair;
  std::uint32_t* distance = sums.distance.data() + 16 * pair;
  std::uint32_t* samples = sums.samples.data() + 16 * pair;
  const Ints zero = allInts(0), old = loadInts(packed), count = loadInts(samples);
  const Ints mean = shiftRight(old, kWeightBits), weight = bitAnd(old, allInts(static_cast<std::int32_t>(kWeightMask)));
  const Ints total = addInts(weight, count);
  const std::uint32_t sampled = lessInts(zero, count), was_observed = lessInts(zero, weight);
  // Lanes without any observation would divide zero by zero.
  const Ints folded = foldedMean(mean, weight, loadInts(distance), mostInts(total, allInts(1)));
  const Ints now_mean = choose(sampled, folded, mean);
  const Ints now_weight = leastInts(total, allInts(c.max_weight));
  store(packed, bitOr(shiftLeft(now_mean, kWeightBits), now_weight));
  store(distance, zero);
  store(samples, zero);
  sample_total = addInts(sample_total, count);
  const std::uint32_t is_observed = was_observed | sampled;
  const Ints limit = allInts(c.collision_mean);
  setPair(facts.old_observed, pair, was_observed);
  setPair(facts.now_observed, pair, is_observed);
  setPair(facts.old_collides, pair, was_observed & lessInts(mean, limit));
  setPair(facts.now_collides, pair, is_observed & lessInts(now_mean, limit));
}

inline bool fold(const LeafTarget& leaf, const KernelConstants& c, std::uint32_t touched, LeafSums& sums,
                 const LeafBits& passed, LeafChange& change, FoldCounts& counts) {
  LeafFacts facts;
  Ints sample_total = allInts(0);
  for (std::uint32_t left = touched; left != 0; left &= left - 1) {
    foldPair(leaf, sums, c, std::countr_zero(left), facts, sample_total);
  }
  LeafBits gained;
  for (std::size_t x = 0; x < 8; ++x) gained[x] = passed[x] & ~leaf.cleared[x];
  if (leaf.packed != nullptr) {
    // Observed voxels gain nothing from being cleared.
    const Ints weights = allInts(static_cast<std::int32_t>(kWeightMask));
    for (std::uint32_t left = pairsOf(gained) & ~touched; left != 0; left &= left - 1) {
      const int pair = std::countr_zero(left);
      const std::uint32_t observed = lessInts(allInts(0), bitAnd(loadInts(leaf.packed + 16 * pair), weights));
      setPair(facts.old_observed, pair, observed);
      setPair(facts.now_observed, pair, observed);
      // Not looked at before: whether these collide. It stays as it is, and so does what the arm sees.
    }
  }
  std::uint64_t flipped = 0, newly_observed = 0;
  for (std::size_t x = 0; x < 8; ++x) {
    const std::uint64_t old_cleared = leaf.cleared[x], now_cleared = old_cleared | gained[x];
    const std::uint64_t old_arm =
        (facts.old_observed[x] & ~facts.old_collides[x]) | (~facts.old_observed[x] & old_cleared);
    const std::uint64_t now_arm =
        (facts.now_observed[x] & ~facts.now_collides[x]) | (~facts.now_observed[x] & now_cleared);
    change.collides_on[x] = facts.now_collides[x] & ~facts.old_collides[x];
    change.collides_off[x] = facts.old_collides[x] & ~facts.now_collides[x];
    change.arm_free_on[x] = now_arm & ~old_arm;
    change.arm_free_off[x] = old_arm & ~now_arm;
    flipped |= (facts.now_collides[x] ^ facts.old_collides[x]) | (now_arm ^ old_arm);
    leaf.cleared[x] = now_cleared;
  }
  for (std::size_t x = 0; x < 8; ++x) {
    newly_observed += static_cast<std::uint64_t>(std::popcount(facts.now_observed[x] & ~facts.old_observed[x]));
  }
  counts.distance_updates += sumOf(sample_total);
  counts.newly_observed += newly_observed;
  return flipped != 0;
}
