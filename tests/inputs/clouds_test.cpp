// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// LAS files and tool meshes that say more about themselves than where points are.
#include <filesystem>
#include <nlohmann/json.hpp>

#include "inputs/cloud_files.h"

namespace accessvdb::inputs_test {
namespace {

constexpr double kSurveyFoot = 1200.0 / 3937, kFoot = 0.3048;

class LasInputs : public InputTest {
 protected:
  /// Maps "walk.las" along "walk.txt".
  [[nodiscard]] MapOutcome mapWalk(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> all = {"--scans", path("walk.las"), "--trajectory", path("walk.txt")};
    all.insert(all.end(), more.begin(), more.end());
    return map(all);
  }
  void writeWalk(const LasFile& las, const std::vector<LasReturn>& returns) const {
    writeBytes("walk.las", las.bytes(returns));
    writeBytes("walk.txt", walkLines(scans_));
  }
  std::vector<WorldScan> scans_ = worldScans(600);
};

void expectSame(const MapOutcome& a, const MapOutcome& b) {
  EXPECT_EQ(a.program.exit_code, 0) << a.program.err;
  EXPECT_EQ(a.points, b.points);
  EXPECT_EQ(a.accessible, b.accessible);
  EXPECT_EQ(a.blocked, b.blocked);
}

TEST_F(LasInputs, DeletedPointsAndNoiseAreLeftOut) {
  const std::vector<LasReturn> good = walkReturns(scans_);
  for (const int format : {1, 6}) {
    writeWalk({.format = format}, good);
    const MapOutcome right = mapWalk();
    expectRight(right);
    // A wall that is not there, before the scene, in each way that a maker has to say so.
    std::vector<LasReturn> with_noise;
    std::size_t n = 0;
    constexpr std::pair<int, int> kBad[] = {{4, 1}, {0, 7}, {1, 2}, {0, 18}, {6, 7}};
    for (const LasReturn& one : good) {
      with_noise.push_back(one);
      with_noise.back().flags = 2;  // a key point is a point
      const auto [flags, point_class] = kBad[n++ % std::size(kBad)];
      with_noise.push_back({{one.p.x() * 0.3 + 0.5, one.p.y(), one.p.z()},
                            one.time,
                            static_cast<std::uint8_t>(flags),
                            static_cast<std::uint8_t>(point_class)});
    }
    writeWalk({.format = format}, with_noise);
    const MapOutcome left_out = mapWalk();
    expectSame(left_out, right);
    EXPECT_NE(left_out.program.err.find("--keep-noise"), std::string::npos) << left_out.program.err;
    EXPECT_NE(left_out.program.err.find("withheld points"), std::string::npos) << left_out.program.err;
    EXPECT_EQ(nlohmann::json::parse(readText("out/report.json")).at("counts").at("noise_points"), good.size());
    const MapOutcome kept = mapWalk({"--keep-noise"});
    EXPECT_GT(kept.points, right.points);
    EXPECT_EQ(nlohmann::json::parse(readText("out/report.json")).at("parameters").at("keep_noise"), true);
  }
  std::vector<LasReturn> all = good;
  for (LasReturn& one : all) one.point_class = 7;
  writeWalk({}, all);
  const MapOutcome none = mapWalk();
  EXPECT_EQ(none.program.exit_code, 4);
  EXPECT_NE(none.program.err.find("Use --keep-noise"), std::string::npos) << none.program.err;
}

/// What makers write for "no return", in clouds in the world frame as in those of a sensor.
TEST_F(LasInputs, PlacesAtExactlyZeroAreNoReturns) {
  const std::vector<LasReturn> good = walkReturns(scans_);
  writeWalk({}, good);
  const MapOutcome right = mapWalk();
  expectRight(right);
  std::vector<LasReturn> with_zeros;
  for (const LasReturn& one : good) {
    with_zeros.push_back(one);
    if (with_zeros.size() % 3 == 1) with_zeros.push_back({Eigen::Vector3d::Zero(), one.time});
  }
  writeWalk({}, with_zeros);
  expectSame(mapWalk(), right);
  EXPECT_EQ(nlohmann::json::parse(readText("out/report.json")).at("counts").at("dropped").at("no_return"),
            with_zeros.size() - good.size());
}

TEST_F(LasInputs, FeetBecomeMetres) {
  writeWalk({}, walkReturns(scans_));
  const MapOutcome right = mapWalk();
  const std::string base = "GEOGCS[\"NAD83\",UNIT[\"degree\",0.0174532925199433]]";
  const std::string survey = "UNIT[\"US survey foot\",0.304800609601219]", foot = "UNIT[\"foot\",0.3048]";
  std::string citation = geoKeys({{1024, 1}, {1026, 0}});
  const std::uint16_t place[] = {34737, 27, 0};
  std::memcpy(&citation[18], place, sizeof place);
  struct Case {
    const char* what;
    LasFile las;
    double unit_m;
  };
  const Case cases[] = {
      {"GeoKeys", {.projection = {{34735, geoKeys({{1024, 1}, {3076, 9003}, {4099, 9003}})}}}, kSurveyFoot},
      {"heights as coordinates", {.projection = {{34735, geoKeys({{1024, 1}, {3076, 9002}})}}}, kFoot},
      {"WKT",
       {.format = 6, .global_encoding = 16, .projection = {{2112, "PROJCS[\"a\"," + base + "," + survey + "]"}}},
       kSurveyFoot},
      {"WKT behind the points",
       {.format = 7,
        .global_encoding = 16,
        .projection = {{2112, "PROJCS[\"a\"," + base + "," + foot + "]"}},
        .extended = true},
       kFoot},
      {"number of a projection", {.projection = {{34735, geoKeys({{1024, 1}, {3072, 6539}})}}}, kSurveyFoot},
      {"number in international feet", {.projection = {{34735, geoKeys({{1024, 1}, {3072, 3361}})}}}, kFoot},
      {"WKT of libLAS",
       {.projection = {{2112, "PROJCS[\"a\"," + base + "," + survey + "]"}}, .user = "liblas"},
       kSurveyFoot},
      {"words", {.projection = {{34735, citation}, {34737, "NAD83 / New York LI (ftUS)|"}}}, kSurveyFoot},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    writeBytes("walk.las", one.las.bytes(walkReturns(scans_, one.unit_m)));
    writeBytes("walk.txt", walkLines(scans_, one.unit_m));
    const MapOutcome outcome = mapWalk();
    expectRight(outcome);
    EXPECT_NEAR(static_cast<double>(outcome.points), static_cast<double>(right.points),
                0.02 * static_cast<double>(right.points));
    EXPECT_NE(outcome.program.err.find("converted to metres"), std::string::npos) << outcome.program.err;
  }
}

TEST_F(LasInputs, OneSensorIsInTheUnitsOfTheCloud) {
  const auto one = std::vector<WorldScan>(scans_.begin(), scans_.begin() + 1);
  const auto at = [&](double unit_m) {
    const Eigen::Vector3d p = scans_[0].T_W_S.translation() / unit_m;
    return decimals(p.x()) + "," + decimals(p.y()) + "," + decimals(p.z());
  };
  writeBytes("one.las", LasFile().bytes(walkReturns(one)));
  const MapOutcome right = map({"--scans", path("one.las"), "--sensor-at", at(1)});
  expectRight(right);
  writeBytes("one.las", LasFile{.projection = {{34735, geoKeys({{3076, 9002}})}}}.bytes(walkReturns(one, kFoot)));
  const MapOutcome feet = map({"--scans", path("one.las"), "--sensor-at", at(kFoot)});
  expectRight(feet);
  EXPECT_NEAR(static_cast<double>(feet.points), static_cast<double>(right.points),
              0.02 * static_cast<double>(right.points));
}

TEST_F(LasInputs, OtherUnitsAndDegreesAreRefused) {
  const auto refuse = [&](const LasFile& las, const std::vector<LasReturn>& returns, const char* id) {
    writeWalk(las, returns);
    const MapOutcome outcome = mapWalk();
    EXPECT_EQ(outcome.program.exit_code, 3) << outcome.program.err;
    EXPECT_TRUE(outcome.fails(id)) << outcome.program.err;
    EXPECT_NE(outcome.program.err.find("pdal translate"), std::string::npos) << outcome.program.err;
  };
  const std::vector<LasReturn> good = walkReturns(scans_);
  refuse({.projection = {{34735, geoKeys({{1024, 1}, {3076, 9005}})}}}, good, "input.unit");
  refuse({.projection = {{34735, geoKeys({{1024, 2}, {2048, 4326}})}}}, good, "input.geographic");
  refuse({.projection = {{34735, geoKeys({{1024, 3}})}}}, good, "input.geographic");
  refuse(
      {.format = 6, .global_encoding = 16, .projection = {{2112, "GEOGCS[\"WGS 84\",UNIT[\"degree\",0.0174532925]]"}}},
      good, "input.geographic");
  std::vector<LasReturn> degrees = good;
  for (LasReturn& one : degrees) one.p = {11.5 + one.p.x() / 76000, 48.1 + one.p.y() / 111000, one.p.z()};
  refuse({.scale = 1e-7, .z_scale = 1e-3}, degrees, "input.geographic");
  refuse({.scale = 1e-7, .z_scale = 1e-7}, degrees, "input.geographic");
}

TEST_F(LasInputs, UnitsThatCannotBeReadAreWarnedOf) {
  writeWalk({.format = 6, .global_encoding = 16, .projection = {{2112, "PROJCS[\"cut off"}}}, walkReturns(scans_));
  const MapOutcome outcome = mapWalk();
  expectRight(outcome);
  EXPECT_TRUE(outcome.warns("scans.unit")) << outcome.program.err;
  for (const int code : {54032, 32633}) {  // of ESRI, and of EPSG
    writeWalk({.projection = {{34735, geoKeys({{1024, 1}, {3072, code}})}}}, walkReturns(scans_));
    const MapOutcome numbered = mapWalk();
    expectRight(numbered);
    EXPECT_EQ(numbered.warns("scans.unit"), code == 54032) << numbered.program.err;
  }
}

TEST_F(LasInputs, ASmallSceneWithFineStepsIsNotInDegrees) {
  writeWalk({.scale = 1e-7, .z_scale = 1e-7}, walkReturns(scans_));
  const MapOutcome outcome = mapWalk();
  expectRight(outcome);
  EXPECT_EQ(outcome.program.err.find("warning["), std::string::npos) << outcome.program.err;
}

TEST_F(LasInputs, TimesInOtherUnits) {
  writeWalk({}, walkReturns(scans_));
  const MapOutcome right = mapWalk();
  struct Case {
    double first_s, per_second;
    const char* words;
  };
  for (const Case& one :
       {Case{1.7e9, 1e9, "nanoseconds"}, {4.1e8, 1e6, "microseconds"}, {4.1e8, 1e3, "milliseconds"}}) {
    std::string lines;
    for (std::size_t i = 0; i < scans_.size(); ++i) {
      const Eigen::Vector3d p = scans_[i].T_W_S.translation();
      lines += decimals(one.first_s + 0.1 * static_cast<double>(i)) + " " + decimals(p.x()) + " " + decimals(p.y()) +
               " " + decimals(p.z()) + "\n";
    }
    std::vector<LasReturn> returns = walkReturns(scans_);
    for (LasReturn& r : returns) r.time = (r.time - 1e7 + one.first_s) * one.per_second;
    writeBytes("walk.las", LasFile().bytes(returns));
    writeBytes("walk.txt", lines);
    const MapOutcome outcome = mapWalk();
    expectSame(outcome, right);
    EXPECT_NE(outcome.program.err.find(one.words), std::string::npos) << outcome.program.err;
  }
}

TEST_F(LasInputs, CoarseStepsAreWarnedOf) {
  writeWalk({.scale = 0.02, .z_scale = 0.02}, walkReturns(scans_));
  EXPECT_TRUE(mapWalk().warns("scans.coarse"));
  writeWalk({.scale = 0.004, .z_scale = 0.004}, walkReturns(scans_));
  EXPECT_FALSE(mapWalk().warns("scans.coarse"));
}

class StlInputs : public InputTest {
 protected:
  [[nodiscard]] MapOutcome mapWith(const std::string& stl) const {
    writeBytes("tool.stl", stl);
    return map(
        {"--scans", path("scans"), "--poses", path("poses.txt"), "--tool", path("tool.stl"), "--tool-unit", "m"});
  }
};

TEST_F(StlInputs, BytesBehindTheLastFaceAreIgnored) {
  writeNumberedScans(worldScans(300));
  const MapOutcome right = mapWith(boxStl());
  ASSERT_EQ(right.program.exit_code, 0) << right.program.err;
  EXPECT_EQ(right.program.err.find("behind the last face"), std::string::npos);
  const std::string solid = "solid part made by a CAD program facet";
  const std::string tails[] = {"\r\n", std::string(34, '\0'), std::string(50, '\0'), std::string(150, 'x')};
  for (const std::string& header : {std::string(), solid})
    for (const std::string& tail : tails) {
      const MapOutcome outcome = mapWith(boxStl(header) + tail);
      EXPECT_EQ(outcome.program.exit_code, 0) << outcome.program.err;
      EXPECT_EQ(outcome.accessible, right.accessible);
      EXPECT_NE(outcome.program.err.find(std::to_string(tail.size()) + " bytes behind the last face"),
                std::string::npos)
          << outcome.program.err;
    }
  for (std::string text : {boxStlText(), boxStlText("\r\n"), " " + boxStlText(), boxStlText() + boxStlText()}) {
    EXPECT_EQ(mapWith(text).program.exit_code, 0) << text.substr(0, 20);
    for (char& c : text)
      if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
    EXPECT_EQ(mapWith(text).program.exit_code, 0) << text.substr(0, 20);
  }
}

TEST_F(StlInputs, ACountThatIsNotThatOfTheFacesIsRefused) {
  writeNumberedScans(worldScans(50));
  for (const auto& [count, words] : {std::pair(13, "announces 13 faces but has room for 12"),
                                     {11, "announces 11 faces and seems to have 12"},
                                     {0, "announces 0 faces"}}) {
    for (const std::string header : {"", "solid part facet"}) {
      std::string stl = boxStl(header);
      stl[80] = static_cast<char>(count);
      const MapOutcome outcome = mapWith(stl);
      EXPECT_EQ(outcome.program.exit_code, 3) << outcome.program.err;
      EXPECT_NE(outcome.program.err.find(words), std::string::npos) << outcome.program.err;
    }
  }
}

}  // namespace
}  // namespace accessvdb::inputs_test
