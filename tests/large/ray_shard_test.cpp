// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files of sorted returns: what is written is read back, and nothing that was changed afterwards is.
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <sstream>

#include "accessvdb/error.h"
#include "support/scratch_folder.h"
#include "tiles/ray_shard.h"

namespace accessvdb::tiles {
namespace {

const std::string kPlan(64, 'a');

struct Block {
  std::uint32_t step = 0;
  std::vector<float> p_L, q_L;
  bool operator==(const Block&) const = default;
};
using Contents = std::map<TileIndex, std::vector<Block>>;

std::vector<float> floatsOf(const std::vector<Eigen::Vector3f>& positions) {
  std::vector<float> floats;
  for (const Eigen::Vector3f& p : positions) floats.insert(floats.end(), p.data(), p.data() + 3);
  return floats;
}

class RayShard : public ::testing::Test {
 protected:
  void add(const TileIndex& tile, std::uint32_t step, int returns, bool own_sensors) {
    std::vector<Eigen::Vector3f> p_L, q_L;
    for (int n = 0; n < returns; ++n) {
      const auto x = static_cast<float>(n + 1000 * static_cast<int>(step));
      p_L.emplace_back(x, 0.5f * x, static_cast<float>(tile.first));
      if (own_sensors || n == 0) q_L.emplace_back(-x, 1.0f, 2.0f);
    }
    buffer_.add(tile, step, p_L, q_L);
    written_[tile].push_back({step, floatsOf(p_L), floatsOf(q_L)});
  }

  void write() {
    ShardIndex index;
    index.first_step = 7;
    index.end_step = 10;
    index.points_in = 1234;
    index.points_used = 1200;
    index.truncated_points = 3;
    index.dropped[1] = 34;
    index.farthest_m = {3, 0, 1.5f};
    buffer_.write(file_, kPlan, index);
  }

  [[nodiscard]] Contents read() const {
    Contents contents;
    const ShardIndex index = readShardIndex(file_, kPlan);
    if (index.first_step != 7 || index.end_step != 10 || index.points_in != 1234 || index.points_used != 1200 ||
        index.truncated_points != 3 || index.dropped[1] != 34 || index.farthest_m != std::vector<float>{3, 0, 1.5f}) {
      ADD_FAILURE() << "the index has other numbers";
    }
    RayBlock block;
    for (const ShardSegment& segment : index.segments) {
      std::uint64_t returns = 0;
      SegmentReader reader(file_, segment);
      while (reader.next(block)) {
        contents[segment.tile].push_back({block.step, floatsOf(block.p_L), floatsOf(block.q_L)});
        returns += block.p_L.size();
      }
      EXPECT_EQ(returns, segment.returns);
      EXPECT_FALSE(reader.next(block)) << "after the end";
    }
    return contents;
  }

  /// Damaged, and says so; never other returns.
  void expectDamaged(const std::string& what) const {
    try {
      (void)read();
      ADD_FAILURE() << what << ": was read";
    } catch (const InputError& error) {
      EXPECT_EQ(error.id(), "rays.damaged") << what;
      EXPECT_EQ(error.subject(), file_.string()) << what;
    }
  }

  [[nodiscard]] std::string bytes() const {
    std::ostringstream text;
    text << std::ifstream(file_, std::ios::binary).rdbuf();
    return text.str();
  }
  void overwrite(const std::string& text) const { std::ofstream(file_, std::ios::binary) << text; }

  test::ScratchFolder folder_;
  std::filesystem::path file_ = folder_ / shardName(7);
  ShardBuffer buffer_;
  Contents written_;
};

TEST_F(RayShard, IsReadBack) {
  add({0, 0}, 7, 3, false);
  add({-1, 4}, 7, 1, true);
  add({0, 0}, 8, 20000, true);  // several chunks
  add({0, 0}, 9, 2, false);
  write();
  EXPECT_TRUE(read() == written_);
  EXPECT_EQ(buffer_.bytes(), 0u);
}

/// A tile's hash does not depend on where shards end, and does on every step and return.
TEST_F(RayShard, HashesOfPartsAddUp) {
  const auto sumOf = [&](const std::vector<std::vector<std::uint32_t>>& shards, int returns) {
    RayDigest sum = {};
    for (const std::vector<std::uint32_t>& steps : shards) {
      for (const std::uint32_t step : steps) add({0, 0}, step, returns, step % 2 == 1);
      write();
      for (const ShardSegment& segment : readShardIndex(file_, kPlan).segments) tiles::add(sum, segment.digest);
    }
    return sum;
  };
  const RayDigest whole = sumOf({{7, 8, 9}}, 5);
  EXPECT_EQ(sumOf({{7}, {8, 9}}, 5), whole);
  EXPECT_EQ(sumOf({{7, 8}, {}, {9}}, 5), whole);
  EXPECT_NE(sumOf({{7, 8}}, 5), whole);
  EXPECT_NE(sumOf({{7, 8, 10}}, 5), whole);
  EXPECT_NE(sumOf({{7, 8, 9}}, 6), whole);
}

TEST_F(RayShard, AShardWithoutReturnsIsReadBack) {
  write();
  EXPECT_TRUE(read().empty());
}

/// Many tiles with a few returns each are what a wide view brings.
TEST_F(RayShard, TilesWithFewReturnsTakeLittleMemory) {
  for (int tile = 0; tile < 1000; ++tile) add({tile, 0}, 7, 5, false);
  EXPECT_LT(buffer_.bytes(), 4'000'000u);
}

TEST_F(RayShard, EveryFlippedByteIsNoticed) {
  add({0, 0}, 7, 3, false);
  add({-1, 4}, 8, 2, true);
  write();
  const std::string whole = bytes();
  ASSERT_TRUE(read() == written_);
  for (std::size_t n = 0; n < whole.size(); ++n) {
    if (n >= 12 && n < 16) continue;  // reserved for later versions
    for (const int flip : {0x01, 0x80, 0xff}) {
      std::string changed = whole;
      changed[n] = static_cast<char>(changed[n] ^ flip);
      overwrite(changed);
      expectDamaged("byte " + std::to_string(n) + " of " + std::to_string(whole.size()));
    }
  }
}

TEST_F(RayShard, EveryTruncationAndAnythingAddedIsNoticed) {
  add({0, 0}, 7, 3, false);
  add({-1, 4}, 8, 2, true);
  write();
  const std::string whole = bytes();
  for (std::size_t n = 0; n < whole.size(); ++n) {
    overwrite(whole.substr(0, n));
    expectDamaged("the first " + std::to_string(n) + " bytes");
  }
  overwrite(whole + '\0');
  expectDamaged("a byte more");
  overwrite(whole + whole);
  expectDamaged("twice");
  std::filesystem::remove(file_);
  expectDamaged("no file");
}

TEST_F(RayShard, ThatOfAnotherPlanIsRefused) {
  add({0, 0}, 7, 3, false);
  write();
  EXPECT_THROW((void)readShardIndex(file_, std::string(64, 'b')), InputError);
}

}  // namespace
}  // namespace accessvdb::tiles
