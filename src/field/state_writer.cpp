// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/state_writer.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "field/state_sections.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kPointsWritten = 1 << 14;

int wordsOf(const FieldParams& params) { return (params.approach.directionCount() + 63) / 64; }

void writeLeaves(SectionWriter& out, const StateHead& head, const PackedMap& map) {
  out.begin("leaves", head.leaves * kLeafBytes + head.leaves_with_values * kLeafValueBytes +
                          head.leaves_with_votes * kLeafVoteBytes);
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const std::int32_t origin[3] = {leaf->origin().x(), leaf->origin().y(), leaf->origin().z()};
    const std::uint32_t* values = packedValues(*leaf);
    const VoxelVotes* votes = map.votesOf(*leaf);
    const std::uint32_t has = (values != nullptr ? kHasValues : 0) | (votes != nullptr ? kHasVotes : 0);
    LeafBits cleared;
    for (openvdb::Index x = 0; x < 8; ++x) cleared[x] = leaf->getValueMask().getWord<std::uint64_t>(x);
    out.write(origin, sizeof origin);
    out.write(&has, sizeof has);
    out.write(cleared.data(), sizeof cleared);
    if (values != nullptr) out.write(values, kLeafValueBytes);
    if (votes != nullptr) out.write(votes->bit.data(), kLeafVoteBytes);
  }
  out.end();
}

void writePoses(SectionWriter& out, const StateHead& head, const PointStore& points) {
  out.begin("poses", head.poses * kPoseBytes);
  for (std::size_t n = 0; n < points.poses().size(); ++n) out.write(points.poses()[n].data(), kPoseBytes);
  out.end();
}

/// @param words  of seen directions; 0 with viewpoints
void putPoint(const StoredPoint& point, std::size_t words, char* to) {
  const auto put = [&to](const void* data, std::size_t bytes) {
    std::memcpy(to, data, bytes);
    to += bytes;
  };
  put(point.first_L.data(), 3 * sizeof(float));
  put(point.sums.offset.data(), sizeof point.sums.offset);
  put(point.sums.sensor.data(), sizeof point.sums.sensor);
  put(&point.sums.returns, sizeof point.sums.returns);
  if (words == 0) {
    put(&point.views.count, sizeof point.views.count);
    put(point.views.pose.data(), sizeof point.views.pose);
  } else {
    put(point.seen.word, words * sizeof(std::uint64_t));
  }
}

void writePoints(SectionWriter& out, const StateHead& head, const PointStore& points) {
  const std::size_t bytes = storedPointBytes(head.params);
  const std::size_t words = head.params.approach.viewpoints ? 0 : static_cast<std::size_t>(wordsOf(head.params));
  out.begin("points", head.points * bytes);
  std::vector<char> block;
  for (std::size_t first = 0; first < head.points; first += kPointsWritten) {
    const std::size_t count = std::min<std::size_t>(head.points - first, kPointsWritten);
    block.resize(count * bytes);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 512), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        putPoint(points.stored(static_cast<std::uint32_t>(first + n)), words, block.data() + n * bytes);
      }
    });
    out.write(block.data(), block.size());
  }
  out.end();
}

/// Seen directions of the points in other stores, store by store.
void writeViews(SectionWriter& out, const StateHead& head, const std::vector<PointStore*>& stores) {
  out.begin("views", head.points * viewBytesPerPoint(head));
  for (const PointStore* store : stores) {
    const auto words = static_cast<std::size_t>((store->numDirections() + 63) / 64);
    std::vector<std::uint64_t> block;
    for (std::uint64_t first = 0; first < head.points; first += kPointsWritten) {
      const std::size_t count = std::min<std::size_t>(head.points - first, kPointsWritten);
      block.clear();
      for (std::size_t n = 0; n < count; ++n) {
        const DirectionMask seen = store->seen(static_cast<std::uint32_t>(first + n));
        block.insert(block.end(), seen.word, seen.word + words);
      }
      out.write(block.data(), block.size() * sizeof(block[0]));
    }
  }
  out.end();
}

}  // namespace

std::uint64_t storedPointBytes(const FieldParams& params) {
  const std::uint64_t own = 3 * sizeof(float) + 6 * sizeof(std::int64_t) + sizeof(std::uint32_t);
  if (params.approach.viewpoints) return own + sizeof(Viewpoints);
  return own + static_cast<std::uint64_t>(wordsOf(params)) * sizeof(std::uint64_t);
}

void requireSavable(const FieldParams& params) {
  if (params.update.policy == UpdatePolicy::Paper) {
    throw InvalidArgument("usage.checkpoint", "policy",
                          "the paper's update policy depends on the field's history, which a state does not hold",
                          "Use UpdatePolicy::Exact (--policy exact)");
  }
  if (params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("usage.checkpoint", "region", "the projective baseline cannot be saved",
                          "Use another UpdateRegion");
  }
}

void writeState(const std::filesystem::path& file, StateHead head, const SavedParts& parts) {
  const auto& [map, points, views] = parts;
  requireSavable(head.params);
  head.schema = stateSchemaOf(head.params);
  head.leaves = map.leaf_count;
  head.leaves_with_values = map.allocated_leaf_count;
  head.leaves_with_votes = map.votedLeafCount();
  head.points = points.size();
  head.poses = points.poses().size();
  io::writeFileDurably(file, [&](std::ostream& stream) {
    SectionWriter out(stream);
    const std::vector<char> bytes = bytesOf(head);
    out.begin("head", bytes.size());
    out.write(bytes.data(), bytes.size());
    out.end();
    writeLeaves(out, head, map);
    writePoses(out, head, points);
    writePoints(out, head, points);
    if (!head.tools.empty()) writeViews(out, head, views);
  });
}

}  // namespace accessvdb::internal
