// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans as PCD, PLY, text and .bin in the forms that drivers and converters give them.
#include <filesystem>

#include "inputs/cloud_files.h"

namespace accessvdb::inputs_test {
namespace {

class TextInputs : public InputTest {
 protected:
  void SetUp() override {
    InputTest::SetUp();
    writeNumberedScans(scans_);
    right_ = mapScans();
    expectRight(right_);
  }
  [[nodiscard]] MapOutcome mapScans() const { return map({"--scans", path("scans"), "--poses", path("poses.txt")}); }
  void expectAsRight(const MapOutcome& outcome) const {
    EXPECT_EQ(outcome.program.exit_code, 0) << outcome.program.err;
    EXPECT_EQ(outcome.points, right_.points);
    EXPECT_EQ(outcome.accessible, right_.accessible);
    EXPECT_EQ(outcome.program.err.find("warning["), std::string::npos) << outcome.program.err;
  }
  /// Each scan anew, with a record of its points between a header and a tail.
  template <typename Record>
  void rewrite(const std::string& ending, const std::string& header, const Record& record) const {
    std::filesystem::remove_all(path("scans"));
    for (std::size_t i = 0; i < scans_.size(); ++i) {
      std::string bytes = header;
      for (const Eigen::Vector3d& p : scans_[i].points_S()) record(bytes, p);
      writeBytes("scans/00000" + std::to_string(i) + ending, bytes);
    }
  }
  /// The scan of the first position in the world frame as text.
  [[nodiscard]] MapOutcome mapText(const std::string& text) const {
    writeBytes("one.xyz", text);
    const Eigen::Vector3d p = scans_[0].T_W_S.translation();
    return map(
        {"--scans", path("one.xyz"), "--sensor-at", decimals(p.x()) + "," + decimals(p.y()) + "," + decimals(p.z())});
  }
  std::vector<WorldScan> scans_ = worldScans(400);
  MapOutcome right_;
};

void putFloats(std::string& bytes, const Eigen::Vector3d& p) {
  for (int axis = 0; axis < 3; ++axis) put(bytes, static_cast<float>(p[axis]));
}

TEST_F(TextInputs, PcdOfDrivers) {
  const std::string tail = "\nWIDTH 400\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 400\nDATA binary\n";
  // Padding of COUNT 0, also under other names, and of COUNT 3.
  rewrite(".pcd",
          "VERSION 0.7\nFIELDS x y z _ pad ring _\nSIZE 4 4 4 1 4 2 1\nTYPE F F F U F U U\nCOUNT 1 1 1 3 0 1 0" + tail,
          [](std::string& bytes, const Eigen::Vector3d& p) {
            putFloats(bytes, p);
            bytes.append(5, '\x40');
          });
  expectAsRight(mapScans());
  rewrite(".pcd", "VERSION 0.7\nFIELDS INTENSITY X Y Z\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1" + tail,
          [](std::string& bytes, const Eigen::Vector3d& p) {
            put(bytes, 9.0F);
            putFloats(bytes, p);
          });
  expectAsRight(mapScans());
  rewrite(".pcd", "version .7\nfields x,y,z\nsize 4,4,4\ntype f,f,f\nwidth 400\nheight 1\npoints 400\ndata BINARY\n",
          [](std::string& bytes, const Eigen::Vector3d& p) { putFloats(bytes, p); });
  expectAsRight(mapScans());
  rewrite(".pcd", "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 20\nHEIGHT 21\nPOINTS 400\nDATA binary\n",
          [](std::string& bytes, const Eigen::Vector3d& p) { putFloats(bytes, p); });
  const MapOutcome counts = mapScans();
  EXPECT_EQ(counts.program.exit_code, 3);
  EXPECT_NE(counts.program.err.find("POINTS 400 is not WIDTH 20 times HEIGHT 21"), std::string::npos)
      << counts.program.err;
}

TEST_F(TextInputs, PlyOfOthers) {
  rewrite(".ply",
          "ply\nformat binary_little_endian 1.0\nelement vertex 400\nproperty float X\nproperty float Y\nproperty "
          "float Z\nend_header\n",
          [](std::string& bytes, const Eigen::Vector3d& p) { putFloats(bytes, p); });
  expectAsRight(mapScans());
  rewrite(
      ".ply",
      "ply\nformat ascii 1.0\nelement vertex 400\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
      [](std::string& bytes, const Eigen::Vector3d& p) {
        std::string line = decimals(p.x()) + " " + decimals(p.y()) + " " + decimals(p.z()) + "\n";
        for (char& c : line)
          if (c == '.') c = ',';
        bytes += line;
      });
  EXPECT_TRUE(mapScans().fails("input.decimal_comma"));
}

TEST_F(TextInputs, TextWithHeadersAndCommas) {
  std::string plain, named, counted = "400\n", commas, semicolons = "x;y;z\n";
  named = "//X Y Z Intensity\n";
  for (const Eigen::Vector3d& p : scans_[0].points_W) {
    const std::string line = decimals(p.x()) + " " + decimals(p.y()) + " " + decimals(p.z());
    plain += line + "\n";
    named += line + " 7\n";
    counted += line + "\n";
    for (const char c : line + "\n") {
      commas += c == '.' ? ',' : c;
      semicolons += c == '.' ? ',' : c == ' ' ? ';' : c;
    }
  }
  const MapOutcome right = mapText(plain);
  ASSERT_EQ(right.program.exit_code, 0) << right.program.err;
  for (const std::string& text : {named, counted, "X,Y,Z\n" + plain}) {
    const MapOutcome outcome = mapText(text);
    EXPECT_EQ(outcome.program.exit_code, 0) << outcome.program.err;
    EXPECT_EQ(outcome.points, right.points);
    EXPECT_EQ(outcome.accessible, right.accessible);
  }
  for (const std::string& text : {commas, semicolons}) {
    const MapOutcome outcome = mapText(text);
    EXPECT_EQ(outcome.program.exit_code, 3);
    EXPECT_NE(outcome.program.err.find("decimal commas"), std::string::npos) << outcome.program.err;
  }
  const MapOutcome cut = mapText("401\n" + plain);
  EXPECT_TRUE(cut.fails("input.truncated")) << cut.program.err;
}

TEST_F(TextInputs, TextWithNamesAndNumbersOfOthers) {
  std::string plain, driver = "TIMESTAMP (ns), LiDAR Index, X (m), Y (m), Z (m)\n",
                     feet = "E (US ft);N (US ft);H (US ft)\n", thousands, degrees, old;
  for (const Eigen::Vector3d& p : scans_[0].points_W) {
    const std::string y = decimals(p.y()), z = decimals(p.z());
    plain += decimals(p.x()) + " " + y + " " + z + "\n";
    driver += "1, 0, " + decimals(p.x()) + ", " + y + ", " + z + "\n";
    feet += decimals(p.x() / 0.3048) + ";" + y + ";" + z + "\n";
    thousands += "4,00" + decimals(std::abs(p.x())) + " " + y + " " + z + "\n";
    degrees += decimals(48 + p.x() / 111000) + " " + decimals(11 + p.y() / 74000) + " " + z + "\n";
  }
  for (int i = 0; i < 3; ++i)  // more than a line may have
    for (const char c : plain) old += c == '\n' ? '\r' : c;
  const MapOutcome right = mapText(plain), named = mapText(driver);
  EXPECT_EQ(named.program.exit_code, 0) << named.program.err;
  EXPECT_EQ(named.points, right.points);
  EXPECT_EQ(named.accessible, right.accessible);
  for (const auto& [text, id] : {std::pair(feet, "input.unit"),
                                 {thousands, "input.thousands_separator"},
                                 {degrees, "input.geographic"},
                                 {old, "input.malformed"}}) {
    const MapOutcome outcome = mapText(text);
    EXPECT_EQ(outcome.program.exit_code, 3) << id;
    EXPECT_TRUE(outcome.fails(id)) << outcome.program.err;
  }
  EXPECT_NE(mapText(old).program.err.find("mac2unix"), std::string::npos);
}

TEST_F(TextInputs, BinOfOtherRecords) {
  int n = 0;
  const auto ring = [&n] { return static_cast<float>(n++ % 32); };
  rewrite(".bin", "", [&](std::string& bytes, const Eigen::Vector3d& p) {
    putFloats(bytes, p);
    put(bytes, ring() / 32);
  });
  expectAsRight(mapScans());
  rewrite(".bin", "", [&](std::string& bytes, const Eigen::Vector3d& p) {
    putFloats(bytes, p);
    put(bytes, 8 * ring());
  });
  expectAsRight(mapScans());
  const auto expectRefused = [&](const char* words) {
    for (const bool forced : {false, true}) {
      std::vector<std::string> arguments = {"--scans", path("scans"), "--poses", path("poses.txt")};
      if (forced) arguments.emplace_back("--allow-truncated");
      const MapOutcome outcome = map(arguments);
      EXPECT_EQ(outcome.program.exit_code, 3) << words;
      EXPECT_NE(outcome.program.err.find(words), std::string::npos) << outcome.program.err;
    }
  };
  rewrite(".bin", "", [&](std::string& bytes, const Eigen::Vector3d& p) {
    putFloats(bytes, p);
    put(bytes, 3 * ring());
    put(bytes, ring());
  });
  expectRefused("5 floats a point (20 bytes)");
  rewrite(".bin", "", [](std::string& bytes, const Eigen::Vector3d& p) { putFloats(bytes, p); });
  expectRefused("3 floats a point (12 bytes)");
  rewrite(".bin", "", [&](std::string& bytes, const Eigen::Vector3d& p) {
    putFloats(bytes, p);
    for (int i = 0; i < 3; ++i) put(bytes, 8 * ring());
  });
  expectRefused("6 floats a point (24 bytes)");
  rewrite(".bin", "", [&](std::string& bytes, const Eigen::Vector3d& p) {
    for (int axis = 0; axis < 3; ++axis) put(bytes, p[axis]);
    put(bytes, double{ring()});
  });
  expectRefused("64-bit floats");
}

TEST_F(TextInputs, FloatsFarFromZeroAreWarnedOf) {
  const Eigen::Vector3d far(500000, 5600000, 300), sensor = scans_[0].T_W_S.translation() + far;
  const std::string at = decimals(sensor.x()) + "," + decimals(sensor.y()) + "," + decimals(sensor.z());
  for (const bool single : {true, false}) {
    const std::string type = single ? "float" : "double";
    std::string ply = "ply\nformat binary_little_endian 1.0\nelement vertex 400\nproperty " + type + " x\nproperty " +
                      type + " y\nproperty " + type + " z\nend_header\n";
    for (const Eigen::Vector3d& p : scans_[0].points_W)
      for (int axis = 0; axis < 3; ++axis) {
        if (single) put(ply, static_cast<float>(p[axis] + far[axis]));
        if (!single) put(ply, p[axis] + far[axis]);
      }
    writeBytes("far.ply", ply);
    const MapOutcome outcome = map({"--scans", path("far.ply"), "--sensor-at", at});
    EXPECT_EQ(outcome.warns("scans.coarse"), single) << outcome.program.err;
    const bool named = outcome.program.err.find("steps of 0.5 m, 10 voxels") != std::string::npos;
    EXPECT_EQ(named, single) << outcome.program.err;
  }
}

TEST_F(TextInputs, PackedFilesAreNamed) {
  for (const auto& [name, cure] :
       {std::pair("walk.db3.zstd", "zstd -d"), {"walk.mcap.zst", "zstd -d"}, {"walk.bag.gz", "gzip -dk"}}) {
    writeBytes("packed/" + std::string(name), "\x28\xb5\x2f\xfd");
    for (const std::string& given : {std::string("packed"), "packed/" + std::string(name)}) {
      const MapOutcome outcome = map({"--scans", path(given)});
      EXPECT_TRUE(outcome.fails("input.compressed")) << outcome.program.err;
      EXPECT_NE(outcome.program.err.find(cure), std::string::npos) << outcome.program.err;
    }
    std::filesystem::remove_all(path("packed"));
  }
}

}  // namespace
}  // namespace accessvdb::inputs_test
