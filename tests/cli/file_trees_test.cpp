// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Random folders of scans, links, results of ours and files of others, and one command on each: whatever it does,
/// every file that it did not make is there afterwards as it was. Longer: ACCESSVDB_FILE_TREES=10000, and from another
/// start with ACCESSVDB_FILE_TREES_SEED.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <random>

#include "file_snapshot.h"
#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

namespace fs = std::filesystem;
using Flags = std::vector<std::string>;

std::uint64_t numberFrom(const char* variable, std::uint64_t usual) {
  const char* text = std::getenv(variable);
  return text != nullptr ? std::strtoull(text, nullptr, 10) : usual;
}

class FileTrees : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    writeWallScans(2, 6);
    writePoses(2);
    writeBoxTool(0.9, 0.1);
    fs::create_directories(path("material"));
    for (const char* name : {"scans", "poses.txt", "tool.obj"})
      fs::rename(path(name), path(std::string("material/") + name));
    const Flags made = given(path("material/scans"), path("material/poses.txt"), path("material/tool.obj"));
    make("piece", with({"map", "--out", path("material/piece"), "--html", "--checkpoint", path("material/cp")}, made));
    make("tiled", with({"map", "--out", path("material/tiled"), "--tiles", "12.8", "--keep-rays"}, made));
    make("merged", with({"map", "--out", path("material/merged"), "--tiles", "12.8"}, made));
    make("planned", with({"tile", "plan", path("material/planned"), "--tiles", "12.8"}, made));
    make("binned", with({"tile", "plan", path("material/binned"), "--tiles", "12.8"}, made));
    make("binned", {"tile", "bin", path("material/binned")});
  }

  static Flags with(Flags flags, const Flags& more) {
    flags.insert(flags.end(), more.begin(), more.end());
    return flags;
  }
  static Flags given(const std::string& scans, const std::string& poses, const std::string& tool) {
    return {"--scans", scans, "--poses",      poses, "--tool",   tool,  "--tool-unit", "m",
            "--voxel", "0.1", "--directions", "8",   "--device", "cpu", "--threads",   "1"};
  }
  void make(const std::string& what, const Flags& arguments) const {
    const ProgramResult result = runProgram(arguments);
    ASSERT_EQ(result.exit_code, 0) << what << ": " << result.err;
  }

  std::size_t below(std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_); }
  template <typename T>
  const T& oneOf(const std::vector<T>& list) {
    return list[below(list.size())];
  }

  /// A tree of its own in "tree"; what is foreign in it, or outside, is remembered.
  void grow() {
    fs::remove_all(path("tree"));
    fs::create_directories(path("tree/outside"));
    foreign_.clear();
    for (const char* name : {"a.bin", "b.txt"}) {
      writeText(std::string("tree/outside/") + name, "precious " + std::string(name));
      keep(path(std::string("tree/outside/") + name));
    }
    const std::string start = oneOf<std::string>({"", "", "piece", "tiled", "merged", "planned", "binned"});
    has_results_ = start == "piece" || start == "tiled" || start == "merged";
    const auto copy_of = [&](const std::string& from, const std::string& to) {
      fs::copy(path("material/" + from), path("tree/" + to), fs::copy_options::recursive);
    };
    if (start.empty()) {
      if (below(2) == 0) fs::create_directories(path("tree/out"));
    } else {
      copy_of(start, "out");
      loseSome();
    }
    copy_of("cp", "cp");
    if (below(8) == 0 && !fs::exists(path("tree/out"))) fs::create_directory_symlink("outside", path("tree/out"));
    placeInputs();
    for (std::size_t n = below(5); n-- > 0;) placeForeign();
  }

  /// As after a crash, or by hand.
  void loseSome() {
    std::vector<fs::path> own;
    for (const auto& [file, content] : snapshotOf(path("tree/out"))) own.emplace_back(file);
    for (std::size_t n = below(3); n-- > 0;) fs::remove(oneOf(own));
  }

  void keep(const fs::path& file) { foreign_[file.string()] = describeFile(file); }

  /// Scans, poses and tool: outside, in OUT, or where tiles are kept.
  void placeInputs() {
    scans_ = oneOf<std::string>({"scans", "scans", "out", "out/scans", "out/rays", "out/tiles", "out/tiles/0_0"});
    for (const auto& entry : fs::directory_iterator(path("material/scans"))) {
      const fs::path to = fs::path(path("tree/" + scans_)) / entry.path().filename();
      if (!place(to)) continue;
      fs::copy_file(entry.path(), to);
      keep(to);
    }
    poses_ =
        oneOf<std::string>({"poses.txt", "out/poses.txt", "out/rays/poses.txt", "out/report.json", "cp/state-9.avst"});
    tool_ = oneOf<std::string>({"tool.obj", "out/tool.obj", "out/tiles/tool.obj"});
    for (const auto& [file, from] :
         {std::pair{&poses_, "material/poses.txt"}, std::pair{&tool_, "material/tool.obj"}}) {
      const fs::path to = path("tree/" + *file);
      if (!place(to)) continue;
      fs::copy_file(path(from), to);
      keep(to);
    }
  }

  /// Makes the folder. @return whether there is a place, with nothing in it
  static bool place(const fs::path& file) {
    std::error_code error;
    if (fs::exists(fs::symlink_status(file, error))) return false;
    fs::create_directories(file.parent_path(), error);
    return !error && fs::is_directory(file.parent_path());
  }

  void placeForeign() {
    static const std::vector<std::string> kFolders = {
        "",          "/rays",  "/tiles",     "/tiles/0_0",           "/tiles/7_7", "/tiles/-1_0",
        "/pictures", "/scans", "/rays/deep", "/tiles/.0_0.attempt-x"};
    static const std::vector<std::string> kNames = {"notes.txt",
                                                    ".hidden",
                                                    "points.ply",
                                                    "points.las",
                                                    "field.vdb",
                                                    "field_points.vdb",
                                                    "report.json",
                                                    "report.html",
                                                    "field.json",
                                                    "rays.json",
                                                    "plan.json",
                                                    "shard-000000.rays",
                                                    "tile.json",
                                                    "order.bin",
                                                    "0_0.split.json",
                                                    "0_0.poison.json",
                                                    "state.json",
                                                    "state-2.avst",
                                                    "all.ply",
                                                    "scan.laz",
                                                    "whatif.json",
                                                    "merged_points.ply",
                                                    ".x.tmp",
                                                    "tiles",
                                                    "rays",
                                                    "preview.png",
                                                    "0_0",
                                                    ".0_0.attempt-17",
                                                    "scene.json",
                                                    "poses.txt"};
    const std::string folder = below(6) == 0 ? "cp" : "out" + oneOf(kFolders);
    const std::string name = oneOf(kNames);
    // A picture beside results of ours is taken for theirs.
    if (name == "preview.png" && has_results_) return;
    const fs::path to = fs::path(path("tree/" + folder)) / name;
    if (!place(to)) return;
    switch (below(5)) {
      case 0:
        fs::create_symlink(path("tree/outside/a.bin"), to);
        break;
      case 1:
        fs::create_hard_link(path("tree/outside/b.txt"), to);
        break;
      case 2:
        fs::create_directory_symlink(path("tree/outside"), to);
        break;
      default:
        std::ofstream(to) << "mine " << random_();
    }
    keep(to);
  }

  /// Some command over the tree. Explicit outputs are inputs or new: what is named alone may be replaced.
  Flags command() {
    const std::string out = path("tree/out");
    Flags inputs = given(path("tree/" + scans_), path("tree/" + poses_), path("tree/" + tool_));
    if (!fs::exists(path("tree/" + tool_)) || below(4) == 0) inputs[5] = path("material/tool.obj");
    const Flags fresh = below(2) == 0 ? Flags{"--fresh"} : Flags{};
    const std::string target = oneOf<std::string>({path("tree/new"), inputs[5], inputs[3]});
    const Flags small = {"--width", "64", "--height", "48"};
    switch (below(14)) {
      case 0:
      case 1:
        return with(with({"map", "--out", out}, with(inputs, small)), fresh);
      case 2:
      case 3:
      case 4:
        return with(with({"map", "--out", out, "--tiles", "12.8"}, with(inputs, small)), fresh);
      case 5:
        return with(with({"map", "--out", out, "--checkpoint", path("tree/cp")}, with(inputs, small)), fresh);
      case 6:
        return with(with({"map", "--out", out, "--resume", path("tree/cp"), "--html"}, inputs), small);
      case 7:
        return with(with({"tile", "plan", out, "--tiles", "12.8"}, inputs), fresh);
      case 8:
        return {"tile", "bin", out};
      case 9:
        return {"tile", "run", out};
      case 10:
        return {"tile", "merge", out, "--vdb", path("tree/all.vdb")};
      case 11:
        return with(with({"render", "--map", out, "--out", out + "/points.ply"}, small), {"--quiet"});
      case 12:
        return {"diff", out, path("material/piece"), "--out", path("tree/changes")};
      default:
        return with(with({"advise", "--out", target}, inputs), {"--quiet"});
    }
  }

  std::mt19937_64 random_;
  std::map<std::string, std::string> foreign_;  ///< and what is in each
  std::string scans_, poses_, tool_;            ///< below "tree"
  bool has_results_ = false;
};

TEST_F(FileTrees, NothingOfOthersIsLost) {
  const std::uint64_t trees = numberFrom("ACCESSVDB_FILE_TREES", 300),
                      seed = numberFrom("ACCESSVDB_FILE_TREES_SEED", 1);
  std::map<int, int> codes;
  for (std::uint64_t tree = seed; tree < seed + trees; ++tree) {
    random_.seed(tree);
    grow();
    const Flags arguments = command();
    const ProgramResult result = runProgram(arguments);
    ++codes[result.exit_code];
    std::string line;
    for (const std::string& argument : arguments) line += argument + " ";
    const std::string what = "tree " + std::to_string(tree) + ": " + line + "\n" + result.err;
    EXPECT_NE(result.exit_code, -1) << what;
    EXPECT_NE(result.exit_code, 70) << what;
    for (const auto& [file, content] : foreign_) {
      EXPECT_TRUE(describeFile(file) == content) << file << " was lost in " << what;
    }
  }
  // Neither has everything been refused, nor nothing.
  if (trees < 300) return;
  for (const int code : {0, 2, 7}) EXPECT_GE(codes[code], 15) << "runs with code " << code;
}

}  // namespace
}  // namespace accessvdb::cli_test
