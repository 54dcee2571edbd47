// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Storage for the buffers of leaves: chunks of 2 MiB, in huge pages if the system grants them.
///
/// A scan touches fresh memory for tens of thousands of leaves; with malloc, page faults cost more than the fusion
/// itself. Leaves are only ever added; their buffers are freed with their map, or when they become compact
/// (leaf_values.h). So a thread cuts buffers off its own chunk without any lock, and a chunk counts the buffers in use;
/// the last one to be freed returns it to the system. Of a chunk some buffers stay and some go, of leaves that become
/// compact and, where there are several maps, such as the tiles of a rolling field, of maps that go: then pieces of it
/// go back to the system before the whole.
#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstring>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

#include "tsdf/leaf_reserve.h"
#include "tsdf/leaf_values.h"
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

thread_local void* t_given = nullptr;  ///< PackedVoxel::giveNext()

#if ACCESSVDB_LEAF_POOL
constexpr std::size_t kChunkBytes = std::size_t{2} << 20;
/// The header occupies the first buffer's place.
constexpr std::uint32_t kBuffersPerChunk = kChunkBytes / kBufferBytes - 1;

/// Of eight buffers, which a scan mostly gives to one map.
constexpr std::size_t kPieceBytes = 8 * kBufferBytes;

struct ChunkHeader {
  std::atomic<std::uint32_t> in_use;  ///< buffers handed out and not freed, plus those still available
  std::atomic<bool> in_pieces;        ///< some went back to the system
  std::array<std::atomic<std::uint8_t>, kChunkBytes / kPieceBytes> freed;  ///< a bit per buffer
};
static_assert(sizeof(ChunkHeader) <= kBufferBytes);

/// @throws std::bad_alloc
ChunkHeader* newChunk() {
  // Twice the size contains an aligned chunk; the rest is returned at once.
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
  madvise(chunk, kChunkBytes, MADV_HUGEPAGE);  // a hint only: small pages work as well
#endif
  auto* header = new (chunk) ChunkHeader;
  header->in_use.store(kBuffersPerChunk, std::memory_order_relaxed);
  return header;
}

/// Chunks ready for any thread that needs one; see leaf_reserve.h.
struct ChunkStore {
  std::mutex mutex;
  std::vector<ChunkHeader*> chunks;
  std::atomic<std::size_t> reserves = 0;  ///< number of existing LeafReserves: of maps
  std::uint64_t taken = 0;                ///< chunks taken by threads so far, ready or not
  std::vector<void*> recycled;            ///< buffers of leaves that became compact, zero again
  std::atomic<bool> hands_on = false;     ///< some were recycled
  std::size_t most_recycled = 0;          ///< so many may wait: nobody counts them
  std::uint64_t reused = 0;               ///< taken by threads so far
};
/// Never destroyed: threads may end after everything else.
ChunkStore& chunkStore() {
  static auto* ready = new ChunkStore;
  return *ready;
}

/// Of recycled buffers, those that a thread takes at once.
constexpr std::size_t kBatch = 256;
/// So many wait for leaves to come at most: 128 MiB.
constexpr std::size_t kMostRecycled = std::size_t{1} << 16;

/// @throws std::bad_alloc
ChunkHeader* takeChunk() {
  ChunkStore& ready = chunkStore();
  {
    const std::lock_guard lock(ready.mutex);
    ++ready.taken;
    if (!ready.chunks.empty()) {
      ChunkHeader* chunk = ready.chunks.back();
      ready.chunks.pop_back();
      return chunk;
    }
  }
  return newChunk();
}

/// Makes the system clear all pages of a chunk, by overwriting their zeros with zeros.
void touchPages(ChunkHeader* chunk) {
  constexpr std::size_t kPage = 4096;
  auto* bytes = reinterpret_cast<volatile char*>(chunk);
  for (std::size_t n = kPage; n < kChunkBytes; n += kPage) bytes[n] = 0;
}

void release(ChunkHeader* chunk, std::uint32_t buffers) noexcept {
  if (buffers == 0) return;
  if (chunk->in_use.fetch_sub(buffers, std::memory_order_acq_rel) == buffers) munmap(chunk, kChunkBytes);
}

/// Before release(): until then the chunk is there.
void freeInPieces(ChunkHeader* chunk, std::size_t buffer) noexcept {
  std::atomic<std::uint8_t>& freed = chunk->freed[buffer / 8];
  const auto bit = static_cast<std::uint8_t>(1u << (buffer % 8));
  const bool is_last = (freed.fetch_or(bit, std::memory_order_acq_rel) | bit) == 0xff;  // never with the header's own
  if (!is_last) return;
#ifdef MADV_NOHUGEPAGE
  // A huge page would come back as a whole.
  if (!chunk->in_pieces.exchange(true, std::memory_order_relaxed)) madvise(chunk, kChunkBytes, MADV_NOHUGEPAGE);
#endif
  madvise(reinterpret_cast<std::byte*>(chunk) + buffer / 8 * kPieceBytes, kPieceBytes, MADV_DONTNEED);
}

/// @param in_pieces  where others of its chunk may stay: else pieces would only be more calls
void freeBuffer(void* buffer, bool in_pieces) noexcept {
  const auto address = reinterpret_cast<std::uintptr_t>(buffer);
  auto* chunk = reinterpret_cast<ChunkHeader*>(address & ~(kChunkBytes - 1));
  if (in_pieces) freeInPieces(chunk, address % kChunkBytes / kBufferBytes);
  release(chunk, 1);
}

/// The chunk from which a thread cuts buffers, and those that it takes before.
struct ThreadChunk {
  ChunkHeader* chunk = nullptr;
  std::uint32_t next = kBuffersPerChunk;
  std::vector<void*> recycled;
  ~ThreadChunk() {
    release(chunk, kBuffersPerChunk - next);
    for (void* buffer : recycled) freeBuffer(buffer, true);
  }
  void takeRecycled() {
    ChunkStore& ready = chunkStore();
    const std::lock_guard lock(ready.mutex);
    const std::size_t count = std::min(kBatch, ready.recycled.size());
    recycled.assign(ready.recycled.end() - static_cast<std::ptrdiff_t>(count), ready.recycled.end());
    ready.recycled.resize(ready.recycled.size() - count);
    ready.reused += count;
  }
};
thread_local ThreadChunk t_chunk;

#endif

}  // namespace

void PackedVoxel::giveNext(void* buffer) noexcept { t_given = buffer; }

#if ACCESSVDB_LEAF_POOL
void* PackedVoxel::operator new[](std::size_t bytes) {
  if (t_given != nullptr) return std::exchange(t_given, nullptr);
  if (bytes != kBufferBytes) throw std::bad_alloc();  // only OpenVDB's leaves allocate here
  ThreadChunk& mine = t_chunk;
  if (mine.recycled.empty() && (mine.next == kBuffersPerChunk || mine.next % kBatch == 0)) mine.takeRecycled();
  if (!mine.recycled.empty()) {
    void* buffer = mine.recycled.back();
    mine.recycled.pop_back();
    return buffer;
  }
  if (mine.next == kBuffersPerChunk) {
    mine.chunk = takeChunk();
    mine.next = 0;
  }
  ++mine.next;
  return reinterpret_cast<std::byte*>(mine.chunk) + mine.next * kBufferBytes;
}

void PackedVoxel::operator delete[](void* buffer) noexcept {
  if (buffer == nullptr) return;
  if (CompactLeaf::isAt(buffer)) return CompactLeaf::free(CompactLeaf::at(buffer));
  // Where buffers were handed on, those of a thread or of another map hold a chunk.
  freeBuffer(buffer, chunkStore().reserves.load(std::memory_order_relaxed) >= 2 ||
                         chunkStore().hands_on.load(std::memory_order_relaxed));
}
void PackedVoxel::recycle(std::span<void* const> buffers) noexcept {
  for (void* buffer : buffers) std::memset(buffer, 0, kBufferBytes);
  ChunkStore& ready = chunkStore();
  std::size_t kept = 0;
  try {
    const std::lock_guard lock(ready.mutex);
    ready.hands_on = true;
    kept = std::min(buffers.size(), ready.most_recycled - std::min(ready.most_recycled, ready.recycled.size()));
    ready.recycled.insert(ready.recycled.end(), buffers.begin(), buffers.begin() + static_cast<std::ptrdiff_t>(kept));
  } catch (const std::bad_alloc&) {
    kept = 0;
  }
  for (void* buffer : buffers.subspan(kept)) freeBuffer(buffer, true);
}

bool newPackedVoxelsAreZero() { return true; }  // what recycle() hands on is zeroed there

LeafReserve::LeafReserve() : arena_(1, 0) {
  ChunkStore& ready = chunkStore();
  const std::lock_guard lock(ready.mutex);
  ++ready.reserves;
  seen_chunks_ = ready.taken;
}

LeafReserve::~LeafReserve() noexcept {
  wait();
  ChunkStore& ready = chunkStore();
  std::vector<ChunkHeader*> unused;
  std::vector<void*> recycled;
  {
    const std::lock_guard lock(ready.mutex);
    if (--ready.reserves == 0) {
      unused.swap(ready.chunks);
      recycled.swap(ready.recycled);
      ready.most_recycled = 0;
    }
  }
  for (void* buffer : recycled) freeBuffer(buffer, true);
  for (ChunkHeader* chunk : unused) release(chunk, kBuffersPerChunk);
}

void LeafReserve::begin() {
  ChunkStore& ready = chunkStore();
  const std::lock_guard lock(ready.mutex);
  seen_chunks_ = ready.taken;
  seen_reused_ = ready.reused;
}

void LeafReserve::refill() {
  constexpr std::uint64_t kMostChunks = 64;
  ChunkStore& ready = chunkStore();
  std::uint64_t wanted = 0;
  {
    const std::lock_guard lock(ready.mutex);
    const std::uint64_t taken = ready.taken - seen_chunks_;
    const std::uint64_t buffers = taken * kBuffersPerChunk + ready.reused - seen_reused_;
    ready.most_recycled = std::min(std::max<std::size_t>(ready.most_recycled / 8 * 7, 2 * buffers), kMostRecycled);
    // Each thread begins with one chunk, and a map that does not grow needs no second one.
    wanted = std::min({taken, last_taken_, kMostChunks});
    last_taken_ = taken;
    if (ready.chunks.size() >= wanted) return;
  }
  arena_.enqueue(group_.defer([wanted, &ready] {
    for (;;) {
      {
        const std::lock_guard lock(ready.mutex);
        if (ready.chunks.size() >= wanted) return;
      }
      ChunkHeader* chunk = nullptr;
      try {
        chunk = newChunk();
        touchPages(chunk);
        const std::lock_guard lock(ready.mutex);
        ready.chunks.push_back(chunk);
      } catch (const std::bad_alloc&) {  // the thread that needs the memory will report it
        if (chunk != nullptr) release(chunk, kBuffersPerChunk);
        return;
      }
    }
  }));
}

void LeafReserve::wait() {
  arena_.execute([this] { group_.wait(); });
}

std::size_t LeafReserve::readyChunks() {
  ChunkStore& ready = chunkStore();
  const std::lock_guard lock(ready.mutex);
  return ready.chunks.size();
}
#else
bool newPackedVoxelsAreZero() { return false; }
LeafReserve::LeafReserve() : seen_chunks_(0), arena_(1, 0) {}
LeafReserve::~LeafReserve() noexcept = default;
void LeafReserve::begin() {}
void LeafReserve::refill() {}
void LeafReserve::wait() {}
std::size_t LeafReserve::readyChunks() { return 0; }
void* PackedVoxel::operator new[](std::size_t bytes) {
  return t_given != nullptr ? std::exchange(t_given, nullptr) : ::operator new[](bytes);
}
void PackedVoxel::operator delete[](void* buffer) noexcept {
  if (CompactLeaf::isAt(buffer)) return CompactLeaf::free(CompactLeaf::at(buffer));
  ::operator delete[](buffer);
}
void PackedVoxel::recycle(std::span<void* const> buffers) noexcept {
  for (void* buffer : buffers) ::operator delete[](buffer);
}
#endif

}  // namespace accessvdb::internal
