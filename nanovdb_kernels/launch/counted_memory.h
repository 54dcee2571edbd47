// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A backend's memory that counts the bytes in use, so that no caller has to add up arrays by hand.
#pragma once

#include <cstddef>
#include <cstdint>

#include "launch/device_array.h"

namespace accessvdb::kernels {

/// Not thread safe. Declare it before the arrays that use it.
class CountedMemory final : public DeviceMemory {
 public:
  /// @param memory  where the bytes come from; must outlive this
  explicit CountedMemory(DeviceMemory& memory) : memory_(memory) {}
  CountedMemory(const CountedMemory&) = delete;
  CountedMemory& operator=(const CountedMemory&) = delete;

  void* allocate(std::size_t bytes) override {
    void* const address = memory_.allocate(bytes);
    bytes_ += bytes;
    return address;
  }
  void release(void* address, std::size_t bytes) noexcept override {
    memory_.release(address, bytes);
    if (address != nullptr) bytes_ -= bytes;
  }
  void upload(void* to_device, const void* from_host, std::size_t bytes) override {
    memory_.upload(to_device, from_host, bytes);
  }
  void download(void* to_host, const void* from_device, std::size_t bytes) override {
    memory_.download(to_host, from_device, bytes);
  }
  void copy(void* to_device, const void* from_device, std::size_t bytes) override {
    memory_.copy(to_device, from_device, bytes);
  }

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  DeviceMemory& memory_;
  std::uint64_t bytes_ = 0;
};

}  // namespace accessvdb::kernels
