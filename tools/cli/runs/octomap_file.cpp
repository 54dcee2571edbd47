// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/octomap_file.h"

#include <octomap/OcTree.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <ostream>
#include <set>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/known_leaves.h"

namespace accessvdb::tools {
namespace {

using Place = std::array<std::int32_t, 3>;
constexpr std::int32_t kLeaf = 8;

/// Voxels of a leaf, and one more along each axis.
class LeafAndNext {
 public:
  LeafAndNext(const std::map<Place, KnownLeaf>& leaves, const Place& origin) {
    for (std::size_t n = 0; n < 8; ++n) {
      const Place at = {origin[0] + kLeaf * static_cast<std::int32_t>(n >> 2 & 1),
                        origin[1] + kLeaf * static_cast<std::int32_t>(n >> 1 & 1),
                        origin[2] + kLeaf * static_cast<std::int32_t>(n & 1)};
      const auto found = leaves.find(at);
      if (found != leaves.end()) leaves_[n] = &found->second;
    }
  }
  enum class Cell : std::uint8_t { Unknown, Free, Occupied };
  /// The cell whose least corner is the centre of voxel x y z of the leaf: it overlaps that and the next on each axis.
  [[nodiscard]] Cell cell(int x, int y, int z) const {
    bool all_free = true;
    for (int n = 0; n < 8; ++n) {
      const int at[3] = {x + (n >> 2 & 1), y + (n >> 1 & 1), z + (n & 1)};
      const std::size_t which = static_cast<std::size_t>((at[0] >> 3) * 4 + (at[1] >> 3) * 2 + (at[2] >> 3));
      const KnownLeaf* leaf = leaves_[which];
      const std::uint64_t bit = std::uint64_t{1} << (8 * (at[1] & 7) + (at[2] & 7));
      const auto word = static_cast<std::size_t>(at[0] & 7);
      if (leaf != nullptr && (leaf->collides[word] & bit) != 0) return Cell::Occupied;
      all_free = all_free && leaf != nullptr && (leaf->free[word] & bit) != 0;
    }
    return all_free ? Cell::Free : Cell::Unknown;
  }

 private:
  std::array<const KnownLeaf*, 8> leaves_ = {};
};

/// OctoMap's own writers of whole trees say on stderr what they do, and have no room for a mark.
void writeTree(const octomap::OcTree& tree, std::ostream& out) {
  char resolution[32];
  std::snprintf(resolution, sizeof resolution, "%.17g", tree.getResolution());
  out << "# Octomap OcTree binary file\n# AccessVDB " ACCESSVDB_VERSION "\nid " << tree.getTreeType() << "\nsize "
      << tree.size() << "\nres " << resolution << "\ndata\n";
  if (tree.getRoot() != nullptr) tree.writeBinaryNode(out, tree.getRoot());
}

}  // namespace

void requireOctomap(const std::string&) {}

PreparedFile octomapFile(const std::filesystem::path& file, const AccessibilityField& field) {
  const double voxel_m = field.params().tsdf.voxel_size_m;
  // Of the world's origin, in voxels: the map's origin is a multiple of them.
  std::array<std::int64_t, 3> origin = {};
  for (int axis = 0; axis < 3; ++axis)
    origin[static_cast<std::size_t>(axis)] = std::llround(field.origin_W()[axis] / voxel_m);
  std::map<Place, KnownLeaf> leaves;
  std::set<Place> places;  // of cells, also those half a voxel before the first voxels of a leaf
  forEachKnownLeaf(field, [&](const KnownLeaf& leaf) {
    leaves.emplace(leaf.origin_ijk, leaf);
    for (int n = 0; n < 8; ++n)
      places.insert({leaf.origin_ijk[0] - kLeaf * (n >> 2 & 1), leaf.origin_ijk[1] - kLeaf * (n >> 1 & 1),
                     leaf.origin_ijk[2] - kLeaf * (n & 1)});
  });
  const auto tree = std::make_shared<octomap::OcTree>(voxel_m);
  const float occupied = tree->getClampingThresMaxLog(), free = tree->getClampingThresMinLog();
  constexpr std::int64_t kHalf = 1 << 15;
  std::uint64_t count_occupied = 0, count_free = 0;
  for (const Place& place : places) {
    const LeafAndNext voxels(leaves, place);
    for (int x = 0; x < kLeaf; ++x) {
      for (int y = 0; y < kLeaf; ++y) {
        for (int z = 0; z < kLeaf; ++z) {
          const LeafAndNext::Cell cell = voxels.cell(x, y, z);
          if (cell == LeafAndNext::Cell::Unknown) continue;
          octomap::OcTreeKey key;
          const int within[3] = {x, y, z};
          for (unsigned axis = 0; axis < 3; ++axis) {
            const std::int64_t at = origin[axis] + place[axis] + within[axis] + kHalf;
            if (at < 0 || at >= 2 * kHalf) {
              char text[120];
              std::snprintf(text, sizeof text, "an OctoMap with cells of %g m ends %g m from the world's origin",
                            voxel_m, static_cast<double>(kHalf) * voxel_m);
              throw ResourceLimit("octomap.range", "", text,
                                  "Take a round offset off the poses, map again, and export that");
            }
            key[axis] = static_cast<octomap::key_type>(at);
          }
          // Cells that are alike are joined on the way, so the tree never has all of them.
          tree->setNodeValue(key, cell == LeafAndNext::Cell::Occupied ? occupied : free);
          ++(cell == LeafAndNext::Cell::Occupied ? count_occupied : count_free);
        }
      }
    }
  }
  return {file, std::to_string(count_occupied) + " occupied and " + std::to_string(count_free) + " free cells",
          [tree](std::ostream& out) { writeTree(*tree, out); }};
}

}  // namespace accessvdb::tools
