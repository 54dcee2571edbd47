// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The mirror's memory on the device: writes are gathered in pinned host memory, travel in one transfer and are put in
/// their places by one kernel, on the mirror's own stream.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "cuda/address_range.h"
#include "cuda/device_context.h"
#include "cuda/pinned_buffer.h"
#include "launch/mirror_arena.h"

namespace accessvdb::kernels {

/// One write: `bytes` bytes at byte `source` of the batch go to byte `offset` of the arena.
struct StagedWrite {
  std::uint64_t offset;
  std::uint32_t source, bytes;
};

class DeviceArena final : public MirrorArena {
 public:
  static constexpr std::uint64_t kDefaultReserveBytes = std::uint64_t(64) << 30;

  explicit DeviceArena(std::shared_ptr<DeviceContext> context, std::uint64_t reserve_bytes = kDefaultReserveBytes);
  ~DeviceArena() override;

  [[nodiscard]] void* base() const noexcept override { return range_.base(); }
  void commit(std::uint64_t bytes) override;
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes) override;
  bool stage(std::span<const std::uint64_t> offsets, std::uint64_t bytes, std::span<void*> places) override;
  void flush() override;
  [[nodiscard]] std::uint64_t reservedBytes() const noexcept override { return range_.reservedBytes(); }
  [[nodiscard]] std::uint64_t committedBytes() const noexcept override { return range_.backedBytes(); }

 private:
  /// One of two: while the device reads one, the host fills the other.
  struct Batch {
    PinnedBuffer host;
    void* device = nullptr;
    std::size_t device_bytes = 0;
    cudaEvent_t done = nullptr;
  };
  void requireCommitted(std::uint64_t offset, std::uint64_t bytes) const;
  void reserveHost(std::size_t bytes);
  void reserveDevice(Batch& batch, std::size_t bytes);
  void send();

  std::shared_ptr<DeviceContext> context_;
  AddressRange range_;
  std::array<Batch, 2> batches_;
  std::size_t filling_ = 0;
  std::size_t filled_bytes_ = 0;
  std::vector<StagedWrite> writes_;  ///< of the batch that is being filled
};

}  // namespace accessvdb::kernels
