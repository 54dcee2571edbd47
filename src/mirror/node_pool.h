// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Nodes by index that never move, in slabs of 2 MiB: in huge pages if the system grants them, because lookups are
/// scattered over them and would miss the TLB each time.
#pragma once

#if defined(__linux__)
#include <sys/mman.h>
#endif

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <type_traits>
#include <vector>

#include "mirror/change_batches.h"

namespace accessvdb::internal {

template <class T>
class NodePool {
 public:
  [[nodiscard]] T& operator[](std::uint32_t n) noexcept { return nodesOf(n)[n % kPerSlab]; }
  [[nodiscard]] const T& operator[](std::uint32_t n) const noexcept { return nodesOf(n)[n % kPerSlab]; }
  [[nodiscard]] std::uint32_t size() const noexcept { return size_; }
  [[nodiscard]] std::uint64_t bytes() const noexcept { return slabs_.size() * kSlabBytes; }

  /// Adding `count` nodes cannot fail. @throw std::bad_alloc
  void reserve(std::uint32_t count) {
    while (slabs_.size() * kPerSlab < std::size_t{size_} + count) addSlab();
  }
  /// @return the new node, with index size() - 1
  T& add() {
    add(1);
    return (*this)[size_ - 1];
  }
  /// Many are made on several threads, because most of their time goes into fresh memory.
  void add(std::uint32_t count) {
    reserve(count);
    const std::uint32_t first = size_;
    size_ += count;
    forEachIndex(first, size_, kLeastForThreads, [this](std::size_t n) { new (placeOf(n)) T(); });
  }

 private:
  static constexpr std::size_t kSlabBytes = std::size_t{2} << 20;
  static constexpr std::uint32_t kPerSlab = kSlabBytes / sizeof(T);
  static constexpr std::align_val_t kAlignment{kSlabBytes};
  static constexpr std::size_t kLeastForThreads = 2 * kPerSlab;
  static_assert(kPerSlab > 0 && std::is_trivially_destructible_v<T> && std::is_nothrow_default_constructible_v<T>);

  struct Free {
    void operator()(std::byte* slab) const noexcept { ::operator delete(slab, kAlignment); }
  };
  using Slab = std::unique_ptr<std::byte, Free>;

  void addSlab() {
    Slab slab(static_cast<std::byte*>(::operator new(kSlabBytes, kAlignment)));
#if defined(__linux__) && defined(MADV_HUGEPAGE)
    (void)madvise(slab.get(), kSlabBytes, MADV_HUGEPAGE);  // a hint only: small pages work as well
#endif
    slabs_.push_back(std::move(slab));
  }
  [[nodiscard]] T* placeOf(std::size_t n) const noexcept {
    return reinterpret_cast<T*>(slabs_[n / kPerSlab].get()) + n % kPerSlab;
  }
  [[nodiscard]] T* nodesOf(std::uint32_t n) const noexcept {
    return std::launder(reinterpret_cast<T*>(slabs_[n / kPerSlab].get()));
  }

  std::vector<Slab> slabs_;
  std::uint32_t size_ = 0;
};

}  // namespace accessvdb::internal
