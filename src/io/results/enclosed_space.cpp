// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Finds regions of free space around a narrow band without looking at empty leaves: regions are traced inside each
/// leaf, joined over the faces of neighbouring leaves, and over gaps along the three axes, because two consecutive
/// leaves with nothing between them are connected through free space.
#include "io/results/enclosed_space.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>

namespace accessvdb::internal {
namespace {

using Leaf = openvdb::FloatTree::LeafNodeType;
constexpr int kDim = 8, kVoxels = kDim * kDim * kDim;
static_assert(Leaf::DIM == kDim);
constexpr std::array<int, 3> kStrides = {kDim * kDim, kDim, 1};  // strides of x, y, z in a leaf's values
constexpr std::uint16_t kNone = 0xFFFF;                          // voxel in the layer
constexpr std::uint32_t kExterior = 0;

class FreeSpace {
 public:
  FreeSpace(const std::vector<Leaf*>& leaves, float layer) : leaves_(leaves), regions_(leaves.size()) {
    tbb::parallel_for(std::size_t{0}, leaves.size(), [&](std::size_t n) { trace(n, layer); });
    first_.resize(leaves.size() + 1, 1);  // number 0 is the exterior
    for (std::size_t n = 0; n < leaves.size(); ++n) first_[n + 1] = first_[n] + regions_[n].count;
    parent_.resize(first_.back());
    std::iota(parent_.begin(), parent_.end(), 0u);
    for (int axis = 0; axis < 3; ++axis) joinAlong(axis);
    vote(layer);
  }

  [[nodiscard]] bool isInside(std::size_t leaf, int voxel) {
    const std::uint32_t root = find(first_[leaf] + regions_[leaf].of_voxel[static_cast<std::size_t>(voxel)]);
    return root != find(kExterior) && votes_[root] < 0;
  }

 private:
  /// The regions of one leaf.
  struct Regions {
    std::array<std::uint16_t, kVoxels> of_voxel;
    std::uint32_t count = 0;
  };

  void trace(std::size_t n, float layer) {
    Regions& regions = regions_[n];
    constexpr std::uint16_t kUnseen = 0xFFFE;
    for (int voxel = 0; voxel < kVoxels; ++voxel) {
      const auto v = static_cast<openvdb::Index>(voxel);
      const bool wall = leaves_[n]->isValueOn(v) && std::abs(leaves_[n]->getValue(v)) < layer;
      regions.of_voxel[v] = wall ? kNone : kUnseen;
    }
    std::vector<int> open;
    for (int seed = 0; seed < kVoxels; ++seed) {
      if (regions.of_voxel[static_cast<std::size_t>(seed)] != kUnseen) continue;
      const auto label = static_cast<std::uint16_t>(regions.count++);
      regions.of_voxel[static_cast<std::size_t>(seed)] = label;
      open.assign(1, seed);
      while (!open.empty()) {
        const int voxel = open.back();
        open.pop_back();
        for (const int stride : kStrides) {
          const int coordinate = voxel / stride % kDim;
          for (const int step : {-1, 1}) {
            if (coordinate + step < 0 || coordinate + step >= kDim) continue;
            std::uint16_t& next = regions.of_voxel[static_cast<std::size_t>(voxel + step * stride)];
            if (next != kUnseen) continue;
            next = label;
            open.push_back(voxel + step * stride);
          }
        }
      }
    }
  }

  std::uint32_t find(std::uint32_t region) {
    while (parent_[region] != region) region = parent_[region] = parent_[parent_[region]];
    return region;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

  /// Calls visit(voxel) for the 64 voxels of the face at `coordinate` (0 or 7) of an axis.
  template <typename Visit>
  static void forFace(int axis, int coordinate, const Visit& visit) {
    const int a = kStrides[static_cast<std::size_t>((axis + 1) % 3)],
              b = kStrides[static_cast<std::size_t>((axis + 2) % 3)];
    for (int i = 0; i < kDim; ++i) {
      for (int j = 0; j < kDim; ++j) visit(coordinate * kStrides[static_cast<std::size_t>(axis)] + i * a + j * b);
    }
  }

  /// Joins all regions at a face towards a missing neighbour, and `other` with them.
  void openFace(std::size_t leaf, int axis, int coordinate, std::uint32_t other) {
    forFace(axis, coordinate, [&](int voxel) {
      const std::uint16_t region = regions_[leaf].of_voxel[static_cast<std::size_t>(voxel)];
      if (region != kNone) join(first_[leaf] + region, other);
    });
  }
  /// A region at that face, if any.
  [[nodiscard]] std::uint32_t regionAtFace(std::size_t leaf, int axis, int coordinate) const {
    std::uint32_t found = kExterior;
    forFace(axis, coordinate, [&](int voxel) {
      const std::uint16_t region = regions_[leaf].of_voxel[static_cast<std::size_t>(voxel)];
      if (region != kNone) found = first_[leaf] + region;
    });
    return found;
  }

  void joinAlong(int axis) {
    std::vector<std::size_t> order(leaves_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto key = [&](std::size_t n) {
      const openvdb::Coord& origin = leaves_[n]->origin();
      return std::array{origin[(axis + 1) % 3], origin[(axis + 2) % 3], origin[axis]};
    };
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
    for (std::size_t n = 0; n < order.size(); ++n) {
      const auto here = key(order[n]);
      const auto sameRow = [&](const std::array<std::int32_t, 3>& other) {
        return other[0] == here[0] && other[1] == here[1];
      };
      if (n == 0 || !sameRow(key(order[n - 1]))) openFace(order[n], axis, 0, kExterior);
      if (n + 1 == order.size() || !sameRow(key(order[n + 1]))) {
        openFace(order[n], axis, kDim - 1, kExterior);
        continue;
      }
      const std::size_t leaf = order[n], next = order[n + 1];
      if (key(next)[2] == here[2] + kDim) {
        const int back = (kDim - 1) * kStrides[static_cast<std::size_t>(axis)];
        forFace(axis, kDim - 1, [&](int voxel) {
          const std::uint16_t a = regions_[leaf].of_voxel[static_cast<std::size_t>(voxel)];
          const std::uint16_t b = regions_[next].of_voxel[static_cast<std::size_t>(voxel - back)];
          if (a != kNone && b != kNone) join(first_[leaf] + a, first_[next] + b);
        });
      } else if (const std::uint32_t gap = regionAtFace(leaf, axis, kDim - 1); gap != kExterior) {
        openFace(leaf, axis, kDim - 1, gap);
        openFace(next, axis, 0, gap);
      }
    }
  }

  void vote(float layer) {
    votes_.assign(parent_.size(), 0);
    for (std::size_t n = 0; n < leaves_.size(); ++n) {
      for (auto value = leaves_[n]->cbeginValueOn(); value; ++value) {
        if (std::abs(*value) < layer) continue;
        votes_[find(first_[n] + regions_[n].of_voxel[value.pos()])] += *value < 0 ? -1 : 1;
      }
    }
  }

  const std::vector<Leaf*>& leaves_;
  std::vector<Regions> regions_;       ///< [leaf]
  std::vector<std::uint32_t> first_;   ///< [leaf + 1] number of its first region
  std::vector<std::uint32_t> parent_;  ///< [region]
  std::vector<std::int64_t> votes_;    ///< [root] voxels in front of the surface minus voxels behind it
};

}  // namespace

void signInactiveVoxels(const std::vector<Leaf*>& leaves, float layer, float background) {
  FreeSpace space(leaves, layer);
  for (std::size_t n = 0; n < leaves.size(); ++n) {
    for (auto value = leaves[n]->beginValueOff(); value; ++value) {
      const bool inside = space.isInside(n, static_cast<int>(value.pos()));
      leaves[n]->setValueOnly(value.pos(), inside ? -background : background);
    }
  }
}

}  // namespace accessvdb::internal
