// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A range of device addresses: reserved once, then backed with memory from its start as it grows.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "cuda/memory/device_context.h"

namespace accessvdb::kernels {

class AddressRange {
 public:
  /// Reserves `reserve_bytes`; on failure retries with half the size, down to 1 GiB.
  /// @throw DeviceError    the device or driver cannot map memory explicitly
  /// @throw ResourceLimit  even the smallest size could not be reserved
  AddressRange(std::shared_ptr<DeviceContext> context, std::uint64_t reserve_bytes);
  ~AddressRange();
  AddressRange(const AddressRange&) = delete;
  AddressRange& operator=(const AddressRange&) = delete;

  [[nodiscard]] void* base() const { return base_; }
  [[nodiscard]] std::uint64_t reservedBytes() const { return reserved_; }
  [[nodiscard]] std::uint64_t backedBytes() const { return backed_; }

  /// Backs at least the first `bytes` bytes, in large steps so that steps are rare. New memory is not initialised.
  /// @throw ResourceLimit  past the range, or out of device memory; what was backed stays backed
  void back(std::uint64_t bytes);

 private:
  void mapMore(std::uint64_t bytes);

  struct Piece {
    unsigned long long handle;
    std::uint64_t offset, bytes;
  };
  std::shared_ptr<DeviceContext> context_;
  void* base_ = nullptr;
  std::uint64_t reserved_ = 0, backed_ = 0, granularity_ = 0;
  std::vector<Piece> pieces_;
};

}  // namespace accessvdb::kernels
