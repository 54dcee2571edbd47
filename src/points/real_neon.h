// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Two doubles at a time, on 64-bit ARM. Included inside a namespace; hence no include guard.

using Real = float64x2_t;
using Flag = uint64x2_t;
constexpr int kLanes = 2;
inline Real real(double value) { return vdupq_n_f64(value); }
inline Real load(const double* from) { return vld1q_f64(from); }
inline Real loadFloats(const float* from) { return vcvt_f64_f32(vld1_f32(from)); }
inline void store(double* to, Real x) { vst1q_f64(to, x); }
inline void storeFloats(float* to, Real x) { vst1_f32(to, vcvt_f32_f64(x)); }
inline Real plus(Real x, Real y) { return vaddq_f64(x, y); }
inline Real minus(Real x, Real y) { return vsubq_f64(x, y); }
inline Real times(Real x, Real y) { return vmulq_f64(x, y); }
inline Real over(Real x, Real y) { return vdivq_f64(x, y); }
inline Real root(Real x) { return vsqrtq_f64(x); }
inline Real roundedDown(Real x) { return vrndmq_f64(x); }
inline Real negative(Real x) { return vnegq_f64(x); }
inline Real magnitude(Real x) { return vabsq_f64(x); }
inline Flag isBelow(Real x, Real y) { return vcltq_f64(x, y); }
inline Flag atMost(Real x, Real y) { return vcleq_f64(x, y); }
inline Flag differ(Real x, Real y) { return vreinterpretq_u64_u32(vmvnq_u32(vreinterpretq_u32_u64(vceqq_f64(x, y)))); }
inline Real choose(Flag flag, Real yes, Real no) { return vbslq_f64(flag, yes, no); }
// Like the other sets, and unlike vminq and vmaxq, the second where the two do not compare.
inline Real lower(Real x, Real y) { return choose(vcltq_f64(x, y), x, y); }
inline Real higher(Real x, Real y) { return choose(vcgtq_f64(x, y), x, y); }
inline unsigned bitsOf(Flag flag) {
  return static_cast<unsigned>((vgetq_lane_u64(flag, 0) & 1) | (vgetq_lane_u64(flag, 1) & 2));
}
inline bool areAll(Flag flag) { return bitsOf(flag) == 3; }
inline bool areNone(Flag flag) { return bitsOf(flag) == 0; }
