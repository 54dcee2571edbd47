// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/ray_shard.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <ostream>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"

namespace accessvdb::tiles {
namespace {

static_assert(std::endian::native == std::endian::little, "values are copied directly from memory");

constexpr std::size_t kLeastChunkBytes = 512, kMostChunkBytes = std::size_t{64} << 10;
constexpr std::array<char, 8> kMagic = {'A', 'V', 'D', 'B', 'R', 'A', 'Y', 'S'};
constexpr std::uint32_t kVersion = 2;
constexpr std::uint64_t kMostIndexBytes = std::uint64_t{1} << 30;

struct Head {
  std::array<char, 8> magic = kMagic;
  std::uint32_t version = kVersion, reserved = 0;
  std::array<char, 64> plan_id = {};
};
struct Tail {
  std::uint64_t index_begin = 0, index_bytes = 0;
  Digest index_sha256 = {};
  std::array<char, 8> magic = kMagic;
};
struct BlockHead {
  std::uint32_t step = 0, returns = 0;
  std::uint16_t own_sensors = 0, attributes = 0;
};
struct IndexHead {
  std::uint64_t first_step = 0, end_step = 0, points_in = 0, points_used = 0, truncated_points = 0;
  std::array<std::uint64_t, kNumDropReasons> dropped = {};
  std::uint64_t segments = 0;
};
struct IndexEntry {
  std::int32_t x = 0, y = 0;
  std::uint64_t begin = 0, bytes = 0, returns = 0;
  RayDigest digest = {};
};
static_assert(sizeof(BlockHead) == 12 && sizeof(Eigen::Vector3f) == 12 && sizeof(IndexEntry) == 64);

[[noreturn]] void failDamaged(const std::filesystem::path& path, const std::string& problem) {
  throw InputError("rays.damaged", path.string(), problem, "Delete this file and run accessvdb tile bin again");
}

Digest digestOf(const void* data, std::size_t bytes) {
  internal::Sha256 sha256;
  sha256.update(data, bytes);
  return sha256.digest();
}

BlockHead headOf(std::uint32_t step, std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                 std::span<const std::int32_t> attributes) {
  return {step, static_cast<std::uint32_t>(p_L.size()), static_cast<std::uint16_t>(q_L.size() > 1 ? 1 : 0),
          static_cast<std::uint16_t>(attributes.size() / p_L.size())};
}

RayDigest digestOf(internal::Sha256& block) { return std::bit_cast<RayDigest>(block.digest()); }

template <typename T>
void put(std::ostream& stream, const T& value) {
  stream.write(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace

void add(RayDigest& sum, const RayDigest& more) {
  for (std::size_t n = 0; n < sum.size(); ++n) sum[n] += more[n];
}

std::string shardName(std::uint64_t first_step) {
  std::string digits = std::to_string(first_step);
  if (digits.size() < 6) digits.insert(0, 6 - digits.size(), '0');
  return "shard-" + digits + ".rays";
}

bool beginsAsShard(const std::filesystem::path& file) {
  std::array<char, kMagic.size()> beginning = {};
  std::ifstream stream(file, std::ios::binary);
  stream.read(beginning.data(), beginning.size());
  return stream && beginning == kMagic;
}

RayDigest digestOfBlock(std::uint32_t step, std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                        std::span<const std::int32_t> attributes) {
  const BlockHead head = headOf(step, p_L, q_L, attributes);
  internal::Sha256 block;
  block.update(&head, sizeof head);
  block.update(q_L.data(), q_L.size_bytes());
  block.update(p_L.data(), p_L.size_bytes());
  if (!attributes.empty()) block.update(attributes.data(), attributes.size_bytes());
  return digestOf(block);
}

double listedRange_m(float longest_m) {
  return std::ceil(1000 * (static_cast<double>(longest_m) * (1 + 1e-6)) + 0.1) / 1000;
}

void ShardBuffer::append(Rays& rays, const void* data, std::size_t bytes) {
  const auto* from = static_cast<const std::byte*>(data);
  while (bytes > 0) {
    if (rays.chunks.empty() || rays.chunks.back().used == rays.chunks.back().size) {
      // As large as all so far: a wide view touches thousands of tiles with a few returns each.
      const std::size_t size = std::clamp<std::size_t>(rays.bytes, kLeastChunkBytes, kMostChunkBytes);
      rays.chunks.push_back({std::make_unique_for_overwrite<std::byte[]>(size), size, 0});
      bytes_ += size;
    }
    Chunk& chunk = rays.chunks.back();
    const std::size_t part = std::min(bytes, chunk.size - chunk.used);
    std::memcpy(chunk.data.get() + chunk.used, from, part);
    chunk.used += part;
    rays.bytes += part;
    from += part;
    bytes -= part;
  }
}

void ShardBuffer::add(const TileIndex& tile, std::uint32_t step, std::span<const Eigen::Vector3f> p_L,
                      std::span<const Eigen::Vector3f> q_L, std::span<const std::int32_t> attributes) {
  Rays& rays = tiles_[tile];
  const BlockHead head = headOf(step, p_L, q_L, attributes);
  append(rays, &head, sizeof head);
  append(rays, q_L.data(), q_L.size_bytes());
  append(rays, p_L.data(), p_L.size_bytes());
  if (!attributes.empty()) append(rays, attributes.data(), attributes.size_bytes());
  tiles::add(rays.digest, digestOfBlock(step, p_L, q_L, attributes));
  rays.returns += p_L.size();
}

void ShardBuffer::write(const std::filesystem::path& path, const std::string& plan_id, ShardIndex index) {
  io::writeFileDurably(path, [&](std::ostream& stream) {
    Head head;
    std::copy_n(plan_id.begin(), std::min(plan_id.size(), head.plan_id.size()), head.plan_id.begin());
    put(stream, head);
    std::uint64_t place = sizeof head;
    std::vector<IndexEntry> entries;
    for (const auto& [tile, rays] : tiles_) {
      for (const Chunk& chunk : rays.chunks) {
        stream.write(reinterpret_cast<const char*>(chunk.data.get()), static_cast<std::streamsize>(chunk.used));
      }
      entries.push_back({tile.first, tile.second, place, rays.bytes, rays.returns, rays.digest});
      place += rays.bytes;
    }
    const IndexHead index_head = {index.first_step,       index.end_step, index.points_in, index.points_used,
                                  index.truncated_points, index.dropped,  entries.size()};
    index.farthest_m.resize(index.end_step - index.first_step);
    const auto bytesOf = [](const auto& values) { return std::as_bytes(std::span(values)); };
    std::vector<std::byte> text;
    for (const auto& part : {bytesOf(std::span(&index_head, 1)), bytesOf(entries), bytesOf(index.farthest_m)}) {
      text.insert(text.end(), part.begin(), part.end());
    }
    stream.write(reinterpret_cast<const char*>(text.data()), static_cast<std::streamsize>(text.size()));
    put(stream, Tail{place, text.size(), digestOf(text.data(), text.size()), kMagic});
  });
  tiles_.clear();
  bytes_ = 0;
}

ShardIndex readShardIndex(const std::filesystem::path& path, const std::string& plan_id) {
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(path, error);
  if (error) failDamaged(path, "cannot be read (" + error.message() + ")");
  std::ifstream stream(path, std::ios::binary);
  Head head;
  Tail tail;
  if (!stream || size < sizeof head + sizeof tail) failDamaged(path, "is not whole");
  stream.read(reinterpret_cast<char*>(&head), sizeof head);
  stream.seekg(static_cast<std::streamoff>(size - sizeof tail));
  stream.read(reinterpret_cast<char*>(&tail), sizeof tail);
  if (!stream || head.magic != kMagic || tail.magic != kMagic || head.version != kVersion) {
    failDamaged(path, "is not a whole file of rays");
  }
  if (plan_id != std::string(head.plan_id.data(), head.plan_id.size())) failDamaged(path, "belongs to another plan");
  const std::uint64_t end = size - sizeof tail;
  if (tail.index_begin < sizeof head || tail.index_begin > end || tail.index_bytes != end - tail.index_begin ||
      tail.index_bytes > kMostIndexBytes || tail.index_bytes < sizeof(IndexHead)) {
    failDamaged(path, "has a damaged index");
  }
  std::vector<char> text(tail.index_bytes);
  stream.seekg(static_cast<std::streamoff>(tail.index_begin));
  stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (!stream || digestOf(text.data(), text.size()) != tail.index_sha256) failDamaged(path, "has a damaged index");
  IndexHead index_head;
  std::memcpy(&index_head, text.data(), sizeof index_head);
  const std::uint64_t steps = index_head.end_step - index_head.first_step;
  const std::size_t listed = text.size() - sizeof index_head;
  if (index_head.segments > listed / sizeof(IndexEntry) ||
      steps != (listed - index_head.segments * sizeof(IndexEntry)) / sizeof(float)) {
    failDamaged(path, "has a damaged index");
  }
  ShardIndex index = {index_head.first_step,
                      index_head.end_step,
                      index_head.points_in,
                      index_head.points_used,
                      index_head.truncated_points,
                      index_head.dropped,
                      {},
                      std::vector<float>(steps)};
  for (std::uint64_t n = 0; n < index_head.segments; ++n) {
    IndexEntry entry;
    std::memcpy(&entry, text.data() + sizeof index_head + n * sizeof entry, sizeof entry);
    if (entry.begin > tail.index_begin || entry.bytes > tail.index_begin - entry.begin) {
      failDamaged(path, "has a damaged index");
    }
    index.segments.push_back({{entry.x, entry.y}, entry.begin, entry.bytes, entry.returns, entry.digest});
  }
  if (steps > 0) {
    std::memcpy(index.farthest_m.data(), text.data() + text.size() - steps * sizeof(float), steps * sizeof(float));
  }
  return index;
}

SegmentReader::SegmentReader(const std::filesystem::path& path, const ShardSegment& segment)
    : path_(path), segment_(segment), stream_(path, std::ios::binary), left_(segment.bytes) {
  stream_.seekg(static_cast<std::streamoff>(segment.begin));
}

void SegmentReader::fail() const { failDamaged(path_, "does not hold what was written into it"); }

void SegmentReader::take(internal::Sha256& block, void* to, std::size_t bytes) {
  if (bytes > left_ || !stream_.read(static_cast<char*>(to), static_cast<std::streamsize>(bytes))) fail();
  block.update(to, bytes);
  left_ -= bytes;
}

bool SegmentReader::next(RayBlock& block) {
  if (left_ == 0) {
    if (!std::exchange(checked_, true) && digest_ != segment_.digest) fail();
    return false;
  }
  internal::Sha256 bytes;
  BlockHead head;
  take(bytes, &head, sizeof head);
  const std::uint64_t sensors = head.own_sensors != 0 ? head.returns : 1;
  const std::uint64_t attributes = std::uint64_t{head.returns} * head.attributes;
  if (head.returns == 0 ||
      (sensors + head.returns) * sizeof(Eigen::Vector3f) + attributes * sizeof(std::int32_t) > left_) {
    fail();
  }
  block.step = head.step;
  block.q_L.resize(sensors);
  block.p_L.resize(head.returns);
  take(bytes, block.q_L.data(), block.q_L.size() * sizeof(Eigen::Vector3f));
  take(bytes, block.p_L.data(), block.p_L.size() * sizeof(Eigen::Vector3f));
  block.attributes.resize(attributes);
  if (attributes > 0) take(bytes, block.attributes.data(), attributes * sizeof(std::int32_t));
  tiles::add(digest_, digestOf(bytes));
  return true;
}

}  // namespace accessvdb::tiles
