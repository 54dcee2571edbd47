// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// How a scan is fused into one leaf, in terms of lanes: cone, band, news, votes and fold. Included inside a namespace
// after one of the lanes_*, which say how many lanes there are and what they can do; hence no include guard.
//
// Voxels of a leaf are handled kLanes at a time: a *strip*, kLanes / 8 rows along z, kSlabStrips of them to a slab of
// equal x. Lanes hold a number each (Floats, Ints) or a flag each (Mask, Rows). Bits are the flags of a whole leaf, in
// kBitWords words; a Slab has those of a slab, Flips those of the facts that flipped. Every step is an IEEE operation
// that rounds once (no contraction), in the same order for all lanes, so that all of them give the same bits.

/// e along x, and the terms of s and |e|^2 that depend only on x.
struct SlabTerms {
  float ex, sx, ex2;
};

/// These for all slabs; and the terms that depend only on y and z, for the strips of a slab.
struct Terms {
  alignas(32) float ex[8], sx[8], ex2[8];  ///< only if kKeepsSlabTerms
  Floats s[kSlabStrips], e2[kSlabStrips];
  Mask in_cube[kSlabStrips];
};

/// Slabs inside the region's box, first and last. Rows are not cut: a loop of fixed length is cheaper.
struct SlabRange {
  int x0, x1;
};

ACCESSVDB_KERNEL int floorOf(float value) {
  const int n = static_cast<int>(value);
  return n - (static_cast<float>(n) > value ? 1 : 0);
}

ACCESSVDB_KERNEL SlabRange slabsOf(const ReturnInLeaf& ray) {
  const float x = ray.leaf[0] - ray.offset[0];
  const int x0 = -floorOf(x - ray.box_x.low), x1 = floorOf(ray.box_x.high - x);
  return {x0 > 0 ? x0 : 0, x1 < 7 ? x1 : 7};
}

ACCESSVDB_KERNEL SlabTerms makeSlabTerms(const ReturnInLeaf& ray, int x) {
  const float ex = (ray.leaf[0] + static_cast<float>(x)) - ray.offset[0];
  return {ex, ex * ray.to_sensor[0], ex * ex};
}

/// Of the slab at x.
ACCESSVDB_KERNEL SlabTerms slabTerms(const Terms& terms, const ReturnInLeaf& ray, int x) {
  if constexpr (kKeepsSlabTerms) return {terms.ex[x], terms.sx[x], terms.ex2[x]};
  return makeSlabTerms(ray, x);
}

ACCESSVDB_KERNEL void setTerms(const ReturnInLeaf& ray, float tau, Terms& terms) {
  if constexpr (kKeepsSlabTerms) {
    for (int x = 0; x < 8; ++x) {
      const SlabTerms slab = makeSlabTerms(ray, x);
      terms.ex[x] = slab.ex;
      terms.sx[x] = slab.sx;
      terms.ex2[x] = slab.ex2;
    }
  }
  const Floats ez = sub(add(all(ray.leaf[2]), laneZ()), all(ray.offset[2]));
  const Floats sz = mul(ez, all(ray.to_sensor[2])), ez2 = mul(ez, ez);
  const Mask in_z = atMost(absolute(ez), all(tau));
  for (int strip = 0; strip < kSlabStrips; ++strip) {
    const Floats y = add(all(static_cast<float>(kLanes / 8 * strip)), laneY());
    const Floats ey = sub(add(all(ray.leaf[1]), y), all(ray.offset[1]));
    terms.s[strip] = add(mul(ey, all(ray.to_sensor[1])), sz);
    terms.e2[strip] = add(mul(ey, ey), ez2);
    terms.in_cube[strip] = atMost(in_z, absolute(ey), all(tau));
  }
}

/// d = R - |x - q|, without the cancellation of two large numbers, clamped and in steps.
ACCESSVDB_KERNEL Ints sampleOf(Floats two_rs, Floats e2, Floats to_sensor, Floats range, const KernelConstants& c) {
  const Floats d = div(sub(two_rs, e2), add(range, to_sensor));
  const Floats clamped = least(most(d, all(c.clamp_low)), all(c.clamp_high));
  return truncate(add(mul(sub(clamped, all(c.clamp_low)), all(c.sample_scale)), all(0.5f)));
}

/// Whether a voxel of the leaf may be in the ball around the return that is always updated.
ACCESSVDB_KERNEL bool reachesOwnBall(const ReturnInLeaf& ray) {
  float e2 = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float low = ray.leaf[axis] - ray.offset[axis], beyond = low > -7 - low ? low : -7 - low;
    const float e = beyond > 0 ? beyond : 0;  // least distance along this axis
    e2 += e * e;
  }
  return e2 <= kOwnVoxelRadius + kSlack;
}

ACCESSVDB_KERNEL Inside insideDoubleCone(const ReturnInLeaf& ray, const KernelConstants& c, const Terms& terms) {
  const SlabRange slabs = slabsOf(ray);
  const Floats cos2 = all(c.cone_cos_squared), one = all(1.0f);
  const bool own_ball = reachesOwnBall(ray);
  Inside inside;
  for (int x = slabs.x0; x <= slabs.x1; ++x) {
    const SlabTerms of_slab = slabTerms(terms, ray, x);
    if (!(magnitude(of_slab.ex) <= c.tau)) continue;
    const Floats sx = all(of_slab.sx), ex2 = all(of_slab.ex2);
    Slab slab = 0;
    for (int y = 0; y < kSlabStrips; ++y) {
      const Floats s = add(sx, terms.s[y]), e2 = add(ex2, terms.e2[y]);
      Rows in_strip = greater(terms.in_cube[y], mul(s, s), mul(cos2, e2));
      if (own_ball) in_strip |= atMost(terms.in_cube[y], e2, one);
      setStrip(slab, y, in_strip);
    }
    inside.add(x, slab);
  }
  inside.finish();
  return inside;
}

ACCESSVDB_KERNEL void addSamples(Rows inside, Ints sample, int strip, LeafSums& sums) {
  std::uint32_t* to = sums.packed + kLanes * strip;
  const Ints old = loadInts(to), one_sample = allInts(1 << LeafSums::kDistanceBits);
  store(to, choose(inside, addInts(old, addInts(sample, one_sample)), old));
}

/// @param contra  nullptr, or where to mark the voxels whose sample collides
ACCESSVDB_KERNEL_INLINE std::uint32_t addDoubleConeTo(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums,
                                                      Bits* contra) {
  Terms terms;
  setTerms(ray, c.tau, terms);
  const Inside inside = insideDoubleCone(ray, c, terms);
  const Floats range = all(ray.range), range_squared = mul(range, range), two_range = add(range, range);
  const Floats zero = all(0.0f);
  for (std::uint32_t left = inside.strips; left != 0; left &= left - 1) {
    const int strip = lowestBit(left), x = strip / kSlabStrips, y = strip % kSlabStrips;
    const SlabTerms slab = slabTerms(terms, ray, x);
    const Floats s = add(all(slab.sx), ofStrip(terms.s, y)), e2 = add(all(slab.ex2), ofStrip(terms.e2, y));
    const Floats two_rs = mul(two_range, s);  // a doubled number: nothing is rounded
    const Floats to_sensor = squareRoot(most(add(sub(range_squared, two_rs), e2), zero));
    const Ints sample = sampleOf(two_rs, e2, to_sensor, range, c);
    addSamples(inside.ofStrip(strip), sample, strip, sums);
    if (contra == nullptr) continue;
    const Rows collides = inside.ofStrip(strip) & lessInts(sample, allInts(c.collision_sample));
    setStrip(*contra, strip, collides);
  }
  return inside.strips;
}

ACCESSVDB_KERNEL std::uint32_t addDoubleCone(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums) {
  return addDoubleConeTo(ray, c, sums, nullptr);
}

ACCESSVDB_KERNEL std::uint32_t addNews(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums,
                                       Bits& contra) {
  return addDoubleConeTo(ray, c, sums, &contra);
}

ACCESSVDB_KERNEL std::uint32_t addFullCube(const ReturnInLeaf& ray, const KernelConstants& c, LeafSums& sums) {
  const SlabRange slabs = slabsOf(ray);
  Terms terms;
  setTerms(ray, c.tau, terms);
  const Floats range = all(ray.range), range_squared = mul(range, range), two_range = add(range, range);
  const Floats zero = all(0.0f);
  std::uint32_t touched = 0;
  for (int x = slabs.x0; x <= slabs.x1; ++x) {
    const SlabTerms of_slab = slabTerms(terms, ray, x);
    if (!(magnitude(of_slab.ex) <= c.tau)) continue;
    const Floats sx = all(of_slab.sx), ex2 = all(of_slab.ex2);
    for (int y = 0; y < kSlabStrips; ++y) {
      if (areNone(terms.in_cube[y])) continue;
      const Floats s = add(sx, terms.s[y]), e2 = add(ex2, terms.e2[y]);
      const Floats two_rs = mul(two_range, s);  // a doubled number: nothing is rounded
      const Floats to_sensor = squareRoot(most(add(sub(range_squared, two_rs), e2), zero));
      const Rows inside = greater(terms.in_cube[y], sub(range, s), mul(all(c.cone_cos), to_sensor));
      if (areNone(inside)) continue;
      const int strip = kSlabStrips * x + y;
      addSamples(inside, sampleOf(two_rs, e2, to_sensor, range, c), strip, sums);
      touched |= 1u << strip;
    }
  }
  return touched;
}

ACCESSVDB_KERNEL std::uint32_t markBand(const ReturnInLeaf& ray, const KernelConstants& c, Bits& passed) {
  const SlabRange slabs = slabsOf(ray);
  Terms terms;
  setTerms(ray, c.tau, terms);
  const Floats begin = all(c.band_begin), end = all(c.band_end < ray.range ? c.band_end : ray.range);
  const Floats radius2 = all(c.band_radius_squared);
  std::uint32_t count = 0;
  for (int x = slabs.x0; x <= slabs.x1; ++x) {
    const SlabTerms of_slab = slabTerms(terms, ray, x);
    const Floats sx = all(of_slab.sx), ex2 = all(of_slab.ex2);
    Slab slab = 0;
    for (int y = 0; y < kSlabStrips; ++y) {
      const Floats s = add(sx, terms.s[y]), e2 = add(ex2, terms.e2[y]);
      setStrip(slab, y, atMost(atMost(greater(s, begin), s, end), sub(e2, mul(s, s)), radius2));
    }
    setSlab(passed, x, slab);
    count += static_cast<std::uint32_t>(countBits(slab));
  }
  return sumOfLanes(count);
}

/// Facts of a leaf before and after a fold, as far as they were checked; one bit per voxel.
struct LeafFacts {
  Bits old_observed = {}, now_observed = {}, old_collides = {}, now_collides = {};
};

/// (mean * (total - count) + 16 * sum) / total, rounded to nearest, halves up: computed as the step from the old mean,
/// which fits into 32 bits. No step exceeds 2^20, so the quotient in floats is off by less than 1/8; the remainder
/// after truncation says whether to correct it by one.
/// @param total  1 or more, even if there is no sample
ACCESSVDB_KERNEL Ints foldedMean(Ints mean, Ints sum, Ints count, Ints total) {
  const Ints step = subInts(shiftLeft(sum, 4), mulInts(mean, count));
  const Ints about = truncate(div(toFloats(step), toFloats(total)));
  const Ints left = subInts(step, mulInts(about, total)), twice_left = addInts(left, left);
  const Ints folded = addInts(mean, about), one = allInts(1);
  const Rows below = lessInts(twice_left, subInts(allInts(0), total));
  const Rows above = ~lessInts(twice_left, total);
  return addInts(addInts(folded, choose(above, one, allInts(0))), choose(below, allInts(-1), allInts(0)));
}

/// Folds one strip with samples.
ACCESSVDB_KERNEL void foldStrip(const LeafTarget& leaf, LeafSums& sums, const KernelConstants& c, int strip,
                                LeafFacts& facts, Ints& sample_total) {
  std::uint32_t* packed = leaf.packed + kLanes * strip;
  std::uint32_t* summed = sums.packed + kLanes * strip;
  const Ints zero = allInts(0), old = loadInts(packed), summed_up = loadInts(summed);
  const Ints count = shiftRight(summed_up, LeafSums::kDistanceBits);
  const Ints sum = bitAnd(summed_up, allInts((1 << LeafSums::kDistanceBits) - 1));
  const Ints mean = shiftRight(old, kWeightBits), weight = bitAnd(old, allInts(static_cast<std::int32_t>(kWeightMask)));
  const Ints total = addInts(weight, count);
  const Rows was_observed = lessInts(zero, weight), is_observed = lessInts(zero, total);
  const Ints now_mean = foldedMean(mean, sum, count, mostInts(total, allInts(1)));
  const Ints now_weight = leastInts(total, allInts(c.max_weight));
  store(packed, bitOr(shiftLeft(now_mean, kWeightBits), now_weight));
  store(summed, zero);
  sample_total = addInts(sample_total, count);
  const Ints limit = allInts(c.collision_mean);
  setStrip(facts.old_observed, strip, was_observed);
  setStrip(facts.now_observed, strip, is_observed);
  setStrip(facts.old_collides, strip, was_observed & lessInts(mean, limit));
  setStrip(facts.now_collides, strip, is_observed & lessInts(now_mean, limit));
}

ACCESSVDB_KERNEL std::uint32_t gainedStrips(const Bits& passed, const Bits& cleared) {
  Bits gained;
  for (std::size_t n = 0; n < kBitWords; ++n) gained[n] = passed[n] & ~cleared[n];
  return stripsOf(gained);
}

ACCESSVDB_KERNEL void markMeasuredFree(const LeafSums& sums, const KernelConstants& c, std::uint32_t touched,
                                       Bits& free) {
  for (std::uint32_t left = touched; left != 0; left &= left - 1) {
    const int strip = lowestBit(left);
    const Ints summed_up = loadInts(sums.packed + kLanes * strip);
    const Ints count = shiftRight(summed_up, LeafSums::kDistanceBits);
    const Ints sum = bitAnd(summed_up, allInts((1 << LeafSums::kDistanceBits) - 1));
    // 16 sum / count >= collision mean; a sum has 24 bits, a mean 20, a count 8: no overflow.
    const Rows collides = lessInts(shiftLeft(sum, 4), mulInts(allInts(c.collision_mean), count));
    setStrip(free, strip, lessInts(allInts(0), count) & ~collides);
  }
}

ACCESSVDB_KERNEL void markColliding(const std::uint32_t* packed, const KernelConstants& c, std::uint32_t strips,
                                    Bits& collides) {
  for (std::uint32_t left = strips; left != 0; left &= left - 1) {
    const int strip = lowestBit(left);
    const Ints old = loadInts(packed + kLanes * strip);
    const Ints weight = bitAnd(old, allInts(static_cast<std::int32_t>(kWeightMask)));
    setStrip(collides, strip,
             lessInts(allInts(0), weight) & lessInts(shiftRight(old, kWeightBits), allInts(c.collision_mean)));
  }
}

ACCESSVDB_KERNEL std::uint64_t flipArm(const AgedFacts& facts, BitWord* confirmed, Flips& change) {
  std::uint64_t flipped = 0;
  for (std::size_t n = 0; n < kBitWords; ++n) {
    confirmed[n] |= facts.confirmed[n];
    const BitWord collides = (facts.collided[n] & ~change.collides_off[n]) | change.collides_on[n];
    const BitWord old_arm = facts.was_free[n] & ~facts.collided[n];
    const BitWord now_arm = (facts.was_free[n] | facts.confirmed[n]) & ~collides;
    change.arm_free_on[n] = now_arm & ~old_arm;
    change.arm_free_off[n] = old_arm & ~now_arm;
    const BitWord any = change.collides_on[n] | change.collides_off[n] | (now_arm ^ old_arm);
    flipped += static_cast<std::uint64_t>(countBits(any));
  }
  return sumOfLanes(flipped);
}

/// What the scan says, before it is folded, about the voxels that it may vote for or that have votes: others keep none.
ACCESSVDB_KERNEL void judge(const LeafTarget& leaf, const LeafSums& sums, const KernelConstants& c,
                            std::uint32_t touched, ScanVerdict& scan) {
  const Ints zero = allInts(0);
  Bits concerned = *leaf.contra;
  for (const Bits& bits : leaf.votes->bit) {
    for (std::size_t n = 0; n < kBitWords; ++n) concerned[n] |= bits[n];
  }
  for (std::uint32_t left = stripsOf(concerned) & touched; left != 0; left &= left - 1) {
    const int strip = lowestBit(left);
    const Ints old = loadInts(leaf.packed + kLanes * strip), summed_up = loadInts(sums.packed + kLanes * strip);
    const Ints count = shiftRight(summed_up, LeafSums::kDistanceBits);
    const Ints sum = bitAnd(summed_up, allInts((1 << LeafSums::kDistanceBits) - 1));
    const Ints mean = shiftRight(old, kWeightBits);
    const Ints weight = bitAnd(old, allInts(static_cast<std::int32_t>(kWeightMask)));
    // 16 sum / count - zero_mean < (mean - zero_mean) / 2; a sum has 24 bits, a mean 20, a count 8: no overflow.
    const Ints scans = shiftLeft(sum, 5), maps = mulInts(addInts(mean, allInts(c.zero_mean)), count);
    setStrip(scan.sampled, strip, lessInts(zero, count));
    setStrip(scan.contradicts, strip, lessInts(scans, maps));
    setStrip(scan.free, strip, lessInts(zero, weight) & ~lessInts(mean, allInts(c.collision_mean)));
  }
  scan.contra = *leaf.contra;
}

/// The end of a fold: clears what was passed, and finds what flipped.
/// @param facts  of the strips in `touched`  @param old_blocked, now_blocked  by votes
/// @return whether a fact flipped; `change` is written in any case
ACCESSVDB_KERNEL bool finishFold(const LeafTarget& leaf, std::uint32_t touched, const Bits& passed, LeafFacts& facts,
                                 const Bits& old_blocked, const Bits& now_blocked, Flips& change, FoldCounts& counts) {
  Bits gained;
  for (std::size_t n = 0; n < kBitWords; ++n) gained[n] = passed[n] & ~leaf.cleared[n];
  if (leaf.packed != nullptr) {
    // Clearing does not affect observed voxels.
    const Ints weights = allInts(static_cast<std::int32_t>(kWeightMask));
    for (std::uint32_t left = stripsOf(gained) & ~touched; left != 0; left &= left - 1) {
      const int strip = lowestBit(left);
      const Rows observed = lessInts(allInts(0), bitAnd(loadInts(leaf.packed + kLanes * strip), weights));
      setStrip(facts.old_observed, strip, observed);
      setStrip(facts.now_observed, strip, observed);
      // Whether these collide is not checked here: it does not change, and neither does what the arm sees.
    }
  }
  std::uint64_t flipped_voxels = 0, newly_observed = 0;
  for (std::size_t n = 0; n < kBitWords; ++n) {
    const BitWord old_cleared = leaf.cleared[n], now_cleared = old_cleared | gained[n];
    // Only observed voxels are blocked.
    const BitWord old_collides = facts.old_collides[n] | old_blocked[n];
    const BitWord now_collides = facts.now_collides[n] | now_blocked[n];
    const BitWord old_arm = (facts.old_observed[n] & ~old_collides) | (~facts.old_observed[n] & old_cleared);
    const BitWord now_arm = (facts.now_observed[n] & ~now_collides) | (~facts.now_observed[n] & now_cleared);
    change.collides_on[n] = now_collides & ~old_collides;
    change.collides_off[n] = old_collides & ~now_collides;
    change.arm_free_on[n] = now_arm & ~old_arm;
    change.arm_free_off[n] = old_arm & ~now_arm;
    const BitWord flipped = (now_collides ^ old_collides) | (now_arm ^ old_arm);
    flipped_voxels += static_cast<std::uint64_t>(countBits(flipped));
    leaf.cleared[n] = now_cleared;
  }
  for (std::size_t n = 0; n < kBitWords; ++n) {
    newly_observed += static_cast<std::uint64_t>(countBits(facts.now_observed[n] & ~facts.old_observed[n]));
  }
  flipped_voxels = sumOfLanes(flipped_voxels);
  counts.newly_observed += sumOfLanes(newly_observed);
  counts.flipped_voxels += flipped_voxels;
  return flipped_voxels != 0;
}

ACCESSVDB_KERNEL bool fold(const LeafTarget& leaf, const KernelConstants& c, std::uint32_t touched, LeafSums& sums,
                           const Bits& passed, Flips& change, FoldCounts& counts) {
  LeafFacts facts;
  Bits old_blocked = {}, now_blocked = {};
  if (leaf.votes != nullptr) {
    ScanVerdict scan;
    judge(leaf, sums, c, touched, scan);
    castVotes(*leaf.votes, scan, old_blocked, now_blocked);
  }
  Ints sample_total = allInts(0);
  for (std::uint32_t left = touched; left != 0; left &= left - 1) {
    foldStrip(leaf, sums, c, lowestBit(left), facts, sample_total);
  }
  counts.distance_updates += sumOf(sample_total);
  return finishFold(leaf, touched, passed, facts, old_blocked, now_blocked, change, counts);
}
