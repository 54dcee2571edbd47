// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The arena of the CPU backend: host memory, reserved without access rights and made writable as it grows.
#pragma once

#include "launch/mirror_arena.h"

namespace accessvdb::kernels {

class HostArena final : public MirrorArena {
 public:
  /// Addresses only, no memory: a million leaves use 0.2 to 2 GB of it.
  static constexpr std::uint64_t kDefaultReserveBytes = std::uint64_t(256) << 30;
  /// What must at least be reservable if the process limits forbid `reserve_bytes`.
  static constexpr std::uint64_t kLeastReserveBytes = std::uint64_t(1) << 30;

  /// Reserves `reserve_bytes` [B], rounded up to a huge page; if the process may not, half of it, and so on down to
  /// `kLeastReserveBytes` (or to `reserve_bytes` if that is less).
  /// @throw InvalidArgument  zero bytes
  /// @throw ResourceLimit    not even the minimum could be reserved
  explicit HostArena(std::uint64_t reserve_bytes = kDefaultReserveBytes);
  ~HostArena() override;

  [[nodiscard]] void* base() const noexcept override { return base_; }
  [[nodiscard]] std::byte* inPlace() const noexcept override { return reinterpret_cast<std::byte*>(base_); }
  void commit(std::uint64_t bytes) override;
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes) override;
  void flush() override {}
  [[nodiscard]] std::uint64_t reservedBytes() const noexcept override { return reserved_; }
  [[nodiscard]] std::uint64_t committedBytes() const noexcept override { return committed_; }

 private:
  unsigned char* base_ = nullptr;  ///< aligned to a huge page, inside the mapping
  void* mapping_ = nullptr;
  std::uint64_t mapping_bytes_ = 0;
  std::uint64_t reserved_ = 0;
  std::uint64_t committed_ = 0;
};

}  // namespace accessvdb::kernels
