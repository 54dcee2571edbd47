// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/voxel_bitmap.h"

#include <bit>
#include <cmath>

namespace accessvdb::internal {
namespace {

double sizeOf(const VoxelBitmap::Box& box, std::size_t axis) { return double(box.high[axis]) - box.low[axis] + 1; }
double wordsAlong(const VoxelBitmap::Box& box) { return std::ceil(sizeOf(box, 2) / 64); }

}  // namespace

double VoxelBitmap::Box::bits() const { return sizeOf(*this, 0) * sizeOf(*this, 1) * wordsAlong(*this) * 64; }

VoxelBitmap::VoxelBitmap(const Box& box)
    : box_(box),
      size_y_(static_cast<std::size_t>(sizeOf(box, 1))),
      words_z_(static_cast<std::size_t>(wordsAlong(box))),
      words_(static_cast<std::size_t>(sizeOf(box, 0)) * size_y_ * words_z_ + 1, 0) {}

std::vector<VoxelRun> VoxelBitmap::runs() const {
  std::vector<VoxelRun> runs;
  const std::uint64_t* column = words_.data();
  for (std::int32_t i = box_.low[0]; i <= box_.high[0]; ++i) {
    for (std::int32_t j = box_.low[1]; j <= box_.high[1]; ++j, column += words_z_) {
      bool open = false;  // the last run reaches the end of the word
      for (std::size_t word = 0; word < words_z_; ++word) {
        const std::int32_t k = box_.low[2] + static_cast<std::int32_t>(64 * word);
        std::uint64_t bits = column[word];
        if (open) {
          const int more = std::countr_one(bits);
          runs.back().hi += more;
          open = more == 64;
          if (open) continue;
          bits &= ~std::uint64_t{0} << more;
        }
        while (bits != 0) {
          const int low = std::countr_zero(bits), end = low + std::countr_one(bits >> low);
          runs.push_back({i, j, k + low, k + end - 1});
          open = end == 64;
          if (open) break;
          bits &= ~std::uint64_t{0} << end;
        }
      }
    }
  }
  return runs;
}

}  // namespace accessvdb::internal
