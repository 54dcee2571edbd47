// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Prefetches memory that will be read soon.
#pragma once

#include <cstddef>

namespace accessvdb::internal {

inline void prefetchRead([[maybe_unused]] const void* begin, [[maybe_unused]] std::size_t bytes = 1) {
#if defined(__GNUC__)
  const char* address = static_cast<const char*>(begin);
  for (std::size_t n = 0; n < bytes; n += 64) __builtin_prefetch(address + n);
  if (bytes > 1) __builtin_prefetch(address + bytes - 1);  // in case it does not start on a cache line
#endif
}

}  // namespace accessvdb::internal
