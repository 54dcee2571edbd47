// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/state/state_writer.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "field/state/state_sections.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kPointsWritten = 1 << 14, kLeavesWritten = 1 << 11;

/// Calls visit(id, column, votes) where a point's returns do not agree.
template <typename Visit>
void forEachSplit(const PointAttributes& attributes, std::uint32_t points, const Visit& visit) {
  std::vector<PointAttributes::Vote> votes;
  for (std::uint32_t id = 0; id < points; ++id) {
    for (std::size_t c = 0; c < attributes.columns(); ++c) {
      attributes.votes(id, c, votes);
      if (!votes.empty()) visit(id, c, std::span<const PointAttributes::Vote>(votes));
    }
  }
}

int wordsOf(const FieldParams& params) { return (params.approach.directionCount() + 63) / 64; }

/// What a state holds of a leaf.
struct StoredLeaf {
  StoredLeaf(const PackedMap& map, const PackedLeaf& of) : leaf(&of), values(of), votes(map.votesOf(of)) {
    before = map.beforeOf(of);
    if (before != nullptr && *before == LeafBits{}) before = nullptr;
    if (values.compact() == nullptr && values) plain.emplace(CompactLeaf::headOf(values.plain()));
  }

  [[nodiscard]] const CompactLeaf* head() const { return plain ? &*plain : values.compact(); }
  [[nodiscard]] std::uint64_t voxelBytes() const { return head() == nullptr ? 0 : head()->voxelsBytes(); }
  [[nodiscard]] std::uint64_t bytes() const {
    return kLeafBytes + (head() == nullptr ? 0 : kLeafValuesBytes + voxelBytes()) +
           (votes == nullptr ? 0 : kLeafVoteBytes) + (before == nullptr ? 0 : kLeafBeforeBytes);
  }
  /// Writes bytes() bytes.
  void put(std::byte* to) const {
    const auto write = [&to](const void* from, std::size_t count) {
      std::memcpy(to, from, count);
      to += count;
    };
    const std::int32_t origin[3] = {leaf->origin().x(), leaf->origin().y(), leaf->origin().z()};
    const std::uint32_t has = (head() != nullptr ? kHasValues : 0) | (votes != nullptr ? kHasVotes : 0) |
                              (before != nullptr ? kHasBefore : 0);
    LeafBits cleared;
    for (openvdb::Index x = 0; x < 8; ++x) cleared[x] = leaf->getValueMask().getWord<std::uint64_t>(x);
    write(origin, sizeof origin);
    write(&has, sizeof has);
    write(cleared.data(), sizeof cleared);
    if (head() != nullptr) {
      visitValues(*head(), write);
      if (plain) {
        plain->packVoxels(values.plain(), to);
        to += voxelBytes();
      } else {
        write(head()->voxels(), voxelBytes());
      }
    }
    if (votes != nullptr) write(votes->bit.data(), kLeafVoteBytes);
    if (before != nullptr) write(before->data(), kLeafBeforeBytes);
  }

  const PackedLeaf* leaf;
  LeafValues values;
  std::optional<CompactLeaf> plain;  ///< of plain values: how they are stored
  const VoxelVotes* votes;
  const LeafBits* before;
};

std::vector<const PackedLeaf*> leavesOf(const PackedMap& map) {
  std::vector<const PackedLeaf*> leaves;
  leaves.reserve(map.leaf_count);
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) leaves.push_back(&*leaf);
  return leaves;
}

std::uint64_t voxelBytesOf(const PackedMap& map, const std::vector<const PackedLeaf*>& leaves) {
  return tbb::parallel_reduce(
      tbb::blocked_range<std::size_t>(0, leaves.size(), 64), std::uint64_t{0},
      [&](const auto& range, std::uint64_t bytes) {
        for (std::size_t n = range.begin(); n != range.end(); ++n) bytes += StoredLeaf(map, *leaves[n]).voxelBytes();
        return bytes;
      },
      std::plus<>());
}

void writeLeaves(SectionWriter& out, const StateHead& head, const PackedMap& map,
                 const std::vector<const PackedLeaf*>& leaves) {
  out.begin("leaves", leavesBytes(head));
  std::vector<std::byte> block;
  std::vector<std::optional<StoredLeaf>> stored;
  std::vector<std::uint64_t> ends;
  for (std::size_t first = 0; first < leaves.size(); first += kLeavesWritten) {
    const std::size_t count = std::min(leaves.size() - first, kLeavesWritten);
    stored.resize(count);
    ends.assign(count + 1, 0);
    const auto forEachLeaf = [count](const auto& visit) {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 32), [&](const auto& range) {
        for (std::size_t n = range.begin(); n != range.end(); ++n) visit(n);
      });
    };
    forEachLeaf([&](std::size_t n) { ends[n + 1] = stored[n].emplace(map, *leaves[first + n]).bytes(); });
    std::partial_sum(ends.begin(), ends.end(), ends.begin());
    block.resize(ends.back());
    forEachLeaf([&](std::size_t n) { stored[n]->put(block.data() + ends[n]); });
    out.write(block.data(), block.size());
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
  visitStoredPoint(point, point.seen.words().first(words), [&to](const void* data, std::size_t bytes) {
    std::memcpy(to, data, bytes);
    to += bytes;
  });
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
void writeViews(SectionWriter& out, const StateHead& head, std::span<PointStore* const> stores) {
  out.begin("views", head.points * viewBytesPerPoint(head));
  for (const PointStore* store : stores) {
    const auto words = static_cast<std::size_t>(store->directionWords());
    std::vector<std::uint64_t> block;
    for (std::uint64_t first = 0; first < head.points; first += kPointsWritten) {
      const std::size_t count = std::min<std::size_t>(head.points - first, kPointsWritten);
      block.clear();
      for (std::size_t n = 0; n < count; ++n) {
        block.resize(block.size() + words);
        store->joinSeen(static_cast<std::uint32_t>(first + n), std::span(block).last(words));
      }
      out.write(block.data(), block.size() * sizeof(block[0]));
    }
  }
  out.end();
}

void writeCells(SectionWriter& out, const StateHead& head, const GoneCells& cells, const PointStore& points) {
  out.begin("cells", head.cell_blocks * kLeafCellBytes);
  for (const std::uint32_t block : cells.blocksInOrder()) {
    const Index3& leaf = points.index().blocks()[block].leaf;
    out.write(leaf.data(), sizeof leaf);
    std::array<char, sizeof(LeafCells)> bytes = {};
    for (std::size_t n = 0; n < 8; ++n) {
      const CellRecord& cell = cells.cellsOf(block)[n];
      const auto verdict = static_cast<std::uint16_t>(cell.verdict);
      char* to = bytes.data() + n * sizeof(CellRecord);
      visitStored(cell, verdict, [&to](const auto& part) {
        std::memcpy(to, &part, sizeof part);
        to += sizeof part;
      });
    }
    out.write(bytes.data(), bytes.size());
  }
  out.end();
}

/// What value() says of each point, then the votes of those whose returns do not agree.
void writeAttributes(SectionWriter& out, const StateHead& head, const PointAttributes& attributes) {
  const std::size_t columns = attributes.columns();
  out.begin("carried", head.points * columns * sizeof(std::int32_t) + head.split_points * kSplitPointBytes +
                           head.votes * kVoteBytes);
  std::vector<std::int32_t> row(columns);
  for (std::uint32_t id = 0; id < head.points; ++id) {
    for (std::size_t c = 0; c < columns; ++c) row[c] = attributes.value(id, c);
    out.write(row.data(), row.size() * sizeof(row[0]));
  }
  forEachSplit(
      attributes, static_cast<std::uint32_t>(head.points),
      [&](std::uint32_t id, std::size_t c, std::span<const PointAttributes::Vote> votes) {
        const std::uint32_t record[3] = {id, static_cast<std::uint32_t>(c), static_cast<std::uint32_t>(votes.size())};
        out.write(record, sizeof record);
        out.write(votes.data(), votes.size_bytes());
      });
  out.end();
}

bool isKept(const GonePoints& gone, std::uint32_t id) { return gone.leastWeight(id) != 0 || gone.isGone(id); }

void writeGonePoints(SectionWriter& out, const StateHead& head, const GonePoints& gone) {
  out.begin("gone", head.gone_points * kGonePointBytes);
  for (std::uint32_t id = 0; id < gone.size(); ++id) {
    if (!isKept(gone, id)) continue;
    const std::uint32_t record[2] = {id, std::uint32_t{gone.leastWeight(id)} << 1 | (gone.isGone(id) ? 1u : 0u)};
    out.write(record, sizeof record);
  }
  out.end();
}

/// @param scorers  tool by tool
void writeScored(SectionWriter& out, const StateHead& head, const std::vector<const PointScorer*>& scorers) {
  out.begin("scored", head.points * (kScoredPointBytes * scorers.size() + 8 * head.scored_words));
  std::vector<char> block;
  for (const PointScorer* scorer : scorers) {
    const auto words = static_cast<std::size_t>(scorer->points().directionWords());
    const std::size_t each = kScoredPointBytes + 8 * words;
    for (std::uint64_t first = 0; first < head.points; first += kPointsWritten) {
      const std::size_t count = std::min<std::size_t>(head.points - first, kPointsWritten);
      block.resize(count * each);
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 512), [&](const auto& range) {
        std::vector<std::uint64_t> seen(words);
        for (std::size_t n = range.begin(); n != range.end(); ++n) {
          const ScoredPoint point = scorer->scored(static_cast<std::uint32_t>(first + n), seen);
          char* to = block.data() + n * each;
          visitScored(point, [&to](const auto& part) {
            std::memcpy(to, &part, sizeof part);
            to += sizeof part;
          });
          std::memcpy(to, seen.data(), 8 * words);
        }
      });
      out.write(block.data(), block.size());
    }
  }
  out.end();
}

void writeLeftOut(SectionWriter& out, const LeftOutVoxels& voxels, const LeftOutPoints& points) {
  out.begin("leftout", voxels.leaves() * kLeftOutLeafBytes + points.closedCubes().size() * kClosedCubeBytes);
  for (const auto& [ijk, bits] : voxels.inOrder()) {
    const std::int32_t origin[3] = {ijk.x(), ijk.y(), ijk.z()};
    out.write(origin, sizeof origin);
    out.write(bits.data(), sizeof bits);
  }
  for (const LeftOutPoints::Cube& cube : points.closedCubes()) out.write(cube.data(), kClosedCubeBytes);
  out.end();
}

}  // namespace

std::uint64_t leavesBytes(const StateHead& head) {
  const std::uint64_t value_bytes = isCompactSchema(head.schema)
                                        ? head.leaves_with_values * kLeafValuesBytes + head.voxel_bytes
                                        : head.leaves_with_values * kPlainValuesBytes;
  return head.leaves * kLeafBytes + value_bytes + head.leaves_with_votes * kLeafVoteBytes +
         head.leaves_with_before * kLeafBeforeBytes;
}

std::uint64_t goneStateBytes(const StateHead& head) {
  if (head.params.change.mode != ChangeMode::Full) return 0;
  return 2 * kSectionFrameBytes + head.cell_blocks * kLeafCellBytes + head.gone_points * kGonePointBytes;
}

std::uint64_t scoredStateBytes(const StateHead& head) {
  if (!head.isScored()) return 0;
  return kSectionFrameBytes + head.points * (kScoredPointBytes * head.toolCount() + 8 * head.scored_words);
}

std::uint64_t storedPointBytes(const FieldParams& params) {
  const std::uint64_t own = 3 * sizeof(float) + 6 * sizeof(std::int64_t) + sizeof(std::uint32_t);
  if (params.approach.viewpoints) return own + sizeof(Viewpoints);
  return own + static_cast<std::uint64_t>(wordsOf(params)) * sizeof(std::uint64_t);
}

void requireSavable(const FieldParams& params) {
  if (params.update.policy == UpdatePolicy::Paper) {
    throw InvalidArgument("usage.checkpoint", "policy",
                          "the paper's update policy depends on the field's history, which a state does not hold",
                          "Use UpdatePolicy::Exact");
  }
  if (params.tsdf.region == UpdateRegion::Projective) {
    throw InvalidArgument("usage.checkpoint", "region", "the projective baseline cannot be saved",
                          "Use another UpdateRegion");
  }
}

void writeState(const std::filesystem::path& file, StateHead head, const StateInputs& parts, io::WriteFile write) {
  const auto& [map, stores, gone, left_out, scorers] = parts;
  const PointStore& points = *stores.front();
  requireSavable(head.params);
  for (const PointScorer* scorer : scorers)
    head.scored_words += static_cast<std::uint32_t>(scorer->points().directionWords());
  head.schema = stateSchemaOf(head.params, head.isScored());
  head.leaves = map.leaf_count;
  head.leaves_with_values = map.allocated_leaf_count;
  const std::vector<const PackedLeaf*> leaves = leavesOf(map);
  head.voxel_bytes = voxelBytesOf(map, leaves);
  head.leaves_with_votes = map.votedLeafCount();
  head.leaves_with_before = map.agedLeafCount();
  head.points = points.size();
  head.poses = points.poses().size();
  forEachSplit(points.attributes(), points.size(),
               [&](std::uint32_t, std::size_t, std::span<const PointAttributes::Vote> votes) {
                 ++head.split_points;
                 head.votes += votes.size();
               });
  head.left_out_leaves = map.leftOut().leaves();
  head.closed_cubes = left_out.closedCubes().size();
  head.closed_doublings = left_out.doublings();
  if (gone) {
    head.gone_scans = gone->cells->scans();
    head.cell_blocks = gone->cells->blocksInOrder().size();
    for (std::uint32_t id = 0; id < gone->points->size(); ++id) head.gone_points += isKept(*gone->points, id) ? 1 : 0;
  }
  write(file, [&](std::ostream& stream) {
    SectionWriter out(stream);
    const std::vector<char> bytes = bytesOf(head);
    out.begin("head", bytes.size());
    out.write(bytes.data(), bytes.size());
    out.end();
    writeLeaves(out, head, map, leaves);
    writePoses(out, head, points);
    writePoints(out, head, points);
    if (!head.params.carry.empty()) writeAttributes(out, head, points.attributes());
    if (!head.tools.empty()) writeViews(out, head, std::span(stores).subspan(1));
    if (gone) {
      writeCells(out, head, *gone->cells, points);
      writeGonePoints(out, head, *gone->points);
    }
    writeLeftOut(out, map.leftOut(), left_out);
    if (head.isScored()) writeScored(out, head, scorers);
  });
}

}  // namespace accessvdb::internal
