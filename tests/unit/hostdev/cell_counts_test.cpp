// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts of cells against counting voxel by voxel, also on the negative side of the map.
#include "hostdev/cell_counts.h"

#include <gtest/gtest.h>

#include <array>
#include <random>

namespace accessvdb {
namespace {

using LeafWords = std::array<std::uint64_t, 8>;

/// Byte 4 (x / 4) + 2 (y / 4) + z / 4 counts the cell of (x, y, z).
std::array<int, 8> countedBitByBit(const LeafWords& words) {
  std::array<int, 8> counts = {};
  for (int x = 0; x < 8; ++x) {
    for (int y = 0; y < 8; ++y) {
      for (int z = 0; z < 8; ++z) {
        if ((words[static_cast<std::size_t>(x)] >> (8 * y + z) & 1) == 0) continue;
        ++counts[static_cast<std::size_t>(4 * (x / 4) + 2 * (y / 4) + z / 4)];
      }
    }
  }
  return counts;
}

void expectCounted(const LeafWords& words) {
  const std::uint64_t counts = kernels::countCells(words.data());
  const std::array<int, 8> expected = countedBitByBit(words);
  for (std::size_t cell = 0; cell < 8; ++cell) {
    ASSERT_EQ(static_cast<int>(counts >> (8 * cell) & 0xff), expected[cell]) << "cell " << cell;
  }
}

TEST(CountCells, EqualsCountingOneByOne) {
  LeafWords words;
  for (const std::uint64_t all : {std::uint64_t{0}, ~std::uint64_t{0}}) {
    words.fill(all);
    expectCounted(words);
  }
  for (std::size_t bit = 0; bit < 512; ++bit) {
    words.fill(0);
    words[bit / 64] = std::uint64_t{1} << (bit % 64);
    expectCounted(words);
  }
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 2000; ++trial) {
    for (std::uint64_t& word : words) {
      word = random();
      if (trial % 3 == 1) word &= random() & random();
      if (trial % 3 == 2) word |= random() | random();
    }
    expectCounted(words);
  }
}

}  // namespace
}  // namespace accessvdb
