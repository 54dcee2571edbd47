// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is written to an arena in one transfer, laid out in memory that the arena owns: sections in the order of the
/// calls, each with a list of destinations and their data.
///
/// Plain memory and arithmetic, so that tests and benchmarks without a GPU stage like the device.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "launch/mirror_arena.h"

namespace accessvdb::kernels {

class WriteBatch {
 public:
  enum class Kind { Patches, Writes, Fills };
  /// `count` LeafPatch with words at byte `data`, or `count` StagedWrite or ArenaFill; the list begins at byte `list`
  /// of the batch.
  struct Section {
    Kind kind;
    std::uint32_t list, count, data;
    PatchKind patch = PatchKind::Bits;  ///< for Kind::Patches
  };
  static constexpr std::uint32_t kLeastBytes = 1u << 17;

  /// @param memory  aligned to 16 bytes, `bytes` long, at least kLeastBytes
  WriteBatch(std::byte* memory, std::uint32_t bytes) : memory_(memory), bytes_(bytes) { sections_.reserve(64); }

  [[nodiscard]] bool empty() const { return used_ == 0; }
  [[nodiscard]] std::uint32_t usedBytes() const { return used_; }
  [[nodiscard]] const std::byte* data() const { return memory_; }
  [[nodiscard]] const std::vector<Section>& sections() const { return sections_; }
  void clear() {
    sections_.clear();
    used_ = 0;
    open_ = {};
  }

  /// @return count 0 if the batch is too full to be worth it; never for an empty batch
  [[nodiscard]] StagedPatches patches(std::size_t wanted, PatchKind kind) {
    const std::uint32_t count =
        fitting(wanted, std::uint32_t{sizeof(LeafPatch)} + LeafPatch::kMostWords * wordBytes(kind));
    if (count == 0) return {};
    open_ = {};
    const std::uint32_t list = take(count * std::uint32_t{sizeof(LeafPatch)});
    const std::uint32_t words = used_;
    sections_.push_back({Kind::Patches, list, count, words, kind});
    return {reinterpret_cast<LeafPatch*>(memory_ + list), memory_ + words, count};
  }
  /// For the patches handed out last.
  void endPatches(std::size_t count, std::size_t words) {
    sections_.back().count = static_cast<std::uint32_t>(count);
    take(static_cast<std::uint32_t>(words * wordBytes(sections_.back().patch)));
  }

  /// @return how many of the fills fit
  [[nodiscard]] std::size_t fills(std::span<const ArenaFill> wanted) {
    const std::uint32_t count = fitting(wanted.size(), sizeof(ArenaFill));
    if (count == 0) return 0;
    open_ = {};  // later single writes must not be ordered before them
    const std::uint32_t list = take(count * std::uint32_t{sizeof(ArenaFill)});
    std::memcpy(memory_ + list, wanted.data(), count * sizeof(ArenaFill));
    sections_.push_back({Kind::Fills, list, count, list});
    return count;
  }

  [[nodiscard]] StagedWrites writes(std::size_t wanted, std::uint32_t bytes) {
    const std::uint32_t stride = lines(bytes);
    const std::uint32_t count = fitting(wanted, stride + std::uint32_t{sizeof(StagedWrite)});
    if (count == 0) return {};
    open_ = {};
    const std::uint32_t list = take(count * std::uint32_t{sizeof(StagedWrite)}), data = take(count * stride);
    sections_.push_back({Kind::Writes, list, count, data});
    return {reinterpret_cast<StagedWrite*>(memory_ + list), memory_ + data, count, data, stride};
  }

  /// A write of any length to any offset; grouped with adjacent calls. @return how many of the bytes fit
  [[nodiscard]] std::uint32_t write(std::uint64_t offset, const void* source, std::uint64_t bytes) {
    if (open_.room == 0) {
      const std::uint32_t list_bytes = kOpenWrites * std::uint32_t{sizeof(StagedWrite)};
      if (bytes_ - used_ < list_bytes + 2 * kLine) return 0;
      open_ = {take(list_bytes), kOpenWrites};
      sections_.push_back({Kind::Writes, open_.list, 0, used_});
      open_.section = sections_.size() - 1;
    }
    // Data keeps its alignment within a word, so that words can be copied.
    const auto shift = static_cast<std::uint32_t>(offset % 4);
    if (bytes_ - used_ < shift + kLine) return 0;
    const auto part = static_cast<std::uint32_t>(std::min<std::uint64_t>(bytes, bytes_ - used_ - shift));
    std::memcpy(memory_ + used_ + shift, source, part);
    Section& section = sections_[open_.section];
    const StagedWrite write = {offset, used_ + shift, part};
    std::memcpy(memory_ + open_.list + section.count++ * sizeof(write), &write, sizeof(write));
    --open_.room;
    take(shift + part);
    return part;
  }

 private:
  static constexpr std::uint32_t kLine = 16;        ///< all offsets of lists and data are multiples of it
  static constexpr std::uint32_t kOpenWrites = 64;  ///< entries in the list of a section of single writes

  static std::uint32_t lines(std::uint32_t bytes) { return (bytes + kLine - 1) / kLine * kLine; }
  std::uint32_t take(std::uint32_t bytes) {
    const std::uint32_t place = used_;
    used_ = std::min(bytes_, used_ + lines(bytes));
    return place;
  }
  /// How many of `wanted` items of `each` bytes fit; fewer than wanted, but not 0, only if the batch is empty.
  [[nodiscard]] std::uint32_t fitting(std::size_t wanted, std::uint32_t each) const {
    const std::uint32_t room = (bytes_ - used_ - std::min(bytes_ - used_, 4 * kLine)) / each;
    if (room >= wanted) return static_cast<std::uint32_t>(wanted);
    return empty() ? room : 0;
  }

  std::byte* memory_;
  std::uint32_t bytes_, used_ = 0;
  std::vector<Section> sections_;
  struct {
    std::uint32_t list = 0, room = 0;
    std::size_t section = 0;
  } open_;
};

}  // namespace accessvdb::kernels
