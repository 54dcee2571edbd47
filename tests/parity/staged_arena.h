// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A device's arena in plain memory: it takes batches as the device does and carries them out write by write.
#pragma once

#include <functional>
#include <vector>

#include "cpu/host_arena.h"
#include "launch/write_batch.h"

namespace accessvdb::testing {

class StagedArena final : public kernels::MirrorArena {
 public:
  explicit StagedArena(std::uint64_t reserve_bytes = kernels::HostArena::kDefaultReserveBytes,
                       std::uint32_t batch_bytes = kernels::WriteBatch::kLeastBytes)
      : memory_(reserve_bytes), staging_(batch_bytes / 16), batch_(bytesOf(staging_.data()), batch_bytes) {}

  [[nodiscard]] void* base() const noexcept override { return memory_.base(); }
  void commit(std::uint64_t bytes) override {
    if (before_commit) before_commit();
    memory_.commit(bytes);
  }
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes) override {
    if (!(offset <= committedBytes() && bytes <= committedBytes() - offset)) throwOutside();
    const auto* from = static_cast<const std::byte*>(source);
    while (bytes > 0) {
      const std::uint32_t part = batch_.write(offset, from, bytes);
      if (part == 0) send();
      offset += part;
      from += part;
      bytes -= part;
    }
  }
  kernels::StagedWrites stageWrites(std::size_t count, std::uint32_t bytes) override {
    return inBatch(count, [&] { return batch_.writes(count, bytes); });
  }
  kernels::StagedPatches stagePatches(std::size_t count, kernels::PatchKind kind) override {
    return inBatch(count, [&] { return batch_.patches(count, kind); });
  }
  void endPatches(std::size_t count, std::size_t words) override { batch_.endPatches(count, words); }
  void stageFills(std::span<const kernels::ArenaFill> fills) override {
    while (!fills.empty()) {
      const std::size_t part = batch_.fills(fills);
      if (part == 0) send();
      fills = fills.subspan(part);
    }
  }
  void flush() override {
    send();
    if (after_flush) after_flush();
  }
  [[nodiscard]] std::uint64_t reservedBytes() const noexcept override { return memory_.reservedBytes(); }
  [[nodiscard]] std::uint64_t committedBytes() const noexcept override { return memory_.committedBytes(); }

  // Hooks for a test to observe, or to make fail by throwing.
  std::function<void()> before_commit, before_send, after_flush;
  std::function<void(std::uint64_t offset, std::uint64_t bytes)> after_write;
  std::uint64_t batches = 0, sent_bytes = 0;
  bool carries_out = true;  ///< false: what is sent is discarded

 private:
  /// Room in the batch, or in the next one.
  template <class Stage>
  auto inBatch(std::size_t count, const Stage& stage) -> decltype(stage()) {
    auto room = stage();
    if (room.count == 0 && count > 0) {
      send();
      room = stage();
    }
    return room;
  }
  struct alignas(16) Line {
    std::byte bytes[16];
  };
  static std::byte* bytesOf(Line* line) { return line->bytes; }

  void send() {
    if (batch_.empty()) return;
    if (before_send) before_send();
    for (const auto& section : batch_.sections()) {
      for (std::uint32_t n = 0; carries_out && n < section.count; ++n) {
        if (section.kind == kernels::WriteBatch::Kind::Fills) {
          fill(section, n);
        } else if (section.kind == kernels::WriteBatch::Kind::Writes) {
          scatter(section, n);
        } else if (section.patch == kernels::PatchKind::Bits) {
          patch(section, n);
        } else {
          writeRows(section, n);
        }
      }
    }
    ++batches;
    sent_bytes += batch_.usedBytes();
    batch_.clear();
  }
  void scatter(const kernels::WriteBatch::Section& section, std::uint32_t n) {
    kernels::StagedWrite write;
    std::memcpy(&write, batch_.data() + section.list + n * sizeof(write), sizeof(write));
    memory_.write(write.offset, batch_.data() + write.source, write.bytes);
    if (after_write) after_write(write.offset, write.bytes);
  }
  /// Bit by bit, where that is clearer.
  void patch(const kernels::WriteBatch::Section& section, std::uint32_t n) {
    kernels::LeafPatch patch;
    std::memcpy(&patch, batch_.data() + section.list + n * sizeof(patch), sizeof(patch));
    if (patch.mask == 0) return;
    const std::byte* next = batch_.data() + section.data + patch.first_word * 8;
    std::uint64_t on[16] = {}, off[16] = {};
    for (std::uint32_t bit = 0; bit < 32; ++bit) {
      if ((patch.mask >> bit & 1) == 0) continue;
      std::memcpy(bit < 16 ? &on[bit] : &off[bit - 16], next, 8);
      next += 8;
    }
    const std::uint64_t offset = std::uint64_t{patch.leaf} * kernels::LeafPatch::kUnit + kernels::kLeafBitsBytes;
    if (offset + 136 > committedBytes()) throwOutside();
    auto* bits = reinterpret_cast<std::uint64_t*>(memory_.inPlace() + offset);
    std::uint8_t counts[8] = {};
    for (int word = 0; word < 16; ++word) {
      bits[word] = (bits[word] | on[word]) & ~off[word];
      for (int bit = 0; word >= 8 && bit < 64; ++bit) {
        const int x = word - 8, y = bit >> 3, z = bit & 7;
        if ((bits[word] >> bit & 1) != 0) ++counts[(x >> 2) << 2 | (y >> 2) << 1 | z >> 2];
      }
    }
    std::memcpy(bits + 16, counts, 8);
    if (after_write) after_write(offset, 136);
  }

  /// Voxel by voxel. A leaf of floats: origin and flags 16 B, value mask 64 B, extrema 16 B, 512 values.
  void writeRows(const kernels::WriteBatch::Section& section, std::uint32_t n) {
    kernels::LeafPatch patch;
    std::memcpy(&patch, batch_.data() + section.list + n * sizeof(patch), sizeof(patch));
    const std::uint64_t offset = std::uint64_t{patch.leaf} * kernels::LeafPatch::kUnit;
    if (patch.mask == 0) return;
    if (offset + 2144 > committedBytes()) throwOutside();
    auto* leaf = reinterpret_cast<std::uint8_t*>(memory_.inPlace() + offset);
    const std::byte* next = batch_.data() + section.data + patch.first_word * 64;
    for (std::uint32_t voxel = 0; voxel < 512; ++voxel) {
      if ((patch.mask >> (voxel / 16) & 1) == 0) continue;
      float value = 0;
      std::memcpy(&value, next, sizeof(value));
      next += sizeof(value);
      if (value != value) continue;
      std::memcpy(leaf + 96 + 4 * voxel, &value, sizeof(value));
      leaf[16 + voxel / 8] = static_cast<std::uint8_t>(leaf[16 + voxel / 8] | 1u << (voxel % 8));
      if (after_write) after_write(offset + 96 + 4 * voxel, 4);
    }
  }
  void fill(const kernels::WriteBatch::Section& section, std::uint32_t n) {
    kernels::ArenaFill fill;
    std::memcpy(&fill, batch_.data() + section.list + n * sizeof(fill), sizeof(fill));
    for (std::uint32_t piece = 0; piece < fill.count; ++piece) {
      for (std::uint32_t byte = 0; byte < fill.bytes; byte += 4) {
        memory_.write(fill.offset + std::uint64_t{piece} * fill.stride + byte, &fill.word, 4);
      }
    }
  }

  kernels::HostArena memory_;
  std::vector<Line> staging_;
  kernels::WriteBatch batch_;
};

}  // namespace accessvdb::testing
