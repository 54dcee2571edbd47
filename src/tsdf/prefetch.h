// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Asks for memory before it is written; does nothing if the compiler does not support it.
#pragma once

#include <cstddef>

namespace accessvdb::internal {

inline void prefetch([[maybe_unused]] const void* begin, [[maybe_unused]] std::size_t bytes) {
#if defined(__GNUC__)
  const auto* first = static_cast<const std::byte*>(begin);
  for (std::size_t n = 0; n < bytes; n += 64) __builtin_prefetch(first + n, 1);
  __builtin_prefetch(first + bytes - 1, 1);  // in case it does not start on a cache line
#endif
}

}  // namespace accessvdb::internal
