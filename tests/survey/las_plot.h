// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A wall as a LAS file in a coordinate system, and its LAS results byte by byte.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <string>

#include "large/tiled_test.h"
#include "support/bytes.h"
#include "survey/survey_world.h"

namespace accessvdb::survey_test {

inline const std::string kDatum =
    "GEOGCS[\"NAD83\",DATUM[\"North_American_Datum_1983\",SPHEROID[\"GRS 1980\",6378137,298.257222101]],"
    "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],"
    "PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_meridian\",-111],PARAMETER[\"scale_factor\",0.9996],"
    "PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",0],";
inline const std::string kMetres = "PROJCS[\"NAD83 / UTM zone 12N\"," + kDatum + "UNIT[\"metre\",1]]";
inline const std::string kFeet =
    "PROJCS[\"NAD83 / UTM zone 12N (ftUS)\"," + kDatum + "UNIT[\"US survey foot\",0.304800609601219]]";

/// A wall of 2 m x 2 m, 3 m east of the scanner, with a slot that no tool gets into, in survey coordinates.
struct Cloud {
  double unit_m = 1;
  std::string wkt = kMetres;
  int keys_epsg = 0;  ///< instead of the WKT
  static constexpr int kSide = 70;
  static constexpr double kEast = 470627.5, kNorth = 3810222.25, kUp = 2278;

  [[nodiscard]] static double time(int n) { return 3.0e8 + n * 0.125 + 1e-6 * n; }
  [[nodiscard]] static int classOf(int n) { return n % 3 == 0 ? 5 : n % 3 == 1 ? 2 : 200; }
  [[nodiscard]] static double at(int n, int axis) {
    return axis == 0   ? kEast + 3 + 0.001 * (n % 7) + (n % kSide >= 30 && n % kSide < 33 ? 0.4 : 0)
           : axis == 1 ? kNorth + 0.03 * (n % kSide) - 1
                       : kUp + 0.03 * (n / kSide) - 1;
  }
  [[nodiscard]] std::string bytes() const {
    std::string records;
    const auto record = [&records](const std::string& user, int id, const std::string& body) {
      const std::size_t begin = records.size();
      records.append(2, '\0');
      records += user;
      records.resize(begin + 18, '\0');
      test::put(records, static_cast<std::uint16_t>(id));
      test::put(records, static_cast<std::uint16_t>(body.size()));
      records.resize(begin + 54, '\0');
      records += body;
    };
    if (!wkt.empty()) record("LASF_Projection", 2112, wkt + '\0');
    if (keys_epsg != 0) {
      std::string keys;
      for (const int n : {1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, keys_epsg})
        test::put(keys, static_cast<std::uint16_t>(n));
      record("LASF_Projection", 34735, keys);
    }
    std::string extra(2, '\0');
    extra += '\6';
    extra += '\0';
    extra += "tree_id";
    extra.resize(192, '\0');
    record("LASF_Spec", 4, extra);
    std::string file("LASF", 4);
    file.resize(6, '\0');
    test::put(file, static_cast<std::uint16_t>(wkt.empty() ? 1 : 1 | 16));  // adjusted GPS time; WKT
    file.resize(24, '\0');
    file += "\1\4";
    file.resize(90, '\0');
    test::put(file, std::uint16_t{213});
    test::put(file, std::uint16_t{2024});
    test::put(file, std::uint16_t{375});
    test::put(file, static_cast<std::uint32_t>(375 + records.size()));
    test::put(file, static_cast<std::uint32_t>((wkt.empty() ? 0 : 1) + (keys_epsg != 0 ? 1 : 0) + 1));
    file += '\6';
    test::put(file, std::uint16_t{34});
    file.resize(131, '\0');
    for (int axis = 0; axis < 3; ++axis) test::put(file, 0.0001);
    const double offset[] = {std::floor(kEast / unit_m), std::floor(kNorth / unit_m), 0};
    for (const double o : offset) test::put(file, o);
    for (int axis = 0; axis < 3; ++axis) {
      test::put(file, 2e7);
      test::put(file, -2e7);
    }
    file.resize(247, '\0');
    test::put(file, std::uint64_t{kSide * kSide});
    file.resize(375, '\0');
    file += records;
    for (int n = 0; n < kSide * kSide; ++n) {
      for (int axis = 0; axis < 3; ++axis) {
        test::put(file, static_cast<std::int32_t>(std::llround((at(n, axis) / unit_m - offset[axis]) / 0.0001)));
      }
      file.append(2, '\0');
      file += '\x11';
      file += '\0';
      file += static_cast<char>(classOf(n));
      file.append(5, '\0');
      test::put(file, time(n));
      test::put(file, std::int32_t{n % kSide < 30 ? 4 : 9});
    }
    return file;
  }
};

class LasPlotTest : public large_test::TiledTest {
 protected:
  using Flags = large_test::Flags;
  void use(const Cloud& cloud) {
    writeText("plot.las", cloud.bytes());
    char at[100];
    std::snprintf(at, sizeof at, "%.6f,%.6f,%.6f", Cloud::kEast / cloud.unit_m, Cloud::kNorth / cloud.unit_m,
                  Cloud::kUp / cloud.unit_m);
    scans_ = {"--scans", path("plot.las"), "--sensor-at", at, "--points-format", "las"};
  }
  [[nodiscard]] std::string las(const std::string& name = "out/points.las") const { return readText(name); }
  template <typename T>
  static T at(const std::string& bytes, std::size_t offset) {
    T value = {};
    EXPECT_LE(offset + sizeof value, bytes.size());
    if (offset + sizeof value <= bytes.size()) std::memcpy(&value, bytes.data() + offset, sizeof value);
    return value;
  }
  /// The body of a record in front of the points; empty if there is none.
  static std::string record(const std::string& file, const std::string& user, int id) {
    std::size_t begin = at<std::uint16_t>(file, 94);
    for (std::uint32_t n = 0; n < at<std::uint32_t>(file, 100); ++n) {
      const std::size_t bytes = at<std::uint16_t>(file, begin + 20);
      if (std::string(file.c_str() + begin + 2) == user && at<std::uint16_t>(file, begin + 18) == id) {
        return file.substr(begin + 54, bytes);
      }
      begin += 54 + bytes;
    }
    EXPECT_EQ(begin, at<std::uint32_t>(file, 96));
    return {};
  }
  static double coordinate(const std::string& file, std::size_t n, int axis) {
    const std::size_t point = at<std::uint32_t>(file, 96) + n * at<std::uint16_t>(file, 105);
    return at<std::int32_t>(file, point + 4 * static_cast<std::size_t>(axis)) *
               at<double>(file, 131 + 8 * static_cast<std::size_t>(axis)) +
           at<double>(file, 155 + 8 * static_cast<std::size_t>(axis));
  }
};

}  // namespace accessvdb::survey_test
