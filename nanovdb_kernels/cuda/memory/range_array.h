// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// An array that grows where it is, for the largest ones: nothing is copied, there is never a second one beside it, and
/// no quarter more than it needs.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <type_traits>
#include <utility>

#include "cuda/memory/address_range.h"
#include "cuda/memory/growing.h"

namespace accessvdb::kernels {

template <typename T>
class RangeArray {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  /// Addresses for one array: those of the bounds of 357 million points at 180 directions, 134 million at 256 of any
  /// kind.
  static constexpr std::uint64_t kAddresses = std::uint64_t{1} << 36;

  /// @throws as AddressRange does
  explicit RangeArray(std::shared_ptr<DeviceContext> context) : range_(std::move(context), kAddresses) {}

  [[nodiscard]] T* data() const { return static_cast<T*>(range_.base()); }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::uint64_t bytes() const { return range_.backedBytes(); }

  /// To at least `size` elements; new ones are not initialised.  @throws ResourceLimit; then it is as before
  void grow(std::size_t size) {
    if (size <= size_) return;
    range_.back(size * sizeof(T));
    size_ = size;
  }
  /// Fills all bytes of new elements.
  void growFilled(std::size_t size, int byte, cudaStream_t stream) {
    const std::size_t before = size_;
    if (size <= before) return;
    range_.back(size * sizeof(T));
    fillBytes(data() + before, byte, (size - before) * sizeof(T), stream);
    size_ = size;
  }

 private:
  AddressRange range_;
  std::size_t size_ = 0;
};

}  // namespace accessvdb::kernels
