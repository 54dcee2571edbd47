// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Two grids bit for bit: type, background, topology, every value of every leaf, active or not, and every tile.
#pragma once

#include <gtest/gtest.h>
#include <openvdb/openvdb.h>

#include <cstring>
#include <filesystem>
#include <string>

namespace accessvdb::test {

template <typename T>
bool sameBits(const T& a, const T& b) {
  return std::memcmp(&a, &b, sizeof(T)) == 0;
}

template <typename GridT>
void expectBitEqualTrees(const GridT& a, const GridT& b) {
  EXPECT_TRUE(sameBits(a.background(), b.background()));
  ASSERT_EQ(a.tree().leafCount(), b.tree().leafCount());
  EXPECT_TRUE(a.tree().hasSameTopology(b.tree()));
  auto leaf_a = a.tree().cbeginLeaf();
  auto leaf_b = b.tree().cbeginLeaf();
  for (; leaf_a && leaf_b; ++leaf_a, ++leaf_b) {
    ASSERT_EQ(leaf_a->origin(), leaf_b->origin());
    ASSERT_TRUE(leaf_a->getValueMask() == leaf_b->getValueMask());
    for (openvdb::Index n = 0; n < GridT::TreeType::LeafNodeType::SIZE; ++n) {
      ASSERT_TRUE(sameBits(leaf_a->getValue(n), leaf_b->getValue(n))) << leaf_a->origin() << " " << n;
    }
  }
  auto tile_a = a.tree().cbeginValueAll();
  auto tile_b = b.tree().cbeginValueAll();
  tile_a.setMaxDepth(GridT::TreeType::ValueAllCIter::LEAF_DEPTH - 1);
  tile_b.setMaxDepth(GridT::TreeType::ValueAllCIter::LEAF_DEPTH - 1);
  for (; tile_a && tile_b; ++tile_a, ++tile_b) {
    ASSERT_EQ(tile_a.getCoord(), tile_b.getCoord());
    ASSERT_TRUE(sameBits(*tile_a, *tile_b)) << tile_a.getCoord();
  }
  EXPECT_EQ(!tile_a, !tile_b);
}

/// The types of field.vdb; fails for any other.
inline void expectBitEqual(const openvdb::GridBase& a, const openvdb::GridBase& b) {
  SCOPED_TRACE(a.getName());
  ASSERT_EQ(a.type(), b.type());
  if (a.isType<openvdb::FloatGrid>()) {
    expectBitEqualTrees(static_cast<const openvdb::FloatGrid&>(a), static_cast<const openvdb::FloatGrid&>(b));
  } else if (a.isType<openvdb::BoolGrid>()) {
    expectBitEqualTrees(static_cast<const openvdb::BoolGrid&>(a), static_cast<const openvdb::BoolGrid&>(b));
  } else if (a.isType<openvdb::Vec3SGrid>()) {
    expectBitEqualTrees(static_cast<const openvdb::Vec3SGrid&>(a), static_cast<const openvdb::Vec3SGrid&>(b));
  } else {
    FAIL() << "not a type of field.vdb: " << a.type();
  }
}

inline openvdb::GridPtrVecPtr readVdb(const std::filesystem::path& path) {
  openvdb::initialize();
  openvdb::io::File file(path.string());
  file.open(false);
  return file.getGrids();
}

inline openvdb::GridBase::Ptr named(const openvdb::GridPtrVec& grids, const std::string& name) {
  const auto grid = openvdb::findGridByName(grids, name);
  EXPECT_TRUE(grid) << "no grid " << name;
  return grid;
}

}  // namespace accessvdb::test
