// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A vector whose resize() does not clear what it adds, so that threads can write it first.
#pragma once

#include <memory>
#include <new>
#include <type_traits>
#include <utility>
#include <vector>

namespace accessvdb::internal {

template <typename T>
struct RawAllocator : std::allocator<T> {
  static_assert(std::is_trivially_default_constructible_v<T>,
                "other types have constructors, which one thread would run");
  template <typename U>
  struct rebind {
    using other = RawAllocator<U>;
  };
  using std::allocator<T>::allocator;

  void construct(T* at) noexcept { ::new (static_cast<void*>(at)) T; }
  template <typename... Arguments>
  void construct(T* at, Arguments&&... arguments) {
    ::new (static_cast<void*>(at)) T(std::forward<Arguments>(arguments)...);
  }
};

template <typename T>
using RawVector = std::vector<T, RawAllocator<T>>;

}  // namespace accessvdb::internal
