// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads of tables that do not change while a kernel runs.
#pragma once

#include <cuda_runtime.h>

#include <cstring>
#include <type_traits>

namespace accessvdb::kernels {

/// One entry, with one read through the cache for data that does not change.
template <class Entry>
[[nodiscard]] __device__ Entry readEntry(const Entry* at) {
  if constexpr (std::is_integral_v<Entry>) {
    return __ldg(at);
  } else {
    static_assert(std::is_trivially_copyable_v<Entry> && alignof(Entry) == sizeof(Entry), "one read");
    using Whole = std::conditional_t<sizeof(Entry) == sizeof(uint2), uint2, uint4>;
    static_assert(sizeof(Entry) == sizeof(Whole));
    const Whole whole = __ldg(reinterpret_cast<const Whole*>(at));
    Entry entry;
    memcpy(&entry, &whole, sizeof(entry));
    return entry;
  }
}

}  // namespace accessvdb::kernels
