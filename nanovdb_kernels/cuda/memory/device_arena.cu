// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/memory/cuda_check.h"
#include "cuda/memory/device_arena.h"
#include "launch/distance_patch.h"

namespace accessvdb::kernels {
namespace {

/// Host and device hold two batches each; a frame of 100 000 changed leaves takes four.
constexpr std::uint32_t kBatchBytes = 8u << 20;
/// Threads per write; most writes are 8 or 16 bytes.
constexpr unsigned kThreadsPerWrite = 4;
constexpr unsigned kThreadsPerBlock = 256;
constexpr unsigned kBlocksPerFill = 8;
constexpr unsigned kWholeWarp = 0xffffffffu;

__global__ void scatterWrites(unsigned char* to, const unsigned char* batch, const StagedWrite* writes,
                              std::uint32_t count) {
  const std::uint32_t n = (blockIdx.x * kThreadsPerBlock + threadIdx.x) / kThreadsPerWrite;
  if (n >= count) return;
  const StagedWrite write = writes[n];
  const std::uint32_t first = threadIdx.x % kThreadsPerWrite;
  if (((write.offset | write.bytes | write.source) & 3) == 0) {
    const auto* source = reinterpret_cast<const std::uint32_t*>(batch + write.source);
    auto* place = reinterpret_cast<std::uint32_t*>(to + write.offset);
    for (std::uint32_t i = first; i < write.bytes / 4; i += kThreadsPerWrite) place[i] = source[i];
  } else {
    for (std::uint32_t i = first; i < write.bytes; i += kThreadsPerWrite)
      to[write.offset + i] = batch[write.source + i];
  }
}

/// Like switchBits() in launch/leaf_patch.h, one lane per word of the leaf.
__global__ void patchLeaves(unsigned char* to, const LeafPatch* patches, const std::uint64_t* words,
                            std::uint32_t count) {
  const std::uint32_t n = (blockIdx.x * kThreadsPerBlock + threadIdx.x) / kLeafWords;
  const std::uint32_t lane = threadIdx.x % kLeafWords;
  const LeafPatch patch = n < count ? patches[n] : LeafPatch{};
  auto* bits = reinterpret_cast<std::uint64_t*>(to + std::uint64_t{patch.leaf} * LeafPatch::kUnit + kLeafBitsBytes);
  const auto wordOf = [&](std::uint32_t bit) -> std::uint64_t {
    if ((patch.mask >> bit & 1) == 0) return 0;
    return words[patch.first_word + __popc(patch.mask & ((1u << bit) - 1))];
  };
  const std::uint64_t before = patch.mask != 0 ? bits[lane] : 0;
  const std::uint64_t after = switched(before, wordOf(lane), wordOf(kLeafWords + lane));
  if (after != before) bits[lane] = after;

  const bool counts = (patch.mask & 0xff00ff00u) != 0;  // a `collides` word changes
  if (!__any_sync(kWholeWarp, counts)) return;
  unsigned long long collides[8];
  for (int x = 0; x < 8; ++x)
    collides[x] = __shfl_sync(kWholeWarp, static_cast<unsigned long long>(after), 8 + x, kLeafWords);
  if (!counts || lane != 0) return;
  std::uint64_t rows[8];
  for (int x = 0; x < 8; ++x) rows[x] = collides[x];
  bits[kLeafWords] = countCells(rows);
}

/// Like setRowPair() in launch/distance_patch.h: sixteen lanes per leaf, one voxel of each row pair per lane.
__global__ void writeRows(unsigned char* to, const LeafPatch* patches, const float* words, std::uint32_t count) {
  const std::uint32_t n = (blockIdx.x * kThreadsPerBlock + threadIdx.x) / kRowPairVoxels;
  if (n >= count) return;
  const std::uint32_t lane = threadIdx.x % kRowPairVoxels;
  const LeafPatch patch = patches[n];
  unsigned char* const leaf = to + std::uint64_t{patch.leaf} * LeafPatch::kUnit;
  auto* values = reinterpret_cast<float*>(leaf + kDistanceValuesBytes);
  auto* masks = reinterpret_cast<std::uint16_t*>(leaf + kDistanceMaskBytes);
  // The two leaves of a warp have different rows, so each half-warp votes on its own.
  const std::uint32_t shift = threadIdx.x & 16u, half = 0xffffu << shift;
  const float* row = words + std::uint64_t{patch.first_word} * kRowPairVoxels;
  for (std::uint32_t left = patch.mask; left != 0; left &= left - 1, row += kRowPairVoxels) {
    const std::uint32_t pair = static_cast<std::uint32_t>(__ffs(static_cast<int>(left))) - 1;
    const float distance_m = row[lane];
    const bool observed = !isnan(distance_m);
    if (observed) values[pair * kRowPairVoxels + lane] = distance_m;
    const std::uint32_t all = __ballot_sync(half, observed) >> shift;
    if (lane == 0) masks[pair] = static_cast<std::uint16_t>(masks[pair] | (all & 0xffffu));
  }
}

__global__ void fillPieces(unsigned char* to, const ArenaFill* fills) {
  const ArenaFill fill = fills[blockIdx.x];
  const std::uint32_t words_each = fill.bytes / 4, words = words_each * fill.count;
  for (std::uint32_t i = blockIdx.y * kThreadsPerBlock + threadIdx.x; i < words; i += gridDim.y * kThreadsPerBlock) {
    const std::uint64_t piece = fill.offset + std::uint64_t{i / words_each} * fill.stride;
    *reinterpret_cast<std::uint32_t*>(to + piece + std::uint64_t{i % words_each} * 4) = fill.word;
  }
}

unsigned blocksFor(std::uint32_t count, unsigned threads_each) {
  return (count * threads_each + kThreadsPerBlock - 1) / kThreadsPerBlock;
}

}  // namespace

DeviceArena::Slot::Slot(DeviceContext& device_context)
    : context(device_context),
      device(nullptr),
      sent(cudaEventDisableTiming),
      batch((host.reserveExactly(kBatchBytes), host.data()), kBatchBytes) {
  device = context.allocate(kBatchBytes);
  context.countPinned(kBatchBytes);
}

DeviceArena::Slot::~Slot() {
  context.release(device, kBatchBytes);
  context.countPinned(-std::int64_t{kBatchBytes});
}

DeviceArena::DeviceArena(std::shared_ptr<DeviceContext> context, std::uint64_t reserve_bytes)
    : context_(std::move(context)), range_(context_, reserve_bytes) {
  const CurrentDevice current(context_->device());
  for (auto& slot : slots_) slot = std::make_unique<Slot>(*context_);
}

DeviceArena::~DeviceArena() {
  (void)cudaStreamSynchronize(context_->priorityStream());
  (void)cudaGetLastError();
}

void DeviceArena::commit(std::uint64_t bytes) {
  range_.back(bytes);
  const std::uint64_t backed = range_.backedBytes();
  if (zeroed_bytes_ == backed) return;
  const CurrentDevice current(context_->device());
  ACCESSVDB_CUDA(cudaMemsetAsync(static_cast<unsigned char*>(range_.base()) + zeroed_bytes_, 0, backed - zeroed_bytes_,
                                 context_->priorityStream()));
  zeroed_bytes_ = backed;
}

WriteBatch& DeviceArena::filling() {
  Slot& slot = *slots_[filling_];
  if (!waited_) {
    const CurrentDevice current(context_->device());
    ACCESSVDB_CUDA(cudaEventSynchronize(slot.sent.get()));
    slot.batch.clear();
    waited_ = true;
  }
  return slot.batch;
}

void DeviceArena::write(std::uint64_t offset, const void* source, std::uint64_t bytes) {
  if (!(offset <= committedBytes() && bytes <= committedBytes() - offset)) throwOutside();
  const auto* from = static_cast<const unsigned char*>(source);
  while (bytes > 0) {
    const std::uint32_t part = filling().write(offset, from, bytes);
    if (part == 0) send();
    offset += part;
    from += part;
    bytes -= part;
  }
}

StagedWrites DeviceArena::stageWrites(std::size_t count, std::uint32_t bytes) {
  StagedWrites room = filling().writes(count, bytes);
  if (room.count == 0 && count > 0) {
    send();
    room = filling().writes(count, bytes);
  }
  return room;
}

StagedPatches DeviceArena::stagePatches(std::size_t count, PatchKind kind) {
  StagedPatches room = filling().patches(count, kind);
  if (room.count == 0 && count > 0) {
    send();
    room = filling().patches(count, kind);
  }
  return room;
}

void DeviceArena::endPatches(std::size_t count, std::size_t words) { filling().endPatches(count, words); }

void DeviceArena::stageFills(std::span<const ArenaFill> fills) {
  while (!fills.empty()) {
    const std::size_t part = filling().fills(fills);
    if (part == 0) send();
    fills = fills.subspan(part);
  }
}

void DeviceArena::flush() {
  const CurrentDevice current(context_->device());
  send();
  ACCESSVDB_CUDA(cudaEventRecord(context_->mirrorReady(), context_->priorityStream()));
}

void DeviceArena::send() {
  const WriteBatch& batch = filling();
  if (batch.empty()) return;
  const CurrentDevice current(context_->device());
  Slot& slot = *slots_[filling_];
  filling_ = 1 - filling_;
  waited_ = false;
  const cudaStream_t stream = context_->priorityStream();
  ACCESSVDB_CUDA(cudaMemcpyAsync(slot.device, batch.data(), batch.usedBytes(), cudaMemcpyHostToDevice, stream));
  auto* to = static_cast<unsigned char*>(range_.base());
  const auto* device = static_cast<const unsigned char*>(slot.device);
  for (const WriteBatch::Section& section : batch.sections()) {
    if (section.count == 0) continue;
    if (section.kind == WriteBatch::Kind::Patches && section.patch == PatchKind::Bits) {
      patchLeaves<<<blocksFor(section.count, kLeafWords), kThreadsPerBlock, 0, stream>>>(
          to, reinterpret_cast<const LeafPatch*>(device + section.list),
          reinterpret_cast<const std::uint64_t*>(device + section.data), section.count);
      checkLaunch("patchLeaves");
    } else if (section.kind == WriteBatch::Kind::Patches) {
      writeRows<<<blocksFor(section.count, kRowPairVoxels), kThreadsPerBlock, 0, stream>>>(
          to, reinterpret_cast<const LeafPatch*>(device + section.list),
          reinterpret_cast<const float*>(device + section.data), section.count);
      checkLaunch("writeRows");
    } else if (section.kind == WriteBatch::Kind::Fills) {
      fillPieces<<<dim3(section.count, kBlocksPerFill), kThreadsPerBlock, 0, stream>>>(
          to, reinterpret_cast<const ArenaFill*>(device + section.list));
      checkLaunch("fillPieces");
    } else {
      scatterWrites<<<blocksFor(section.count, kThreadsPerWrite), kThreadsPerBlock, 0, stream>>>(
          to, device, reinterpret_cast<const StagedWrite*>(device + section.list), section.count);
      checkLaunch("scatterWrites");
    }
  }
  ACCESSVDB_CUDA(cudaEventRecord(slot.sent.get(), stream));
}

}  // namespace accessvdb::kernels
