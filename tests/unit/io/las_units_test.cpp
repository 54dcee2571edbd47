// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Units of LAS by GeoKeys and by WKT, as exporters write them.
#include "io/clouds/las_units.h"

#include "io/clouds/point_times.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::expectError;

constexpr double kFoot = 0.3048, kSurveyFoot = 0.3048006096012192;

std::string keys(const std::vector<std::pair<int, int>>& values) {
  std::string bytes;
  for (const int head : {1, 1, 0, static_cast<int>(values.size())}) test::put(bytes, static_cast<std::uint16_t>(head));
  for (const auto& [key, value] : values)
    for (const int number : {key, 0, 1, value}) test::put(bytes, static_cast<std::uint16_t>(number));
  return bytes;
}

LasUnits byKeys(const std::vector<std::pair<int, int>>& values) {
  return lasUnits({.geo_keys = keys(values)}, "a.las");
}
LasUnits byWkt(const std::string& wkt) { return lasUnits({.wkt = wkt, .wkt_counts = true}, "a.las"); }

void expectMetres(const LasUnits& units, double horizontal, double vertical) {
  EXPECT_NEAR(units.metres.x(), horizontal, 1e-12);
  EXPECT_EQ(units.metres.x(), units.metres.y());
  EXPECT_NEAR(units.metres.z(), vertical, 1e-12);
  EXPECT_EQ(units.words.empty(), horizontal == 1 && vertical == 1);
  EXPECT_EQ(units.doubt, "");
}

TEST(LasUnits, OfGeoKeys) {
  expectMetres(lasUnits({}, "a.las"), 1, 1);
  expectMetres(byKeys({{1024, 1}, {3072, 32633}, {3076, 9001}}), 1, 1);
  expectMetres(byKeys({{1024, 1}, {3072, 32633}}), 1, 1);
  expectMetres(byKeys({{1024, 1}, {3076, 9003}}), kSurveyFoot, kSurveyFoot);
  expectMetres(byKeys({{1024, 1}, {3076, 9002}, {4099, 9001}}), kFoot, 1);
  expectMetres(byKeys({{1024, 1}, {3076, 9001}, {4099, 9002}}), 1, kFoot);
  expectMetres(byKeys({{1024, 1}, {3072, 2263}}), kSurveyFoot, kSurveyFoot);
  expectMetres(byKeys({{1024, 1}, {3072, 2256}, {4096, 5703}}), kFoot, 1);
  for (const int code : {9005, 9036, 9014, 1234})
    expectError(
        [&] {
          (void)byKeys({{1024, 1}, {3076, code}});
        },
        ErrorCode::Input, "input.unit", {std::to_string(code)});
  expectError(
      [] {
        (void)byKeys({{1024, 1}, {3076, 9001}, {4099, 9005}});
      },
      ErrorCode::Input, "input.unit", {"heights", "Clarke"});
  expectError([] { (void)byKeys({{1024, 2}, {2048, 4326}}); }, ErrorCode::Input, "input.geographic", {"longitude"});
  expectError([] { (void)byKeys({{2048, 4326}, {2054, 9102}}); }, ErrorCode::Input, "input.geographic", {"longitude"});
  expectError([] { (void)byKeys({{1024, 3}}); }, ErrorCode::Input, "input.geographic", {"geocentric"});
}

TEST(LasUnits, OfTheNumberOfAProjection) {
  for (const int code : {2263, 3435, 6424, 6461, 6539, 3734, 32026, 26741, 8540})
    expectMetres(byKeys({{1024, 1}, {3072, code}}), kSurveyFoot, kSurveyFoot);
  for (const int code : {2256, 3361, 6494, 2994, 6868}) expectMetres(byKeys({{1024, 1}, {3072, code}}), kFoot, kFoot);
  for (const int code : {26910, 32104, 25832, 31466, 6423, 6538, 3360, 3857, 32767, 29371, 9741, 20049})
    expectMetres(byKeys({{1024, 1}, {3072, code}}), 1, 1);
  expectMetres(byKeys({{3072, 6539}, {3076, 9001}}), 1, 1);  // what is said counts
  expectMetres(byKeys({{3072, 6539}, {4096, 5703}}), kSurveyFoot, 1);
  expectMetres(byKeys({{3072, 26910}, {4096, 6360}}), 1, kSurveyFoot);
  for (const auto& [code, unit] : {std::pair(2314, "Clarke's feet"), {22300, "kilometres"}, {2136, "another kind"}})
    expectError(
        [code = code] {
          (void)byKeys({{3072, code}});
        },
        ErrorCode::Input, "input.unit", {unit, "EPSG:" + std::to_string(code)});
  for (const int code : {54032, 10480, 102}) {
    const LasUnits units = byKeys({{1024, 1}, {3072, code}});
    EXPECT_EQ(units.metres, Eigen::Vector3d(1, 1, 1));
    EXPECT_NE(units.doubt.find(std::to_string(code)), std::string::npos) << units.doubt;
  }
}

/// GeoKeys with texts, one after the other in 34737.
LasUnits byTexts(std::vector<std::pair<int, int>> values, const std::vector<std::pair<int, std::string>>& texts) {
  std::string all, directory;
  const std::size_t plain = values.size();
  for (const auto& [key, text] : texts) values.emplace_back(key, 0);
  directory = keys(values);
  for (std::size_t i = 0; i < texts.size(); ++i) {
    std::string entry;
    for (const std::size_t number :
         {static_cast<std::size_t>(texts[i].first), std::size_t{34737}, texts[i].second.size() + 1, all.size()})
      test::put(entry, static_cast<std::uint16_t>(number));
    directory.replace(8 * (plain + 1 + i), 8, entry);
    all += texts[i].second + "|";
  }
  return lasUnits({.geo_keys = directory, .geo_texts = all}, "a.las");
}

TEST(LasUnits, OfTheWordsOfGeoKeys) {
  for (const char* const words :
       {"NAD83 / New York LI (ftUS)", "NAD83 Texas Central US survey feet", "x|US Survey Foot",
        "ESRI PE String = PROJCS[\"a\",UNIT[\"Foot_US\",0.3048]]", "State plane (US-ft)", "units: usft"})
    for (const int key : {1026, 3073}) expectMetres(byTexts({{1024, 1}}, {{key, words}}), kSurveyFoot, kSurveyFoot);
  for (const char* const words : {"NAD83(HARN) / South Carolina (ft)", "International feet", "foot"})
    expectMetres(byTexts({{1024, 1}}, {{1026, words}}), kFoot, kFoot);
  for (const char* const words :
       {"WGS 84 / UTM zone 33N", "Custer County, after 1983", "Lambert, metres", "bus, feeta"})
    expectMetres(byTexts({{1024, 1}}, {{1026, words}}), 1, 1);
  expectMetres(byTexts({{3072, 26910}}, {{4097, "NAVD88 height (ftUS)"}, {1026, "UTM 10N"}}), 1, kSurveyFoot);
  expectMetres(byTexts({{3072, 26910}}, {{1026, "(ftUS)"}}), 1, 1);  // the number counts
  expectMetres(byTexts({{3072, 54032}}, {{3073, "a (ftUS)"}}), kSurveyFoot, kSurveyFoot);
  EXPECT_NE(byTexts({{1024, 1}}, {{1026, "NY (ftUS) + NAVD88 (m)"}}).doubt, "");
}

TEST(LasUnits, OfGeoKeysWithAUnitOfTheirOwn) {
  std::string directory = keys({{1024, 1}, {3076, 32767}, {3077, 0}});
  directory[8 * 3 + 2] = static_cast<char>(34736 & 0xff), directory[8 * 3 + 3] = static_cast<char>(34736 >> 8);
  std::string doubles;
  test::put(doubles, 0.3048);
  expectMetres(lasUnits({.geo_keys = directory, .geo_doubles = doubles}, "a.las"), kFoot, kFoot);
  expectError([&] { (void)lasUnits({.geo_keys = directory}, "a.las"); }, ErrorCode::Input, "input.unit", {"32767"});
  EXPECT_NE(lasUnits({.geo_keys = directory.substr(0, 12)}, "a.las").doubt, "");
}

constexpr const char* kGeogcs =
    "GEOGCS[\"NAD83\",DATUM[\"D\",SPHEROID[\"GRS 1980\",6378137,298.257]],UNIT[\"degree\",0.0174532925]]";

TEST(LasUnits, OfWellKnownText) {
  const std::string base = kGeogcs;
  expectMetres(byWkt("PROJCS[\"a, [\"\"b\"\"]\"," + base + ",PROJECTION[\"TM\"],UNIT[\"metre\",1]]"), 1, 1);
  expectMetres(byWkt("PROJCS[\"a\"," + base +
                     ",UNIT[\"US survey foot\",0.3048006096012192,AUTHORITY[\"EPSG\",\"9003\"]],AXIS[\"E\",EAST]]" +
                     std::string(2, '\0')),
               kSurveyFoot, kSurveyFoot);
  expectMetres(byWkt("projcs[\"a\"," + base + ",unit(\"Foot_US\", 0.3048006096)]"), kSurveyFoot, kSurveyFoot);
  expectMetres(
      byWkt("COMPD_CS[\"c\",PROJCS[\"a\"," + base +
            ",UNIT[\"foot\",0.3048]],VERT_CS[\"v\",VERT_DATUM[\"d\",2005],UNIT[\"metre\",1.0],AXIS[\"Up\",UP]]]"),
      kFoot, 1);
  expectMetres(byWkt("COMPOUNDCRS[\"c\",PROJCRS[\"a\",BASEGEOGCRS[\"b\",DATUM[\"d\",ELLIPSOID[\"e\",6378137,298.2,"
                     "LENGTHUNIT[\"metre\",1]]]],CONVERSION[\"x\",PARAMETER[\"f\",1,LENGTHUNIT[\"metre\",1]]],CS["
                     "Cartesian,2],AXIS[\"e\",east],AXIS[\"n\",north],LENGTHUNIT[\"US survey "
                     "foot\",0.304800609601219]],VERTCRS[\"v\",VDATUM[\"d\"],CS[vertical,1],AXIS[\"h\",up],LENGTHUNIT["
                     "\"metre\",1]]]"),
               kSurveyFoot, 1);
  expectMetres(byWkt("PROJCRS[\"a\",BASEGEOGCRS[\"b\"],CS[Cartesian,2],AXIS[\"e\",east,ORDER[1],LENGTHUNIT[\"foot\",0."
                     "3048]],AXIS[\"n\",north,LENGTHUNIT[\"foot\",0.3048]]]"),
               kFoot, kFoot);
  expectMetres(byWkt("BOUNDCRS[SOURCECRS[PROJCRS[\"a\",CS[Cartesian,2],LENGTHUNIT[\"foot\",0.3048]]],TARGETCRS[GEOGCRS["
                     "\"WGS 84\"]]]"),
               kFoot, kFoot);
  for (const std::string& geographic :
       {base, std::string("GEOGCRS[\"WGS 84\",CS[ellipsoidal,2],ANGLEUNIT[\"degree\",0.0174]]"),
        std::string("GEODCRS[\"WGS 84\",CS[ellipsoidal,3]]"),
        "COMPD_CS[\"c\"," + base + ",VERT_CS[\"v\",UNIT[\"metre\",1]]]"})
    expectError([&] { (void)byWkt(geographic); }, ErrorCode::Input, "input.geographic", {"longitude"});
  for (const char* const geocentric :
       {"GEOCCS[\"WGS 84\",UNIT[\"metre\",1]]", "GEODCRS[\"WGS 84\",CS[Cartesian,3],LENGTHUNIT[\"metre\",1]]"})
    expectError([&] { (void)byWkt(geocentric); }, ErrorCode::Input, "input.geographic", {"geocentric"});
  expectError([&] { (void)byWkt("PROJCS[\"a\"," + base + ",UNIT[\"Clarke's foot\",0.3047972654]]"); }, ErrorCode::Input,
              "input.unit", {"Clarke"});
  for (const char* const damaged : {"PROJCS[\"a\",UNIT[\"foot\",0.3048]", "PROJCS[", "nothing", "PROJCS[\"a]"})
    EXPECT_NE(byWkt(damaged).doubt, "") << damaged;
}

TEST(LasUnits, TheHeaderSaysWhichCounts) {
  LasProjection both = {.geo_keys = keys({{1024, 1}, {3076, 9002}}), .wkt = "LOCAL_CS[\"a\",UNIT[\"metre\",1]]"};
  expectMetres(lasUnits(both, "a.las"), kFoot, kFoot);
  both.wkt_counts = true;
  expectMetres(lasUnits(both, "a.las"), 1, 1);
  both.geo_keys.reset();
  both.wkt_counts = false;
  expectMetres(lasUnits(both, "a.las"), 1, 1);
}

TEST(LasUnits, DatesTellTheirUnit) {
  for (const double seconds : {0.0, 1.5, 604799.0, 4.1e8, 1.4e9, 1.7e9, -1.0}) EXPECT_EQ(unitOfDate_s(seconds), 1);
  EXPECT_EQ(unitOfDate_s(1.7e18), 1e-9);
  EXPECT_EQ(unitOfDate_s(4.1e17), 1e-9);
  EXPECT_EQ(unitOfDate_s(1.7e15), 1e-6);
  EXPECT_EQ(unitOfDate_s(1.7e12), 1e-3);
  EXPECT_EQ(unitOfDate_s(4.1e14), 1e-6);
  EXPECT_EQ(unitOfDate_s(4.1e11), 1e-3);
}

}  // namespace
}  // namespace accessvdb::io
