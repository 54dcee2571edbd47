// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a mirrored grid lives: one range of addresses that is reserved once, backed by memory as it grows, and never
/// moves. Links inside a NanoVDB grid are byte offsets, so what never moves never has to be rebuilt.
///
/// A backend implements this; the mirror only ever writes through it and never reads back, so that a device can take
/// the writes as one staged transfer and a scatter.
#pragma once

#include <cstdint>
#include <span>

namespace accessvdb::kernels {

/// Not thread safe; nothing may read the memory between the first `write` and the end of the next `flush`.
class MirrorArena {
 public:
  virtual ~MirrorArena() = default;
  MirrorArena(const MirrorArena&) = delete;
  MirrorArena& operator=(const MirrorArena&) = delete;

  /// Address of byte 0 in the address space of the backend; aligned to a page at least, constant for life.
  [[nodiscard]] virtual void* base() const noexcept = 0;

  /// Backs at least the first `bytes` bytes with memory. Memory that was not backed before reads as zero; what was
  /// written stays. Growing in big steps is the arena's business.
  /// @throw ResourceLimit  past the reserved range, or no memory; what was committed before stays usable
  virtual void commit(std::uint64_t bytes) = 0;

  /// Queues or performs a copy of `bytes` bytes at `source` (host memory, free again on return) to byte `offset`.
  /// Writes take effect in order, at the latest when `flush` returns. The mirror writes no byte twice between two
  /// flushes, so a backend may scatter them in parallel.
  /// @throw InternalError  outside the committed range
  virtual void write(std::uint64_t offset, const void* source, std::uint64_t bytes) = 0;

  /// As a `write` of `bytes` bytes to each offset, but the caller fills what is to be written, from any thread, before
  /// it calls anything else of the arena. @param places  [offsets.size()] out: where the bytes of write n go
  /// @return false: not offered, nothing happened; use `write`
  /// @throw InternalError  outside the committed range
  virtual bool stage(std::span<const std::uint64_t> offsets, std::uint64_t bytes, std::span<void*> places) {
    (void)offsets, (void)bytes, (void)places;
    return false;
  }

  /// Ends a batch: readers that are ordered after the flush (same stream, or an event) see all writes.
  virtual void flush() = 0;

  [[nodiscard]] virtual std::uint64_t reservedBytes() const noexcept = 0;
  [[nodiscard]] virtual std::uint64_t committedBytes() const noexcept = 0;

 protected:
  MirrorArena() = default;
};

}  // namespace accessvdb::kernels
