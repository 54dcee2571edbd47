// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files of returns sorted by tile. A shard holds those of some consecutive steps:
///
///   head     magic, version, id of the plan
///   segments one per tile: blocks of one step each, in the order of the steps
///   index    the steps and what became of their returns; the segments with their hashes; the longest ray of each step
///   tail     where the index is, its hash, magic
///
/// A block is {step u32, returns u32, own sensors u16, attributes u16}, one sensor position or one per return, then the
/// positions; all are float32 in the local frame, metres, little endian: 12 bytes per return, 24 with own sensors. Last
/// comes what the returns carry, 4 bytes each.
///
/// The hash of a segment is the sum of its blocks' hashes (RayDigest), so that the sum over all shards is the same
/// wherever one shard ends and the next begins.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "accessvdb/types.h"
#include "io/streams/sha256.h"

namespace accessvdb::tiles {

using TileIndex = std::pair<std::int32_t, std::int32_t>;  ///< x, y
using Digest = internal::Sha256::Digest;

/// Of blocks, each of which names its step and so occurs once: sums of their SHA-256 as four numbers of 64 bits.
using RayDigest = std::array<std::uint64_t, 4>;
void add(RayDigest& sum, const RayDigest& more);
/// Of the block that ShardBuffer::add() writes of these.
[[nodiscard]] RayDigest digestOfBlock(std::uint32_t step, std::span<const Eigen::Vector3f> p_L,
                                      std::span<const Eigen::Vector3f> q_L, std::span<const std::int32_t> attributes);
/// No return of the scan is farther from its sensor. @param longest_m  rounded  @return in whole millimetres
[[nodiscard]] double listedRange_m(float longest_m);

struct ShardSegment {
  TileIndex tile;
  std::uint64_t begin = 0, bytes = 0, returns = 0;
  RayDigest digest = {};
};

/// What a shard says of itself.
struct ShardIndex {
  std::uint64_t first_step = 0, end_step = 0;
  std::uint64_t points_in = 0, points_used = 0, truncated_points = 0;
  std::array<std::uint64_t, kNumDropReasons> dropped = {};
  std::vector<ShardSegment> segments;  ///< sorted by tile
  std::vector<float> farthest_m;       ///< of each step: its longest ray
};

/// Returns of consecutive steps in memory, by tile.
class ShardBuffer {
 public:
  /// @param q_L  one position for all returns, or one for each  @param attributes  a row for each return
  void add(const TileIndex& tile, std::uint32_t step, std::span<const Eigen::Vector3f> p_L,
           std::span<const Eigen::Vector3f> q_L, std::span<const std::int32_t> attributes = {});
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  /// Writes the file durably and empties the buffer. @param index  all but its segments  @throws OutputError
  void write(const std::filesystem::path& path, const std::string& plan_id, ShardIndex index);

 private:
  struct Chunk {
    std::unique_ptr<std::byte[]> data;
    std::size_t size = 0, used = 0;
  };
  struct Rays {
    std::vector<Chunk> chunks;
    std::uint64_t bytes = 0, returns = 0;
    RayDigest digest = {};
  };
  void append(Rays& rays, const void* data, std::size_t bytes);
  std::map<TileIndex, Rays> tiles_;
  std::uint64_t bytes_ = 0;
};

/// @throws InputError "rays.damaged" if the file is not whole or of another plan
[[nodiscard]] ShardIndex readShardIndex(const std::filesystem::path& path, const std::string& plan_id);

/// One step's returns for one tile.
struct RayBlock {
  std::uint32_t step = 0;
  std::vector<Eigen::Vector3f> p_L, q_L;
  std::vector<std::int32_t> attributes;  ///< row by row
};

/// The blocks of one segment, one after the other.
class SegmentReader {
 public:
  SegmentReader(const std::filesystem::path& path, const ShardSegment& segment);
  /// @return false at the end, when the hash has been found right  @throws InputError "rays.damaged"
  [[nodiscard]] bool next(RayBlock& block);
  [[noreturn]] void fail() const;

 private:
  void take(internal::Sha256& block, void* to, std::size_t bytes);
  std::filesystem::path path_;
  ShardSegment segment_;
  std::ifstream stream_;
  std::uint64_t left_;
  RayDigest digest_ = {};
  bool checked_ = false;
};

/// "shard-000012.rays" for the shard whose first step is 12.
[[nodiscard]] std::string shardName(std::uint64_t first_step);
/// Whether a file begins as every shard does, of whatever plan.
[[nodiscard]] bool beginsAsShard(const std::filesystem::path& file);

}  // namespace accessvdb::tiles
