// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Saved states that are damaged: a file that differs anywhere, or that no field can have written, is refused.
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/leaf_change.h"
#include "accessvdb/saved_state.h"
#include "field/state/state_head.h"
#include "field/state/state_sections.h"
#include "field/state/state_writer.h"
#include "property/state_streams.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

namespace fs = std::filesystem;

/// A small state, for damage.
class DamagedState : public testing::Test {
 protected:
  void SetUp() override {
    Stream stream = {cpuParams(0.1), wallScans(6, 2, 60), true, 0};
    stream.params.approach.num_directions = 8;
    stream.params.approach.viewpoints = true;  // so that there are sensor positions
    AccessibilityField field(pen(), stream.params);
    integrate(field, stream, 0, 1);
    field.stopGrowing();
    integrate(field, stream, 1, 2);
    field.leaveOut(std::vector<Eigen::Vector3d>{{5, 5, 5}}, 0);
    field.saveState(file());
    good_ = bytesOf(file());
  }
  static ToolGeometry pen() { return boxTool({0, -0.1f, -0.1f}, {0.4f, 0.1f, 0.1f}); }
  [[nodiscard]] fs::path file() const { return folder_ / "state.avst"; }
  void load() const { (void)AccessibilityField::loadState(file(), pen(), BackendKind::Cpu, 1); }

  /// @return id and text of the error  @param bytes  of the file
  std::string refusalOf(const std::string& bytes) const {
    writeBytes(file(), bytes);
    try {
      load();
    } catch (const InputError& error) {
      return error.id() + " " + error.what();
    } catch (const UnusableInput& error) {
      return error.id() + " " + error.what();
    }
    return "";
  }

  /// Begin and length of the content of a section.
  struct Place {
    std::size_t begin, bytes;
  };
  [[nodiscard]] std::vector<std::string> sections() const {
    std::vector<std::string> names;
    for (std::size_t at = internal::kStateMagic.size(); at < good_.size();) {
      std::uint64_t bytes = 0;
      std::memcpy(&bytes, good_.data() + at + 8, 8);
      names.emplace_back(good_.c_str() + at);
      at += internal::kSectionFrameBytes + bytes;
    }
    return names;
  }
  [[nodiscard]] Place placeOf(const std::string& name) const {
    std::size_t at = internal::kStateMagic.size();
    while (at < good_.size()) {
      std::uint64_t bytes = 0;
      std::memcpy(&bytes, good_.data() + at + 8, 8);
      if (std::string(good_.c_str() + at) == name) return {at + 16, bytes};
      at += internal::kSectionFrameBytes + bytes;
    }
    ADD_FAILURE() << "no section " << name;
    return {0, 0};
  }
  /// The state with contents changed and the hashes made anew. @param change  (name, content)
  [[nodiscard]] std::string rehashed(const std::function<void(const std::string&, std::string&)>& change) const {
    std::ostringstream out;
    internal::SectionWriter writer(out);
    for (const std::string& name : sections()) {
      const Place place = placeOf(name);
      std::string content = good_.substr(place.begin, place.bytes);
      change(name, content);
      writer.begin(name, content.size());
      writer.write(content.data(), content.size());
      writer.end();
    }
    return out.str();
  }
  [[nodiscard]] std::string withHead(const std::function<void(internal::StateHead&)>& change) const {
    return rehashed([&](const std::string& name, std::string& content) {
      if (name != "head") return;
      auto head = internal::headFrom({content.begin(), content.end()});
      ASSERT_TRUE(head);
      change(*head);
      const std::vector<char> bytes = internal::bytesOf(*head);
      content.assign(bytes.begin(), bytes.end());
    });
  }

  /// Of the leaves' section. @return where a leaf begins
  static std::size_t leafAt(const std::string& content, std::size_t leaf) {
    std::size_t at = 0;
    for (; leaf > 0; --leaf) {
      std::uint32_t has = 0;
      std::memcpy(&has, content.data() + at + 12, 4);
      at += internal::kLeafBytes;
      if ((has & internal::kHasValues) != 0) at += valuesAt(content, at).second;
      if ((has & internal::kHasVotes) != 0) at += internal::kLeafVoteBytes;
    }
    return at;
  }
  /// @return of values that a leaf has there: all, and how many bytes they take
  static std::pair<std::vector<std::uint32_t>, std::size_t> valuesAt(const std::string& content, std::size_t at) {
    std::uint64_t observed[8];
    std::uint32_t numbers[2];
    std::memcpy(observed, content.data() + at, sizeof observed);
    std::memcpy(numbers, content.data() + at + sizeof observed, sizeof numbers);
    const auto [base_weight, voxel_bytes] = numbers;
    std::vector<std::uint32_t> values(512);
    std::size_t next = at + sizeof observed + sizeof numbers;
    for (std::size_t n = 0; n < values.size(); ++n) {
      if ((observed[n / 64] >> n % 64 & 1) == 0) continue;
      std::memcpy(&values[n], content.data() + next, voxel_bytes);
      if (voxel_bytes == 3) values[n] = values[n] / 16 << 12 | (base_weight + values[n] % 16);
      next += voxel_bytes;
    }
    return {values, next - at};
  }

  ScratchFolder folder_;
  std::string good_;
};

/// The same with what an update found out.
class DamagedScoredState : public DamagedState {
 protected:
  void SetUp() override {
    Stream stream = {cpuParams(0.1), wallScans(6, 4, 400), true, 0};
    stream.params.approach.num_directions = 8;
    AccessibilityField field(pen(), stream.params);
    integrate(field, stream, 0, 4);
    field.update();
    ASSERT_GT(field.snapshot().count(PointLabel::Accessible), 0U);
    field.saveState(file());
    good_ = bytesOf(file());
  }
};

/// Of a field whose returns carry attributes, many of which do not agree.
class DamagedCarryingState : public DamagedState {
 protected:
  void SetUp() override {
    Stream stream = {cpuParams(0.1), wallScans(6, 4, 400), false, 0};
    stream.params.approach.num_directions = 8;
    stream.params.carry = treeAndRow();
    AccessibilityField field(pen(), stream.params);
    integrateCarrying(field, stream, 0, 4);
    field.update();
    field.saveState(file());
    good_ = bytesOf(file());
    points_ = field.snapshot().points.size();
  }
  std::size_t points_ = 0;
};

TEST_F(DamagedCarryingState, IsRefusedWhereverAByteDiffers) {
  EXPECT_NO_THROW(load());
  const Place place = placeOf("carried");
  std::mt19937_64 random(10);
  for (int n = 0; n < 200; ++n) {
    const std::size_t at = place.begin + random() % (place.bytes + 32);
    std::string bad = good_;
    bad[at] = static_cast<char>(bad[at] ^ (1 << random() % 8));
    ASSERT_EQ(refusalOf(bad).rfind("state.damaged", 0), 0U) << "byte " << at << " of " << good_.size();
  }
}

TEST_F(DamagedCarryingState, IsRefusedForValuesThatNoFieldHas) {
  // Behind two values of each point: id, column and number of votes of the first that is split, then its votes.
  const std::size_t split = 8 * points_;
  ASSERT_GT(placeOf("carried").bytes, split + 40);
  const auto with = [&](std::size_t offset, const auto& value) {
    return rehashed([&](const std::string& name, std::string& content) {
      if (name == "carried") std::memcpy(content.data() + offset, &value, sizeof value);
    });
  };
  const auto numberOfVotes = [&](std::uint32_t more) {
    std::uint32_t votes = 0;
    std::memcpy(&votes, good_.data() + placeOf("carried").begin + split + 8, 4);
    return votes + more;
  };
  const std::vector<std::string> all = {with(split, static_cast<std::uint32_t>(points_)),
                                        with(split + 4, std::uint32_t{1}),  // whose value is a first return's
                                        with(split + 4, std::uint32_t{2}),
                                        with(split + 8, std::uint32_t{0}),
                                        with(split + 8, numberOfVotes(1)),
                                        with(split + 8, ~std::uint32_t{0}),
                                        with(split + 12, kNoAttribute),
                                        with(split + 12, std::int32_t{9}),  // no longer ascending
                                        with(split + 16, std::uint32_t{0}),
                                        withHead([](internal::StateHead& head) { ++head.votes; }),
                                        withHead([](internal::StateHead& head) { --head.split_points; }),
                                        withHead([](internal::StateHead& head) { head.votes = ~std::uint64_t{0}; }),
                                        withHead([](internal::StateHead& head) { head.params.carry.pop_back(); }),
                                        withHead([](internal::StateHead& head) { head.params.carry.clear(); })};
  for (std::size_t n = 0; n < all.size(); ++n) {
    EXPECT_EQ(refusalOf(all[n]).rfind("state.damaged", 0), 0U) << n << ": " << refusalOf(all[n]);
  }
}

TEST_F(DamagedScoredState, IsRefusedWhereverAByteDiffers) {
  EXPECT_NO_THROW(load());
  const Place place = placeOf("scored");
  ASSERT_GT(place.bytes, 0U);
  std::mt19937_64 random(9);
  for (int n = 0; n < 200; ++n) {
    const std::size_t at = place.begin + random() % (place.bytes + 32);
    std::string bad = good_;
    bad[at] = static_cast<char>(bad[at] ^ (1 << random() % 8));
    ASSERT_EQ(refusalOf(bad).rfind("state.damaged", 0), 0U) << "byte " << at << " of " << good_.size();
  }
}

TEST_F(DamagedScoredState, IsRefusedForValuesThatNoFieldHas) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto with = [&](std::size_t offset, const auto& value) {
    return rehashed([&](const std::string& name, std::string& content) {
      if (name == "scored") std::memcpy(content.data() + offset, &value, sizeof value);
    });
  };
  constexpr std::size_t kReach = 12, kStability = 16, kDirection = 24, kLabel = 26, kReason = 27, kRoll = 28,
                        kKnown = 29, kSeen = 30;
  EXPECT_NO_THROW(load());
  const std::vector<std::string> all = {with(0, nan),
                                        with(kReach, nan),
                                        with(kReach, -1.0F),
                                        with(kStability, 1.5F),
                                        with(kStability, nan),
                                        with(kDirection, std::uint16_t{8}),
                                        with(kLabel, std::uint8_t{3}),
                                        with(kReason, std::uint8_t{99}),
                                        with(kRoll, std::uint8_t{1}),
                                        with(kKnown, std::uint8_t{2}),
                                        with(kSeen, std::uint64_t{256}),
                                        withHead([](internal::StateHead& head) { head.updated = false; }),
                                        withHead([](internal::StateHead& head) { head.scored_words = 2; }),
                                        withHead([](internal::StateHead& head) { head.scored_words = 0; }),
                                        withHead([](internal::StateHead& head) { head.scored_words = ~0U; })};
  for (std::size_t n = 0; n < all.size(); ++n)
    EXPECT_EQ(refusalOf(all[n]).rfind("state.damaged", 0), 0U) << n << ": " << refusalOf(all[n]);
  // Accessible from nowhere, or without a neighbourhood.
  const auto accessible = [&](std::uint8_t known, std::uint16_t direction) {
    return rehashed([&](const std::string& name, std::string& content) {
      if (name != "scored") return;
      content[kLabel] = static_cast<char>(PointLabel::Accessible);
      content[kKnown] = static_cast<char>(known);
      std::memcpy(content.data() + kDirection, &direction, sizeof direction);
    });
  };
  EXPECT_EQ(refusalOf(accessible(1, 3)), "");
  EXPECT_NE(refusalOf(accessible(0, 3)), "");
  EXPECT_NE(refusalOf(accessible(1, kNoDirection)), "");
}

TEST_F(DamagedState, IsRefusedWhereverAByteDiffers) {
  EXPECT_NO_THROW(load());
  EXPECT_EQ(rehashed([](const auto&, auto&) {}), good_);
  std::mt19937_64 random(7);
  for (int n = 0; n < 300; ++n) {
    const std::size_t at = n < 200 ? random() % good_.size() : random() % 600;  // more of them in the head
    std::string bad = good_;
    bad[at] = static_cast<char>(bad[at] ^ (1 << random() % 8));
    ASSERT_NE(refusalOf(bad), "") << "byte " << at << " of " << good_.size();
  }
}

TEST_F(DamagedState, IsRefusedIfTruncatedOrTooLong) {
  std::mt19937_64 random(8);
  for (int n = 0; n < 100; ++n) {
    const std::size_t kept = n < 80 ? random() % good_.size() : static_cast<std::size_t>(n - 80);
    ASSERT_NE(refusalOf(good_.substr(0, kept)), "") << kept;
  }
  EXPECT_NE(refusalOf(good_ + "x"), "");
  EXPECT_NE(refusalOf(good_ + good_), "");
  EXPECT_NE(refusalOf("PLY"), "");
}

TEST_F(DamagedState, NamesTheSection) {
  for (const std::string name : {"head", "leaves", "poses", "points", "leftout"}) {
    const Place place = placeOf(name);
    ASSERT_GT(place.bytes, 0u);
    std::string bad = good_;
    bad[place.begin + place.bytes + 5] ^= 1;  // of the hash
    EXPECT_EQ(refusalOf(bad).rfind("state.damaged", 0), 0u);
    EXPECT_NE(refusalOf(bad).find("\"" + name + "\""), std::string::npos) << refusalOf(bad);
  }
  EXPECT_EQ(refusalOf("not a state, but long enough").rfind("state.format", 0), 0u);
}

/// With right hashes, so that only the checks of the values are left.
TEST_F(DamagedState, IsRefusedForValuesThatNoFieldHas) {
  const auto at = [&](const std::string& section, std::size_t offset, const auto& value) {
    return rehashed([&](const std::string& name, std::string& content) {
      if (name == section) std::memcpy(content.data() + offset, &value, sizeof value);
    });
  };
  const std::string leaf_again = rehashed([](const std::string& name, std::string& content) {
    if (name != "leaves") return;  // the origin of the first leaf once more, where the second one begins
    std::memcpy(content.data() + leafAt(content, 1), content.data(), 12);
  });
  std::size_t first_values = 0;
  static_cast<void>(rehashed([&](const std::string& name, const std::string& content) {
    if (name != "leaves") return;
    for (std::size_t leaf = 0; first_values == 0; ++leaf) {
      const std::size_t leaf_at = leafAt(content, leaf);
      if (content[leaf_at + 12] == 1) first_values = leaf_at + internal::kLeafBytes;
    }
  }));
  const std::size_t point_bytes = 12 + 48 + 4 + 36;
  const std::string point_again = rehashed([&](const std::string& name, std::string& content) {
    if (name == "points") std::memcpy(content.data() + point_bytes, content.data(), 12);
  });
  const Place left_out = placeOf("leftout");
  const std::size_t cell = left_out.bytes - sizeof(internal::LeftOutPoints::Cube);
  const std::string left_out_again = rehashed([&](const std::string& name, std::string& content) {
    if (name == "leftout") std::memcpy(content.data() + internal::kLeftOutLeafBytes, content.data(), 12);
  });
  const std::string nothing_left_out = rehashed([&](const std::string& name, std::string& content) {
    if (name == "leftout") std::memset(content.data() + 12, 0, sizeof(LeafBits));
  });
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<std::string> all = {
      leaf_again,
      point_again,
      left_out_again,
      nothing_left_out,
      at("leftout", 0, std::int32_t{3}),
      at("leftout", 4, std::int32_t{1 << 30}),
      at("leftout", cell, std::numeric_limits<std::int64_t>::min()),
      at("leftout", cell + 16, std::int64_t{1} << 60),
      withHead([](internal::StateHead& head) { head.left_out_leaves = std::uint64_t{1} << 60; }),
      withHead([](internal::StateHead& head) { head.closed_cubes += 1; }),
      withHead([](internal::StateHead& head) { head.closed_doublings = 4000; }),
      at("leaves", 0, std::int32_t{3}),
      at("leaves", 0, std::int32_t{1 << 30}),
      at("leaves", 12, std::uint32_t{2}),
      at("leaves", first_values + 64, std::uint32_t{0}),  // another least weight
      at("leaves", first_values + 64, ~std::uint32_t{0}),
      at("leaves", first_values + 68, std::uint32_t{4}),  // bytes of a voxel
      at("leaves", first_values + 68, std::uint32_t{0}),
      at("leaves", first_values, ~std::uint64_t{0}),  // more voxels than there are
      withHead([](internal::StateHead& head) { head.voxel_bytes += 3; }),
      withHead([](internal::StateHead& head) { head.voxel_bytes = std::uint64_t{1} << 62; }),
      withHead([](internal::StateHead& head) { head.schema -= internal::kCompactSchema; }),
      at("poses", 0, nan),
      at("points", 0, nan),
      at("points", 4, 1e9f),
      at("points", 12, std::int64_t{1} << 62),
      at("points", 36, std::int64_t{1} << 62),
      at("points", 60, std::uint32_t{0}),
      at("points", 64, std::uint32_t{9}),
      at("points", 68, ~std::uint32_t{0}),
      withHead([](internal::StateHead& head) { head.points += 1; }),
      withHead([](internal::StateHead& head) { head.points = std::uint64_t{1} << 40; }),
      withHead([](internal::StateHead& head) { head.leaves = ~std::uint64_t{0}; }),
      withHead([](internal::StateHead& head) { head.leaves_with_values = std::uint64_t{1} << 60; }),
      withHead([](internal::StateHead& head) { head.poses = std::uint64_t{1} << 61; }),
      withHead([](internal::StateHead& head) { head.params.tsdf.voxel_size_m = -1; }),
      withHead([&](internal::StateHead& head) { head.params.tsdf.voxel_size_m = nan; }),
      withHead([](internal::StateHead& head) { head.params.update.policy = UpdatePolicy::Paper; }),
      withHead([](internal::StateHead& head) { head.params.tsdf.region = UpdateRegion::Projective; }),
      withHead([](internal::StateHead& head) { head.schema = internal::kRolledStateSchema; }),  // without any
      withHead([](internal::StateHead& head) {
        head.schema = internal::kRolledStateSchema;
        head.params.approach.rolls = 65;
      }),
      withHead([&](internal::StateHead& head) { (*head.origin_W)[1] = nan; })};
  for (std::size_t n = 0; n < all.size(); ++n) {
    EXPECT_EQ(refusalOf(all[n]).rfind("state.damaged", 0), 0u) << n << ": " << refusalOf(all[n]);
  }
}

/// An age at which doubles no longer tell a tenth of a second from none: space would stay free for ever.
/// As versions wrote it that had every voxel of a leaf.
TEST_F(DamagedScoredState, IsNotOneThatHasEveryVoxel) {
  const std::string older = rehashed([&](const std::string& name, std::string& content) {
    if (name == "head") {
      internal::StateHead head = *internal::headFrom({content.begin(), content.end()});
      EXPECT_EQ(head.schema, 186U);
      head.schema = 26;
      const std::vector<char> bytes = internal::bytesOf(head);
      EXPECT_EQ(bytes.size() + 24, content.size());
      content.assign(bytes.begin(), bytes.end());
    } else if (name == "leaves") {
      std::string all;
      for (std::size_t at = 0; at < content.size(); at = leafAt(content.substr(at), 1) + at) {
        all += content.substr(at, internal::kLeafBytes);
        std::uint32_t has = 0;
        std::memcpy(&has, content.data() + at + 12, 4);
        if ((has & internal::kHasValues) == 0) continue;
        const auto [values, bytes] = valuesAt(content, at + internal::kLeafBytes);
        all.append(reinterpret_cast<const char*>(values.data()), internal::kPlainValuesBytes);
        if ((has & internal::kHasVotes) != 0)
          all += content.substr(at + internal::kLeafBytes + bytes, internal::kLeafVoteBytes);
      }
      content = all;
    }
  });
  EXPECT_GT(older.size(), good_.size());
  writeBytes(file(), older);
  AccessibilityField field = AccessibilityField::loadState(file(), pen(), BackendKind::Cpu, 1);
  field.saveState(file());
  EXPECT_EQ(bytesOf(file()), good_);
}

TEST_F(DamagedState, IsRefusedIfItIsOlderThanScansCanMakeIt) {
  const auto read = [&](double age_s, double free_for_s) {
    const Place place = placeOf("head");
    const std::string bytes = good_.substr(place.begin, place.bytes);
    internal::StateHead head = *internal::headFrom({bytes.begin(), bytes.end()});
    head.params.change.mode = ChangeMode::Full;
    head.params.change.free_for_s = free_for_s;
    head.params = head.params.resolved();
    head.schema = internal::kStateSchema + internal::kFullChangeSchema;
    head.age_s = age_s;
    return internal::headFrom(internal::bytesOf(head)).has_value();
  };
  EXPECT_TRUE(read(3600, 60));
  EXPECT_TRUE(read(1e9, 60));
  EXPECT_FALSE(read(1e12, 60));
  EXPECT_TRUE(read(1e6, 0.001));
  EXPECT_FALSE(read(1e7, 0.001));
  EXPECT_FALSE(read(std::numeric_limits<double>::quiet_NaN(), 60));
  EXPECT_FALSE(read(1, std::numeric_limits<double>::infinity()));
}

TEST_F(DamagedState, IsRefusedForOtherRulesAndAnotherTool) {
  const std::string rules = withHead([](internal::StateHead& head) { head.rules_version += 1; });
  EXPECT_EQ(refusalOf(rules).rfind("state.rules", 0), 0u) << refusalOf(rules);
  const std::string layout = withHead([](internal::StateHead& head) { head.schema += 1000; });
  EXPECT_EQ(refusalOf(layout).rfind("state.rules", 0), 0u) << refusalOf(layout);
  writeBytes(file(), good_);
  try {
    (void)AccessibilityField::loadState(file(), armTool(), BackendKind::Cpu);
    ADD_FAILURE() << "another tool was accepted";
  } catch (const UnusableInput& error) {
    EXPECT_EQ(error.id(), "state.tool");
  }
  EXPECT_THROW((void)AccessibilityField::loadState(folder_ / "none", pen()), InputError);
}

}  // namespace
}  // namespace accessvdb::test
