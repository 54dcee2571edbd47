// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb export: rasters and vectors, read by GDAL's programs, against sums over points.ply made here.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <sstream>

#include "survey/las_plot.h"

namespace accessvdb::survey_test {
namespace {

constexpr double kFoot_m = 1200.0 / 3937;

class Export : public LasPlotTest {
 protected:
  void SetUp() override {
    LasPlotTest::SetUp();
    if (cli_test::runProgram({"export", "--map", path("none"), "--raster", path("a.tif")}).err.find("usage.no_gdal") !=
        std::string::npos) {
      GTEST_SKIP() << "built without GDAL";
    }
    if (std::system("gdalinfo --version > /dev/null 2>&1") != 0) {
      GTEST_SKIP() << "GDAL's programs are missing: apt install gdal-bin";
    }
  }
  [[nodiscard]] Flags exported(const Flags& more, const std::string& out = "out") const {
    return plus({"export", "--map", path(out), "--quiet"}, more);
  }
  /// What a program of GDAL prints.
  [[nodiscard]] std::string said(const std::string& command) const {
    EXPECT_EQ(std::system((command + " > '" + path("said.txt") + "' 2> '" + path("err.txt") + "'").c_str()), 0)
        << command << readText("err.txt");
    return readText("said.txt");
  }
  [[nodiscard]] std::string meaning(const std::string& system) const {
    return said("gdalsrsinfo -o proj4 '" + system + "'");
  }
  /// Values of a band by the middle of their cell, without cells that have none.
  [[nodiscard]] std::map<std::pair<double, double>, double> cellsOf(const std::string& file, int band) const {
    std::istringstream lines(
        said("gdal_translate -q -of XYZ -b " + std::to_string(band) + " '" + path(file) + "' /vsistdout/"));
    std::map<std::pair<double, double>, double> cells;
    double x = 0, y = 0, value = 0;
    while (lines >> x >> y >> value) {
      if (value != -9999) cells[{x, y}] = value;
    }
    return cells;
  }
  /// Each point lies in the cell that has it, and each cell has the sum of its points.
  void expectCells(const std::string& out, const std::string& file, double unit_m, double cell_m) const {
    const Ply points(readText(out + "/points.ply"));
    const Vector origin_W = originOf(points);
    const auto share = cellsOf(file, 1), area = cellsOf(file, 2);
    ASSERT_EQ(share.size(), area.size());
    ASSERT_GT(share.size(), 3U);
    const double cell = cell_m / unit_m;
    std::map<std::pair<long, long>, std::array<double, 2>> sums;
    const auto at = [&](const char* name, std::size_t n) { return points.column.at(name)[n]; };
    for (std::size_t n = 0; n < points.rows; ++n) {
      const double area_m2 =
          sectionOf({at("x", n), at("y", n), at("z", n)}, {at("nx", n), at("ny", n), at("nz", n)}, origin_W, 0.05);
      auto& sum = sums[{std::lround(std::floor(at("x", n) / unit_m / cell)),
                        std::lround(std::floor(at("y", n) / unit_m / cell))}];
      sum[0] += area_m2;
      if (at("label", n) == 1) sum[1] += area_m2;
    }
    ASSERT_EQ(sums.size(), share.size());
    double between = 0;
    for (const auto& [middle, of_area] : area) {
      const auto sum =
          sums.find({std::lround(std::floor(middle.first / cell)), std::lround(std::floor(middle.second / cell))});
      ASSERT_NE(sum, sums.end()) << middle.first << " " << middle.second;
      EXPECT_NEAR(of_area, sum->second[0], 1e-6 * sum->second[0] + 1e-6);  // of a float
      EXPECT_NEAR(share.at(middle), sum->second[1] / sum->second[0], 1e-5);
      if (share.at(middle) > 0.01 && share.at(middle) < 0.99) ++between;
    }
    EXPECT_GT(between, 0);  // so that a raster of zeros and ones would differ
  }
};

TEST_F(Export, RastersHaveTheShareOfEachCellInItsPlace) {
  use({});
  succeed(map({"--tiles", "off", "--carry", "tree_id"}));
  succeed(exported({"--raster", path("share.tif"), "--cell", "0.5"}));
  expectCells("out", "share.tif", 1, 0.5);
  EXPECT_EQ(meaning(path("share.tif")), meaning("EPSG:26912"));
  EXPECT_NE(meaning("EPSG:26912"), meaning("EPSG:32612"));  // so that it tells them apart
  EXPECT_NE(said("gdalinfo '" + path("share.tif") + "'").find("accessible share of the surface"), std::string::npos);
  // Again, and of tiles: the same bytes.
  const std::string before = readText("share.tif");
  succeed(exported({"--raster", path("share.tif"), "--cell", "0.5"}));
  EXPECT_EQ(readText("share.tif"), before);
  succeed(map({"--tiles", "6.4", "--carry", "tree_id"}, "tiled"));
  succeed(exported({"--raster", path("tiled.tif"), "--cell", "0.5"}, "tiled"));
  EXPECT_EQ(readText("tiled.tif"), before);
}

TEST_F(Export, FeetAreFeetAndKeysAreKeys) {
  Cloud cloud;
  cloud.unit_m = kFoot_m;
  cloud.wkt = kFeet;
  use(cloud);
  succeed(map({"--tiles", "off"}));
  succeed(exported({"--raster", path("feet.tif"), "--cell", "0.5"}));
  expectCells("out", "feet.tif", kFoot_m, 0.5);
  EXPECT_NE(meaning(path("feet.tif")).find("+units=us-ft"), std::string::npos);
  Cloud keys;
  keys.wkt.clear();
  keys.keys_epsg = 26912;
  use(keys);
  succeed(map({"--tiles", "off"}, "keys"));
  succeed(exported({"--raster", path("keys.tif")}, "keys"));
  EXPECT_EQ(meaning(path("keys.tif")), meaning("EPSG:26912"));
}

TEST_F(Export, VectorsHaveTheAccessiblePoints) {
  use({});
  succeed(map({"--tiles", "off", "--carry", "tree_id"}));
  succeed(exported({"--vector", path("targets.gpkg")}));
  EXPECT_EQ(meaning(path("targets.gpkg")), meaning("EPSG:26912"));
  const auto rows = parsedCsv(said("ogr2ogr -f CSV -lco GEOMETRY=AS_XYZ -lco STRING_QUOTING=IF_NEEDED /vsistdout/ '" +
                                   path("targets.gpkg") + "' targets"));
  const Ply points(readText("out/points.ply"));
  const auto& labels = points.column.at("label");
  ASSERT_EQ(rows.size(), static_cast<std::size_t>(std::count(labels.begin(), labels.end(), 1.0)));
  ASSERT_GT(rows.size(), 100U);
  for (const auto& row : rows) {
    const auto n = static_cast<std::size_t>(std::stoul(row.at("point")));
    ASSERT_LT(n, points.rows);
    EXPECT_EQ(labels[n], 1);
    for (const auto& [of_row, of_ply] : {std::pair{"X", "x"},
                                         {"Y", "y"},
                                         {"Z", "z"},
                                         {"dx", "dx"},
                                         {"dy", "dy"},
                                         {"dz", "dz"},
                                         {"score", "score"},
                                         {"tree_id", "tree_id"}}) {
      EXPECT_NEAR(std::stod(row.at(of_row)), points.column.at(of_ply)[n], 1e-6) << of_row;  // digits of the CSV
    }
    if (HasFailure()) return;
  }
}

TEST_F(Export, RefusesInOneLine) {
  use({});
  succeed(map({"--tiles", "off"}));
  refuse(exported({}), 2, "usage.missing");
  refuse(exported({"--raster", path("a.png")}), 2, "usage.ending");
  refuse(exported({"--raster", path("a.tif"), "--cell", "0"}), 2, "usage.cell");
  refuse(exported({"--raster", path("a.tif")}, "nothing"), 3, "input.missing");
  writeText("mine.tif", "II*");
  refuse(exported({"--raster", path("mine.tif")}), 7, "output.foreign");
  EXPECT_EQ(readText("mine.tif"), "II*");
  writeText("mine.gpkg", "SQLite format 3, but another's");
  refuse(exported({"--vector", path("mine.gpkg")}), 7, "output.foreign");
  // Points that have changed since are refused before anything is written.
  flipByte("out/points.ply", sizeOf("out/points.ply") - 3);
  refuse(exported({"--raster", path("a.tif"), "--vector", path("a.gpkg")}), 3, "output.changed");
  EXPECT_FALSE(std::filesystem::exists(path("a.tif")));
}

/// Without the library, and with one that is none of the name's: before anything is read or written.
TEST_F(Export, SaysWhenTheLibraryIsMissing) {
  use({});
  succeed(map({"--tiles", "off"}));
  const auto exportWith = [&](const std::string& content) {
    for (int number = 26; number <= 60; ++number) writeText("lib/libgdal.so." + std::to_string(number), content);
    writeText("lib/libgdal.so", content);
    const std::string command = "LD_LIBRARY_PATH='" + path("lib") + "' '" ACCESSVDB_PROGRAM "' export --map '" +
                                path("out") + "' --raster '" + path("missing.tif") + "' 2> '" + path("error.txt") + "'";
    return WEXITSTATUS(std::system(command.c_str()));
  };
  for (const std::string& content : {std::string(), std::string("no library")}) {
    EXPECT_EQ(exportWith(content), 4);
    const std::string said = readText("error.txt");
    EXPECT_TRUE(said.starts_with("accessvdb: error[gdal.missing] ")) << said;
    EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1) << said;
    EXPECT_NE(said.find("apt install"), std::string::npos) << said;
    EXPECT_FALSE(std::filesystem::exists(path("missing.tif")));
  }
}

TEST_F(Export, SaysWhenThereIsNoFrame) {
  use({});
  scans_.resize(scans_.size() - 2);  // without points.las
  succeed(map({"--tiles", "off"}));
  const auto run = cli_test::runProgram({"export", "--map", path("out"), "--raster", path("a.tif")});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.err.find("warning[export.no_frame]"), std::string::npos);
  // A points.las without a system says none either.
  Cloud nowhere;
  nowhere.wkt.clear();
  use(nowhere);
  succeed(map({"--tiles", "off"}, "nowhere"));
  EXPECT_NE(cli_test::runProgram({"export", "--map", path("nowhere"), "--vector", path("a.gpkg")})
                .err.find("warning[export.no_frame]"),
            std::string::npos);
  writeText("frame.wkt", kMetres);
  succeed(exported({"--raster", path("a.tif"), "--crs", path("frame.wkt")}));
  EXPECT_EQ(meaning(path("a.tif")), meaning("EPSG:26912"));
}

}  // namespace
}  // namespace accessvdb::survey_test
