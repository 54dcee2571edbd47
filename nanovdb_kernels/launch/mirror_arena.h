// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a mirrored grid lives: one range of addresses that is reserved once, backed by memory as it grows, and never
/// moves. Links inside a NanoVDB grid are byte offsets, so what never moves never has to be rebuilt.
///
/// A backend implements this. Either the host may change the memory by itself (`inPlace`), or it fills batches that the
/// arena sends (`stagePatches`, `stageWrites`) and never reads back. Both by many threads at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "accessvdb/error.h"
#include "launch/leaf_patch.h"

namespace accessvdb::kernels {

/// One write of a batch: `bytes` bytes at byte `source` of the batch go to byte `offset` of the arena.
struct StagedWrite {
  std::uint64_t offset = 0;
  std::uint32_t source = 0, bytes = 0;
};

/// Room in a batch for writes of one length. The caller fills list[n] and as many bytes at data + n * stride.
struct StagedWrites {
  StagedWrite* list = nullptr;
  std::byte* data = nullptr;
  std::size_t count = 0;
  std::uint32_t source = 0;  ///< of `data`
  std::uint32_t stride = 0;
};

/// Room in a batch for patches and for the most words that as many can have.
struct StagedPatches {
  LeafPatch* list = nullptr;
  std::byte* words = nullptr;  ///< wordBytes() each
  std::size_t count = 0;
};

/// `count` pieces of `bytes` bytes, the first at `offset` of the arena, each `stride` bytes behind the one before, are
/// filled with a word. All are multiples of 4.
struct ArenaFill {
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0, stride = 0, count = 0;
  std::uint32_t word = 0;
};

/// Not thread safe; nothing may read the memory between the first write and the end of the next `flush`.
/// No byte may be written twice between two flushes, so a backend may scatter what it has got in any order; only what
/// is filled may be written over by what comes later.
class MirrorArena {
 public:
  virtual ~MirrorArena() = default;
  MirrorArena(const MirrorArena&) = delete;
  MirrorArena& operator=(const MirrorArena&) = delete;

  /// Address of byte 0 in the address space of the backend; aligned to a page at least, constant for life.
  [[nodiscard]] virtual void* base() const noexcept = 0;

  /// Address of byte 0 for a host that may read and change all committed memory; nullptr: stage instead.
  [[nodiscard]] virtual std::byte* inPlace() const noexcept { return nullptr; }

  /// Backs at least the first `bytes` bytes with memory. Memory that was not backed before reads as zero; what was
  /// written stays. Growing in big steps is the arena's business. Nothing else here needs memory.
  /// @throw ResourceLimit  past the reserved range, or no memory; what was committed before stays usable
  virtual void commit(std::uint64_t bytes) = 0;

  /// Queues or performs a copy of `bytes` bytes at `source` (host memory, free again on return) to byte `offset`.
  /// Takes effect at the latest when `flush` returns. @throw InternalError  outside the committed range
  virtual void write(std::uint64_t offset, const void* source, std::uint64_t bytes) = 0;

  /// Room for `count` writes of `bytes` bytes, or for as many as go into a batch, at least one. What is handed out is
  /// to be filled before anything else of the arena is called. Offsets are not checked.
  /// @param bytes  a multiple of 4, at most 4096; so are the offsets
  virtual StagedWrites stageWrites(std::size_t count, std::uint32_t bytes) {
    (void)count, (void)bytes;
    throwNotStaged();
  }
  /// The same for patches, at least 64 KiB of words where as many are asked for.
  virtual StagedPatches stagePatches(std::size_t count, PatchKind kind) {
    (void)count, (void)kind;
    throwNotStaged();
  }
  /// Says how many of them and of their words were filled, from the first on.
  virtual void endPatches(std::size_t count, std::size_t words) {
    (void)count, (void)words;
    throwNotStaged();
  }

  /// Queues fills, before everything that comes after them.
  virtual void stageFills(std::span<const ArenaFill> fills) {
    (void)fills;
    throwNotStaged();
  }

  /// Ends a batch: readers that are ordered after the flush (same stream, or an event) see all writes.
  virtual void flush() = 0;

  [[nodiscard]] virtual std::uint64_t reservedBytes() const noexcept = 0;
  [[nodiscard]] virtual std::uint64_t committedBytes() const noexcept = 0;

 protected:
  MirrorArena() = default;
  [[noreturn]] static void throwNotStaged() {
    throw InternalError("arena.not_staged", "", "This arena takes no batches", "Please report this");
  }
  [[noreturn]] static void throwOutside() {
    throw InternalError("arena.write_range", "", "A write of the mirror is outside the committed memory",
                        "Please report this");
  }
};

}  // namespace accessvdb::kernels
