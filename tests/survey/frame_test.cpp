// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// points.las comes back in the frame that went in: its coordinate system, date, times and classes, read by a program
/// of others (npm: copc) and by a reader here; and rows that say where they are from.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <sstream>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/scan_io.h"
#include "survey/las_plot.h"

namespace accessvdb::survey_test {
namespace {

class Frame : public LasPlotTest {};

TEST_F(Frame, SystemDateTimesClassesAndTreesComeBack) {
  use({});
  succeed(map({"--tiles", "off", "--carry", "tree_id", "--index"}));
  const Ply points(readText("out/points.ply"));
  const char* folder = std::getenv("ACCESSVDB_COPC");
  const std::string copc = folder != nullptr ? folder : ACCESSVDB_SOURCE_DIR "/build/npm/node_modules/copc";
  if (!std::filesystem::exists(copc) || std::system("node --version > /dev/null 2>&1") != 0) {
    GTEST_SKIP() << "node or the npm package copc is missing: tools/setup_debian.sh --tests";
  }
  const std::string command = "node " ACCESSVDB_SOURCE_DIR "/tests/survey/las_to_text.mjs '" + copc + "' '" +
                              path("out/points.las") + "' X Y Z GpsTime Classification tree_id scan index label > '" +
                              path("las.txt") + "'";
  ASSERT_EQ(std::system(command.c_str()), 0);
  std::istringstream lines(readText("las.txt"));
  std::string line;
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_EQ(line, "count " + std::to_string(points.rows));
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_EQ(line, "date 2024 213");
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_EQ(line, "encoding 17");  // adjusted GPS time, WKT
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_EQ(line, "wkt " + kMetres);
  for (std::size_t n = 0; n < points.rows; ++n) {
    double x = 0, y = 0, z = 0, time = 0, point_class = 0, tree = 0, scan = 0, index = 0, label = 0;
    ASSERT_TRUE(lines >> x >> y >> z >> time >> point_class >> tree >> scan >> index >> label);
    // The row that it names is the return whose position it has, in steps of 0.1 mm; so are time and class.
    const int row = static_cast<int>(index);
    const double p[] = {x, y, z};
    for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(p[axis], Cloud::at(row, axis), 1.01e-4) << n;
    EXPECT_EQ(time, Cloud::time(row));
    EXPECT_EQ(point_class, Cloud::classOf(row));
    EXPECT_EQ(scan, 0);
    EXPECT_EQ(tree, points.column.at("tree_id")[n]);
    EXPECT_EQ(index, points.column.at("index")[n]);
    EXPECT_EQ(label, points.column.at("label")[n]);
    if (HasFailure()) return;
  }
}

/// Numbers are in the unit that the system says.
TEST_F(Frame, FeetGoBackToFeet) {
  Cloud cloud;
  cloud.unit_m = 1200.0 / 3937;
  cloud.wkt = kFeet;
  use(cloud);
  succeed(map({"--tiles", "off"}));
  const Ply points(readText("out/points.ply"));  // metres
  const std::string file = las();
  EXPECT_EQ(record(file, "LASF_Projection", 2112), kFeet + '\0');
  const char* const axes[] = {"x", "y", "z"};
  for (std::size_t n = 0; n < points.rows; ++n) {
    for (int axis = 0; axis < 3; ++axis) {
      // Steps of 0.0003 feet: half of one is 0.046 mm.
      EXPECT_NEAR(coordinate(file, n, axis) * cloud.unit_m, points.column.at(axes[axis])[n], 5e-5);
    }
    if (HasFailure()) return;
  }
  EXPECT_NEAR(at<double>(file, 179) * cloud.unit_m, Cloud::kEast + 3.403, 3.1e-3);
}

TEST_F(Frame, GeoKeysComeBackAsTheyWere) {
  Cloud cloud;
  cloud.wkt.clear();
  cloud.keys_epsg = 26912;
  use(cloud);
  succeed(map({"--tiles", "off"}));
  EXPECT_EQ(record(las(), "LASF_Projection", 34735), record(readText("plot.las"), "LASF_Projection", 34735));
  EXPECT_EQ(at<std::uint16_t>(las(), 6), 1);  // GeoKeys count
}

TEST_F(Frame, TilesAndAStopGiveTheSameFile) {
  use({});
  succeed(map({"--tiles", "off", "--checkpoint", path("state")}, "straight"));
  succeed(map({"--tiles", "off", "--resume", path("state")}, "again"));
  expectSameFiles("again/points.las", "straight/points.las");
  succeed(map({"--tiles", "6.4"}));
  succeed(step("merge", {"--points", path("all.las")}));
  expectSameFiles("all.las", "straight/points.las");
  // A checkpoint of a run without points.las goes on, too; what it did not keep is not there.
  scans_.resize(scans_.size() - 2);
  succeed(map({"--tiles", "off", "--checkpoint", path("plain")}, "plain_out"));
  succeed(map({"--tiles", "off", "--resume", path("plain"), "--points-format", "las"}, "later"));
  EXPECT_EQ(readText("later/points.ply"), readText("plain_out/points.ply"));
}

/// PROJ itself says what the text in the file means.
TEST_F(Frame, ACodeIsWhatProjKnows) {
  if (std::system("projinfo EPSG:26912 > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "projinfo is missing: apt install proj-bin";
  Cloud cloud;
  cloud.wkt.clear();
  use(cloud);
  succeed(map({"--tiles", "off", "--crs", "EPSG:26912"}));
  const std::string wkt = record(las(), "LASF_Projection", 2112);
  ASSERT_GT(wkt.size(), 100u);
  writeText("found.wkt", wkt.substr(0, wkt.size() - 1));
  const auto meaning = [&](const std::string& system) {
    const std::string to = path("meaning.txt");
    EXPECT_EQ(std::system(("projinfo -q -o PROJ '" + system + "' > '" + to + "'").c_str()), 0) << system;
    return readText("meaning.txt");
  };
  EXPECT_EQ(meaning("@" + path("found.wkt")), meaning("EPSG:26912"));
  EXPECT_NE(meaning("EPSG:26912"), meaning("EPSG:32612"));  // so that it can tell them apart
}

TEST_F(Frame, WhatContradictsIsRefused) {
  use({});
  Cloud other;
  other.wkt = std::string(kMetres).replace(kMetres.find("1983\""), 4, "1927");
  writeText("plots/a.las", Cloud().bytes());
  writeText("plots/b.las", other.bytes());
  writeText("stations.txt", "a.las 470627.5 3810222.25 2278\nb.las 470627.5 3810222.25 2278\n");
  scans_ = {"--scans", path("plots"), "--stations", path("stations.txt"), "--points-format", "las"};
  EXPECT_NE(refuse(map({"--tiles", "off"}), 4, "scans.frame").find("b.las"), std::string::npos);
  // Unless it is said which one both are in.
  writeText("frame.wkt", kMetres + "\n");
  succeed(map({"--tiles", "off", "--crs", path("frame.wkt")}));
  EXPECT_EQ(record(las(), "LASF_Projection", 2112), kMetres + '\0');
  writeText("degrees.wkt",
            "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
            "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]");
  refuse(map({"--tiles", "off", "--crs", path("degrees.wkt")}), 3, "input.geographic");
  writeText("words.wkt", "UTM zone 12\n");
  refuse(map({"--tiles", "off", "--crs", path("words.wkt")}), 3, "las.crs");
  refuse(map({"--tiles", "off", "--crs", "EPSG:0"}), 3, "las.crs");
  scans_ = {"--scans", path("plot.las"), "--sensor-at", "0,0,0", "--crs", path("frame.wkt")};
  refuse(map({"--tiles", "off"}), 2, "usage.crs");
}

/// Scans that come later: in the same frame, in none, or in another one, which would be some metres off.
TEST_F(Frame, LaterScansAreInTheSameOne) {
  use({});
  Cloud other;
  other.wkt = std::string(kMetres).replace(kMetres.find("1983\""), 4, "1927");
  writeText("other.las", other.bytes());
  // A ray cloud knows of no frame, nor of classes and times.
  writeText("rays.ply",
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\n"
            "property double nx\nproperty double ny\nproperty double nz\nend_header\n"
            "470624.5 3810222.25 2278 3 0 0\n");
  const Flags from = {"--sensor-at", scans_[3]};
  succeed(plan({"--tiles", "6.4"}));
  refuse(plus({"tile", "plan", path("out"), "--append", "--scans", path("other.las")}, from), 4, "scans.frame");
  succeed({"tile", "plan", path("out"), "--append", "--scans", path("rays.ply")});
  succeed(step("bin"));
  succeed(step("run"));
  succeed(step("merge", {"--points", path("all.las")}));
  EXPECT_EQ(record(las("all.las"), "LASF_Projection", 2112), kMetres + '\0');
  // The same by resuming.
  succeed(map({"--tiles", "off", "--checkpoint", path("state")}, "first"));
  scans_ = plus({"--scans", path("other.las"), "--points-format", "las"}, from);
  refuse(map({"--tiles", "off", "--resume", path("state")}, "second"), 4, "scans.frame");
  writeText("frame.wkt", kMetres);
  succeed(map({"--tiles", "off", "--resume", path("state"), "--crs", path("frame.wkt")}, "second"));
}

/// A record in front of the points, or behind them. @param bytes  that it says to have, where that is not the truth
struct Record {
  std::string user = {};
  int id = 0;
  std::string body = {};
  std::optional<std::uint64_t> bytes = {};
};
std::string bytesOf(const Record& record, bool extended) {
  std::string out(2, '\0');
  out += record.user;
  out.resize(18, '\0');
  test::put(out, static_cast<std::uint16_t>(record.id));
  const std::uint64_t bytes = record.bytes.value_or(record.body.size());
  if (extended) {
    test::put(out, bytes);
  } else {
    test::put(out, static_cast<std::uint16_t>(bytes));
  }
  out.resize(extended ? 60 : 54, '\0');
  return out + record.body;
}
std::string keysOf(const std::vector<std::array<int, 2>>& entries, int more_than_there_are = 0) {
  std::string keys;
  for (const int n : {1, 1, 0, static_cast<int>(entries.size()) + more_than_there_are})
    test::put(keys, static_cast<std::uint16_t>(n));
  for (const auto& [key, value] : entries) {
    for (const int n : {key, 0, 1, value}) test::put(keys, static_cast<std::uint16_t>(n));
  }
  return keys;
}
template <typename T>
void set(std::string& bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}
/// The plot with these records in front of its own, which says what tree_id is.
std::string plotWith(const std::vector<Record>& records, bool wkt_counts) {
  Cloud cloud;
  cloud.wkt.clear();
  std::string file = cloud.bytes(), front;
  for (const Record& record : records) front += bytesOf(record, false);
  set(file, 6, static_cast<std::uint16_t>(wkt_counts ? 17 : 1));
  set(file, 96, static_cast<std::uint32_t>(375 + 54 + 192 + front.size()));
  set(file, 100, static_cast<std::uint32_t>(records.size() + 1));
  return file.insert(375, front);
}
std::string plotWithBehind(std::string tail, std::uint32_t count, std::optional<std::uint64_t> begin = {}) {
  std::string file = plotWith({}, true);
  set(file, 235, begin.value_or(file.size()));
  set(file, 243, count);
  return file + tail;
}
const char* const kProjection = "LASF_Projection";
const Record kWkt = {kProjection, 2112, kMetres + '\0'};
const std::string kZone12 = keysOf({{1024, 1}, {3072, 26912}});
std::string zone11() {
  std::string wkt = kMetres;
  wkt.insert(wkt.size() - 1, ",AUTHORITY[\"EPSG\",\"26911\"]");
  return wkt;
}

/// What is damaged or contradicts itself moves no point, comes back only as far as it can be read and counts, and is
/// named in one line.
TEST_F(Frame, BrokenRecordsAreNamed) {
  struct Case {
    const char* what;
    std::string file;
    const char* words;      ///< of the one warning scans.crs; null: there is none
    std::string wkt, keys;  ///< in points.las
    bool trees = true;      ///< the record with tree_id can be read
  };
  const std::string behind = bytesOf({kProjection, 2112, kMetres + '\0'}, true);
  const std::string wkt = kMetres + '\0', damaged = "its list of records is damaged";
  const Case cases[] = {
      {"whole", plotWith({kWkt}, true), nullptr, wkt, {}},
      {"without a zero", plotWith({{kProjection, 2112, kMetres}}, true), nullptr, wkt, {}},
      {"more behind the zero", plotWith({{kProjection, 2112, wkt + "junk\n\33["}}, true), nullptr, wkt, {}},
      {"past the points", plotWith({{kProjection, 2112, wkt, 60000}}, true), damaged.c_str(), {}, {}, false},
      {"past the points, the second", plotWith({kWkt, {"mine", 1, "x", 65535}}, true), damaged.c_str(), wkt, {}, false},
      {"cut inside", plotWith({{kProjection, 2112, kMetres.substr(0, 300)}}, true), "not well formed", {}, {}},
      {"no text", plotWith({{kProjection, 2112, "\1\2\377\n"}}, true), "not well formed", {}, {}},
      {"deep", plotWith({{kProjection, 2112, std::string(40000, '[')}}, true), "not well formed", {}, {}},
      {"empty", plotWith({{kProjection, 2112, std::string(1, '\0')}}, true), nullptr, {}, {}},
      {"two texts", plotWith({kWkt, {kProjection, 2112, kFeet}}, true), "two records of one kind", wkt, {}},
      {"more keys than there are",
       plotWith({{kProjection, 34735, keysOf({{1024, 1}}, 999)}}, false),
       "GeoKeys cannot be read",
       {},
       {}},
      {"half a key", plotWith({{kProjection, 34735, kZone12.substr(0, 21)}}, false), "GeoKeys cannot be read", {}, {}},
      {"no keys", plotWith({{kProjection, 34735, ""}}, false), "GeoKeys cannot be read", {}, {}},
      {"a key twice",
       plotWith({{kProjection, 34735, keysOf({{1024, 1}, {3072, 26911}, {3072, 26912}})}}, false),
       "a key twice",
       {},
       keysOf({{1024, 1}, {3072, 26911}, {3072, 26912}})},
      {"keys of another zone, text counts",
       plotWith({{kProjection, 2112, zone11()}, {kProjection, 34735, kZone12}}, true),
       "the WKT counts, and the GeoKeys are left out",
       zone11() + '\0',
       {}},
      {"keys of another zone count",
       plotWith({{kProjection, 2112, zone11()}, {kProjection, 34735, kZone12}}, false),
       "the GeoKeys count, and the WKT is left out",
       {},
       kZone12},
      {"keys in feet, text in metres",
       plotWith({kWkt, {kProjection, 34735, keysOf({{1024, 1}, {3072, 2264}})}}, true),
       "the GeoKeys are left out",
       wkt,
       {}},
      {"keys in degrees, text in metres",
       plotWith({kWkt, {kProjection, 34735, keysOf({{1024, 2}, {2048, 4326}})}}, true),
       "the GeoKeys are left out",
       wkt,
       {}},
      {"both the same", plotWith({kWkt, {kProjection, 34735, kZone12}}, true), nullptr, wkt, kZone12},
      {"behind, whole", plotWithBehind(behind, 1), nullptr, wkt, {}},
      {"behind, cut in its head", plotWithBehind(behind.substr(0, 20), 1), damaged.c_str(), {}, {}},
      {"behind, cut in its body", plotWithBehind(behind.substr(0, 100), 1), damaged.c_str(), {}, {}},
      {"behind, endless", plotWithBehind(bytesOf({kProjection, 2112, wkt, ~0ULL}, true), 1), damaged.c_str(), {}, {}},
      {"behind, past the end", plotWithBehind("", 1, 1ULL << 63), damaged.c_str(), {}, {}},
      {"behind, 4 billion of them", plotWithBehind(behind, ~0U), damaged.c_str(), wkt, {}},
  };
  use({});
  succeed(map({"--tiles", "off"}, "intact"));
  const std::string points = readText("intact/points.ply");
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    writeText("plot.las", one.file);
    const auto result = cli_test::runProgram(map({"--tiles", "off"}));
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const std::size_t warning = result.err.find("warning[scans.crs]");
    ASSERT_EQ(warning != std::string::npos, one.words != nullptr) << result.err;
    if (one.words != nullptr) {
      EXPECT_NE(result.err.substr(warning, result.err.find('\n', warning) - warning).find(one.words), std::string::npos)
          << result.err;
      EXPECT_EQ(result.err.find("warning[scans.crs]", warning + 1), std::string::npos);
    }
    EXPECT_EQ(readText("out/points.ply"), points);
    EXPECT_EQ(record(las(), kProjection, 2112), one.wkt);
    EXPECT_EQ(record(las(), kProjection, 34735), one.keys);
    const Flags trees = map({"--tiles", "off", "--carry", "tree_id"}, "trees");
    if (one.trees) {
      succeed(trees);
    } else {
      EXPECT_NE(refuse(trees, 4, "carry.missing").find(damaged), std::string::npos);
    }
  }
  // What the file does not say can be said.
  writeText("frame.wkt", kMetres);
  writeText("plot.las", cases[5].file);
  EXPECT_EQ(succeed(map({"--tiles", "off", "--crs", path("frame.wkt")})).find("scans.crs"), std::string::npos);
  EXPECT_EQ(record(las(), kProjection, 2112), wkt);
}

/// Any byte of header and records may be wrong: one error of ours, or a frame.
TEST_F(Frame, NoByteOfTheRecordsCrashes) {
  const std::string whole = plotWith({kWkt, {kProjection, 34735, kZone12}}, true);
  const std::size_t records_end = at<std::uint32_t>(whole, 96);
  std::mt19937 random(50);
  int read = 0, refused = 0;
  for (int n = 0; n < 2000; ++n) {
    std::string file = whole;
    for (int k = 0; k <= n % 3; ++k) file[random() % records_end] = static_cast<char>(random());
    if (n % 5 == 0) file.resize(random() % file.size());
    writeText("mutated.las", file);
    try {
      (void)io::frameOfLas(folder_ / "mutated.las");
      ++read;
    } catch (const Error& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      ++refused;
    }
  }
  EXPECT_GT(read, 200);
  EXPECT_GT(refused, 200);
}

}  // namespace
}  // namespace accessvdb::survey_test
