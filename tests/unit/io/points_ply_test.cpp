// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// points.ply: columns by an independent parser, the round trip, and damage.
#include <gtest/gtest.h>

#include <clocale>
#include <cmath>
#include <cstring>
#include <fstream>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "unit/io/parsed_ply.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using test::contentOf;
using test::ParsedPly;
using test::sampleField;
using test::ScratchFolder;

const io::FieldMetadata kMetadata = {{"tool.name", "builtin:pruner\nelement vertex 9"},
                                     {"approach.num_directions", "180"},
                                     {"scoring.confidence_half_weight", "5"},
                                     {"update.stability_min", "0.7"}};

/// Every combination of what a field may have besides, and back.
TEST(PointsPly, SeveralToolsAreTheLastColumns) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  for (std::size_t n = 0; n < field.points.size(); ++n) {
    field.points[n].tool = static_cast<std::uint8_t>(n % 32);
    if (field.points[n].label != PointLabel::Accessible) continue;
    field.points[n].tools = 0x80000001u * static_cast<std::uint32_t>(n + 1) | 1u << n % 32;
  }
  std::string names = "t0";
  for (int k = 1; k < 32; ++k) names += ",t" + std::to_string(k);
  for (const bool oriented : {false, true}) {
    io::FieldMetadata metadata = kMetadata;
    metadata.emplace_back("tools", names);
    if (oriented) metadata.emplace_back("orientations", "by_tool");
    if (oriented) metadata.emplace_back("rolls", "by_tool");
    io::writePointsPly(folder / "points.ply", field, metadata);
    const ParsedPly ply(contentOf(folder / "points.ply"));
    ASSERT_EQ(ply.names.size(), oriented ? 26u : 20u);
    EXPECT_EQ(ply.names[ply.names.size() - 2], "tool");
    EXPECT_EQ(ply.names.back(), "tools");
    const FieldSnapshot back = io::readPointsPly(folder / "points.ply");
    ASSERT_EQ(back.points.size(), field.points.size());
    for (std::size_t n = 0; n < back.points.size(); ++n) {
      EXPECT_EQ(ply.rows[n][ply.names.size() - 2], field.points[n].tool);
      EXPECT_EQ(ply.rows[n].back(), field.points[n].tools);
      EXPECT_EQ(back.points[n].tool, field.points[n].tool);
      EXPECT_EQ(back.points[n].tools, field.points[n].tools);
    }
  }
  field.points.front().tool = 32;  // no field has so many
  io::writePointsPly(folder / "points.ply", field, {{"tools", "a,b"}});
  EXPECT_THROW(static_cast<void>(io::readPointsPly(folder / "points.ply")), InputError);
}

TEST(PointsPly, ColumnsAreThoseOfTheInterface) {
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  io::writePointsPly(folder / "points.ply", field, kMetadata);
  const ParsedPly ply(contentOf(folder / "points.ply"));
  const std::vector<std::string> expected = {"x",          "y",         "z",    "nx",    "ny",     "nz",
                                             "red",        "green",     "blue", "label", "reason", "score",
                                             "confidence", "stability", "dx",   "dy",    "dz",     "yaw"};
  EXPECT_EQ(ply.names, expected);
  ASSERT_EQ(ply.rows.size(), field.points.size());
  for (std::size_t i = 0; i < ply.rows.size(); ++i) {
    const auto& row = ply.rows[i];
    const SurfacePoint& point = field.points[i];
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      EXPECT_EQ(row[a], point.position_W[axis]);
      EXPECT_EQ(row[3 + a], point.normal_W[axis]);
      EXPECT_EQ(row[14 + a], point.direction_W[axis]);
    }
    EXPECT_EQ(row[9], static_cast<double>(point.label));
    EXPECT_EQ(row[10], static_cast<double>(point.reason));
    EXPECT_EQ(row[11], point.score);
    EXPECT_EQ(row[12], point.confidence);
    EXPECT_EQ(row[13], point.stability);
    // 1e-4 degrees: a float of up to 360 has steps of 3e-5.
    EXPECT_NEAR(row[17], point.direction == kNoDirection ? 0.0 : 2.0 * point.direction, 1e-4);
    if (point.label == PointLabel::Accessible) {
      EXPECT_GT(row[7], 1.5 * row[6]);
    }
    if (point.label == PointLabel::Blocked) {
      EXPECT_GT(row[6], 1.5 * row[7]);
    }
  }
}

TEST(PointsPly, ReadsBackWhatWasWritten) {
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  io::writePointsPly(folder / "points.ply", field, kMetadata);
  const FieldSnapshot back = io::readPointsPly(folder / "points.ply");
  EXPECT_EQ(back.origin_W, field.origin_W);
  EXPECT_EQ(back.voxel_size_m, field.voxel_size_m);
  ASSERT_EQ(back.points.size(), field.points.size());
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    const SurfacePoint &a = field.points[i], &b = back.points[i];
    EXPECT_EQ(b.id, a.id);
    EXPECT_EQ(b.position_W, a.position_W);
    EXPECT_EQ(b.normal_W, a.normal_W);
    EXPECT_EQ(b.direction_W, a.direction_W);
    EXPECT_EQ(b.direction, a.direction);
    EXPECT_FLOAT_EQ(b.yaw_rad, a.yaw_rad);  // through degrees and back: the last bits
    EXPECT_EQ(b.score, a.score);
    EXPECT_EQ(b.weight, a.weight);
    EXPECT_EQ(b.confidence, a.confidence);
    EXPECT_EQ(b.stability, a.stability);
    EXPECT_EQ(b.label, a.label);
    EXPECT_EQ(b.reason, a.reason);
    EXPECT_EQ(b.confident, a.confident);
  }
  EXPECT_EQ(back.count(PointLabel::Blocked), 200u);
  EXPECT_EQ(back.accessible().size(), 200u);
  EXPECT_EQ(back.reasons(), field.reasons());
  EXPECT_EQ(back.reasons()[0], 200u);  // none: the accessible ones
}

/// One more column behind the others, in files that say whose constants it is from; those of before are read as ever.
TEST(PointsPly, SayHowLikelyTheToolReachesAPoint) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  io::FieldMetadata metadata = kMetadata;
  metadata.emplace_back("access_probability", "1");
  io::writePointsPly(folder / "points.ply", field, metadata);
  const ParsedPly ply(contentOf(folder / "points.ply"));
  EXPECT_EQ(ply.names.size(), 19U);
  EXPECT_EQ(ply.names.back(), "access_probability");
  const FieldSnapshot back = io::readPointsPly(folder / "points.ply");
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    ASSERT_EQ(ply.rows[i].back(), field.points[i].access_probability);
    ASSERT_EQ(back.points[i].access_probability, field.points[i].access_probability);
  }
  io::writePointsPly(folder / "before.ply", field, kMetadata);
  for (const SurfacePoint& point : io::readPointsPly(folder / "before.ply").points)
    ASSERT_EQ(point.access_probability, -1);

  const auto refuses = [&](std::size_t n, float probability) {
    FieldSnapshot wrong = field;
    wrong.points[n].access_probability = probability;
    io::writePointsPly(folder / "wrong.ply", wrong, metadata);
    EXPECT_THROW(static_cast<void>(io::readPointsPly(folder / "wrong.ply")), InputError) << n << " " << probability;
  };
  refuses(0, 0.5F);  // unscored
  for (const float probability : {1.5F, -0.5F, std::nanf("")}) refuses(1, probability);
}

/// A field of other orientations than yaw: five more columns behind the others, whose bytes are the same.
TEST(PointsPly, SaysHowTheToolIsHeldWhereItTilts) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    SurfacePoint& point = field.points[i];
    if (point.direction == kNoDirection) continue;
    const auto angle = static_cast<float>(i);
    point.orientation_WT =
        Eigen::Quaternionf(1 + std::sin(angle), std::sin(2 * angle), std::cos(3 * angle), std::sin(5 * angle))
            .normalized();
    point.direction = static_cast<std::uint16_t>(i % 254);
  }
  io::FieldMetadata metadata = kMetadata;
  metadata.emplace_back("orientations", "sphere:12.5");
  io::writePointsPly(folder / "points.ply", field, metadata);
  io::writePointsPly(folder / "yaw.ply", field, kMetadata);
  const ParsedPly ply(contentOf(folder / "points.ply")), yaw(contentOf(folder / "yaw.ply"));
  const std::vector<std::string> more(ply.names.begin() + 18, ply.names.end());
  EXPECT_EQ(more, (std::vector<std::string>{"qw", "qx", "qy", "qz", "orientation"}));
  ASSERT_EQ(yaw.names.size(), 18u);
  const FieldSnapshot back = io::readPointsPly(folder / "points.ply");
  ASSERT_EQ(back.points.size(), field.points.size());
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    const Eigen::Quaternionf& q = field.points[i].orientation_WT;
    EXPECT_EQ(std::vector<double>(ply.rows[i].begin(), ply.rows[i].begin() + 18), yaw.rows[i]);
    EXPECT_EQ(std::vector<double>(ply.rows[i].begin() + 18, ply.rows[i].end()),
              (std::vector<double>{q.w(), q.x(), q.y(), q.z(), static_cast<double>(field.points[i].direction)}));
    EXPECT_EQ(back.points[i].orientation_WT.coeffs(), q.coeffs());
    EXPECT_EQ(back.points[i].direction, field.points[i].direction);
  }
  // A file of yaw says it by the yaw.
  const SurfacePoint level = io::readPointsPly(folder / "yaw.ply").accessible().at(0);
  EXPECT_LT((level.orientation_WT * Eigen::Vector3f::UnitX() - level.direction_W).norm(), 1e-6f);
  const std::string whole = contentOf(folder / "points.ply");
  for (const std::size_t cut : {std::size_t{1}, std::size_t{17}, std::size_t{85}}) {
    std::ofstream(folder / "cut.ply", std::ios::binary) << whole.substr(0, whole.size() - cut);
    EXPECT_THROW(static_cast<void>(io::readPointsPly(folder / "cut.ply")), InputError) << cut;
  }
  std::string foreign = whole;
  foreign.replace(foreign.find("property float qy\n"), 18, "property float qq\n");
  std::ofstream(folder / "foreign.ply", std::ios::binary) << foreign;
  EXPECT_THROW(static_cast<void>(io::readPointsPly(folder / "foreign.ply")), InputError);
}

/// A field whose tool also rolls: one more column, and otherwise the same records.
TEST(PointsPly, NamesTheRollWhereTheToolRolls) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  for (std::size_t i = 0; i < field.points.size(); ++i) field.points[i].roll = static_cast<std::uint8_t>(i % 64);
  io::FieldMetadata metadata = kMetadata;
  metadata.emplace_back("orientations", "sphere:12.5");
  io::writePointsPly(folder / "one.ply", field, metadata);
  metadata.emplace_back("rolls", "64");
  io::writePointsPly(folder / "points.ply", field, metadata);
  const ParsedPly ply(contentOf(folder / "points.ply")), one(contentOf(folder / "one.ply"));
  ASSERT_EQ(ply.names.size(), 24u);
  EXPECT_EQ(ply.names.back(), "roll");
  EXPECT_EQ(one.names.size(), 23u);
  const FieldSnapshot back = io::readPointsPly(folder / "points.ply"), without = io::readPointsPly(folder / "one.ply");
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    EXPECT_EQ(std::vector<double>(ply.rows[i].begin(), ply.rows[i].begin() + 23), one.rows[i]);
    EXPECT_EQ(back.points[i].roll, i % 64);
    EXPECT_EQ(back.points[i].direction, without.points[i].direction);
    EXPECT_EQ(without.points[i].roll, 0);
  }
  const std::string whole = contentOf(folder / "points.ply");
  std::ofstream(folder / "cut.ply", std::ios::binary) << whole.substr(0, whole.size() - 1);
  EXPECT_THROW(static_cast<void>(io::readPointsPly(folder / "cut.ply")), InputError);
}

TEST(PointsPly, SameBytesInEveryLocale) {
  const ScratchFolder folder;
  io::writePointsPly(folder / "c.ply", sampleField(), kMetadata);
  if (!std::setlocale(LC_ALL, "de_DE.UTF-8")) GTEST_SKIP() << "locale de_DE.UTF-8 is not installed";
  io::writePointsPly(folder / "de.ply", sampleField(), kMetadata);
  const FieldSnapshot back = io::readPointsPly(folder / "c.ply");
  std::setlocale(LC_ALL, "C");
  EXPECT_EQ(contentOf(folder / "c.ply"), contentOf(folder / "de.ply"));
  EXPECT_EQ(back.voxel_size_m, test::kVoxel_m);
}

TEST(PointsPly, EmptyFieldAndMoreThanOneBlock) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  const std::vector<SurfacePoint> some = field.points;
  field.points.clear();
  io::writePointsPly(folder / "empty.ply", field, {});
  EXPECT_TRUE(io::readPointsPly(folder / "empty.ply").points.empty());
  while (field.points.size() < 40000) field.points.insert(field.points.end(), some.begin(), some.end());
  io::writePointsPly(folder / "many.ply", field, {});
  const FieldSnapshot back = io::readPointsPly(folder / "many.ply");
  ASSERT_EQ(back.points.size(), field.points.size());
  EXPECT_EQ(back.points.back().position_W, field.points.back().position_W);
}

TEST(PointsPly, EveryTruncationIsAnInputError) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  field.points.resize(5);
  io::writePointsPly(folder / "a.ply", field, kMetadata);
  const std::string whole = contentOf(folder / "a.ply");
  for (std::size_t size = 0; size < whole.size(); ++size) {
    std::ofstream(folder / "cut.ply", std::ios::binary) << whole.substr(0, size);
    EXPECT_THROW(static_cast<void>(io::readPointsPly(folder / "cut.ply")), InputError) << size;
  }
}

TEST(PointsPly, DamageIsAnInputError) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  field.points.resize(5);
  io::writePointsPly(folder / "a.ply", field, {});
  const std::string whole = contentOf(folder / "a.ply");
  const std::size_t body = whole.find("end_header\n") + 11;
  const auto refused = [&](std::string bytes) {
    std::ofstream(folder / "bad.ply", std::ios::binary | std::ios::trunc) << bytes;
    EXPECT_THROW(static_cast<void>(io::readPointsPly(folder / "bad.ply")), InputError);
  };
  const auto replaced = [&](const std::string& from, const std::string& to) {
    std::string bytes = whole;
    const std::size_t at = bytes.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return bytes.replace(at, from.size(), to);
  };
  refused(replaced("vertex 5", "vertex 4294967295"));
  refused(replaced("vertex 5", "vertex 18446744073709551615"));
  refused(replaced("vertex 5", "vertex -5"));
  refused(replaced("property float nx", "property float nn"));
  refused(replaced("comment voxel_size_m 0.02", "comment voxel_size_m nan"));
  refused(replaced("comment voxel_size_m 0.02", "comment voxel_size_m -1"));
  refused(replaced("comment origin_W", "comment origin_X"));
  std::string bytes = whole;
  bytes[body + 3 * 8 + 3 * 4 + 3] = 3;  // label
  refused(bytes);
  bytes = whole;
  bytes[body + 3 * 8 + 3 * 4 + 4] = kNumPointReasons;  // reason
  refused(bytes);
  bytes = whole;
  const double nan = std::nan("");
  std::memcpy(bytes.data() + body + 8, &nan, 8);  // y
  refused(bytes);
  refused("");
  EXPECT_THROW(static_cast<void>(io::readPointsPly(folder / "missing.ply")), InputError);
  EXPECT_THROW(static_cast<void>(io::readPointsPly(folder.path())), InputError);
}

}  // namespace
}  // namespace accessvdb
