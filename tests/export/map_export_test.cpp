// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The export flags of `map`, sequences, and .vdb files of other programs passed to `info` and `query`.
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/field_export.h"
#include "cli/program_run.h"
#include "export/bit_equal.h"

namespace accessvdb::cli_test {
namespace {

using nlohmann::json;
using test::named;
using test::readVdb;

class MapExport : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    openvdb::initialize();
    writeWallScans(5);
    writePoses(5);
  }
  void map(const std::vector<std::string>& more) const {
    const ProgramResult result = runProgram(mapArguments(more));
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  /// All records of a points.ply, without its header.
  std::string records(const std::string& file) const {
    const std::string text = readText(file), end = "end_header\n";
    return text.substr(text.find(end) + end.size());
  }
  /// One line, of the documented shape, with all of these words.
  static void expectOneLine(const ProgramResult& result, const std::string& id, const std::vector<std::string>& words) {
    EXPECT_EQ(result.exit_code, 3) << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_NE(result.err.find("accessvdb: error[" + id + "]"), std::string::npos) << result.err;
    for (const std::string& word : words) EXPECT_NE(result.err.find(word), std::string::npos) << word << result.err;
  }
};

TEST_F(MapExport, OptionsChangeTheVdbFilesAndNoLabel) {
  map({"--out", path("plain")});
  const std::vector<std::vector<std::string>> runs = {
      {"--half"},
      {"--compression", "zip"},
      {"--compression", "none"},
      {"--up-axis", "y"},
      {"--surface"},
      {"--half", "--compression", "zip", "--up-axis", "y", "--surface"}};
  const auto plain = readVdb(path("plain/field.vdb"));
  const auto mebibytes = [this](const std::string& file) {
    char text[32];
    std::snprintf(text, sizeof text, "%.1f MiB",
                  static_cast<double>(std::filesystem::file_size(path(file))) / (1 << 20));
    return std::string(text);
  };
  int n = 0;
  for (std::vector<std::string> run : runs) {
    SCOPED_TRACE(run.front());
    const std::string out = "out" + std::to_string(n++);
    run.insert(run.end(), {"--out", path(out)});
    map(run);
    EXPECT_EQ(records(out + "/points.ply"), records("plain/points.ply")) << "labels must be the same bits";
    if (n == 1) {
      const std::string report = readText(out + "/report.json");
      EXPECT_NE(report.find("field.vdb with 16-bit floats has " + mebibytes(out + "/field.vdb")), std::string::npos);
      EXPECT_NE(report.find("less than the " + mebibytes("plain/field.vdb") + " without"), std::string::npos);
    }
    const auto grids = readVdb(path(out + "/field.vdb"));
    for (const char* name : {"accessible", "blocked", "score", "weight", "cleared", "density"}) {
      test::expectBitEqual(*named(*plain, name), *named(*grids, name));
    }
    const bool surface = std::find(run.begin(), run.end(), "--surface") != run.end();
    EXPECT_EQ(grids->size(), surface ? 10u : 9u);
    // Every verb that reads a map reads these too, with the same answer.
    const ProgramResult query = runProgram({"query", "--map", path(out), "--at", "2,0.1,0", "--json"});
    ASSERT_EQ(query.exit_code, 0) << query.err;
    const json answer = json::parse(query.out)[0];
    const json expected =
        json::parse(runProgram({"query", "--map", path("plain"), "--at", "2,0.1,0", "--json"}).out)[0];
    EXPECT_EQ(answer.at("point"), expected.at("point"));
    EXPECT_EQ(answer.at("weight"), expected.at("weight"));
    EXPECT_NEAR(answer.at("distance_m").get<double>(), expected.at("distance_m").get<double>(), 0.2 * 0x1p-11);
    const ProgramResult info = runProgram({"info", path(out)});
    EXPECT_EQ(info.exit_code, 0) << info.err;
    const bool y_up = std::find(run.begin(), run.end(), "y") != run.end();
    EXPECT_NE(info.out.find(y_up ? "up_axis: y" : "up_axis: z"), std::string::npos) << info.out;
    EXPECT_EQ(runProgram({"render", "--map", path(out), "--out", path("x.png")}).exit_code, 0);
    EXPECT_EQ(readText("x.png"), readText("plain/preview.png"));
  }
  const auto surface = openvdb::gridPtrCast<openvdb::FloatGrid>(named(*readVdb(path("out4/field.vdb")), "surface"));
  EXPECT_EQ(surface->getGridClass(), openvdb::GRID_LEVEL_SET);
  // The wall is at x = 2 m and was seen from x = 0: free in front of it, solid right behind.
  const auto read = surface->getConstAccessor();
  const auto at = [&](double x) {
    const double origin_x = surface->metaValue<double>("origin_W_x");
    const double y = surface->metaValue<double>("origin_W_y"), z = surface->metaValue<double>("origin_W_z");
    return read.getValue(surface->transform().worldToIndexCellCentered({x - origin_x, 0.1 - y, 0.0 - z}));
  };
  EXPECT_NEAR(at(1.9), 0.1, 0.026);  // the voxel's centre is up to half a voxel of 5 cm away
  EXPECT_NEAR(at(2.1), -0.1, 0.026);
}

TEST_F(MapExport, BadWordsAreUsageErrors) {
  for (const std::vector<std::string>& bad : {std::vector<std::string>{"--compression", "lzma"},
                                              {"--up-axis", "x"},
                                              {"--sequence", "-1"},
                                              {"--sequence", "two"}}) {
    EXPECT_EQ(runProgram(mapArguments(bad)).exit_code, 2) << bad[0] << bad[1];
  }
}

TEST_F(MapExport, TheConfigFileKnowsTheOptions) {
  writeText("options.toml", "[map]\nhalf = true\ncompression = \"none\"\nup-axis = \"y\"\nsequence = 2\n");
  map({"--config", path("options.toml")});
  EXPECT_EQ(listing("out"), (std::vector<std::string>{"field.vdb", "field_0001.vdb", "field_0002.vdb", "field_0003.vdb",
                                                      "field_points.vdb", "points.ply", "preview.png", "report.json"}));
  const auto grids = readVdb(path("out/field.vdb"));
  EXPECT_TRUE(named(*grids, "distance")->saveFloatAsHalf());
  EXPECT_EQ(named(*grids, "distance")->metaValue<std::string>("up_axis"), "y");
  const json parameters = json::parse(readText("out/report.json")).at("parameters");
  EXPECT_EQ(parameters.at("up_axis"), "y");
  EXPECT_EQ(parameters.at("sequence"), 2);
}

TEST_F(MapExport, ASequenceGrowsAndEndsAsTheField) {
  map({"--out", path("once")});
  map({"--sequence", "2"});  // 5 scans: frames after 2, 4 and 5
  const auto final_grids = readVdb(path("out/field.vdb"));
  std::uint64_t before = 0;
  double weight = 0;
  for (const char* frame : {"out/field_0001.vdb", "out/field_0002.vdb", "out/field_0003.vdb"}) {
    const auto grids = readVdb(path(frame));
    ASSERT_EQ(grids->size(), 9u);
    EXPECT_GE(named(*grids, "density")->activeVoxelCount(), before);
    before = named(*grids, "density")->activeVoxelCount();
    EXPECT_GT(before, 0u);
    double sum = 0;
    const auto weights = openvdb::gridPtrCast<openvdb::FloatGrid>(named(*grids, "weight"));
    for (auto value = weights->cbeginValueOn(); value; ++value) sum += *value;
    EXPECT_GT(sum, weight) << "each frame holds more observations than the one before";
    weight = sum;
  }
  const auto last = readVdb(path("out/field_0003.vdb"));
  for (const auto& grid : *final_grids) test::expectBitEqual(*grid, *named(*last, grid->getName()));
  EXPECT_EQ(records("out/points.ply"), records("once/points.ply")) << "scoring in between changes no label";

  // Existing files are refused, replaced, or reported as old.
  const ProgramResult refused = runProgram(mapArguments({"--no-clobber", "--sequence", "2"}));
  EXPECT_EQ(refused.exit_code, 7);
  for (const char* file : {"field.vdb", "field_points.vdb", "points.ply", "preview.png", "report.json"}) {
    std::filesystem::remove(path("out") + "/" + file);
  }
  const std::string frame = readText("out/field_0002.vdb");
  EXPECT_EQ(runProgram(mapArguments({"--no-clobber", "--sequence", "2"})).exit_code, 7) << "frames are outputs too";
  EXPECT_EQ(readText("out/field_0002.vdb"), frame);
  const ProgramResult shorter = runProgram(mapArguments({"--sequence", "4"}));
  EXPECT_EQ(shorter.exit_code, 0) << shorter.err;
  EXPECT_NE(shorter.err.find("warning[output.old_frames]"), std::string::npos) << shorter.err;
  EXPECT_EQ(runProgram(mapArguments({"--sequence", "2"})).err.find("output.old_frames"), std::string::npos);
}

TEST_F(MapExport, AFullDiskInTheMiddleOfASequenceLeavesNoHalfFrame) {
  ProgramSetup setup;
  setup.arguments = mapArguments({"--sequence", "1"});
  setup.file_size_limit = 16384;  // room for the report, not for a frame
  const ProgramResult result = runProgram(setup);
  EXPECT_EQ(result.exit_code, 7) << result.err;
  EXPECT_EQ(listing("out"), std::vector<std::string>{"report.json"});
}

TEST_F(MapExport, FilesOfOthersAreNamedForWhatTheyAre) {
  const auto ball = openvdb::FloatGrid::create(0.3f);
  ball->tree().fill(openvdb::CoordBBox(openvdb::Coord(-2), openvdb::Coord(2)), -0.1f);
  ball->setName("ball");
  ball->setCreator("Somebody else");
  ball->setGridClass(openvdb::GRID_LEVEL_SET);
  openvdb::io::File(path("ball.vdb")).write({ball});
  const auto fog = ball->deepCopy();
  fog->setName("smoke");
  fog->setGridClass(openvdb::GRID_FOG_VOLUME);
  openvdb::io::File(path("smoke.vdb")).write({fog});
  openvdb::io::File(path("both.vdb")).write({fog, ball});

  const std::vector<std::pair<std::string, std::string>> files = {
      {"ball.vdb", "level set \"ball\" (float), by Somebody else"},
      {"smoke.vdb", "fog volume \"smoke\" (float), by Somebody else"},
      {"both.vdb", "level set \"ball\" (float) and 1 more"}};
  map({});
  std::filesystem::remove(path("out/report.json"));  // which would say that the file has changed
  for (const auto& [file, what] : files) {
    SCOPED_TRACE(file);
    const ProgramResult info = runProgram({"info", path(file)});
    EXPECT_EQ(info.exit_code, 0) << info.err;
    EXPECT_NE(info.out.find("not written by AccessVDB"), std::string::npos) << info.out;
    EXPECT_EQ(json::parse(runProgram({"info", path(file), "--json"}).out).at("accessvdb"), false);
    expectOneLine(runProgram({"query", "--map", path(file), "--at", "0,0,0"}), "input.not_a_folder", {what});
    std::filesystem::copy_file(path(file), path("out/field.vdb"), std::filesystem::copy_options::overwrite_existing);
    expectOneLine(runProgram({"query", "--map", path("out"), "--at", "0,0,0"}), "input.not_a_field",
                  {"not written by AccessVDB", what});
  }
  expectOneLine(runProgram({"query", "--map", path("poses.txt"), "--at", "0,0,0"}), "input.not_a_folder",
                {"is not an OpenVDB file"});
  writeText("short.vdb", readText("ball.vdb").substr(0, 300));
  EXPECT_EQ(runProgram({"info", path("short.vdb")}).exit_code, 3);
  expectOneLine(runProgram({"query", "--map", path("short.vdb"), "--at", "0,0,0"}), "input.not_a_folder",
                {"cannot be read"});
}

TEST_F(MapExport, AnEmptyFieldIsReadByEveryReaderWithAWarning) {
  // map refuses scans without a usable return, so the library writes this one.
  const AccessibilityField field(ToolGeometry::builtin("builtin:pencil"));
  io::WriteOptions options;
  options.surface = true;
  writeField(field, path("empty"), options);
  field.write(path("plain"));
  EXPECT_EQ(listing("empty"), (std::vector<std::string>{"field.vdb", "field_points.vdb", "points.ply"}));
  for (const std::string folder : {"empty", "plain"}) {
    for (const std::vector<std::string>& arguments : {std::vector<std::string>{"info", path(folder)},
                                                      {"info", path(folder + "/field.vdb")},
                                                      {"info", path(folder + "/field_points.vdb")},
                                                      {"query", "--map", path(folder), "--at", "0,0,0"},
                                                      {"render", "--map", path(folder), "--out", path("empty.png")}}) {
      const ProgramResult result = runProgram(arguments);
      EXPECT_EQ(result.exit_code, 0) << result.err;
      EXPECT_NE(result.err.find("warning[field.empty]"), std::string::npos) << arguments[0] << result.err;
    }
  }
  EXPECT_EQ(readVdb(path("empty/field.vdb"))->size(), 10u);
  const std::string read =
      "import importlib, importlib.util as u, sys; "
      "v = importlib.import_module('pyopenvdb' if u.find_spec('pyopenvdb') else 'openvdb'); g, m = "
      "v.readAll(sys.argv[1]); "
      "sys.exit(len(g) != 10 or any(x.activeVoxelCount() for x in g) or m['up_axis'] != 'z')";
  const std::string script =
      "for p in /usr/bin/python3 python3; do if $p -c 'import pyopenvdb' 2>/dev/null || $p -c 'import openvdb' "
      "2>/dev/null; then exec $p -c \"" +
      read + "\" '" + path("empty/field.vdb") + "'; fi; done; exit 9";
  EXPECT_EQ(std::system(script.c_str()), 0) << "apt install python3-openvdb";
}

TEST_F(MapExport, OwnFilesGivenAloneAreNamedToo) {
  map({});
  EXPECT_EQ(json::parse(runProgram({"info", path("out/field.vdb"), "--json"}).out).at("accessvdb"), true);
  expectOneLine(runProgram({"query", "--map", path("out/field.vdb"), "--at", "0,0,0"}), "input.not_a_folder",
                {"by AccessVDB", "whole folder"});
}

}  // namespace
}  // namespace accessvdb::cli_test
