// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Attributes of returns as files have them: bytes are written here by the tables of the formats' specifications.
#include "io/clouds/carried_fields.h"

#include <limits>
#include <string>
#include <vector>

#include "accessvdb/attributes.h"
#include "accessvdb/scan_io.h"
#include "io/clouds/point_cloud.h"
#include "unit/io/input_fixture.h"

namespace accessvdb::io {
namespace {

using test::expectError;
using test::put;
using test::TempFolder;
using Rows = std::vector<std::int32_t>;

/// A column of extra bytes, as the specification's table "Extra Bytes" describes it.
struct Extra {
  std::string name;
  int type;
  std::string value;  ///< of each of the two points, one behind the other
  int options = 0;
  std::string no_data = {};
  double scale = 0, offset = 0;
};

std::string extraRecord(const std::vector<Extra>& columns) {
  std::string record;
  for (const Extra& column : columns) {
    const std::size_t begin = record.size();
    record.append(2, '\0');
    record += static_cast<char>(column.type);
    record += static_cast<char>(column.options);
    record += column.name;
    record.resize(begin + 40, '\0');
    record += column.no_data;
    record.resize(begin + 112, '\0');
    put(record, column.scale);
    record.resize(begin + 136, '\0');
    put(record, column.offset);
    record.resize(begin + 192, '\0');
  }
  return record;
}

/// Two points of a format, whose bytes from 12 on are these.
std::string lasOf(int format, const std::string& body_a, const std::string& body_b, const std::vector<Extra>& columns) {
  const bool new_format = format >= 6;
  const std::string extra = extraRecord(columns);
  std::string file("LASF", 4);
  file.resize(24, '\0');
  file += '\1';
  file += static_cast<char>(new_format ? 4 : 2);
  file.resize(94, '\0');
  const std::uint16_t header = new_format ? 375 : 227;
  put(file, header);
  put(file, static_cast<std::uint32_t>(header + 54 + extra.size()));
  put(file, std::uint32_t{1});
  file += static_cast<char>(format);
  std::string points[2] = {body_a, body_b};
  for (int n = 0; n < 2; ++n) {
    for (const Extra& column : columns)
      points[n] += column.value.substr(n * column.value.size() / 2, column.value.size() / 2);
  }
  put(file, static_cast<std::uint16_t>(12 + points[0].size()));
  put(file, std::uint32_t{2});
  file.resize(131, '\0');
  for (int axis = 0; axis < 3; ++axis) put(file, 0.01);
  file.resize(179, '\0');
  for (int axis = 0; axis < 3; ++axis) {
    put(file, 1000.0);
    put(file, -1000.0);
  }
  file.resize(247, '\0');
  if (new_format) put(file, std::uint64_t{2});
  file.resize(header, '\0');
  file.append(2, '\0');
  file += "LASF_Spec";
  file.resize(header + 18, '\0');
  put(file, std::uint16_t{4});
  put(file, static_cast<std::uint16_t>(extra.size()));
  file.resize(header + 54, '\0');
  file += extra;
  for (int n = 0; n < 2; ++n) {
    for (int axis = 0; axis < 3; ++axis) put(file, std::int32_t{100 * n + axis});
    file += points[n];
  }
  return file;
}

template <typename T>
std::string two(T a, T b) {
  std::string bytes;
  put(bytes, a);
  put(bytes, b);
  return bytes;
}

class CarriedFieldsTest : public testing::Test {
 protected:
  Rows read(const std::string& name, const std::string& bytes, const std::vector<std::string>& carry) const {
    ReadOptions options;
    options.carry = carry;
    const ScanKind kind = name.ends_with(".las")   ? ScanKind::Las
                          : name.ends_with(".ply") ? ScanKind::Ply
                                                   : ScanKind::Pcd;
    return readCloud(folder_.write(name, bytes), kind, options).attributes;
  }
  TempFolder folder_;
};

TEST_F(CarriedFieldsTest, DimensionsOfOldLasFormats) {
  // Intensity 513; return 2 of 5, scan direction 1, edge 0; class 11 with key point; angle -7; user 200; source 300.
  std::string a;
  put(a, std::uint16_t{513});
  a += static_cast<char>(2 | 5 << 3 | 1 << 6);
  a += static_cast<char>(11 | 1 << 6);
  a += static_cast<char>(-7);
  a += static_cast<char>(200);
  put(a, std::uint16_t{300});
  const std::string b(8, '\0');
  const std::vector<std::string> names = {
      "intensity",      "return_number", "number_of_returns", "scan_direction_flag", "edge_of_flight_line",
      "Classification", "key_point",     "ScanAngleRank",     "user_data",           "PointSourceId"};
  EXPECT_EQ(read("a.las", lasOf(0, a, b, {}), names),
            (Rows{513, 2, 5, 1, 0, 11, 1, -7, 200, 300, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  // Format 3: GPS time, then colours from byte 28 on.
  std::string colours = a;
  put(colours, 12.5);
  for (const std::uint16_t c : {10, 20, 65535}) put(colours, c);
  EXPECT_EQ(read("b.las", lasOf(3, colours, colours, {}), {"blue", "class"}), (Rows{65535, 11, 65535, 11}));
}

TEST_F(CarriedFieldsTest, DimensionsOfNewLasFormats) {
  // Intensity; return 9 of 15; withheld no, overlap 1, channel 2, direction 1, edge 1; class 200; user 3; angle -3000;
  // source 40000; GPS time.
  std::string a;
  put(a, std::uint16_t{7});
  a += static_cast<char>(9 | 15 << 4);
  a += static_cast<char>(1 << 3 | 2 << 4 | 1 << 6 | 1 << 7);
  a += static_cast<char>(200);
  a += static_cast<char>(3);
  put(a, std::int16_t{-3000});
  put(a, std::uint16_t{40000});
  put(a, 1.5);
  const std::vector<std::string> names = {"return_number",   "number_of_returns", "overlap",
                                          "scanner_channel", "classification",    "user_data",
                                          "scan_angle",      "point_source_id",   "synthetic"};
  EXPECT_EQ(read("a.las", lasOf(6, a, a, {}), names),
            (Rows{9, 15, 1, 2, 200, 3, -3000, 40000, 0, 9, 15, 1, 2, 200, 3, -3000, 40000, 0}));
  std::string infrared = a;
  for (const std::uint16_t c : {1, 2, 3, 4}) put(infrared, c);
  EXPECT_EQ(read("b.las", lasOf(8, infrared, infrared, {}), {"nir", "red"}), (Rows{4, 1, 4, 1}));
}

TEST_F(CarriedFieldsTest, ExtraBytesOfLasInEveryType) {
  const std::string body(18, '\0');  // format 6
  const std::vector<Extra> columns = {
      {"u8", 1, two<std::uint8_t>(255, 1)},
      {"", 0, std::string(6, '\x7f'), 3},  // three bytes that nobody describes
      {"i8", 2, two<std::int8_t>(-128, 1)},
      {"u16", 3, two<std::uint16_t>(65535, 1)},
      {"i16", 4, two<std::int16_t>(-32768, 1)},
      {"u32", 5, two<std::uint32_t>(2147483647u, 1)},
      {"Tree ID", 6, two<std::int32_t>(-2147483647, -5), 1, two<std::int64_t>(-5, 0)},
      {"pair", 13, std::string(8, '\0')},  // two numbers of 16 bits: deprecated, stepped over
      {"u64", 7, two<std::uint64_t>(9, 10), 1, two<std::uint64_t>(10, 0)},
      {"i64", 8, two<std::int64_t>(-11, 1)},
      {"f32", 9, two<float>(12, std::numeric_limits<float>::quiet_NaN())},
      {"f64", 10, two<double>(-13, 99), 1, two<double>(99, 0)},
      {"scaled", 3, two<std::uint16_t>(7, 8), 8 | 16, {}, 0.5, 100.5}};
  EXPECT_EQ(read("a.las", lasOf(6, body, body, columns),
                 {"u8", "i8", "u16", "i16", "u32", "tree_id", "u64", "i64", "f32", "f64"}),
            (Rows{255,
                  -128,
                  65535,
                  -32768,
                  2147483647,
                  -2147483647,
                  9,
                  -11,
                  12,
                  -13,  //
                  1,
                  1,
                  1,
                  1,
                  1,
                  kNoAttribute,
                  kNoAttribute,
                  1,
                  kNoAttribute,
                  kNoAttribute}));
  expectError([&] { (void)read("b.las", lasOf(6, body, body, columns), {"scaled"}); }, ErrorCode::Input, "carry.value",
              {"scaled 104.5", "no whole number"});  // the first is 104, the second is not
}

TEST_F(CarriedFieldsTest, ARecordOfExtraBytesThatSaysTooMuchHasOnlyWhatThereIs) {
  const std::string body(18, '\0');
  std::string file = lasOf(6, body, body, {{"tree", 6, two<std::int32_t>(3, 4)}});
  const std::size_t type = 375 + 54 + 2;
  file[type] = 8;  // 64 bits in the room of 32
  EXPECT_EQ(read("a.las", file, {"tree"}), (Rows{kNoAttribute, kNoAttribute}));
  file[type] = 77;
  EXPECT_EQ(read("b.las", file, {"tree"}), (Rows{kNoAttribute, kNoAttribute}));
  file[type] = 6;
  file[375 + 20] = static_cast<char>(0xff);  // the record is longer than the file
  file[375 + 21] = static_cast<char>(0xff);
  EXPECT_EQ(read("c.las", file, {"tree"}), (Rows{kNoAttribute, kNoAttribute}));
}

TEST_F(CarriedFieldsTest, PropertiesOfPly) {
  const std::string head = "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string text =
      "ply\nformat ascii 1.0\n" + head +
      "property float scalar_Tree_ID\nproperty int n\nend_header\n0 0 1 7 -3\n1 0 1 nan 2147483647\n";
  EXPECT_EQ(read("a.ply", text, {"tree_id", "n"}), (Rows{7, -3, kNoAttribute, 2147483647}));
  std::string binary = "ply\nformat binary_big_endian 1.0\n" + head + "property ushort class\nend_header\n";
  for (const std::uint16_t c : {0x0102, 5}) {
    binary += std::string("\x3f\x80\0\0\x3f\x80\0\0\x3f\x80\0\0", 12);  // 1 1 1
    binary += static_cast<char>(c >> 8);
    binary += static_cast<char>(c & 0xff);
  }
  EXPECT_EQ(read("b.ply", binary, {"classification"}), (Rows{0x0102, 5}));
  std::string lists = "ply\nformat binary_little_endian 1.0\n" + head +
                      "property list uchar int friends\nproperty char tree\nend_header\n";
  for (const int n : {2, 0}) {
    for (int axis = 0; axis < 3; ++axis) put(lists, 1.0f);
    lists += static_cast<char>(n);
    for (int i = 0; i < n; ++i) put(lists, std::int32_t{4});
    lists += static_cast<char>(-n - 1);
  }
  EXPECT_EQ(read("c.ply", lists, {"tree", "friends"}), (Rows{-3, kNoAttribute, -1, kNoAttribute}));
}

TEST_F(CarriedFieldsTest, FieldsOfPcd) {
  const auto head = [](const std::string& data) {
    return "VERSION 0.7\nFIELDS x y z label normal\nSIZE 4 4 4 4 4\nTYPE F F F U F\nCOUNT 1 1 1 1 3\nWIDTH 2\nHEIGHT "
           "1\n"
           "POINTS 2\nDATA " +
           data + "\n";
  };
  EXPECT_EQ(read("a.pcd", head("ascii") + "1 1 1 7 0 0 1\n1 2 1 0 0 0 1\n", {"label"}), (Rows{7, 0}));
  std::string binary = head("binary");
  for (const std::uint32_t label : {3000000000u, 8u}) {
    for (int axis = 0; axis < 3; ++axis) put(binary, 1.0f);
    put(binary, label);
    for (int axis = 0; axis < 3; ++axis) put(binary, 0.5f);
  }
  expectError([&] { (void)read("b.pcd", binary, {"label"}); }, ErrorCode::Input, "carry.value", {"label 3e+09"});
  binary[binary.size() - 56 + 15] = 0;  // the highest byte of the first label
  EXPECT_EQ(read("c.pcd", binary, {"label", "normal"}), (Rows{0xd05e00, kNoAttribute, 8, kNoAttribute}));
}

/// What none of the scans has is refused, with what they do have; what some lack is said.
TEST_F(CarriedFieldsTest, ScansThatLackIt) {
  const auto ply = [](const std::string& name) {
    std::string text =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    if (!name.empty()) text += "property int " + name + "\n";
    text += "end_header\n";
    for (int n = 1; n <= 3; ++n) text += "1 " + std::to_string(n) + " 1" + (name.empty() ? "\n" : " 5\n");
    return text;
  };
  folder_.write("scans/0.ply", ply(""));
  folder_.write("scans/1.ply", ply("tree"));
  folder_.write("poses.txt", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n");
  ScanInputOptions options;
  options.scans = folder_ / "scans";
  options.poses = folder_ / "poses.txt";
  options.carry = {"tree"};
  ScanSequence scans = ScanSequence::open(options);
  EXPECT_EQ(scans.read(0).attributes, (Rows{kNoAttribute, kNoAttribute, kNoAttribute}));
  EXPECT_EQ(scans.read(1).attributes, (Rows{5, 5, 5}));
  ASSERT_EQ(scans.readWarnings().size(), 1u);
  EXPECT_EQ(scans.readWarnings().front().id, "carry.some_missing");
  EXPECT_NE(scans.readWarnings().front().text.find("tree in 1 of 2"), std::string::npos);
  options.carry = {"tree", "species"};
  expectError([&] { (void)ScanSequence::open(options); }, ErrorCode::Unusable, "carry.missing",
              {"has no species", "x y z"});
  folder_.write("kitti/0.bin", std::string(1600, '\0'));
  options.scans = folder_ / "kitti";
  options.carry = {"reflectance"};
  folder_.write("poses.txt", "0 0 0 0 0 0 0 1\n");
  expectError([&] { (void)ScanSequence::open(options); }, ErrorCode::Usage, "carry.format", {"LAS, PLY, PCD"});
}

}  // namespace
}  // namespace accessvdb::io
