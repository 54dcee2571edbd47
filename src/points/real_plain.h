// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// One double at a time, in the terms of real_avx512.h, as far as near_kernels_body.h needs them. Included inside a
// namespace; hence no include guard.

using kernels::one_normal::atMost, kernels::one_normal::choose, kernels::one_normal::Flag, kernels::one_normal::higher,
    kernels::one_normal::minus, kernels::one_normal::plus, kernels::one_normal::Real, kernels::one_normal::real,
    kernels::one_normal::times;
constexpr int kLanes = 1;
inline Real load(const double* from) { return *from; }
inline Real loadFloats(const float* from) { return static_cast<double>(*from); }
inline void store(double* to, Real x) { *to = x; }
inline Real roundedDown(Real x) { return std::floor(x); }
inline unsigned bitsOf(Flag flag) { return flag ? 1u : 0u; }
