// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Queries to a map in tiles on disk.
#include <map>

#include "accessvdb/error.h"
#include "accessvdb/output_check.h"
#include "accessvdb/tiles.h"
#include "io/results/surface_voxels.h"
#include "tiles/tile_files.h"

namespace accessvdb::tiles {
namespace {

/// A query finds points this far away (io::StoredField), and a point's position may lie one voxel beside its tile.
constexpr std::int32_t kAroundVoxels = 4;

bool isIn(const FieldWindow& core, const openvdb::Coord& ijk, std::int32_t around) {
  return ijk.x() >= core.core_low[0] - around && ijk.x() < core.core_high[0] + around &&
         ijk.y() >= core.core_low[1] - around && ijk.y() < core.core_high[1] + around;
}

/// Joins what one tile says about a position with what others said.
class Joined {
 public:
  Joined(const Eigen::Vector3d& p_W, const openvdb::Coord& ijk) : ijk_(ijk) { answer_.field.position_W = p_W; }

  void add(const IndexedTile& tile, const io::StoredField::Answer& found, bool in_core, bool own_voxel) {
    if (in_core) {
      answer_.field.observed = found.observed;
      answer_.field.cleared = found.cleared;
      answer_.field.distance_m = found.distance_m;
      answer_.field.weight = found.weight;
    }
    if (!found.point) return;
    // As in one piece: the point of the position's own voxel, else the nearest.
    const bool better = !answer_.field.point || (own_voxel && !own_voxel_) ||
                        (own_voxel == own_voxel_ && found.point_distance_m < answer_.field.point_distance_m);
    if (!better) return;
    answer_.field.point = found.point;
    answer_.field.point_distance_m = found.point_distance_m;
    answer_.field.attributes = found.attributes;
    answer_.tile = tile.id;
    own_voxel_ = own_voxel;
  }
  [[nodiscard]] const openvdb::Coord& ijk() const { return ijk_; }
  [[nodiscard]] const StoredAnswer& answer() const { return answer_; }

 private:
  openvdb::Coord ijk_;
  StoredAnswer answer_;
  bool own_voxel_ = false;
};

}  // namespace

std::vector<StoredAnswer> answersAt(const Index& index, std::span<const Eigen::Vector3d> positions_W) {
  io::OutputCheck check;
  return answersAt(index, positions_W, check);
}

std::vector<StoredAnswer> answersAt(const Index& index, std::span<const Eigen::Vector3d> positions_W,
                                    io::OutputCheck& check) {
  const Eigen::Vector3d origin_W = {index.origin_W[0], index.origin_W[1], index.origin_W[2]};
  const auto voxelOf = [&](const Eigen::Vector3d& p_W) {
    return internal::voxelAt(p_W - origin_W, index.voxel_size_m);
  };
  std::vector<Joined> joined;
  for (const Eigen::Vector3d& p_W : positions_W) joined.emplace_back(p_W, voxelOf(p_W));
  for (const IndexedTile& tile : index.tiles) {
    const FieldWindow core = tile.id.window(index.tile_voxels);
    std::optional<io::StoredField> field;  // one tile is in memory at a time
    for (Joined& place : joined) {
      if (!isIn(core, place.ijk(), kAroundVoxels)) continue;
      if (!field) {
        beginCheck(check, tile, {kPointsFile, kGridsFile});
        field.emplace(io::StoredField::open(tile.folder, check));
      }
      const io::StoredField::Answer found = field->at(place.answer().field.position_W);
      const bool own_voxel = found.point && voxelOf(found.point->position_W) == place.ijk();
      place.add(tile, found, isIn(core, place.ijk(), 0), own_voxel);
    }
  }
  std::vector<StoredAnswer> answers;
  for (const Joined& place : joined) answers.push_back(place.answer());
  return answers;
}

}  // namespace accessvdb::tiles
