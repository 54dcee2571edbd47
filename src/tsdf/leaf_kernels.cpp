// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/leaf_kernels.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "processor/instruction_sets.h"

// leaf_kernels_body.h is included once per instruction set, each time in its own namespace with its own lanes.
#define ACCESSVDB_KERNEL inline
#define ACCESSVDB_KERNEL_INLINE [[gnu::always_inline]] inline

#if ACCESSVDB_X86_KERNELS
#pragma GCC push_options
#pragma GCC target("avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::avx512 {
#include "tsdf/lanes_avx512.h"
// The lanes come first.
#include "tsdf/lanes_sixteen.h"
// Uses what is defined above.
#include "hostdev/leaf_kernels_body.h"
}  // namespace accessvdb::internal::avx512
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx2,bmi,bmi2,lzcnt,popcnt")
namespace accessvdb::internal::avx2 {
#include "tsdf/lanes_avx2.h"
// The lanes come first.
#include "tsdf/lanes_sixteen.h"
// Uses what is defined above.
#include "hostdev/leaf_kernels_body.h"
}  // namespace accessvdb::internal::avx2
#pragma GCC pop_options
#endif

#if ACCESSVDB_NEON_KERNELS
namespace accessvdb::internal::neon {
#include "tsdf/lanes_neon.h"
// The lanes come first.
#include "tsdf/lanes_sixteen.h"
// Uses what is defined above.
#include "hostdev/leaf_kernels_body.h"
}  // namespace accessvdb::internal::neon
#endif

namespace accessvdb::internal::plain {
#include "tsdf/lanes_plain.h"
// The lanes come first.
#include "tsdf/lanes_sixteen.h"
// Uses what is defined above.
#include "hostdev/leaf_kernels_body.h"
}  // namespace accessvdb::internal::plain

namespace accessvdb::internal {
namespace {

constexpr LeafKernels kPlain = {"plain",         plain::addDoubleCone, plain::addNews,          plain::addFullCube,
                                plain::markBand, plain::gainedStrips,  plain::markMeasuredFree, plain::markColliding,
                                plain::flipArm,  plain::fold};
#if ACCESSVDB_X86_KERNELS
constexpr LeafKernels kAvx512 = {
    "avx512",         avx512::addDoubleCone, avx512::addNews,          avx512::addFullCube,
    avx512::markBand, avx512::gainedStrips,  avx512::markMeasuredFree, avx512::markColliding,
    avx512::flipArm,  avx512::fold};
constexpr LeafKernels kAvx2 = {"avx2",         avx2::addDoubleCone, avx2::addNews,          avx2::addFullCube,
                               avx2::markBand, avx2::gainedStrips,  avx2::markMeasuredFree, avx2::markColliding,
                               avx2::flipArm,  avx2::fold};
#elif ACCESSVDB_NEON_KERNELS
constexpr LeafKernels kNeon = {"neon",         neon::addDoubleCone, neon::addNews,          neon::addFullCube,
                               neon::markBand, neon::gainedStrips,  neon::markMeasuredFree, neon::markColliding,
                               neon::flipArm,  neon::fold};
#endif

}  // namespace

KernelList<LeafKernels> runnableLeafKernels() {
#if ACCESSVDB_X86_KERNELS
  return runnableKernels(kAvx512, kAvx2, kPlain);
#elif ACCESSVDB_NEON_KERNELS
  return {{&kNeon, &kPlain, nullptr}, 2};
#else
  return {{&kPlain, nullptr, nullptr}, 1};
#endif
}

const LeafKernels& leafKernels() {
  static const LeafKernels& best = *runnableLeafKernels().kernels[0];
  return best;
}

}  // namespace accessvdb::internal
