// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The mirror's device memory: writes are gathered in pinned host memory, sent in one transfer and put in place by a
/// kernel, on the mirror's own stream.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "cuda/memory/address_range.h"
#include "cuda/memory/device_context.h"
#include "cuda/memory/owned_event.h"
#include "cuda/memory/pinned_buffer.h"
#include "launch/device_array.h"
#include "launch/mirror_arena.h"
#include "launch/write_batch.h"

namespace accessvdb::kernels {

class DeviceArena final : public MirrorArena {
 public:
  static constexpr std::uint64_t kDefaultReserveBytes = std::uint64_t(64) << 30;

  /// Allocates all memory that it will ever need, except what it commits. @throw DeviceError, ResourceLimit
  explicit DeviceArena(std::shared_ptr<DeviceContext> context, std::uint64_t reserve_bytes = kDefaultReserveBytes);
  ~DeviceArena() override;

  [[nodiscard]] void* base() const noexcept override { return range_.base(); }
  void commit(std::uint64_t bytes) override;
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes) override;
  StagedWrites stageWrites(std::size_t count, std::uint32_t bytes) override;
  StagedPatches stagePatches(std::size_t count, PatchKind kind) override;
  void endPatches(std::size_t count, std::size_t words) override;
  void stageFills(std::span<const ArenaFill> fills) override;
  void flush() override;
  [[nodiscard]] std::uint64_t reservedBytes() const noexcept override { return range_.reservedBytes(); }
  [[nodiscard]] std::uint64_t committedBytes() const noexcept override { return range_.backedBytes(); }

 private:
  /// One of two buffers: while the device reads one, the host fills the other.
  struct Slot {
    explicit Slot(DeviceContext& context);
    ~Slot();
    Slot(const Slot&) = delete;
    Slot& operator=(const Slot&) = delete;

    DeviceContext& context;
    PinnedBuffer host;
    void* device;
    OwnedEvent sent;  ///< recorded when the device has read it
    WriteBatch batch;
  };
  /// The batch being filled; waits until the device has read its previous contents.
  WriteBatch& filling();
  void send();

  std::shared_ptr<DeviceContext> context_;
  AddressRange range_;
  std::uint64_t zeroed_bytes_ = 0;
  std::array<std::unique_ptr<Slot>, 2> slots_;
  std::size_t filling_ = 0;
  bool waited_ = true;  ///< for the slot being filled
};

}  // namespace accessvdb::kernels
