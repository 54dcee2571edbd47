// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/scan_io.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::anyContains;
using test::expectError;
using test::TempFolder;

/// Clouds a, b, c with the points (i, 10, 20 ...) in scans/.
void writeClouds(const TempFolder& folder) {
  (void)folder.write("scans/a.xyz", "1 10 20\n1 11 20\n1 12 20\n");
  (void)folder.write("scans/b 2.xyz", "2 10 20\n");
  (void)folder.write("scans/c.xyz", "3 10 20\n");
}

TEST(StationFile, GivesEachCloudItsScanner) {
  const TempFolder folder;
  writeClouds(folder);
  for (const char* const text : {"# my stations\nc.xyz 470000.25 5 6\na.xyz 7 8 9\nb 2.xyz -1 -2 -3\n",
                                 "file,x,y,z\r\n\"c.xyz\",470000.25,5,6\r\na.xyz,7,8,9\r\n\"b 2.xyz\",-1,-2,-3\r\n"}) {
    ScanSequence scans =
        ScanSequence::open({.scans = folder / "scans", .rays_per_step = 2, .stations = folder.write("s.txt", text)});
    ASSERT_EQ(scans.size(), 4U);
    const std::vector<std::pair<double, Eigen::Vector3d>> truth = {
        {3, {470000.25, 5, 6}}, {1, {7, 8, 9}}, {1, {7, 8, 9}}, {2, {-1, -2, -3}}};
    for (const std::size_t step : {2U, 0U, 1U, 3U}) {
      const ScanRecord record = scans.read(step);
      EXPECT_EQ(record.points_W.at(0)[0], truth[step].first) << step;
      ASSERT_EQ(record.origins_W.size(), 1U);
      EXPECT_EQ(record.origins_W[0], truth[step].second) << step;
    }
    EXPECT_EQ(std::filesystem::path(scans.path(3)).filename(), "b 2.xyz");
    EXPECT_FALSE(scans.stamp_s(0));
    EXPECT_TRUE(anyContains(scans.notices(), "3 stations"));
    EXPECT_TRUE(anyContains(scans.paths(), "s.txt"));
  }
}

TEST(StationFile, TakesTheLineOfOneFileAndTellsOfScansWithoutALine) {
  const TempFolder folder;
  writeClouds(folder);
  const auto stations = folder.write("s.txt", "c.xyz 4 5 6\n./a.xyz 7 8 9\n");
  ScanSequence one = ScanSequence::open({.scans = folder / "scans/a.xyz", .stations = stations});
  ASSERT_EQ(one.size(), 1U);
  EXPECT_EQ(one.read(0).origins_W.at(0), Eigen::Vector3d(7, 8, 9));
  const ScanSequence two = ScanSequence::open({.scans = folder / "scans", .stations = stations});
  EXPECT_EQ(two.size(), 2U);
  EXPECT_TRUE(anyContains(two.notices(), "1 scans in the folder are not used"));
}

TEST(StationFile, RefusesWhatDoesNotFit) {
  const TempFolder folder;
  writeClouds(folder);
  (void)folder.write("scans/d.las", "x");
  const auto refuse = [&](const std::string& text, ErrorCode code, const std::string& id,
                          const std::vector<std::string>& words = {}, const std::string& scans = "scans") {
    expectError([&] { (void)ScanSequence::open({.scans = folder / scans, .stations = folder.write("s.txt", text)}); },
                code, id, words);
  };
  refuse("", ErrorCode::Input, "input.empty");
  refuse("# nothing\n", ErrorCode::Unusable, "stations.none", {"file x y z"});
  refuse("file x y z\n", ErrorCode::Unusable, "stations.none");
  refuse("a.xyz 1 2\n", ErrorCode::Input, "input.malformed", {"line 1"});
  refuse("a.xyz 1 2 3\n1 2 3\n", ErrorCode::Input, "input.malformed", {"line 2"});
  refuse("a.xyz 1 2 up\n", ErrorCode::Input, "input.malformed", {"line 1"});
  refuse("a.xyz 1 2 nan\n", ErrorCode::Unusable, "stations.non_finite", {"line 1"});
  refuse("a.xyz 1 2 3\n./a.xyz 1 2 3\n", ErrorCode::Unusable, "stations.duplicate", {"line 2"});
  refuse("a.xyz 1 2 3\nz.xyz 1 2 3\n", ErrorCode::Input, "input.missing", {"z.xyz"});
  refuse("a.xyz 1 2 3\nd.las 1 2 3\n", ErrorCode::Unusable, "stations.kinds", {"d.las"});
  refuse("s.txt 1 2 3\n", ErrorCode::Input, "input.missing");
  refuse("../s.txt 1 2 3\n", ErrorCode::Input, "input.unsupported", {".pcd"});
  refuse("a.xyz 1 2 3\n", ErrorCode::Unusable, "stations.missing", {"c.xyz"}, "scans/c.xyz");
  const auto stations = folder.write("s.txt", "a.xyz 1 2 3\n");
  expectError([&] { (void)ScanSequence::open({.scans = folder / "scans", .poses = stations, .stations = stations}); },
              ErrorCode::Usage, "usage.stations");
  expectError(
      [&] { (void)ScanSequence::open({.scans = folder / "scans", .trajectory = stations, .stations = stations}); },
      ErrorCode::Usage, "usage.stations");
  expectError([&] { (void)ScanSequence::open({.scans = folder / "scans", .stations = folder / "none.txt"}); },
              ErrorCode::Input, "input.missing");
}

}  // namespace
}  // namespace accessvdb::io
