// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads what state_writer.h wrote. Nothing in the file is believed: lengths are compared with the size of the file
/// before anything is allocated, values with what a field can have, and all of it with its hashes.
#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "change/gone_cells.h"
#include "change/gone_points.h"
#include "field/left_out_points.h"
#include "field/state/state_head.h"
#include "field/state/state_sections.h"
#include "points/point_store.h"
#include "tsdf/leaf_values.h"
#include "tsdf/packed_map.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

class StateReader {
 public:
  /// Reads and checks the head. @throws InputError "state.format", "state.damaged"
  /// @throws UnusableInput "state.rules"  other rules or another layout made it
  explicit StateReader(const std::filesystem::path& file);

  [[nodiscard]] const StateHead& head() const { return head_; }
  /// Hash of the head, which stands for the state: it says how many scans, leaves and points there are.
  [[nodiscard]] const Sha256::Digest& headDigest() const { return head_digest_; }

  /// Some leaves, and as changes of an empty map the facts of those that have any.
  using TakeLeaves = std::function<void(std::span<const LeafChange> facts, std::span<const PackedLeaf* const> leaves)>;
  /// Fills an empty map and empty stores. @param stores  of the field's tools, the first tool's first: they get the
  /// same points, seen from other directions  @param take  for the mirrors; the leaves are in the map by then
  /// @throws InputError "state.damaged"; then all are of no use any more
  void readInto(PackedMap& map, const std::vector<PointStore*>& stores, const TakeLeaves& take);

  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  /// Next, for ChangeMode::Full. @throws as that does
  void readGone(GoneCells& cells, GonePoints& points);
  /// Next. @throws as that does
  void readLeftOut(LeftOutVoxels& voxels, LeftOutPoints& points);
  /// Last, if StateHead::isScored(). @param scorers  of the tools, grown; none if they cannot take it: then it is only
  /// checked. @throws as that does
  void readScored(const std::vector<PointScorer*>& scorers);

 private:
  void readHead();
  void readLeaves(PackedMap& map, const TakeLeaves& take);
  /// Of a leaf. @param most_bytes  of its voxels  @return as many as there are
  std::uint64_t readValues(LeafValues::Room& values, std::uint64_t most_bytes);
  void readPoses(PointStore& points);
  void readPoints(PointStore& points);
  void readAttributes(PointAttributes& attributes);
  void readViews(const PointStore& points, std::span<PointStore* const> stores);

  std::filesystem::path file_;
  SectionReader in_;
  StateHead head_;
  Sha256::Digest head_digest_ = {};
};

}  // namespace accessvdb::internal
