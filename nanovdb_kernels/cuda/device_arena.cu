// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <cstring>

#include "cuda/cuda_check.h"
#include "cuda/device_arena.h"

namespace accessvdb::kernels {
namespace {

/// A batch is sent when it holds this much, so that staging stays small however large a frame is.
constexpr std::size_t kMostBatchBytes = std::size_t(32) << 20;
constexpr std::size_t kLeastBatchBytes = std::size_t(1) << 20;
/// Data keep their place in a 16-byte line on the way, so that the kernel may copy words.
constexpr std::uint64_t kLine = 16;
/// Threads that share a write: most are 128 bytes or 8.
constexpr unsigned kThreadsPerWrite = 8;
constexpr unsigned kThreadsPerBlock = 256;

__global__ void scatterWrites(unsigned char* to, const unsigned char* batch, const StagedWrite* writes,
                              std::uint32_t count) {
  const std::uint32_t n = (blockIdx.x * kThreadsPerBlock + threadIdx.x) / kThreadsPerWrite;
  if (n >= count) return;
  const StagedWrite write = writes[n];
  const std::uint32_t first = threadIdx.x % kThreadsPerWrite;
  if (((write.offset | write.bytes) & 3) == 0) {
    const auto* source = reinterpret_cast<const std::uint32_t*>(batch + write.source);
    auto* place = reinterpret_cast<std::uint32_t*>(to + write.offset);
    for (std::uint32_t i = first; i < write.bytes / 4; i += kThreadsPerWrite) place[i] = source[i];
  } else {
    for (std::uint32_t i = first; i < write.bytes; i += kThreadsPerWrite)
      to[write.offset + i] = batch[write.source + i];
  }
}

}  // namespace

DeviceArena::DeviceArena(std::shared_ptr<DeviceContext> context, std::uint64_t reserve_bytes)
    : context_(std::move(context)), range_(context_, reserve_bytes) {
  const CurrentDevice current(context_->device());
  for (Batch& batch : batches_) {
    ACCESSVDB_CUDA(cudaEventCreateWithFlags(&batch.done, cudaEventDisableTiming));
  }
}

DeviceArena::~DeviceArena() {
  (void)cudaStreamSynchronize(context_->mirrorStream());
  for (Batch& batch : batches_) {
    if (batch.done != nullptr) (void)cudaEventDestroy(batch.done);
    context_->release(batch.device);
  }
  (void)cudaGetLastError();
}

void DeviceArena::commit(std::uint64_t bytes) {
  const std::uint64_t before = range_.backedBytes();
  if (bytes <= before) return;
  range_.back(bytes);
  const CurrentDevice current(context_->device());
  ACCESSVDB_CUDA(cudaMemsetAsync(static_cast<unsigned char*>(range_.base()) + before, 0, range_.backedBytes() - before,
                                 context_->mirrorStream()));
}

void DeviceArena::requireCommitted(std::uint64_t offset, std::uint64_t bytes) const {
  if (!(offset <= committedBytes() && bytes <= committedBytes() - offset)) {
    throw InternalError("arena.write_range", "", "A write of the mirror is outside the committed memory",
                        "Please report this");
  }
}

/// Of the batch that is being filled. Pinned memory loses what it holds when it grows.
void DeviceArena::reserveHost(std::size_t bytes) {
  Batch& batch = batches_[filling_];
  if (batch.host.size() >= bytes) return;
  const std::vector<std::byte> kept(batch.host.data(), batch.host.data() + filled_bytes_);
  batch.host.reserve(bytes < kLeastBatchBytes ? kLeastBatchBytes : bytes);
  if (!kept.empty()) std::memcpy(batch.host.data(), kept.data(), kept.size());
}

void DeviceArena::write(std::uint64_t offset, const void* source, std::uint64_t bytes) {
  requireCommitted(offset, bytes);
  const auto* from = static_cast<const unsigned char*>(source);
  while (bytes > 0) {
    const std::uint64_t part = bytes < kMostBatchBytes / 2 ? bytes : kMostBatchBytes / 2;
    std::size_t place = (filled_bytes_ + kLine - 1) / kLine * kLine + offset % kLine;
    if (place + part + (writes_.size() + 2) * sizeof(StagedWrite) > kMostBatchBytes) {
      send();
      place = offset % kLine;
    }
    reserveHost(place + part);
    std::memcpy(batches_[filling_].host.data() + place, from, part);
    writes_.push_back({offset, static_cast<std::uint32_t>(place), static_cast<std::uint32_t>(part)});
    filled_bytes_ = place + part;
    offset += part;
    from += part;
    bytes -= part;
  }
}

bool DeviceArena::stage(std::span<const std::uint64_t> offsets, std::uint64_t bytes, std::span<void*> places) {
  const std::uint64_t each = (bytes + kLine - 1) / kLine * kLine + kLine;  // room for any alignment
  if (offsets.size() * (each + sizeof(StagedWrite)) > kMostBatchBytes) return false;
  const std::size_t begin = (filled_bytes_ + kLine - 1) / kLine * kLine;
  if (begin + offsets.size() * each + (writes_.size() + offsets.size()) * sizeof(StagedWrite) > kMostBatchBytes) send();
  for (const std::uint64_t offset : offsets) requireCommitted(offset, bytes);
  std::size_t top = (filled_bytes_ + kLine - 1) / kLine * kLine;
  reserveHost(top + offsets.size() * each);
  for (std::size_t n = 0; n < offsets.size(); ++n) {
    const std::size_t place = top + offsets[n] % kLine;
    writes_.push_back({offsets[n], static_cast<std::uint32_t>(place), static_cast<std::uint32_t>(bytes)});
    places[n] = batches_[filling_].host.data() + place;
    top = (place + bytes + kLine - 1) / kLine * kLine;
    filled_bytes_ = place + bytes;
  }
  return true;
}

void DeviceArena::flush() {
  const CurrentDevice current(context_->device());
  send();
  ACCESSVDB_CUDA(cudaEventRecord(context_->mirrorReady(), context_->mirrorStream()));
}

void DeviceArena::reserveDevice(Batch& batch, std::size_t bytes) {
  if (bytes <= batch.device_bytes) return;
  context_->release(batch.device);
  batch.device = nullptr;
  batch.device_bytes = 0;
  const std::size_t wanted = bytes + bytes / 2;
  batch.device = context_->allocate(wanted);
  batch.device_bytes = wanted;
}

void DeviceArena::send() {
  if (writes_.empty()) return;
  const CurrentDevice current(context_->device());
  Batch& batch = batches_[filling_];
  const std::size_t list = (filled_bytes_ + kLine - 1) / kLine * kLine;
  const std::size_t list_bytes = writes_.size() * sizeof(StagedWrite), total = list + list_bytes;
  reserveHost(total);
  std::memcpy(batch.host.data() + list, writes_.data(), list_bytes);
  reserveDevice(batch, total);
  const cudaStream_t stream = context_->mirrorStream();
  ACCESSVDB_CUDA(cudaMemcpyAsync(batch.device, batch.host.data(), total, cudaMemcpyHostToDevice, stream));
  const auto count = static_cast<std::uint32_t>(writes_.size());
  const unsigned blocks = (count * kThreadsPerWrite + kThreadsPerBlock - 1) / kThreadsPerBlock;
  const auto* device = static_cast<const unsigned char*>(batch.device);
  scatterWrites<<<blocks, kThreadsPerBlock, 0, stream>>>(static_cast<unsigned char*>(range_.base()), device,
                                                         reinterpret_cast<const StagedWrite*>(device + list), count);
  checkLaunch("scatterWrites");
  ACCESSVDB_CUDA(cudaEventRecord(batch.done, stream));
  writes_.clear();
  filled_bytes_ = 0;
  filling_ = 1 - filling_;
  ACCESSVDB_CUDA(cudaEventSynchronize(batches_[filling_].done));  // the device has read what is filled next
}

}  // namespace accessvdb::kernels
