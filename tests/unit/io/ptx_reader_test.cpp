// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// PTX by hand: stations, their poses, what is no return, and what is not a PTX; and clouds whose rays are assumed.
#include "accessvdb/scan_io.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::anyContains;
using test::expectError;
using test::TempFolder;

/// Turned by 90 degrees about z: x of the station is y of the world. Rows of a matrix for row vectors.
const char* const kTurned = "10 20 30\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n";
/// In the world already.
const char* const kRegistered = "-1 -2 -3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
const char* const kTurnedPoints = "1 2 3 0.5\n0 0 0 0.5\n4 5 6 0.25 255 0 10\n0.5 0 0 1\n";

std::string twoStations() {
  return std::string("2\n2\n") + kTurned + kTurnedPoints + "1\n3\n" + kRegistered + "7 8 9 1\n-7 -8 -9 1\n0 0 0 0\n";
}

class Ptx : public ::testing::Test {
 protected:
  void expect(const std::string& text, const std::string& id, const std::vector<std::string>& words = {},
              ErrorCode code = ErrorCode::Input) {
    const auto file = folder_.write("bad.ptx", text);
    expectError([&] { (void)ScanSequence::open({.scans = file}); }, code, id, words);
  }
  TempFolder folder_;
};

TEST_F(Ptx, HasItsPointsInTheWorldAndItsScannersWhereTheyStood) {
  const auto file = folder_.write("scans/a.ptx", twoStations());
  (void)folder_.write("scans/b.ptx", std::string("1\n1\n") + kRegistered + "1 1 1 1\n");
  const Eigen::Vector3d first(10, 20, 30), second(-1, -2, -3);
  const std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> truth = {{{10 - 2, 20 + 1, 33}, first},
                                                                          {first, first},
                                                                          {{10 - 5, 20 + 4, 36}, first},
                                                                          {{10, 20.5, 30}, first},
                                                                          {{7, 8, 9}, second},
                                                                          {{-7, -8, -9}, second},
                                                                          {second, second},
                                                                          {{1, 1, 1}, second}};
  for (const std::size_t rays : {1U, 2U, 3U, 100U}) {
    ScanSequence scans = ScanSequence::open({.scans = folder_ / "scans", .rays_per_step = rays});
    EXPECT_NE(scans.matchingRule().find("PTX"), std::string::npos);
    // Backwards, so that every step has to find its station again.
    std::vector<ScanRecord> records;
    for (std::size_t step = scans.size(); step-- > 0;) records.insert(records.begin(), scans.read(step));
    std::size_t n = 0;
    for (const ScanRecord& record : records)
      for (std::size_t i = 0; i < record.points_W.size(); ++i, ++n) {
        ASSERT_LT(n, truth.size());
        EXPECT_LT((record.points_W[i] - truth[n].first).norm(), 1e-12) << n << " with " << rays;
        EXPECT_EQ(record.origins_W.at(i), truth[n].second) << n << " with " << rays;
        if (truth[n].first == truth[n].second) {
          EXPECT_EQ(record.points_W[i], record.origins_W[i]) << "no return";
        }
      }
    EXPECT_EQ(n, truth.size());
  }
  EXPECT_EQ(ScanSequence::open({.scans = file}).size(), 1U);
}

TEST_F(Ptx, ThatIsNotOneIsRefused) {
  expect("", "input.empty");
  expect("2\n", "input.truncated", {"header of a station"});
  expect("2\nx\n", "input.malformed", {"line 2"});
  expect("2\n2 2\n", "input.malformed", {"line 2"});
  expect("-2\n2\n", "input.malformed", {"line 1"});
  expect(std::string("2\n2\n") + kTurned + "1 2 3\n", "input.malformed", {"line 11", "3 values"});
  expect(std::string("2\n2\n") + kTurned + "1 2 x 3\n", "input.malformed", {"line 11", "not a number"});
  expect("2\n2\n1 2\n", "input.malformed", {"line 3", "scanner's position"});
  expect("2\n2\n1 2 nan\n", "input.malformed", {"line 3", "not finite"});
  expect("2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0\n", "input.malformed", {"line 8", "transform"});
  // A matrix for column vectors, one that scales, and a scanner that is in two places.
  expect("1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 5\n0 1 0 6\n0 0 1 7\n0 0 0 1\n1 1 1 1\n", "input.malformed",
         {"row vectors"});
  expect("1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n1 1 1 1\n", "poses.bad_rotation", {},
         ErrorCode::Unusable);
  expect("1\n1\n5 5 5\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n9 9 9 1\n1 1 1 1\n", "ptx.scanner",
         {"another place"}, ErrorCode::Unusable);
  expect("4294967295\n4294967295\n" + std::string(kTurned) + "1 1 1 1\n", "input.truncated");
  expectError(
      [&] {
        (void)ScanSequence::open(
            {.scans = folder_.write("a.ptx", twoStations()), .sensor_at_W = Eigen::Vector3d(1, 2, 3)});
      },
      ErrorCode::Usage, "usage.ptx");
}

/// Cut off anywhere: an error, or with allow_truncated the points that are whole.
TEST_F(Ptx, ThatIsCutOffIsRefusedOrReadAsFarAsItGoes) {
  const std::string whole = twoStations();
  const std::size_t first_point = std::string("2\n2\n").size() + std::string(kTurned).size();
  int kept = 0;
  for (std::size_t size = 1; size + 2 < whole.size(); ++size) {
    const auto file = folder_.write("cut.ptx", whole.substr(0, size));
    bool refused = false;
    try {
      (void)ScanSequence::open({.scans = file});
    } catch (const Error& error) {
      refused = true;
      EXPECT_FALSE(error.advice().empty());
    }
    // Whole at the end of a station, even without the line feed; digits at the end of a number cannot be told.
    const bool first_whole = size >= first_point + std::string(kTurnedPoints).size() - 1 &&
                             size <= first_point + std::string(kTurnedPoints).size();
    EXPECT_EQ(refused, !first_whole) << size << ": " << whole.substr(0, size);
    try {
      ScanSequence scans = ScanSequence::open({.scans = file, .allow_truncated = true});
      for (std::size_t step = 0; step < scans.size(); ++step) {
        const ScanRecord record = scans.read(step);
        EXPECT_LE(record.points_W.size(), 6U);
      }
      ++kept;
    } catch (const Error& error) {
      EXPECT_NE(error.code(), ErrorCode::Internal);
    }
  }
  EXPECT_GT(kept, 20);
}

TEST(AssumedRays, BeginBeforeEachPointAndAreWarnedOf) {
  const TempFolder folder;
  (void)folder.write("scans/a.xyz", "1 2 3\n4 5 6\n");
  const auto one = folder.write("one.xyz", "1 2 3\n4 5 6\n7 8 9\n");
  ScanSequence scans = ScanSequence::open({.scans = one, .rays_per_step = 2, .ray_W = Eigen::Vector3d(0, 0.5, -10)});
  ASSERT_EQ(scans.size(), 2U);
  const ScanRecord record = scans.read(0);
  EXPECT_EQ(record.points_W.at(1), Eigen::Vector3d(4, 5, 6));
  EXPECT_EQ(record.origins_W.at(1), Eigen::Vector3d(4, 4.5, 16));
  EXPECT_EQ(scans.read(1).origins_W.at(0), Eigen::Vector3d(7, 7.5, 19));
  ASSERT_EQ(scans.warnings().size(), 1U);
  EXPECT_EQ(scans.warnings()[0].id, "scans.constant_ray");
  for (const Eigen::Vector3d& bad :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0, 0, std::nan("")), Eigen::Vector3d(0, 0, 1e9)})
    expectError([&] { (void)ScanSequence::open({.scans = one, .ray_W = bad}); }, ErrorCode::Usage, "usage.ray");
  expectError(
      [&] {
        (void)ScanSequence::open(
            {.scans = one, .sensor_at_W = Eigen::Vector3d(1, 2, 3), .ray_W = Eigen::Vector3d(0, 0, -1)});
      },
      ErrorCode::Usage, "usage.ray");
}

}  // namespace
}  // namespace accessvdb::io
