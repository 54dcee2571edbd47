// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Memory of a mirrored grid: an address range that is reserved once, backed by memory as it grows, and never moves.
/// Links inside a NanoVDB grid are byte offsets, so they never have to be rebuilt.
///
/// A backend implements this. Either the host may change the memory directly (`inPlace`), or it fills batches that the
/// arena sends (`stagePatches`, `stageWrites`) and never reads back. Both with many threads at a time.
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

/// Space in a batch for writes of one length. The caller fills list[n] and that many bytes at data + n * stride.
struct StagedWrites {
  StagedWrite* list = nullptr;
  std::byte* data = nullptr;
  std::size_t count = 0;
  std::uint32_t source = 0;  ///< of `data`
  std::uint32_t stride = 0;
};

/// Space in a batch for patches and for the most words that they can have.
struct StagedPatches {
  LeafPatch* list = nullptr;
  std::byte* words = nullptr;  ///< wordBytes() each
  std::size_t count = 0;
};

/// Fills `count` pieces of `bytes` bytes with a word, the first at `offset` of the arena, each `stride` bytes after the
/// previous one. All are multiples of 4.
struct ArenaFill {
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0, stride = 0, count = 0;
  std::uint32_t word = 0;
};

/// Not thread safe; nothing may read the memory between the first write and the end of the next `flush`.
/// No byte may be written twice between two flushes, so a backend may scatter writes in any order; only filled bytes
/// may be overwritten by later writes.
class MirrorArena {
 public:
  virtual ~MirrorArena() = default;
  MirrorArena(const MirrorArena&) = delete;
  MirrorArena& operator=(const MirrorArena&) = delete;

  /// Address of byte 0 in the backend's address space; at least page-aligned, constant for the arena's lifetime.
  [[nodiscard]] virtual void* base() const noexcept = 0;

  /// Address of byte 0 if the host may read and change all committed memory; nullptr: stage instead.
  [[nodiscard]] virtual std::byte* inPlace() const noexcept { return nullptr; }

  /// Backs at least the first `bytes` bytes with memory. Newly backed memory reads as zero; written data stays. The
  /// arena may grow in larger steps. Nothing else here needs memory.
  /// @throw ResourceLimit  past the reserved range, or no memory; what was committed before stays usable
  virtual void commit(std::uint64_t bytes) = 0;

  /// Queues or performs a copy of `bytes` bytes at `source` (host memory, reusable on return) to byte `offset`. Takes
  /// effect no later than when `flush` returns. @throw InternalError  outside the committed range
  virtual void write(std::uint64_t offset, const void* source, std::uint64_t bytes) = 0;

  /// Space for `count` writes of `bytes` bytes, or for as many as fit into a batch, at least one. The caller must fill
  /// it before calling anything else of the arena. Offsets are not checked.
  /// @param bytes  a multiple of 4, at most 4096; so are the offsets
  virtual StagedWrites stageWrites(std::size_t count, std::uint32_t bytes) {
    (void)count, (void)bytes;
    throwNotStaged();
  }
  /// The same for patches, with at least 64 KiB of words if that many are requested.
  virtual StagedPatches stagePatches(std::size_t count, PatchKind kind) {
    (void)count, (void)kind;
    throwNotStaged();
  }
  /// Says how many of the patches and of their words were filled, from the first on.
  virtual void endPatches(std::size_t count, std::size_t words) {
    (void)count, (void)words;
    throwNotStaged();
  }

  /// Queues fills, ordered before everything queued later.
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
