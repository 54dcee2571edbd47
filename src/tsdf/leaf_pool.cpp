// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the buffers of leaves live: chunks of 2 MiB, in huge pages where the system grants them.
///
/// A scan touches fresh memory for ten thousands of leaves; with malloc, page faults cost more than the fusion itself.
/// Leaves are only ever added, and freed with their map. So a thread cuts buffers off its own chunk without any lock,
/// and a chunk counts the buffers still in use; the last one gives it back to the system.
#include <atomic>
#include <new>

#include "tsdf/packed_voxel.h"

#if defined(__linux__) && !defined(__SANITIZE_ADDRESS__)
#define ACCESSVDB_LEAF_POOL 1
#include <sys/mman.h>
#else
#define ACCESSVDB_LEAF_POOL 0
#endif

namespace accessvdb::internal {
namespace {

constexpr std::size_t kBufferBytes = 512 * sizeof(PackedVoxel);

#if ACCESSVDB_LEAF_POOL
constexpr std::size_t kChunkBytes = std::size_t{2} << 20;
/// The first buffer's place holds the header.
constexpr std::uint32_t kBuffersPerChunk = kChunkBytes / kBufferBytes - 1;

struct ChunkHeader {
  std::atomic<std::uint32_t> in_use;  ///< buffers handed out and not freed, plus those not yet cut off
};

/// @throws std::bad_alloc
ChunkHeader* newChunk() {
  // Twice the size holds an aligned chunk; the rest goes back at once.
  void* mapped = mmap(nullptr, 2 * kChunkBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (mapped == MAP_FAILED) throw std::bad_alloc();
  const auto begin = reinterpret_cast<std::uintptr_t>(mapped);
  const std::uintptr_t aligned = (begin + kChunkBytes - 1) & ~(kChunkBytes - 1);
  if (aligned > begin) munmap(mapped, aligned - begin);
  if (aligned < begin + kChunkBytes) {
    munmap(reinterpret_cast<void*>(aligned + kChunkBytes), begin + kChunkBytes - aligned);
  }
  void* chunk = reinterpret_cast<void*>(aligned);
#ifdef MADV_HUGEPAGE
  madvise(chunk, kChunkBytes, MADV_HUGEPAGE);  // advice only: small pages work as well
#endif
  auto* header = new (chunk) ChunkHeader;
  header->in_use.store(kBuffersPerChunk, std::memory_order_relaxed);
  return header;
}

void release(ChunkHeader* chunk, std::uint32_t buffers) noexcept {
  if (buffers == 0) return;
  if (chunk->in_use.fetch_sub(buffers, std::memory_order_acq_rel) == buffers) munmap(chunk, kChunkBytes);
}

/// The chunk that a thread cuts from.
struct ThreadChunk {
  ChunkHeader* chunk = nullptr;
  std::uint32_t next = kBuffersPerChunk;
  ~ThreadChunk() { release(chunk, kBuffersPerChunk - next); }
};
thread_local ThreadChunk t_chunk;

#endif

}  // namespace

#if ACCESSVDB_LEAF_POOL
void* PackedVoxel::operator new[](std::size_t bytes) {
  if (bytes != kBufferBytes) throw std::bad_alloc();  // nobody but OpenVDB's leaves asks
  ThreadChunk& mine = t_chunk;
  if (mine.next == kBuffersPerChunk) {
    mine.chunk = newChunk();
    mine.next = 0;
  }
  ++mine.next;
  return reinterpret_cast<std::byte*>(mine.chunk) + mine.next * kBufferBytes;
}

void PackedVoxel::operator delete[](void* buffer) noexcept {
  if (buffer == nullptr) return;
  const auto address = reinterpret_cast<std::uintptr_t>(buffer);
  release(reinterpret_cast<ChunkHeader*>(address & ~(kChunkBytes - 1)), 1);
}
#else
void* PackedVoxel::operator new[](std::size_t bytes) { return ::operator new[](bytes); }
void PackedVoxel::operator delete[](void* buffer) noexcept { ::operator delete[](buffer); }
#endif

}  // namespace accessvdb::internal
