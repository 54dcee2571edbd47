// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/state/state_reader.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>

#include "accessvdb/error.h"
#include "field/state/rules_version.h"
#include "field/state/state_writer.h"
#include "io/streams/input_file.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb::internal {
namespace {

constexpr std::uint64_t kMostHeadBytes = 1 << 20;  // a list of 4096 orientations takes 96 bytes for each
constexpr std::size_t kLeavesRead = 1 << 12, kPointsRead = 1 << 14, kPosesRead = 1 << 12;

/// @param words  of seen directions; 0 with viewpoints
StoredPoint pointFrom(const char* from, std::size_t words) {
  StoredPoint point = {};
  const std::span<std::uint64_t> seen = words == 0 ? std::span<std::uint64_t>() : point.seen.clearWords(words);
  visitStoredPoint(point, seen, [&from](void* to, std::size_t bytes) {
    std::memcpy(to, from, bytes);
    from += bytes;
  });
  return point;
}

/// @return nothing if no point can be so
std::optional<ScoredPoint> scoredPointFrom(const char* from, const ApproachParams& approach) {
  ScoredPoint point;
  std::uint8_t label = 0, reason = 0, known = 0;
  const auto take = [&from](auto& part) {
    std::memcpy(&part, from, sizeof part);
    from += sizeof part;
  };
  visitScored(point, [&](auto& part) {
    using Part = std::remove_cvref_t<decltype(part)>;
    if constexpr (std::is_same_v<Part, PointLabel>) {
      take(label);
    } else if constexpr (std::is_same_v<Part, PointReason>) {
      take(reason);
    } else if constexpr (std::is_same_v<Part, bool>) {
      take(known);
    } else {
      take(part);
    }
  });
  const auto directions = static_cast<std::uint16_t>(approach.directionCount());
  const bool fits = label < kNumPointLabels && reason < kNumPointReasons && known <= 1 && point.normal_L.allFinite() &&
                    std::isfinite(point.reach_m) && point.reach_m >= 0 && point.stability >= 0 &&
                    point.stability <= 1 && (point.direction < directions || point.direction == kNoDirection) &&
                    point.roll < std::max(approach.rolls, 1);
  if (!fits) return std::nullopt;
  point.label = static_cast<PointLabel>(label);
  point.reason = static_cast<PointReason>(reason);
  point.has_neighbourhood = known == 1;
  // Who reaches a point knows from where, and what lies around it.
  if (point.label != PointLabel::Unscored && !point.has_neighbourhood) return std::nullopt;
  if (point.label == PointLabel::Accessible && point.direction == kNoDirection) return std::nullopt;
  return point;
}

bool isInSet(std::span<const std::uint64_t> seen, int directions) {
  const int in_last = directions - 64 * (static_cast<int>(seen.size()) - 1);
  return in_last >= 64 || seen.back() >> in_last == 0;
}

}  // namespace

StateReader::StateReader(const std::filesystem::path& file) : file_(file), in_(file) { readHead(); }

void StateReader::readHead() {
  const std::uint64_t length = in_.begin("head");
  if (length > kMostHeadBytes) in_.refuse("it is too long");
  std::vector<char> bytes(length);
  in_.read(bytes.data(), bytes.size());
  head_digest_ = in_.end();
  const std::optional<StateHead> head = headFrom(bytes);
  if (!head) in_.refuse("it holds values that no field has");
  head_ = *head;
  if (!isStateSchema(head_.schema) || head_.rules_version != kRulesVersion) {
    throw UnusableInput("state.rules", io::forMessage(file_.native()),
                        "was written by version " + io::wordForMessage(head_.version) + " with rules " +
                            std::to_string(head_.rules_version) + " in layout " + std::to_string(head_.schema) +
                            "; this program has rules " + std::to_string(kRulesVersion) + " and layout " +
                            std::to_string(kStateSchema),
                        "Start again from the scans, or use the program that wrote it");
  }
  // No product overflows: ids and file sizes bound the factors.
  const std::uint64_t left = in_.fileBytes();
  const bool small = head_.leaves <= left / kLeafBytes && head_.leaves_with_values <= left / kLeafValuesBytes &&
                     head_.voxel_bytes <= left && head_.leaves_with_votes <= left / kLeafVoteBytes &&
                     head_.leaves_with_before <= left / kLeafBeforeBytes &&
                     head_.points <= left / storedPointBytes(head_.params) && head_.poses <= left / kPoseBytes &&
                     head_.cell_blocks <= left / kLeafCellBytes && head_.gone_points <= left / kGonePointBytes &&
                     head_.left_out_leaves <= left / kLeftOutLeafBytes &&
                     head_.closed_cubes <= left / kClosedCubeBytes && head_.split_points <= left / kSplitPointBytes &&
                     head_.votes <= left / kVoteBytes;
  const std::uint64_t columns = head_.params.carry.size();
  const std::uint64_t sections = std::uint64_t{head_.tools.empty() ? 5u : 6u} + (columns > 0 ? 1 : 0);
  const std::uint64_t expected =
      kStateMagic.size() + sections * kSectionFrameBytes + length + leavesBytes(head_) + head_.poses * kPoseBytes +
      head_.points * (storedPointBytes(head_.params) + viewBytesPerPoint(head_) + columns * sizeof(std::int32_t)) +
      head_.split_points * kSplitPointBytes + head_.votes * kVoteBytes + goneStateBytes(head_) +
      head_.left_out_leaves * kLeftOutLeafBytes + head_.closed_cubes * kClosedCubeBytes + scoredStateBytes(head_);
  if (!small || expected != in_.fileBytes()) {
    in_.refuse("its counts do not match the file's size of " + std::to_string(in_.fileBytes()) + " bytes");
  }
}

void StateReader::readInto(PackedMap& map, const std::vector<PointStore*>& stores, const TakeLeaves& take) {
  PointStore& points = *stores.front();
  readLeaves(map, take);
  readPoses(points);
  readPoints(points);
  if (!head_.params.carry.empty()) readAttributes(points.attributes());
  readViews(points, std::span(stores).subspan(1));
}

void StateReader::readViews(const PointStore& points, std::span<PointStore* const> stores) {
  if (head_.tools.empty()) return;
  if (in_.begin("views") != head_.points * viewBytesPerPoint(head_)) {
    in_.refuse("its length does not match the number of views in the head");
  }
  std::vector<StoredPoint> block;
  std::vector<std::uint64_t> seen;
  for (PointStore* store : stores) {
    const auto words = static_cast<std::size_t>(store->directionWords());
    for (std::uint64_t first = 0; first < head_.points; first += kPointsRead) {
      block.resize(std::min<std::uint64_t>(head_.points - first, kPointsRead));
      seen.resize(block.size() * words);
      in_.read(seen.data(), seen.size() * sizeof(seen[0]));
      for (std::size_t n = 0; n < block.size(); ++n) {
        block[n] = points.stored(static_cast<std::uint32_t>(first + n));
        std::copy_n(seen.data() + n * words, words, block[n].seen.clearWords(words).data());
      }
      if (!store->restore(block)) in_.refuse("a point has directions that its tool is not tried in");
    }
  }
  in_.end();
}

void StateReader::readGone(GoneCells& cells, GonePoints& points) {
  if (in_.begin("cells") != head_.cell_blocks * kLeafCellBytes)
    in_.refuse("its length does not match the number of cells in the head");
  for (std::uint64_t n = 0; n < head_.cell_blocks; ++n) {
    Index3 leaf;
    LeafCells of_leaf;
    std::array<char, sizeof(LeafCells)> bytes;
    in_.read(leaf.data(), sizeof leaf);
    in_.read(bytes.data(), bytes.size());
    for (std::size_t c = 0; c < of_leaf.size(); ++c) {
      CellRecord& cell = of_leaf[c];
      std::uint16_t verdict = 0;
      const char* from = bytes.data() + c * sizeof(CellRecord);
      visitStored(cell, verdict, [&from](auto& part) {
        std::memcpy(&part, from, sizeof part);
        from += sizeof part;
      });
      if (verdict > static_cast<std::uint16_t>(Verdict::Open)) in_.refuse("a cell has an unknown verdict");
      cell.verdict = static_cast<Verdict>(verdict);
    }
    if (!cells.restore(leaf, of_leaf)) in_.refuse("a cell occurs twice, has no points, or is invalid");
  }
  in_.end();
  cells.restoreScans(head_.gone_scans);
  if (in_.begin("gone") != head_.gone_points * kGonePointBytes) {
    in_.refuse("its length does not match the number of points in the head");
  }
  std::uint64_t next = 0;
  for (std::uint64_t n = 0; n < head_.gone_points; ++n) {
    std::uint32_t record[2];
    in_.read(record, sizeof record);
    constexpr std::uint32_t kMostWeight = 0xffff;
    if (record[0] < next || record[0] >= head_.points || record[1] >> 1 > kMostWeight) {
      in_.refuse("a point is out of place");
    }
    points.restore(record[0], static_cast<std::uint16_t>(record[1] >> 1), (record[1] & 1) != 0);
    next = std::uint64_t{record[0]} + 1;
  }
  in_.end();
}

void StateReader::readLeftOut(LeftOutVoxels& voxels, LeftOutPoints& points) {
  if (in_.begin("leftout") != head_.left_out_leaves * kLeftOutLeafBytes + head_.closed_cubes * kClosedCubeBytes)
    in_.refuse("its length does not match the numbers in the head");
  for (std::uint64_t n = 0; n < head_.left_out_leaves; ++n) {
    std::int32_t origin[3];
    LeafBits bits;
    in_.read(origin, sizeof origin);
    in_.read(bits.data(), sizeof bits);
    for (const std::int32_t x : origin) {
      if (x % 8 != 0 || x < -kFarthestLeaf_voxels || x > kFarthestLeaf_voxels) in_.refuse("a leaf is out of place");
    }
    const openvdb::Coord ijk(origin[0], origin[1], origin[2]);
    if (bits == LeafBits{} || voxels.find(ijk) != nullptr) in_.refuse("a leaf is empty or there twice");
    voxels.set(ijk, bits);
  }
  std::vector<LeftOutPoints::Cube> cubes(head_.closed_cubes);
  for (LeftOutPoints::Cube& cube : cubes) in_.read(cube.data(), kClosedCubeBytes);
  if (!points.restoreCubes(head_.closed_doublings, cubes)) in_.refuse("a cell is there twice or out of place");
  in_.end();
}

void StateReader::readScored(const std::vector<PointScorer*>& scorers) {
  const std::uint64_t length = head_.points * (kScoredPointBytes * head_.toolCount() + 8 * head_.scored_words);
  if (in_.begin("scored") != length) in_.refuse("its length does not match the number of points in the head");
  std::uint64_t words_of_all = 0;
  for (const PointScorer* scorer : scorers)
    words_of_all += static_cast<std::uint64_t>(scorer->points().directionWords());
  if (!scorers.empty() && words_of_all != head_.scored_words) in_.refuse("it is of other directions");
  std::vector<char> bytes;
  if (scorers.empty()) {
    for (std::uint64_t left = length; left > 0; left -= bytes.size()) {
      bytes.resize(std::min<std::uint64_t>(left, 1 << 20));
      in_.read(bytes.data(), bytes.size());
    }
  }
  for (PointScorer* scorer : scorers) {
    const auto words = static_cast<std::size_t>(scorer->points().directionWords());
    const std::size_t each = kScoredPointBytes + 8 * words;
    for (std::uint64_t first = 0; first < head_.points; first += kPointsRead) {
      const std::size_t count = std::min<std::uint64_t>(head_.points - first, kPointsRead);
      bytes.resize(count * each);
      in_.read(bytes.data(), bytes.size());
      std::atomic<bool> fits = true;
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 512), [&](const auto& range) {
        std::vector<std::uint64_t> seen(words);
        for (std::size_t n = range.begin(); n != range.end(); ++n) {
          const char* from = bytes.data() + n * each;
          const std::optional<ScoredPoint> point = scoredPointFrom(from, scorer->params().approach);
          std::memcpy(seen.data(), from + kScoredPointBytes, 8 * words);
          if (point && isInSet(seen, scorer->params().approach.directionCount())) {
            scorer->restore(static_cast<std::uint32_t>(first + n), *point, seen);
          } else {
            fits = false;
          }
        }
      });
      if (!fits) in_.refuse("a point has values that no point can have");
    }
  }
  in_.end();
}

void StateReader::readLeaves(PackedMap& map, const TakeLeaves& take) {
  if (in_.begin("leaves") != leavesBytes(head_))
    in_.refuse("its length does not match the number of leaves in the head");
  std::vector<const PackedLeaf*> leaves;
  std::vector<LeafChange> facts;
  const auto hand_over = [&] {
    factsOf(map, leaves, facts);
    take(facts, leaves);
    leaves.clear();
  };
  std::uint64_t with_values = 0, with_votes = 0, with_before = 0, voxel_bytes = 0;
  for (std::uint64_t n = 0; n < head_.leaves; ++n) {
    std::int32_t origin[3];
    std::uint32_t has = 0;
    LeafBits cleared, before;
    VoxelVotes votes;
    LeafValues::Room values;
    in_.read(origin, sizeof origin);
    in_.read(&has, sizeof has);
    in_.read(cleared.data(), sizeof cleared);
    const bool has_values = (has & kHasValues) != 0, has_votes = (has & kHasVotes) != 0,
               has_before = (has & kHasBefore) != 0;
    with_values += has_values ? 1 : 0;
    with_votes += has_votes ? 1 : 0;
    with_before += has_before ? 1 : 0;
    if ((has & ~(kHasValues | kHasVotes | kHasBefore)) != 0 || with_values > head_.leaves_with_values ||
        with_votes > head_.leaves_with_votes || with_before > head_.leaves_with_before) {
      in_.refuse("it has too many values");
    }
    for (const std::int32_t x : origin) {
      if (x % 8 != 0 || x < -kFarthestLeaf_voxels || x > kFarthestLeaf_voxels) in_.refuse("a leaf is out of place");
    }
    if (has_values) voxel_bytes += readValues(values, head_.voxel_bytes - voxel_bytes);
    if (has_votes) in_.read(votes.bit.data(), kLeafVoteBytes);
    if (has_before) in_.read(before.data(), kLeafBeforeBytes);
    const PackedLeaf* leaf = map.restoreLeaf({origin[0], origin[1], origin[2]}, cleared, has_values ? values : nullptr,
                                             has_votes ? &votes : nullptr, has_before ? &before : nullptr);
    if (leaf == nullptr) in_.refuse("a leaf is there twice, or has voxels that no map has");
    leaves.push_back(leaf);
    if (leaves.size() == kLeavesRead) hand_over();
  }
  in_.end();
  if (with_values != head_.leaves_with_values || with_votes != head_.leaves_with_votes ||
      with_before != head_.leaves_with_before || voxel_bytes != head_.voxel_bytes) {
    in_.refuse("it has too few values");
  }
  hand_over();
}

std::uint64_t StateReader::readValues(LeafValues::Room& values, std::uint64_t most_bytes) {
  if (!isCompactSchema(head_.schema)) {
    in_.read(values, sizeof values);
    return 0;
  }
  struct {
    CompactLeaf head = {};
    std::byte voxels[sizeof values + 1];  // CompactLeaf::voxel() reads four bytes
  } room;
  visitValues(room.head, [this](void* to, std::size_t bytes) { in_.read(to, bytes); });
  room.head.countVoxels();
  const bool fits = (room.head.voxel_bytes == 3 || room.head.voxel_bytes == 4) && room.head.base_weight <= kWeightMask;
  if (!fits || room.head.voxelsBytes() > most_bytes) in_.refuse("it has too many values");
  in_.read(room.voxels, room.head.voxelsBytes());
  room.head.writeTo(values);
  // One way to say it, so that the same map has the same bytes.
  const CompactLeaf ours = CompactLeaf::headOf(values);
  if (std::memcmp(ours.observed, room.head.observed, sizeof ours.observed) != 0 ||
      ours.base_weight != room.head.base_weight || ours.voxel_bytes != room.head.voxel_bytes) {
    in_.refuse("a leaf has voxels that no map has");
  }
  return room.head.voxelsBytes();
}

void StateReader::readPoses(PointStore& points) {
  if (in_.begin("poses") != head_.poses * kPoseBytes)
    in_.refuse("its length does not match the number of positions in the head");
  std::vector<Eigen::Vector3f> poses_L;
  for (std::uint64_t first = 0; first < head_.poses; first += kPosesRead) {
    poses_L.resize(std::min<std::uint64_t>(head_.poses - first, kPosesRead));
    in_.read(poses_L.data(), poses_L.size() * kPoseBytes);
    for (const Eigen::Vector3f& q_L : poses_L) {
      if (!q_L.allFinite()) in_.refuse("a sensor position is not finite");
    }
    points.restorePoses(poses_L);
  }
  in_.end();
}

void StateReader::readAttributes(PointAttributes& attributes) {
  const std::size_t columns = attributes.columns();
  if (in_.begin("carried") != head_.points * columns * sizeof(std::int32_t) + head_.split_points * kSplitPointBytes +
                                  head_.votes * kVoteBytes) {
    in_.refuse("its length does not match the numbers in the head");
  }
  std::vector<std::int32_t> values;
  for (std::uint64_t first = 0; first < head_.points; first += kPointsRead) {
    values.resize(std::min<std::uint64_t>(head_.points - first, kPointsRead) * columns);
    in_.read(values.data(), values.size() * sizeof(values[0]));
    attributes.restore(values);
  }
  std::vector<PointAttributes::Vote> votes;
  std::uint64_t left = head_.votes;
  for (std::uint64_t n = 0; n < head_.split_points; ++n) {
    std::uint32_t record[3];
    in_.read(record, sizeof record);
    const auto [id, column, count] = record;
    if (column >= columns || attributes.carried()[column].keep != Keep::Majority || count > left) {
      in_.refuse("votes are out of place");
    }
    left -= count;
    votes.resize(count);
    in_.read(votes.data(), votes.size() * sizeof(votes[0]));
    if (!attributes.restoreVotes(id, column, votes)) in_.refuse("votes are there twice, or no point has them");
  }
  in_.end();
}

void StateReader::readPoints(PointStore& points) {
  const std::size_t each = storedPointBytes(head_.params);
  const ApproachParams& approach = head_.params.approach;
  const std::size_t words = approach.viewpoints ? 0 : (static_cast<std::size_t>(approach.directionCount()) + 63) / 64;
  if (in_.begin("points") != head_.points * each)
    in_.refuse("its length does not match the number of points in the head");
  std::vector<char> bytes;
  std::vector<StoredPoint> block;
  for (std::uint64_t first = 0; first < head_.points; first += kPointsRead) {
    block.resize(std::min<std::uint64_t>(head_.points - first, kPointsRead));
    bytes.resize(block.size() * each);
    in_.read(bytes.data(), bytes.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, block.size(), 512), [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        block[n] = pointFrom(bytes.data() + n * each, words);
      }
    });
    if (!points.restore(block)) in_.refuse("a point is there twice, or is not one that a field can have");
  }
  in_.end();
}

}  // namespace accessvdb::internal
