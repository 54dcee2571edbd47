// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Results that are not as they were written are refused by whatever reads them, with the cure; those that are, and
/// those of programs that wrote no hashes, are read.
#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>

#include "inputs/field_world.h"

namespace accessvdb::inputs_test {
namespace {

namespace fs = std::filesystem;
using cli_test::ProgramResult;
using cli_test::runProgram;
using Json = nlohmann::ordered_json;
using Flags = std::vector<std::string>;

constexpr std::size_t kRecordBytes = 67, kLabel = 39, kReason = 40, kScore = 41, kConfidence = 43, kDirection = 51;

class ResultsTest : public InputTest {
 protected:
  void SetUp() override {
    InputTest::SetUp();
    writeNumberedScans(worldScans(600));
    const MapOutcome made = map(withScans({"--sequence", "4", "--html", "--points-format", "las"}));
    ASSERT_EQ(made.program.exit_code, 0) << made.program.err;
    ASSERT_GT(made.accessible, 0u);
  }
  [[nodiscard]] Flags withScans(const Flags& more) const {
    Flags flags = {"--scans", path("scans"), "--poses", path("poses.txt")};
    flags.insert(flags.end(), more.begin(), more.end());
    return flags;
  }
  /// `map` into another folder, of the same scans.
  [[nodiscard]] ProgramResult mapInto(const std::string& out, const Flags& more = {}) const {
    Flags flags = {"map", "--device", "cpu", "--voxel", "0.05", "--range-noise", "0.01", "--tool", "builtin:pruner"};
    const Flags scans = withScans({"--out", path(out), "--quiet"});
    flags.insert(flags.end(), scans.begin(), scans.end());
    flags.insert(flags.end(), more.begin(), more.end());
    return runProgram(flags);
  }

  [[nodiscard]] std::string bytesOf(const std::string& name) const {
    std::ifstream file(path(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  [[nodiscard]] Json reportOf(const std::string& out) const { return Json::parse(bytesOf(out + "/report.json")); }
  void changeReport(const std::string& out, const std::function<void(Json&)>& change) const {
    Json report = reportOf(out);
    change(report);
    writeBytes(out + "/report.json", report.dump(2));
  }
  [[nodiscard]] static Json* entryOf(Json& report, const std::string& name) {
    for (Json& entry : report["outputs"]) {
      if (entry["path"] == name) return &entry;
    }
    return nullptr;
  }

  [[nodiscard]] Flags query(const std::string& out = "out") const {
    return {"query", "--map", path(out), "--at", "3,0,1"};
  }
  [[nodiscard]] std::vector<Flags> readers(const std::string& out = "out") const {
    return {query(out),
            {"diff", path(out), path("before")},
            {"diff", path("before"), path(out)},
            {"render", "--map", path(out), "--out", path("top.png"), "--width", "64", "--height", "64"},
            {"report", "--map", path(out), "--out", path("page.html")}};
  }
  static Flags allowing(Flags flags) {
    flags.emplace_back("--allow-changed");
    return flags;
  }
  static std::string inWords(const Flags& flags) { return flags[0] + " of " + flags[1]; }

  /// Code 3 with one line that has this id and text.
  static void expectRefused(const Flags& flags, const std::string& id, const std::string& text) {
    const ProgramResult result = runProgram(flags);
    EXPECT_EQ(result.exit_code, 3) << inWords(flags) << ": " << result.err;
    EXPECT_NE(result.err.find("error[" + id + "]"), std::string::npos) << inWords(flags) << ": " << result.err;
    EXPECT_NE(result.err.find(text), std::string::npos) << inWords(flags) << ": " << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_EQ(result.out, "") << inWords(flags);
  }
  /// @return what it says on stderr
  static std::string expectRead(const Flags& flags) {
    const ProgramResult result = runProgram(flags);
    EXPECT_EQ(result.exit_code, 0) << inWords(flags) << ": " << result.err;
    return result.err;
  }
  static void expectSilent(const std::string& err) {
    EXPECT_EQ(err.find("warning["), std::string::npos) << err;
    EXPECT_EQ(err.find("without a check"), std::string::npos) << err;
  }
  void expectRightEntries() const;
  void copyMap(const std::string& to) const {
    fs::remove_all(path(to));
    fs::copy(path("out"), path(to), fs::copy_options::recursive);
  }
};

/// By sha256sum, which shares no code with the program: the rule in docs/file_formats.md, "report.json".
void ResultsTest::expectRightEntries() const {
  const Json report = reportOf("out");
  std::vector<std::string> names;
  for (const Json& entry : report["outputs"]) {
    const std::string name = entry["path"];
    names.push_back(name);
    EXPECT_EQ(entry["bytes"].get<std::uint64_t>(), fs::file_size(path("out/" + name))) << name;
    const std::string script =
        "f='" + path("out/" + name) + "'; n=$(stat -c %s \"$f\"); " +
        "for i in $(seq 0 $(( (n + 1048575) / 1048576 - 1 ))); do dd if=\"$f\" bs=1M skip=$i "
        "count=1 2>/dev/null | sha256sum | cut -c1-64; done | xxd -r -p | sha256sum | cut -c1-64";
    FILE* pipe = ::popen(script.c_str(), "r");
    ASSERT_NE(pipe, nullptr);
    std::array<char, 128> line = {};
    ASSERT_NE(std::fgets(line.data(), line.size(), pipe), nullptr);
    ::pclose(pipe);
    EXPECT_EQ(entry["sha256_of_blocks"].get<std::string>(), std::string(line.data(), 64)) << name;
  }
  std::sort(names.begin(), names.end());
  std::vector<std::string> there = listing("out");
  std::erase(there, "report.json");
  EXPECT_EQ(names, there) << "all files of the folder but the report itself";
}

TEST_F(ResultsTest, EveryOutputIsInTheReport) { expectRightEntries(); }

TEST_F(ResultsTest, UnchangedMapsAreReadInSilence) {
  copyMap("before");
  copyMap("elsewhere");  // a copy of the folder is as good
  fs::create_directory_symlink(path("elsewhere"), path("link"));
  for (const char* out : {"out", "elsewhere", "link"}) {
    for (const Flags& flags : readers(out)) expectSilent(expectRead(flags));
  }
}

TEST_F(ResultsTest, OneByteAnywhereIsRefusedByEveryReader) {
  copyMap("before");
  const std::string whole = bytesOf("out/points.ply");
  const std::size_t header = whole.find("end_header\n") + 11;
  for (const std::size_t place :
       {std::size_t{5}, header / 2, header, header + (whole.size() - header) / 2, whole.size() - 1}) {
    SCOPED_TRACE("byte " + std::to_string(place));
    std::string bytes = whole;
    bytes[place] = static_cast<char>(bytes[place] ^ 1);
    writeBytes("out/points.ply", bytes);
    for (const Flags& flags : readers()) expectRefused(flags, "output.changed", "out/points.ply");
  }
  EXPECT_FALSE(fs::exists(path("top.png"))) << "nothing is written from what has changed";
  EXPECT_FALSE(fs::exists(path("page.html")));
}

TEST_F(ResultsTest, CutExtendedAndSwappedFilesAreRefused) {
  copyMap("before");
  ASSERT_EQ(mapInto("other", {"--max-collisions", "3"}).exit_code, 0);
  const std::string whole = bytesOf("out/points.ply");
  for (const std::string& bytes :
       {whole.substr(0, whole.size() - 1), whole.substr(0, whole.size() / 2), whole.substr(0, 10), std::string(),
        whole + "x", whole + whole, bytesOf("other/points.ply")}) {
    SCOPED_TRACE(std::to_string(bytes.size()) + " bytes");
    writeBytes("out/points.ply", bytes);
    for (const Flags& flags : readers()) expectRefused(flags, "output.changed", "out/points.ply");
  }
  // What a user changed on purpose is read.
  for (const Flags& flags : readers()) {
    const std::string err = expectRead(allowing(flags));
    EXPECT_NE(err.find("warning[output.changed]"), std::string::npos) << inWords(flags) << ": " << err;
  }
}

TEST_F(ResultsTest, TheGridsOfQueryAreCheckedToo) {
  const std::string whole = bytesOf("out/field.vdb");
  for (const std::size_t place : {std::size_t{0}, whole.size() / 4, whole.size() / 2, whole.size() - 1}) {
    SCOPED_TRACE("byte " + std::to_string(place));
    std::string bytes = whole;
    bytes[place] = static_cast<char>(bytes[place] ^ 16);
    writeBytes("out/field.vdb", bytes);
    expectRefused(query(), "output.changed", "out/field.vdb");
  }
  writeBytes("out/field.vdb", whole.substr(0, whole.size() / 2));
  expectRefused(query(), "output.changed", "out/field.vdb");
  ASSERT_EQ(mapInto("other", {"--max-collisions", "3", "--half"}).exit_code, 0);
  writeBytes("out/field.vdb", bytesOf("other/field.vdb"));
  expectRefused(query(), "output.changed", "out/field.vdb");
  EXPECT_NE(expectRead(allowing(query())).find("warning[output.changed]"), std::string::npos);
}

TEST_F(ResultsTest, FilesThatAVerbDoesNotReadAreNoConcernOfIts) {
  copyMap("before");
  for (const char* name : {"preview.png", "field_points.vdb", "points.las", "report.html"}) {
    std::string bytes = bytesOf(std::string("out/") + name);
    bytes[bytes.size() / 2] ^= 1;
    writeBytes(std::string("out/") + name, bytes);
  }
  for (const Flags& flags : readers()) expectSilent(expectRead(flags));
}

TEST_F(ResultsTest, AReportThatWasEditedIsBelievedWhereItsHashesAreUnchanged) {
  copyMap("before");
  changeReport("out", [](Json& report) { report["parameters"]["note"] = "of the north side"; });
  for (const Flags& flags : readers()) expectSilent(expectRead(flags));
  for (const Json& hash :
       {Json("0" + std::string(63, 'a')), Json("abc"), Json(""), Json(7), Json(nullptr), Json(std::string(64, 'G'))}) {
    SCOPED_TRACE(hash.dump());
    changeReport("out", [&](Json& report) { (*entryOf(report, "points.ply"))["sha256_of_blocks"] = hash; });
    for (const Flags& flags : readers()) expectRefused(flags, "output.changed", "out/points.ply");
  }
}

TEST_F(ResultsTest, AFileWithoutAnEntryIsReadWithAWarning) {
  copyMap("before");
  changeReport("out", [](Json& report) {
    for (std::size_t n = 0; n < report["outputs"].size(); ++n) {
      if (report["outputs"][n]["path"] == "points.ply") report["outputs"].erase(n--);
    }
  });
  for (const Flags& flags : readers()) {
    const std::string err = expectRead(flags);
    EXPECT_NE(err.find("warning[output.unlisted]"), std::string::npos) << inWords(flags) << ": " << err;
  }
}

TEST_F(ResultsTest, FoldersWithoutHashesAreReadWithOneNotice) {
  copyMap("before");
  copyMap("older");
  changeReport("older", [](Json& report) { report.erase("outputs"); });
  copyMap("alone");
  fs::remove(path("alone/report.json"));
  copyMap("damaged");
  writeBytes("damaged/report.json", bytesOf("out/report.json").substr(0, 300));
  for (const std::string out : {"older", "alone", "damaged"}) {
    for (const Flags& flags : readers(out)) {
      if (flags[0] == "report" && out == "damaged") continue;  // shows what it holds, and says that it is damaged
      const std::string err = expectRead(flags);
      EXPECT_EQ(err.find("warning["), std::string::npos) << out << ", " << inWords(flags) << ": " << err;
      const std::size_t first = err.find("without a check");
      EXPECT_NE(first, std::string::npos) << out << ", " << inWords(flags) << ": " << err;
      if (first != std::string::npos) {
        EXPECT_EQ(err.find("without a check", first + 1), std::string::npos) << err;
      }
    }
  }
}

TEST_F(ResultsTest, AbsentFilesAreNamedAsBefore) {
  fs::remove(path("out/field.vdb"));
  expectRefused(query(), "input.not_a_field", "no field.vdb");
  fs::remove(path("out/points.ply"));
  expectRefused(readers()[3], "input.missing", "points.ply");
}

TEST_F(ResultsTest, PicturesAndPagesInTheFolderGetTheirEntry) {
  const std::string before = reportOf("out")["outputs"].dump();
  expectRead({"render", "--map", path("out"), "--out", path("out/preview.png"), "--width", "64", "--height", "64"});
  expectRead({"render", "--map", path("out"), "--out", path("out/top.png"), "--width", "64", "--height", "64"});
  expectRead({"report", "--map", path("out"), "--out", path("out/report.html"), "--max-points", "1000"});
  EXPECT_NE(reportOf("out")["outputs"].dump(), before);
  expectRightEntries();
  // Elsewhere it is no concern of the map.
  const std::string after = bytesOf("out/report.json");
  expectRead({"render", "--map", path("out"), "--out", path("top.png"), "--width", "64", "--height", "64"});
  EXPECT_EQ(bytesOf("out/report.json"), after);
}

TEST_F(ResultsTest, AFailedRunLeavesTheReportOfWhatItLeaves) {
  copyMap("before");
  const Json before = reportOf("out");
  writeBytes("poses.txt", "garbage\n");
  EXPECT_NE(mapInto("out").exit_code, 0);
  EXPECT_EQ(reportOf("out"), before);
  std::string bytes = bytesOf("out/points.ply");
  bytes[bytes.size() / 2] ^= 1;
  writeBytes("out/points.ply", bytes);
  expectRefused(query(), "output.changed", "out/points.ply");
}

TEST_F(ResultsTest, ThreadsDoNotShowInTheEntries) {
  ASSERT_EQ(mapInto("one", {"--threads", "1"}).exit_code, 0);
  ASSERT_EQ(mapInto("four", {"--threads", "4"}).exit_code, 0);
  EXPECT_EQ(reportOf("one")["outputs"], reportOf("four")["outputs"]);
}

/// As an editor of points would leave it: changed on purpose, but of what it says nothing may be accessible.
TEST_F(ResultsTest, ALabelThatItsRowContradictsIsRefused) {
  copyMap("before");
  fs::remove(path("out/report.json"));  // so that nothing but the row speaks against it
  const std::string whole = bytesOf("out/points.ply");
  const std::size_t header = whole.find("end_header\n") + 11;
  ASSERT_EQ((whole.size() - header) % kRecordBytes, 0u);
  const auto rowWith = [&](char label) {
    for (std::size_t at = header; at < whole.size(); at += kRecordBytes) {
      if (whole[at + kLabel] == label) return at;
    }
    return std::string::npos;
  };
  const std::size_t accessible = rowWith(1), blocked = rowWith(2);
  ASSERT_NE(accessible, std::string::npos);
  ASSERT_NE(blocked, std::string::npos);
  struct Contradiction {
    const char* what;
    std::size_t row, column;
    std::string bytes;
  };
  const auto floats = [](std::initializer_list<float> values) {
    std::string bytes(values.size() * 4, '\0');
    std::memcpy(bytes.data(), values.begin(), bytes.size());
    return bytes;
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<Contradiction> all = {{"blocked called accessible", blocked, kLabel, "\x01"},
                                          {"accessible with a reason", accessible, kReason, "\x06"},
                                          {"blocked without one", blocked, kReason, std::string(1, '\0')},
                                          {"accessible called blocked", accessible, kLabel, "\x02"},
                                          {"score above the limit", accessible, kScore, "\xf0\x7f"},
                                          {"no score", accessible, kScore, "\xff\xff"},
                                          {"no direction", accessible, kDirection, floats({0, 0, 0})},
                                          {"NaN direction", accessible, kDirection, floats({nan, 0, 0})},
                                          {"long direction", accessible, kDirection, floats({2, 0, 0})},
                                          {"direction of no yaw", accessible, kDirection, floats({0, 0, 1})},
                                          {"confidence above 1", accessible, kConfidence, floats({1.5f})},
                                          {"confidence below 0", accessible, kConfidence, floats({-0.5f})},
                                          {"unknown label", accessible, kLabel, "\x03"},
                                          {"unknown reason", blocked, kReason, "\x2a"}};
  for (const Contradiction& one : all) {
    SCOPED_TRACE(one.what);
    std::string bytes = whole;
    bytes.replace(one.row + one.column, one.bytes.size(), one.bytes);
    writeBytes("out/points.ply", bytes);
    const std::string point = "point " + std::to_string((one.row - header) / kRecordBytes);
    for (const Flags& flags : readers()) {
      const ProgramResult result = runProgram(allowing(flags));
      EXPECT_EQ(result.exit_code, 3) << inWords(flags) << ": " << result.err;
      EXPECT_NE(result.err.find(point), std::string::npos) << inWords(flags) << ": " << result.err;
    }
  }
}

TEST_F(ResultsTest, MapsOfTwoPlacesAreNotComparedInSilence) {
  std::vector<WorldScan> scans = worldScans(600);
  for (WorldScan& scan : scans) {
    scan.T_W_S.pretranslate(Eigen::Vector3d(40, 0, 0));
    for (Eigen::Vector3d& p_W : scan.points_W) p_W.x() += 40;
  }
  copyMap("before");
  expectSilent(expectRead({"diff", path("before"), path("out")}));
  writeNumberedScans(scans);
  ASSERT_EQ(mapInto("away").exit_code, 0);
  EXPECT_NE(expectRead({"diff", path("before"), path("away")}).find("warning[diff.no_overlap]"), std::string::npos);
  EXPECT_NE(expectRead({"diff", path("away"), path("before")}).find("warning[diff.no_overlap]"), std::string::npos);
}

TEST_F(ResultsTest, WhatIfTellsAStateFromAnother) {
  ASSERT_EQ(mapInto("a", {"--checkpoint", path("cp")}).exit_code, 0);
  ASSERT_EQ(mapInto("b", {"--checkpoint", path("other"), "--every", "2"}).exit_code, 0);
  const Flags whatif = {"whatif", path("cp"), "--tool", "builtin:pruner", "--remove", "box:2,0,0,2.5,0.6,2"};
  const Flags access = {"query",        "--map",         path("cp"), "--at",          "3,0,1",
                        "--access-map", path("map.png"), "--tool",   "builtin:pruner"};
  expectRead(whatif);
  const auto stateOf = [&](const std::string& folder) {
    for (const std::string& name : listing(folder)) {
      if (name.ends_with(".avst")) return folder + "/" + name;
    }
    return std::string();
  };
  const std::string own = bytesOf(stateOf("cp"));
  writeBytes(stateOf("cp"), bytesOf(stateOf("other")));
  expectRefused(whatif, "output.changed", "state.json");
  expectRefused(access, "output.changed", "state.json");
  EXPECT_NE(expectRead(allowing(whatif)).find("warning[output.changed]"), std::string::npos);
  std::string bytes = own;
  bytes[bytes.size() - 100] ^= 1;
  writeBytes(stateOf("cp"), bytes);
  EXPECT_EQ(runProgram(whatif).exit_code, 3) << "its own hashes";
  EXPECT_EQ(runProgram(allowing(whatif)).exit_code, 3) << "a damaged state has nothing to say";
}

}  // namespace
}  // namespace accessvdb::inputs_test
