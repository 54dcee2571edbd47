// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <clocale>
#include <cmath>

#include "accessvdb/scan_io.h"
#include "io/scans/scan_files.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::expectError;
using test::TempFolder;

TEST(InputText, NumbersNeedTheWholeTokenAndNoLocale) {
  double value = 0;
  for (const char* bad : {"", "+", "-", "1,5", "1.5x", "0x10", "--1", "+-1", "1e", "e5", "one"})
    EXPECT_FALSE(parseNumber(bad, value)) << bad;
  const std::vector<std::pair<const char*, double>> good = {{"1.5", 1.5},          {"+1.5", 1.5}, {"-2e-3", -2e-3},
                                                            {".5", 0.5},           {"5.", 5},     {"1e400", INFINITY},
                                                            {"-1e400", -INFINITY}, {"1e-400", 0}, {"inf", INFINITY}};
  for (const char* locale : {"C", "de_DE.UTF-8", "tr_TR.UTF-8"}) {
    std::setlocale(LC_ALL, locale);  // if it is not installed, this repeats the test of C
    for (const auto& [text, truth] : good) {
      ASSERT_TRUE(parseNumber(text, value)) << text;
      EXPECT_EQ(value, truth) << text;
    }
  }
  std::setlocale(LC_ALL, "C");
  ASSERT_TRUE(parseNumber("nan", value));
  EXPECT_TRUE(std::isnan(value));
  ASSERT_TRUE(
      parseNumber("-0.0000"
                  "1e-400",
                  value));
  EXPECT_EQ(value, 0);
}

TEST(InputText, LinesEndInEitherWayAndHaveALimit) {
  LineReader lines(
      "\xef\xbb\xbf"
      "a\r\nb\n\nc",
      "file");
  std::vector<std::string> all;
  std::string_view line;
  while (lines.next(line)) all.emplace_back(line);
  EXPECT_EQ(all, (std::vector<std::string>{"a", "b", "", "c"}));
  EXPECT_EQ(lines.number(), 4U);
  EXPECT_FALSE(lines.terminated());
  const std::string longest(kMaxLineBytes, 'x');
  LineReader fits(longest, "file");
  EXPECT_TRUE(fits.next(line));
  EXPECT_EQ(line.size(), kMaxLineBytes);
  const std::string text = "a\n" + longest + "x";
  LineReader over(text, "file");
  EXPECT_TRUE(over.next(line));
  expectError([&] { (void)over.next(line); }, ErrorCode::Input, "input.malformed", {"line 2", "65536"});
}

TEST(InputText, MessagesHaveNoControlBytesAndALimit) {
  EXPECT_EQ(forMessage("a\nb\x1b[0m\x7f"), "a\\x0ab\\x1b[0m\\x7f");
  EXPECT_LE(forMessage(std::string(5000, 'a')).size(), 1027U);
}

TEST(InputText, NaturalOrder) {
  std::vector<std::string> names = {"full100", "b", "full96", "full9", "full096", "a10b2", "a10b10", "full", "a9z"};
  std::sort(names.begin(), names.end(), naturalLess);
  EXPECT_EQ(names,
            (std::vector<std::string>{"a9z", "a10b2", "a10b10", "b", "full", "full9", "full096", "full96", "full100"}));
  for (const auto& a : names)
    for (const auto& b : names) EXPECT_FALSE(naturalLess(a, b) && naturalLess(b, a)) << a << " " << b;
}

TEST(InputText, Sha256OfKnownVectors) {
  const TempFolder folder;
  EXPECT_EQ(sha256OfFile(folder.write("a", "")), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256OfFile(folder.write("b", "abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  // FIPS 180-2, appendix B.3.
  EXPECT_EQ(sha256OfFile(folder.write("c", std::string(1000000, 'a'))),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  expectError([&] { (void)sha256OfFile(folder.path()); }, ErrorCode::Input, "input.not_a_file");
  expectError([&] { (void)sha256OfFile(folder.path() / "none"); }, ErrorCode::Input, "input.missing");
}

TEST(InputText, PositionsInBothSpellings) {
  const TempFolder folder;
  const auto positions = readPositions(folder.write("a.txt", "# x y z\r\n1 2 3\r\n\r\n4.5,5,-6e5\n"));
  ASSERT_EQ(positions.size(), 2U);
  EXPECT_EQ(positions[1], Eigen::Vector3d(4.5, 5, -6e5));
  for (const char* bad : {"1 2 3\n1 2\n", "1 2 3\n1 2 3 4\n", "1 2 3\n1 nan 3\n", "1 2 3\na b c\n"})
    expectError([&] { (void)readPositions(folder.write("b.txt", bad)); }, ErrorCode::Input, "input.malformed",
                {"line 2"});
}

TEST(InputText, PosesOfATool) {
  const TempFolder folder;
  const auto poses = readToolPoses(folder.write("a.txt", "# tip\n1 2 3 1 0 0 0\n\n4,5,6,0.7071068,0,0,0.7071068\n"));
  ASSERT_EQ(poses.size(), 2U);
  EXPECT_EQ(poses[0].translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_TRUE(poses[0].linear().isIdentity());
  EXPECT_TRUE((poses[1].linear() * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d::UnitY(), 1e-6));
  const auto named = readToolPoses(folder.write("b.txt", "id,qx,qy,qz,qw,x,y,z\n7,0,0,0,1,1,2,3\n"));
  ASSERT_EQ(named.size(), 1U);
  EXPECT_TRUE(named[0].isApprox(poses[0]));
  EXPECT_TRUE(readToolPoses(folder.write("c.txt", "# nothing\n")).empty());
  const char* good = "1 2 3 1 0 0 0\n";
  for (const char* bad : {"1 2 3\n", "1 2 3 1 0 0 0 0\n", "1 2 3 nan 0 0 0\n", "1 2 3 0.5 0 0 0\n", "1 2 x 1 0 0 0\n"})
    expectError([&] { (void)readToolPoses(folder.write("d.txt", std::string(good) + bad)); }, ErrorCode::Input,
                "input.malformed", {"line 2"});
  expectError([&] { (void)readToolPoses(folder.write("e.txt", "x y z qw qx qy\n")); }, ErrorCode::Input,
              "input.malformed", {"qz"});
}

}  // namespace
}  // namespace accessvdb::io
