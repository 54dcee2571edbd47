// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/normal_kernels.h"

// No standard library code inside the regions: an inline function compiled there could end up being used everywhere.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define ACCESSVDB_X86_KERNELS 1
#include <immintrin.h>
#else
#define ACCESSVDB_X86_KERNELS 0
#endif

#if ACCESSVDB_X86_KERNELS
#pragma GCC push_options
#pragma GCC target("avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::normals_avx512 {

#include "points/real_avx512.h"
// Uses what is defined above.
#include "hostdev/surface_normal_body.h"
#include "points/normal_kernels_body.h"

}  // namespace accessvdb::internal::normals_avx512
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::normals_avx2 {

#include "points/real_avx2.h"
// Uses what is defined above.
#include "hostdev/surface_normal_body.h"
#include "points/normal_kernels_body.h"

}  // namespace accessvdb::internal::normals_avx2
#pragma GCC pop_options
#endif

namespace accessvdb::internal {
namespace {

void oneByOne(const kernels::Covariance* covariances, std::size_t count, float* normals) {
  for (std::size_t n = 0; n < count; ++n) kernels::smallestEigenvector(covariances[n], normals + 3 * n);
}

constexpr NormalKernels kPlain = {"plain", oneByOne};
#if ACCESSVDB_X86_KERNELS
constexpr NormalKernels kAvx512 = {"avx512", normals_avx512::smallestEigenvectors};
constexpr NormalKernels kAvx2 = {"avx2", normals_avx2::smallestEigenvectors};
#endif

}  // namespace

NormalKernelList runnableNormalKernels() {
#if ACCESSVDB_X86_KERNELS
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  if (avx512) return {{&kAvx512, &kAvx2, &kPlain}, 3};
  if (avx2) return {{&kAvx2, &kPlain, nullptr}, 2};
#endif
  return {{&kPlain, nullptr, nullptr}, 1};
}

const NormalKernels& normalKernels() {
  static const NormalKernels& best = *runnableNormalKernels().kernels[0];
  return best;
}

}  // namespace accessvdb::internal
