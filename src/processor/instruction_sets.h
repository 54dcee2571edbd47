// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Inner loops that one source file compiles for several instruction sets, to choose among at run time.
///
/// On x86-64, code for a set stands between `#pragma GCC push_options` with that target and `pop_options`, under
/// `#if ACCESSVDB_X86_KERNELS`. There is no code of the standard library inside, and no template: an inline function
/// compiled there could end up being used everywhere, and a template would be instantiated outside the pragma's scope.
/// On 64-bit ARM every processor has NEON: its code needs no pragma, under `#if ACCESSVDB_NEON_KERNELS`.
#pragma once

#include "processor/kernel_list.h"

#define ACCESSVDB_X86_KERNELS 0
#define ACCESSVDB_NEON_KERNELS 0
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#undef ACCESSVDB_X86_KERNELS
#define ACCESSVDB_X86_KERNELS 1
#include <immintrin.h>
#elif defined(__aarch64__) && defined(__ARM_NEON) && !defined(__AARCH64EB__)
#undef ACCESSVDB_NEON_KERNELS
#define ACCESSVDB_NEON_KERNELS 1
#include <arm_neon.h>
#endif

namespace accessvdb::internal {

#if ACCESSVDB_X86_KERNELS
/// @param avx2  compiled for avx2,bmi,bmi2,lzcnt,popcnt  @param avx512  also for avx512f,avx512vl,avx512dq,avx512bw
template <typename Kernels>
KernelList<Kernels> runnableKernels(const Kernels& avx512, const Kernels& avx2, const Kernels& plain) {
  const bool has_avx2 =
      __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
  const bool has_avx512 = has_avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                          __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  if (has_avx512) return {{&avx512, &avx2, &plain}, 3};
  if (has_avx2) return {{&avx2, &plain, nullptr}, 2};
  return {{&plain, nullptr, nullptr}, 1};
}
#endif

}  // namespace accessvdb::internal
