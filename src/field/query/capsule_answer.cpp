// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A capsule against the authored map. Which voxels it touches, and where, follows the rules of hostdev/capsule.h, as
/// in a kernel; here their distances are available too.
#include <cmath>

#include "field/query/query_source.h"
#include "hostdev/capsule.h"

namespace accessvdb::internal {
namespace {

using kernels::Capsule;

/// What the walk has found so far, in voxels.
struct Findings {
  float nearest = INFINITY, first_t = INFINITY;
  bool unknown = false, collision = false;
};

bool hasBit(const LeafBits& bits, openvdb::Index n) { return (bits[n >> 6] >> (n & 63) & 1) != 0; }

/// In a leaf where nothing was observed: does the capsule touch a voxel that is not cleared?
bool touchesUnknown(const Capsule& capsule, const float* corner, const LeafBits& cleared, float reach2) {
  for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
    if (hasBit(cleared, n)) continue;
    const float x = corner[0] + static_cast<float>(n >> 6), y = corner[1] + static_cast<float>(n >> 3 & 7),
                z = corner[2] + static_cast<float>(n & 7);
    if (nearestOnAxis(capsule, x, y, z).distance2 <= reach2) return true;
  }
  return false;
}

class CapsuleScan {
 public:
  CapsuleScan(const QuerySource& source, const Capsule& capsule)
      : source_(source),
        capsule_(capsule),
        reach_(capsule.radius + kernels::kHalfCellDiagonal),
        inverse_(source.inverse_voxel_size) {}

  void scanLeaf(const PackedLeaf* leaf, const openvdb::Coord& origin) {
    float corner[3];
    for (int axis = 0; axis < 3; ++axis) corner[axis] = static_cast<float>(origin[axis] - capsule_.anchor[axis]);
    LeafValues::Room room;
    const std::uint32_t* values = leaf == nullptr ? nullptr : LeafValues(*leaf).all(room);
    if (values == nullptr) {
      const LeafBits cleared = leaf == nullptr ? LeafBits{} : source_.map->confirmedIn(*leaf);
      if (!found_.unknown) found_.unknown = touchesUnknown(capsule_, corner, cleared, reach_ * reach_);
      return;
    }
    const LeafBits cleared = source_.map->confirmedIn(*leaf);
    const bool ages = source_.map->agesFreeSpace();
    const VoxelVotes* votes = source_.map->votesOf(*leaf);
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      const std::uint32_t packed = values[n];
      const bool observed = weightOf(packed) > 0;
      if (!observed && (found_.unknown || hasBit(cleared, n))) continue;
      const float x = corner[0] + static_cast<float>(n >> 6), y = corner[1] + static_cast<float>(n >> 3 & 7),
                  z = corner[2] + static_cast<float>(n & 7);
      const float distance2 = nearestOnAxis(capsule_, x, y, z).distance2;
      if (distance2 > reach_ * reach_) continue;
      if (observed) {
        if (ages && !hasBit(cleared, n) && meanOf(packed) >= source_.map->collisionMean()) found_.unknown = true;
        meet(meanOf(packed), votes != nullptr && votes->blockedAt(n), x, y, z, std::sqrt(distance2));
      } else {
        found_.unknown = true;
      }
    }
  }

  [[nodiscard]] const Findings& found() const { return found_; }

 private:
  void meet(std::uint32_t mean, bool blocked, float x, float y, float z, float to_axis) {
    const float to_surface = blocked ? 0 : source_.map->distanceOf(mean) * inverse_;
    found_.nearest = std::min(found_.nearest, to_axis + to_surface);
    const bool collides = blocked || mean < source_.map->collisionMean();
    if (!collides && !(to_axis + to_surface < capsule_.radius)) return;
    found_.collision = true;
    const float within = collides ? reach_ : capsule_.radius - to_surface;
    found_.first_t = std::min(found_.first_t, firstWithin(capsule_, x, y, z, within));
  }

  const QuerySource& source_;
  const Capsule& capsule_;
  float reach_, inverse_;
  Findings found_;
};

}  // namespace

CapsuleAnswer answerCapsule(const QuerySource& source, const CapsuleQuery& query) {
  CapsuleAnswer answer;
  const Eigen::Vector3d a_L = query.a_W - source.origin_W, b_L = query.b_W - source.origin_W;
  Capsule capsule;
  if (!makeCapsule(a_L.data(), b_L.data(), query.radius_m, source.inverse_voxel_size, capsule)) return answer;
  CapsuleScan scan(source, capsule);
  ConstPackedAccessor map(source.map->tree());
  kernels::Coord origin;
  for (kernels::CapsuleLeaves leaves(capsule); leaves.next(origin);) {
    const openvdb::Coord ijk(origin[0], origin[1], origin[2]);
    scan.scanLeaf(map.probeConstLeaf(ijk), ijk);
  }
  const Findings& found = scan.found();
  answer.valid = true;
  answer.unknown = found.unknown;
  answer.collision = found.collision;
  if (std::isfinite(found.nearest)) answer.min_distance_m = found.nearest * source.voxel_size_m;
  if (found.collision) answer.first_hit_t = found.first_t;
  return answer;
}

}  // namespace accessvdb::internal
