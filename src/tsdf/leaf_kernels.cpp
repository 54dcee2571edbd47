// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/leaf_kernels.h"

#include <algorithm>
#include <bit>
#include <cmath>

// leaf_kernels_body.h is included once per instruction set, each time in its own namespace with its own lanes. It has
// no templates: they would be instantiated outside the pragma's scope.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define ACCESSVDB_X86_KERNELS 1
#include <immintrin.h>
#else
#define ACCESSVDB_X86_KERNELS 0
#endif

#if ACCESSVDB_X86_KERNELS
#pragma GCC push_options
#pragma GCC target("avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::avx512 {
#include "tsdf/lanes_avx512.h"
// The lanes come first.
#include "tsdf/leaf_kernels_body.h"
}  // namespace accessvdb::internal::avx512
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::avx2 {
#include "tsdf/lanes_avx2.h"
// The lanes come first.
#include "tsdf/leaf_kernels_body.h"
}  // namespace accessvdb::internal::avx2
#pragma GCC pop_options
#endif

namespace accessvdb::internal::plain {
#include "tsdf/lanes_plain.h"
// The lanes come first.
#include "tsdf/leaf_kernels_body.h"
}  // namespace accessvdb::internal::plain

namespace accessvdb::internal {
namespace {

constexpr LeafKernels kPlain = {"plain",         plain::addDoubleCone, plain::addNews,          plain::addFullCube,
                                plain::markBand, plain::gainedPairs,   plain::markMeasuredFree, plain::markColliding,
                                plain::flipArm,  plain::fold};
#if ACCESSVDB_X86_KERNELS
constexpr LeafKernels kAvx512 = {
    "avx512",         avx512::addDoubleCone, avx512::addNews,          avx512::addFullCube,
    avx512::markBand, avx512::gainedPairs,   avx512::markMeasuredFree, avx512::markColliding,
    avx512::flipArm,  avx512::fold};
constexpr LeafKernels kAvx2 = {"avx2",         avx2::addDoubleCone, avx2::addNews,          avx2::addFullCube,
                               avx2::markBand, avx2::gainedPairs,   avx2::markMeasuredFree, avx2::markColliding,
                               avx2::flipArm,  avx2::fold};
#endif

}  // namespace

LeafKernelList runnableLeafKernels() {
  LeafKernelList list = {{&kPlain, nullptr, nullptr}, 1};
#if ACCESSVDB_X86_KERNELS
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  if (avx512) {
    list = {{&kAvx512, &kAvx2, &kPlain}, 3};
  } else if (avx2) {
    list = {{&kAvx2, &kPlain, nullptr}, 2};
  }
#endif
  return list;
}

const LeafKernels& leafKernels() {
  static const LeafKernels& best = *runnableLeafKernels().kernels[0];
  return best;
}

}  // namespace accessvdb::internal
