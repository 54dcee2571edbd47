// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The kernels in terms of sixteen lanes. Included inside a namespace by leaf_kernels.cpp after one of the lanes_*.h,
// hence no include guard.

alignas(64) constexpr float kLaneZ[16] = {0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7};
alignas(64) constexpr float kLaneY[16] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1};

/// e along x, and the terms of s and |e|^2 that depend only on x; and those that depend only on y and z, for the four
/// pairs of rows of a slab. Loaded from memory, a float fills all lanes at no cost.
struct Terms {
  alignas(32) float ex[8], sx[8], ex2[8];
  Floats s[4], e2[4];
  Mask in_cube[4];
};

/// Slabs inside the region's box, first and last. Rows are not cut: a loop of fixed length is cheaper.
struct SlabRange {
  int x0, x1;
};

inline int floorOf(float value) {
  const int n = static_cast<int>(value);
  return n - (static_cast<float>(n) > value ? 1 : 0);
}

inline SlabRange slabsOf(const ReturnInLeaf& ray) {
  const float x = ray.leaf[0] - ray.offset[0];
  const int x0 = -floorOf(x - ray.box_x.low), x1 = floorOf(ray.box_x.high - x);
  return {x0 > 0 ? x0 : 0, x1 < 7 ? x1 : 7};
}

inline void setTerms(const ReturnInLeaf& ray, float tau, Terms& terms) {
  for (int x = 0; x < 8; ++x) {
    const float ex = (ray.leaf[0] + static_cast<float>(x)) - ray.offset[0];
    terms.ex[x] = ex;
    terms.sx[x] = ex * ray.to_sensor[0];
    terms.ex2[x] = ex * ex;
  }
  const Floats ez = sub(add(all(ray.leaf[2]), loadFloats(kLaneZ)), all(ray.offset[2]));
  const Floats sz = mul(ez, all(ray.to_sensor[2])), ez2 = mul(ez, ez);
  const Mask in_z = atMost(absolute(ez), all(tau));
  for (int pair = 0; pair < 4; ++pair) {
    const Floats y = add(all(static_cast<float>(2 * pair)), loadFloats(kLaneY));
    const Floats ey = sub(add(all(ray.leaf[1]), y), all(ray.offset[1]));
    terms.s[pair] = add(mul(ey, all(ray.to_sensor[1])), sz);
    terms.e2[pair] = add(mul(ey, ey), ez2);
    terms.in_cube[pair] = atMost(in_z, absolute(ey), all(tau));
  }
}

/// d = R - |x - q|, without the cancellation of two large numbers, clamped and in steps.
inline Ints sampleOf(Floats two_rs, Floats e2, Floats to_sensor, Floats range, const KernelConstants& c) {
  const Floats d = div(sub(two_rs, e2), add(range, to_sensor));
  const Floats clamped = least(most(d, all(c.clamp_low)), all(c.clamp_high));
  return truncate(add(mul(sub(clamped, all(c.clamp_low)), all(c.sample_scale)), all(0.5f)));
}

/// Which voxels of a leaf are in a region: pair by pair, and which pairs have any.
struct Inside {
  LeafBits slabs;
  std::uint32_t pairs = 0;
  [[nodiscard]] std::uint32_t ofPair(int pair) const {
    return static_cast<std::uint32_t>(slabs[static_cast<std::size_t>(pair >> 2)] >> (16 * (pair & 3))) & 0xffffu;
  }
};

/// The pairs of a slab with any bit set.
inline std::uint32_t pairsOfSlab(std::uint64_t bits) {
  constexpr std::uint64_t kTop = 0x8000800080008000u;
  const std::uint64_t tops = (((bits & ~kTop) + ~kTop) | bits) & kTop;  // per pair: set if any of its bits is
  return static_cast<std::uint32_t>((tops >> 15) * 0x0001000200040008u >> 48) & 0xfu;
}

/// Whether a voxel of the leaf may be in the ball around the return that is always updated.
inline bool reachesOwnBall(const ReturnInLeaf& ray) {
  float e2 = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float low = ray.leaf[axis] - ray.offset[axis], beyond = low > -7 - low ? low : -7 - low;
    const float e = beyond > 0 ? beyond : 0;  // least distance along this axis
    e2 += e * e;
  }
  return e2 <= kOwnVoxelRadius + kSlack;
}

inline Inside insideDoubleCone(const ReturnInLeaf& ray, const KernelConstants& c, const Terms& terms) {
  const SlabRange slabs = slabsOf(ray);
  const Floats cos2 = all(c.cone_cos_squared), one = all(1.0f);
  const bool own_ball = reachesOwnBall(ray);
  Inside inside;
  for (int x = slabs.x0; x <= slabs.x1; ++x) {
    if (!(std::fabs(terms.ex[x]) <= c.tau)) continue;
    const Floats sx = all(terms.sx[x]), ex2 = all(terms.ex2[x]);
    std::uint64_t bits = 0;
    for (int y = 0; y < 4; ++y) {
      const Floats s = add(sx, terms.s[y]), e2 = add(ex2, terms.e2[y]);
      std::uint32_t in_pair = greater(terms.in_cube[y], mul(s, s), mul(cos2, e2));
      if (own_ball) in_pair |= atMost(terms.in_cube[y], e2, one);
      bits |= static_cast<std::uint64_t>(in_pair) << (16 * y);
    }
    inside.slabs[static_cast<std::size_t>(x)] = bits;
    inside.pairs |= pairsOfSlab(bits) << (4 * x);
  }
  return inside;
}

inline void addSamples(std::uint32_t inside, Ints sample, int pair, LeafSums& sums) {
  std::uint32_t* to = sums.packed.data() + 16 * pair;
  const Ints old = loadInts(to), one_sample = allInts(1 << LeafSums::kDistanceBits);
  store(to, choose(inside, addInts(old, addInts(sample, one_sample)), old));
}

/// @param contra  nullptr, or where to mark the voxels whose sample collides
[[gnu::always_inline]] inline std::uint32_t addDoubleConeTo(const ReturnInLeaf& ray, const KernelConstants& c,
                                                            LeafSums& sums, LeafBits* contra) {
  Terms terms;
  setTerms(ray, c.tau, terms);
  const Inside inside = insideDoubleCone(ray, c, terms);
  const Floats range = all(ray.range), range_squared = mul(range, range), two_range = add(range, range);
  const Floats zero = all(0.0f);
  for (std::uint32_t left = inside.pairs; left != 0; left &= left - 1) {
    const int pair = std::countr_zero(left), x = pair >> 2, y = pair & 3;
    const Floats s = add(all(terms.sx[x]), terms.s[y]), e2 = add(all(terms.ex2[x]), terms.e2[y]);
    const Floats two_rs = mul(two_range, s);  // a doubled number: nothing is rounded
    const Floats to_sensor = squareRoot(most(add(sub(range_squared, two_rs), e2), zero));
    const Ints sample = sampleOf(two_rs, e2, to_sensor, range, c);
    addSamples(inside.ofPair(pair), sample, pair, sums);
    if (contra == nullptr) continue;
    const std::uint32_t collides = inside.ofPair(pair) & lessInts(sample, allInts(c.collision_sample));
    (*contra)[static_cast<std::size_t>(x)] |= static_cast<std::uint64_t>(collides) << (16 * y);
  }
  return inside.pairs;
}

inline std::uint32_t addDoubleCone(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums) {
  return addDoubleConeTo(ray, c, sums, nullptr);
}

inline std::uint32_t addNews(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums, LeafBits& contra) {
  return addDoubleConeTo(ray, c, sums, &contra);
}

inline std::uint32_t addFullCube(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums) {
  const SlabRange slabs = slabsOf(ray);
  Terms terms;
  setTerms(ray, c.tau, terms);
  const Floats range = all(ray.range), range_squared = mul(range, range), two_range = add(range, range);
  const Floats zero = all(0.0f);
  std::uint32_t touched = 0;
  for (int x = slabs.x0; x <= slabs.x1; ++x) {
    if (!(std::fabs(terms.ex[x]) <= c.tau)) continue;
    const Floats sx = all(terms.sx[x]), ex2 = all(terms.ex2[x]);
    for (int y = 0; y < 4; ++y) {
      if (terms.in_cube[y] == 0) continue;
      const Floats s = add(sx, terms.s[y]), e2 = add(ex2, terms.e2[y]);
      const Floats two_rs = mul(two_range, s);  // a doubled number: nothing is rounded
      const Floats to_sensor = squareRoot(most(add(sub(range_squared, two_rs), e2), zero));
      const std::uint32_t inside = greater(terms.in_cube[y], sub(range, s), mul(all(c.cone_cos), to_sensor));
      if (inside == 0) continue;
      const int pair = 4 * x + y;
      addSamples(inside, sampleOf(two_rs, e2, to_sensor, range, c), pair, sums);
      touched |= 1u << pair;
    }
  }
  return touched;
}

inline std::uint32_t markBand(const ReturnInLeaf& ray, const KernelConstants& c, LeafBits& passed) {
  const SlabRange slabs = slabsOf(ray);
  Terms terms;
  setTerms(ray, c.tau, terms);
  const Floats begin = all(c.band_begin), end = all(c.band_end < ray.range ? c.band_end : ray.range);
  const Floats radius2 = all(c.band_radius_squared);
  std::uint32_t count = 0;
  for (int x = slabs.x0; x <= slabs.x1; ++x) {
    const Floats sx = all(terms.sx[x]), ex2 = all(terms.ex2[x]);
    std::uint64_t word = 0;
    for (int y = 0; y < 4; ++y) {
      const Floats s = add(sx, terms.s[y]), e2 = add(ex2, terms.e2[y]);
      const std::uint32_t inside = atMost(atMost(greater(s, begin), s, end), sub(e2, mul(s, s)), radius2);
      word |= static_cast<std::uint64_t>(inside) << (16 * y);
    }
    passed[static_cast<std::size_t>(x)] |= word;
    count += static_cast<std::uint32_t>(std::popcount(word));
  }
  return count;
}

/// Facts of a leaf before and after a fold, as far as they were checked; one bit per voxel.
struct LeafFacts {
  LeafBits old_observed = {}, now_observed = {}, old_collides = {}, now_collides = {};
};

inline void setPair(LeafBits& bits, int pair, std::uint32_t rows) {
  bits[static_cast<std::size_t>(pair >> 2)] |= static_cast<std::uint64_t>(rows) << (16 * (pair & 3));
}

/// (mean * (total - count) + 16 * sum) / total, rounded to nearest, halves up: computed as the step from the old mean,
/// which fits into 32 bits. No step exceeds 2^20, so the quotient in floats is off by less than 1/8; the remainder
/// after truncation says whether to correct it by one.
/// @param total  1 or more, even if there is no sample
inline Ints foldedMean(Ints mean, Ints sum, Ints count, Ints total) {
  const Ints step = subInts(shiftLeft(sum, 4), mulInts(mean, count));
  const Ints about = truncate(div(toFloats(step), toFloats(total)));
  const Ints left = subInts(step, mulInts(about, total)), twice_left = addInts(left, left);
  const Ints folded = addInts(mean, about), one = allInts(1);
  const std::uint32_t below = lessInts(twice_left, subInts(allInts(0), total));
  const std::uint32_t above = ~lessInts(twice_left, total);
  return addInts(addInts(folded, choose(above, one, allInts(0))), choose(below, allInts(-1), allInts(0)));
}

/// Folds one pair of rows with samples.
inline void foldPair(const LeafTarget& leaf, LeafSums& sums, const KernelConstants& c, int pair, LeafFacts& facts,
                     Ints& sample_total) {
  std::uint32_t* packed = leaf.packed + 16 * pair;
  std::uint32_t* summed = sums.packed.data() + 16 * pair;
  const Ints zero = allInts(0), old = loadInts(packed), summed_up = loadInts(summed);
  const Ints count = shiftRight(summed_up, LeafSums::kDistanceBits);
  const Ints sum = bitAnd(summed_up, allInts((1 << LeafSums::kDistanceBits) - 1));
  const Ints mean = shiftRight(old, kWeightBits), weight = bitAnd(old, allInts(static_cast<std::int32_t>(kWeightMask)));
  const Ints total = addInts(weight, count);
  const std::uint32_t was_observed = lessInts(zero, weight), is_observed = lessInts(zero, total);
  const Ints now_mean = foldedMean(mean, sum, count, mostInts(total, allInts(1)));
  const Ints now_weight = leastInts(total, allInts(c.max_weight));
  store(packed, bitOr(shiftLeft(now_mean, kWeightBits), now_weight));
  store(summed, zero);
  sample_total = addInts(sample_total, count);
  const Ints limit = allInts(c.collision_mean);
  setPair(facts.old_observed, pair, was_observed);
  setPair(facts.now_observed, pair, is_observed);
  setPair(facts.old_collides, pair, was_observed & lessInts(mean, limit));
  setPair(facts.now_collides, pair, is_observed & lessInts(now_mean, limit));
}

inline std::uint32_t gainedPairs(const LeafBits& passed, const LeafBits& cleared) {
  LeafBits gained;
  for (std::size_t x = 0; x < 8; ++x) gained[x] = passed[x] & ~cleared[x];
  return pairsOf(gained);
}

inline void markMeasuredFree(const LeafSums& sums, const KernelConstants& c, std::uint32_t touched, LeafBits& free) {
  for (std::uint32_t left = touched; left != 0; left &= left - 1) {
    const int pair = std::countr_zero(left);
    const Ints summed_up = loadInts(sums.packed.data() + 16 * pair);
    const Ints count = shiftRight(summed_up, LeafSums::kDistanceBits);
    const Ints sum = bitAnd(summed_up, allInts((1 << LeafSums::kDistanceBits) - 1));
    // 16 sum / count >= collision mean; a sum has 24 bits, a mean 20, a count 8: no overflow.
    const std::uint32_t collides = lessInts(shiftLeft(sum, 4), mulInts(allInts(c.collision_mean), count));
    setPair(free, pair, lessInts(allInts(0), count) & ~collides);
  }
}

inline void markColliding(const std::uint32_t* packed, const KernelConstants& c, std::uint32_t pairs,
                          LeafBits& collides) {
  for (std::uint32_t left = pairs; left != 0; left &= left - 1) {
    const int pair = std::countr_zero(left);
    const Ints old = loadInts(packed + 16 * pair);
    const Ints weight = bitAnd(old, allInts(static_cast<std::int32_t>(kWeightMask)));
    setPair(collides, pair,
            lessInts(allInts(0), weight) & lessInts(shiftRight(old, kWeightBits), allInts(c.collision_mean)));
  }
}

inline std::uint64_t flipArm(const AgedFacts& facts, std::uint64_t* confirmed, LeafChange& change) {
  std::uint64_t flipped = 0;
  for (std::size_t x = 0; x < 8; ++x) {
    confirmed[x] |= facts.confirmed[x];
    const std::uint64_t collides = (facts.collided[x] & ~change.collides_off[x]) | change.collides_on[x];
    const std::uint64_t old_arm = facts.was_free[x] & ~facts.collided[x];
    const std::uint64_t now_arm = (facts.was_free[x] | facts.confirmed[x]) & ~collides;
    change.arm_free_on[x] = now_arm & ~old_arm;
    change.arm_free_off[x] = old_arm & ~now_arm;
    const std::uint64_t any = change.collides_on[x] | change.collides_off[x] | (now_arm ^ old_arm);
    flipped += static_cast<std::uint64_t>(std::popcount(any));
  }
  return flipped;
}

/// What the scan says, before it is folded, about the voxels that it may vote for or that have votes: others keep none.
inline void judge(const LeafTarget& leaf, const LeafSums& sums, const KernelConstants& c, std::uint32_t touched,
                  ScanVerdict& scan) {
  const Ints zero = allInts(0);
  LeafBits concerned = *leaf.contra;
  for (const LeafBits& bits : leaf.votes->bit) {
    for (std::size_t x = 0; x < 8; ++x) concerned[x] |= bits[x];
  }
  for (std::uint32_t left = pairsOf(concerned) & touched; left != 0; left &= left - 1) {
    const int pair = std::countr_zero(left);
    const Ints old = loadInts(leaf.packed + 16 * pair), summed_up = loadInts(sums.packed.data() + 16 * pair);
    const Ints count = shiftRight(summed_up, LeafSums::kDistanceBits);
    const Ints sum = bitAnd(summed_up, allInts((1 << LeafSums::kDistanceBits) - 1));
    const Ints mean = shiftRight(old, kWeightBits);
    const Ints weight = bitAnd(old, allInts(static_cast<std::int32_t>(kWeightMask)));
    // 16 sum / count - zero_mean < (mean - zero_mean) / 2; a sum has 24 bits, a mean 20, a count 8: no overflow.
    const Ints scans = shiftLeft(sum, 5), maps = mulInts(addInts(mean, allInts(c.zero_mean)), count);
    setPair(scan.sampled, pair, lessInts(zero, count));
    setPair(scan.contradicts, pair, lessInts(scans, maps));
    setPair(scan.free, pair, lessInts(zero, weight) & ~lessInts(mean, allInts(c.collision_mean)));
  }
  scan.contra = *leaf.contra;
}

inline bool fold(const LeafTarget& leaf, const KernelConstants& c, std::uint32_t touched, LeafSums& sums,
                 const LeafBits& passed, LeafChange& change, FoldCounts& counts) {
  LeafFacts facts;
  LeafBits old_blocked = {}, now_blocked = {};
  if (leaf.votes != nullptr) {
    ScanVerdict scan;
    judge(leaf, sums, c, touched, scan);
    castVotes(*leaf.votes, scan, old_blocked, now_blocked);
  }
  Ints sample_total = allInts(0);
  for (std::uint32_t left = touched; left != 0; left &= left - 1) {
    foldPair(leaf, sums, c, std::countr_zero(left), facts, sample_total);
  }
  LeafBits gained;
  for (std::size_t x = 0; x < 8; ++x) gained[x] = passed[x] & ~leaf.cleared[x];
  if (leaf.packed != nullptr) {
    // Clearing does not affect observed voxels.
    const Ints weights = allInts(static_cast<std::int32_t>(kWeightMask));
    for (std::uint32_t left = pairsOf(gained) & ~touched; left != 0; left &= left - 1) {
      const int pair = std::countr_zero(left);
      const std::uint32_t observed = lessInts(allInts(0), bitAnd(loadInts(leaf.packed + 16 * pair), weights));
      setPair(facts.old_observed, pair, observed);
      setPair(facts.now_observed, pair, observed);
      // Whether these collide is not checked here: it does not change, and neither does what the arm sees.
    }
  }
  std::uint64_t flipped_voxels = 0, newly_observed = 0;
  for (std::size_t x = 0; x < 8; ++x) {
    const std::uint64_t old_cleared = leaf.cleared[x], now_cleared = old_cleared | gained[x];
    // Only observed voxels are blocked.
    const std::uint64_t old_collides = facts.old_collides[x] | old_blocked[x];
    const std::uint64_t now_collides = facts.now_collides[x] | now_blocked[x];
    const std::uint64_t old_arm = (facts.old_observed[x] & ~old_collides) | (~facts.old_observed[x] & old_cleared);
    const std::uint64_t now_arm = (facts.now_observed[x] & ~now_collides) | (~facts.now_observed[x] & now_cleared);
    change.collides_on[x] = now_collides & ~old_collides;
    change.collides_off[x] = old_collides & ~now_collides;
    change.arm_free_on[x] = now_arm & ~old_arm;
    change.arm_free_off[x] = old_arm & ~now_arm;
    const std::uint64_t flipped = (now_collides ^ old_collides) | (now_arm ^ old_arm);
    flipped_voxels += static_cast<std::uint64_t>(std::popcount(flipped));
    leaf.cleared[x] = now_cleared;
  }
  for (std::size_t x = 0; x < 8; ++x) {
    newly_observed += static_cast<std::uint64_t>(std::popcount(facts.now_observed[x] & ~facts.old_observed[x]));
  }
  counts.distance_updates += sumOf(sample_total);
  counts.newly_observed += newly_observed;
  counts.flipped_voxels += flipped_voxels;
  return flipped_voxels != 0;
}
