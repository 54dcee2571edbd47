// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// One double at a time, in the terms of real_avx512.h, as far as near_kernels_body.h needs them. Included inside a
// namespace; hence no include guard.

using Real = double;
using Flag = bool;
constexpr int kLanes = 1;
inline Real real(double value) { return value; }
inline Real load(const double* from) { return *from; }
inline Real loadFloats(const float* from) { return static_cast<double>(*from); }
inline void store(double* to, Real x) { *to = x; }
inline Real plus(Real x, Real y) { return x + y; }
inline Real minus(Real x, Real y) { return x - y; }
inline Real times(Real x, Real y) { return x * y; }
inline Real roundedDown(Real x) { return std::floor(x); }
inline Real higher(Real x, Real y) { return x > y ? x : y; }
inline Flag atMost(Real x, Real y) { return x <= y; }
inline Real choose(Flag flag, Real yes, Real no) { return flag ? yes : no; }
inline unsigned bitsOf(Flag flag) { return flag ? 1u : 0u; }
