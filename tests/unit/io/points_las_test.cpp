// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// points.las: by a reader of its own, written from the tables of the LAS specification (1.4 R15), and by a program of
/// others; its values are those of points.ply.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/surface_points.h"
#include "unit/io/parsed_ply.h"
#include "unit/io/sample_field.h"

namespace accessvdb {
namespace {

using test::contentOf;
using test::ParsedPly;
using test::sampleField;
using test::ScratchFolder;

constexpr double kScale_m = 0.0001;

/// A column of extra bytes, as its record describes it.
struct ExtraColumn {
  std::string name, description;
  int type = 0, options = 0;
  std::size_t offset = 0;  ///< in the point's record
};

/// A reader of LAS 1.4 with uncompressed points. Offsets are those of the specification.
class LasFile {
 public:
  explicit LasFile(std::string bytes) : bytes_(std::move(bytes)) {
    std::size_t record = at<std::uint16_t>(94);
    for (std::uint32_t n = 0; n < at<std::uint32_t>(100); ++n) {
      const std::size_t length = at<std::uint16_t>(record + 20);
      if (text(record + 2, 16) == "LASF_Spec" && at<std::uint16_t>(record + 18) == 4) {
        readColumns(record + 54, length);
      }
      record += 54 + length;
    }
    EXPECT_EQ(record, at<std::uint32_t>(96)) << "a gap before the points";
    EXPECT_EQ(bytes_.size(), pointAt(points()));
  }

  template <typename T>
  [[nodiscard]] T at(std::size_t offset) const {
    T value = {};
    if (offset + sizeof value > bytes_.size()) {
      ADD_FAILURE() << "nothing at " << offset;
      return value;
    }
    std::memcpy(&value, bytes_.data() + offset, sizeof value);
    return value;
  }
  [[nodiscard]] std::string text(std::size_t offset, std::size_t size) const {
    const std::string padded = bytes_.substr(offset, size);
    return padded.substr(0, padded.find('\0'));
  }
  [[nodiscard]] std::uint64_t points() const { return at<std::uint64_t>(247); }
  [[nodiscard]] std::size_t pointAt(std::uint64_t n) const {
    return at<std::uint32_t>(96) + static_cast<std::size_t>(n) * at<std::uint16_t>(105);
  }
  [[nodiscard]] const std::vector<ExtraColumn>& columns() const { return columns_; }
  [[nodiscard]] std::size_t recordBytes() const { return record_bytes_; }

  /// World coordinate of a point. @param axis  0 to 2
  [[nodiscard]] double coordinate(std::uint64_t n, std::size_t axis) const {
    return at<std::int32_t>(pointAt(n) + 4 * axis) * at<double>(131 + 8 * axis) + at<double>(155 + 8 * axis);
  }
  [[nodiscard]] double max(std::size_t axis) const { return at<double>(179 + 16 * axis); }
  [[nodiscard]] double min(std::size_t axis) const { return at<double>(187 + 16 * axis); }
  [[nodiscard]] double extra(std::uint64_t n, const std::string& name) const {
    for (const ExtraColumn& column : columns_) {
      if (column.name != name) continue;
      const std::size_t offset = pointAt(n) + column.offset;
      if (column.type == 1) return at<std::uint8_t>(offset);
      if (column.type == 3) return at<std::uint16_t>(offset);
      if (column.type == 9) return at<float>(offset);
    }
    ADD_FAILURE() << "no column " << name;
    return 0;
  }

 private:
  void readColumns(std::size_t offset, std::size_t length) {
    for (std::size_t entry = offset; entry < offset + length; entry += 192) {
      const int type = at<std::uint8_t>(entry + 2);
      columns_.push_back(
          {text(entry + 4, 32), text(entry + 160, 32), type, at<std::uint8_t>(entry + 3), record_bytes_});
      const std::size_t bytes[] = {0, 1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
      record_bytes_ += bytes[static_cast<std::size_t>(type)];
    }
  }

  std::string bytes_;
  std::vector<ExtraColumn> columns_;
  std::size_t record_bytes_ = 36;  ///< of point format 7, and then the extra bytes
};

LasFile written(const ScratchFolder& folder, const FieldSnapshot& field) {
  io::writePointsLas(folder / "points.las", SnapshotPoints(field));
  return LasFile(contentOf(folder / "points.las"));
}

/// The points of sampleField(), again and again, moved by whole metres and with other scores.
FieldSnapshot manyPoints(std::size_t count) {
  const FieldSnapshot some = sampleField();
  FieldSnapshot field = some;
  field.points.clear();
  for (std::size_t n = 0; n < count; ++n) {
    SurfacePoint& point = field.points.emplace_back(some.points[n % some.points.size()]);
    point.id = static_cast<std::uint32_t>(n);
    point.position_W.x() += static_cast<double>(n / some.points.size());
    point.score = static_cast<std::uint16_t>(n * 40503 % 65536);
  }
  return field;
}

/// Half a step of the scale; and the last bits of UTM northings, 5.6e6 m, after a product and two sums.
constexpr double kHalfStep_m = kScale_m / 2 + 3e-9;

TEST(PointsLas, HeaderSaysWhatTheSpecificationAsksFor) {
  const ScratchFolder folder;
  const FieldSnapshot field = sampleField();
  const LasFile las = written(folder, field);
  EXPECT_EQ(las.text(0, 4), "LASF");
  EXPECT_EQ(las.at<std::uint16_t>(6), 16) << "WKT, which formats from 6 on require";
  EXPECT_EQ(las.at<std::uint8_t>(24), 1);
  EXPECT_EQ(las.at<std::uint8_t>(25), 4);
  EXPECT_EQ(las.text(26, 32), "AccessVDB");
  EXPECT_EQ(las.text(58, 32).rfind("AccessVDB ", 0), 0u);
  EXPECT_EQ(las.at<std::uint16_t>(94), 375) << "bytes of the header";
  EXPECT_EQ(las.at<std::uint8_t>(104), 7) << "point format";
  EXPECT_EQ(las.at<std::uint16_t>(105), las.recordBytes());
  EXPECT_EQ(las.at<std::uint32_t>(107), 0u) << "the old number of points, which must be 0 for formats from 6 on";
  EXPECT_EQ(las.points(), field.points.size());
  EXPECT_EQ(las.at<std::uint64_t>(255), field.points.size()) << "first returns";
  for (std::size_t other = 1; other < 15; ++other) EXPECT_EQ(las.at<std::uint64_t>(255 + 8 * other), 0u) << other;
  EXPECT_EQ(las.at<std::uint64_t>(227), 0u) << "waveforms";
  EXPECT_EQ(las.at<std::uint32_t>(243), 0u) << "extended records";
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_EQ(las.at<double>(131 + 8 * axis), kScale_m);
    EXPECT_EQ(las.at<double>(155 + 8 * axis), test::kOrigin_W[static_cast<int>(axis)]);
  }
}

TEST(PointsLas, ExtraBytesAreNamedAndTyped) {
  const ScratchFolder folder;
  const LasFile las = written(folder, sampleField());
  const std::vector<std::pair<std::string, int>> expected = {
      {"label", 1}, {"reason", 1}, {"score", 3}, {"confidence", 9}, {"yaw", 9}};
  ASSERT_EQ(las.columns().size(), expected.size());
  for (std::size_t n = 0; n < expected.size(); ++n) {
    EXPECT_EQ(las.columns()[n].name, expected[n].first);
    EXPECT_EQ(las.columns()[n].type, expected[n].second);
    EXPECT_EQ(las.columns()[n].options, 0) << "no bounds, scale or offset";
    EXPECT_FALSE(las.columns()[n].description.empty());
  }
}

TEST(PointsLas, ValuesAreThoseOfPointsPly) {
  const ScratchFolder folder;
  for (const std::size_t count : {1u, 600u, 70000u}) {  // more than is written at once
    const FieldSnapshot field = manyPoints(count);
    const LasFile las = written(folder, field);
    io::writePointsPly(folder / "points.ply", field, {});
    const ParsedPly ply(contentOf(folder / "points.ply"));
    const auto column = [&](const std::string& name) {
      return static_cast<std::size_t>(std::find(ply.names.begin(), ply.names.end(), name) - ply.names.begin());
    };
    ASSERT_EQ(las.points(), count);
    ASSERT_EQ(ply.rows.size(), count);
    for (std::size_t n = 0; n < count && !HasFailure(); ++n) {
      SCOPED_TRACE(n);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double x = las.coordinate(n, axis);
        EXPECT_NEAR(x, ply.rows[n][axis], kHalfStep_m);
        EXPECT_GE(x, las.min(axis));
        EXPECT_LE(x, las.max(axis));
      }
      for (const char* name : {"label", "reason", "score", "confidence", "yaw"}) {
        EXPECT_EQ(las.extra(n, name), ply.rows[n][column(name)]) << name;
      }
      const std::size_t point = las.pointAt(n);
      EXPECT_EQ(las.at<std::uint8_t>(point + 14), 0x11) << "the first of one return";
      for (std::size_t colour = 0; colour < 3; ++colour) {  // 16 bits, white is 65535
        EXPECT_EQ(las.at<std::uint16_t>(point + 30 + 2 * colour), 257 * ply.rows[n][column("red") + colour]);
      }
    }
    // The bounds are those of the stored points, not of what they were rounded from.
    for (std::size_t axis = 0; axis < 3; ++axis) {
      double low = std::numeric_limits<double>::infinity(), high = -low;
      for (std::size_t n = 0; n < count; ++n) {
        low = std::min(low, las.coordinate(n, axis));
        high = std::max(high, las.coordinate(n, axis));
      }
      EXPECT_EQ(las.min(axis), low);
      EXPECT_EQ(las.max(axis), high);
    }
  }
}

TEST(PointsLas, NoPoints) {
  const ScratchFolder folder;
  FieldSnapshot field = sampleField();
  field.points.clear();
  const LasFile las = written(folder, field);
  EXPECT_EQ(las.points(), 0u);
  EXPECT_EQ(las.columns().size(), 5u);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_EQ(las.min(axis), 0);
    EXPECT_EQ(las.max(axis), 0);
  }
}

TEST(PointsLas, WhatIsTooFarFromTheOriginIsRefused) {
  const ScratchFolder folder;
  constexpr double kFarthest_m = 214748.3646;  // one step less than 32 bits hold
  FieldSnapshot field = sampleField();
  field.points.resize(2);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      SCOPED_TRACE(sign * (axis + 1));
      FieldSnapshot far = field;
      far.points[1].position_W[axis] = far.origin_W[axis] + sign * kFarthest_m;
      EXPECT_NEAR(written(folder, far).coordinate(1, static_cast<std::size_t>(axis)), far.points[1].position_W[axis],
                  kHalfStep_m);
      const std::string before = contentOf(folder / "points.las");
      for (const double x : {sign * (kFarthest_m + 2 * kScale_m), sign * 1e9, sign * 1e300}) {
        far.points[1].position_W[axis] = far.origin_W[axis] + x;
        try {
          io::writePointsLas(folder / "points.las", SnapshotPoints(far));
          FAIL() << x;
        } catch (const OutputError& error) {
          EXPECT_EQ(error.id(), "output.las_range");
        }
        EXPECT_EQ(contentOf(folder / "points.las"), before) << "half-written";
      }
    }
  }
  EXPECT_EQ(folder.names().size(), 1u);
}

/// What a program prints; nothing if it fails.
std::string outputOf(const std::string& command) {
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::string text;
  char block[65536];
  for (std::size_t size = 1; pipe && size > 0;) {
    size = std::fread(block, 1, sizeof block, pipe.get());
    text.append(block, size);
  }
  return text;
}

/// The npm package copc under node: $ACCESSVDB_COPC, or where tools/setup_debian.sh --tests puts it.
TEST(PointsLas, ReaderOfOthersGivesTheSameValues) {
  const char* const given = std::getenv("ACCESSVDB_COPC");
  const std::string copc = given != nullptr ? given : ACCESSVDB_SOURCE_DIR "/build/npm/node_modules/copc";
  if (!std::filesystem::exists(copc) || std::system("node --version > /dev/null 2>&1") != 0) {
    GTEST_SKIP() << "node or the npm package copc is missing: tools/setup_debian.sh --tests";
  }
  const ScratchFolder folder;
  for (const std::size_t count : {0u, 3000u}) {
    const FieldSnapshot field = manyPoints(count);
    const LasFile las = written(folder, field);
    std::istringstream read(outputOf("node " ACCESSVDB_SOURCE_DIR "/tests/unit/io/las_to_text.mjs '" + copc + "' '" +
                                     (folder / "points.las").string() + "'"));
    const auto expect = [&](const std::string& key, const std::vector<double>& expected) {
      std::string word;
      read >> word;
      EXPECT_EQ(word, key);
      for (const double value : expected) {
        double found = std::numeric_limits<double>::quiet_NaN();
        read >> found;
        EXPECT_EQ(found, value) << key;
      }
    };
    expect("count", {static_cast<double>(count)});
    expect("scale", {kScale_m, kScale_m, kScale_m});
    expect("min", {las.min(0), las.min(1), las.min(2)});
    expect("max", {las.max(0), las.max(1), las.max(2)});
    for (std::size_t n = 0; n < count && !HasFailure(); ++n) {
      const SurfacePoint& point = field.points[n];
      double x[3], label = 0, reason = 0, score = 0, confidence = 0, yaw_deg = 0, red = 0, green = 0, blue = 0;
      read >> x[0] >> x[1] >> x[2] >> label >> reason >> score >> confidence >> yaw_deg >> red >> green >> blue;
      for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(x[axis], point.position_W[axis], kHalfStep_m);
      EXPECT_EQ(label, static_cast<double>(point.label));
      EXPECT_EQ(reason, static_cast<double>(point.reason));
      EXPECT_EQ(score, point.score);
      EXPECT_EQ(confidence, static_cast<double>(point.confidence));
      EXPECT_NEAR(yaw_deg, point.yaw_rad * 180 / M_PI, 3e-5);  // float32 of up to 360, and of up to 2 pi
      EXPECT_EQ(point.label == PointLabel::Accessible, green > red && green > blue);
    }
    EXPECT_TRUE(read) << "fewer points than " << count;
  }
}

}  // namespace
}  // namespace accessvdb
