// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// An owning, move-only, uninitialised array in the memory of a backend. Kernels get views of it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <type_traits>
#include <utility>

#include "accessvdb/error.h"

namespace accessvdb::kernels {

/// A backend's raw memory.
class DeviceMemory {
 public:
  virtual ~DeviceMemory() = default;
  /// @throws ResourceLimit if there is no memory
  virtual void* allocate(std::size_t bytes) = 0;
  /// @param bytes  the same as for allocate(). A null address is ignored.
  virtual void release(void* address, std::size_t bytes) noexcept = 0;
  virtual void upload(void* to_device, const void* from_host, std::size_t bytes) = 0;
  virtual void download(void* to_host, const void* from_device, std::size_t bytes) = 0;
  virtual void copy(void* to_device, const void* from_device, std::size_t bytes) = 0;
};

template <typename T>
class DeviceArray {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  DeviceArray() = default;
  DeviceArray(DeviceMemory& memory, std::size_t size)
      : memory_(&memory), data_(static_cast<T*>(memory.allocate(size * sizeof(T)))), size_(size) {}
  ~DeviceArray() { reset(); }
  DeviceArray(DeviceArray&& other) noexcept { swap(other); }
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    swap(other);
    return *this;
  }

  [[nodiscard]] T* data() const { return data_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t bytes() const { return size_ * sizeof(T); }
  void upload(const T* from, std::size_t count, std::size_t first = 0) {
    if (count > 0) memory_->upload(data_ + first, from, count * sizeof(T));
  }

  /// Grows to at least `size`, keeping the first `kept` elements; later elements are not initialised.
  void grow(DeviceMemory& memory, std::size_t size, std::size_t kept) {
    if (size <= size_) return;
    DeviceArray larger(memory, size);
    if (kept > 0) memory.copy(larger.data_, data_, kept * sizeof(T));
    swap(larger);
  }
  /// Like grow(), but to `wanted` elements, so that arrays grow rarely; if memory is short, to `least`.
  void growWithRoom(DeviceMemory& memory, std::size_t least, std::size_t wanted, std::size_t kept) {
    if (least <= size_) return;
    try {
      grow(memory, std::max(least, wanted), kept);
    } catch (const ResourceLimit&) {
      if (wanted <= least) throw;
      grow(memory, least, kept);
    }
  }

 private:
  void swap(DeviceArray& other) noexcept {
    std::swap(memory_, other.memory_);
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
  }
  void reset() noexcept {
    if (data_ != nullptr) memory_->release(data_, bytes());
    data_ = nullptr;
    size_ = 0;
  }
  DeviceMemory* memory_ = nullptr;
  T* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace accessvdb::kernels
