// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/normal_kernels.h"

#include "processor/instruction_sets.h"

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

#if ACCESSVDB_NEON_KERNELS
namespace accessvdb::internal::normals_neon {

#include "points/real_neon.h"
// Uses what is defined above.
#include "hostdev/surface_normal_body.h"
#include "points/normal_kernels_body.h"

}  // namespace accessvdb::internal::normals_neon
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
#elif ACCESSVDB_NEON_KERNELS
constexpr NormalKernels kNeon = {"neon", normals_neon::smallestEigenvectors};
#endif

}  // namespace

KernelList<NormalKernels> runnableNormalKernels() {
#if ACCESSVDB_X86_KERNELS
  return runnableKernels(kAvx512, kAvx2, kPlain);
#elif ACCESSVDB_NEON_KERNELS
  return {{&kNeon, &kPlain, nullptr}, 2};
#else
  return {{&kPlain, nullptr, nullptr}, 1};
#endif
}

const NormalKernels& normalKernels() {
  static const NormalKernels& best = *runnableNormalKernels().kernels[0];
  return best;
}

}  // namespace accessvdb::internal
