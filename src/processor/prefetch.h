// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Asks for memory before it is needed; does nothing if the compiler does not support it.
#pragma once

#include <cstddef>

namespace accessvdb::internal {

/// @param bytes  1 or more
template <bool kForWriting>
inline void prefetchLines([[maybe_unused]] const void* begin, [[maybe_unused]] std::size_t bytes) {
#if defined(__GNUC__)
  const auto* address = static_cast<const std::byte*>(begin);
  for (std::size_t n = 0; n < bytes; n += 64) __builtin_prefetch(address + n, kForWriting ? 1 : 0);
  if (bytes > 1) __builtin_prefetch(address + bytes - 1, kForWriting ? 1 : 0);  // if it does not start on a cache line
#endif
}

inline void prefetchRead(const void* begin, std::size_t bytes = 1) { prefetchLines<false>(begin, bytes); }
inline void prefetchWrite(const void* begin, std::size_t bytes) { prefetchLines<true>(begin, bytes); }

}  // namespace accessvdb::internal
