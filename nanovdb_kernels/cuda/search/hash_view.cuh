// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Device hash table of places (hostdev/place_key.h).
#pragma once

#include <cstdint>

#include "hostdev/place_key.h"

namespace accessvdb::kernels {

inline constexpr std::uint32_t kNoIndex = 0xffffffffu;
inline constexpr std::uint64_t kNoKey = ~std::uint64_t{0};

/// Open addressing with 2^n slots, never full.
struct HashView {
  std::uint64_t* keys = nullptr;  ///< kNoKey: empty
  std::uint32_t mask = 0;

#if defined(__CUDACC__)
  static __device__ std::uint32_t mix(std::uint64_t key) {
    key *= 0x9e3779b97f4a7c15ull;
    return static_cast<std::uint32_t>(key >> 32);
  }
  /// @return the slot, or kNoIndex
  [[nodiscard]] __device__ std::uint32_t find(std::uint64_t key) const {
    for (std::uint32_t slot = mix(key) & mask;; slot = (slot + 1) & mask) {
      const std::uint64_t there = keys[slot];
      if (there == key) return slot;
      if (there == kNoKey) return kNoIndex;
    }
  }
  [[nodiscard]] __device__ std::uint32_t insert(std::uint64_t key) const {
    bool is_new = false;
    return insert(key, is_new);
  }
  /// @param is_new  out: the key was not there yet; true for exactly one of several concurrent inserters
  [[nodiscard]] __device__ std::uint32_t insert(std::uint64_t key, bool& is_new) const {
    for (std::uint32_t slot = mix(key) & mask;; slot = (slot + 1) & mask) {
      const auto before = atomicCAS(reinterpret_cast<unsigned long long*>(keys + slot),
                                    static_cast<unsigned long long>(kNoKey), static_cast<unsigned long long>(key));
      is_new = before == kNoKey;
      if (is_new || before == key) return slot;
    }
  }
#endif
};

}  // namespace accessvdb::kernels
