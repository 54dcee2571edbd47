// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb-lab bench as a user sees it: consistent figures, one-line errors.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program_run.h"

namespace accessvdb::cli_test {
namespace {

using nlohmann::json;

constexpr int kFrames = 7, kTimed = 4, kPoints = 1500;

class Bench : public ProgramTest {
 protected:
  using Flags = std::map<std::string, std::string>;

  /// A few small scans at 10 cm, taking a second. The test's flags take precedence; an empty value means none.
  [[nodiscard]] static std::vector<std::string> arguments(Flags flags) {
    flags.merge(Flags{{"--device", "cpu"},
                      {"--voxel", "0.1"},
                      {"--points-per-frame", std::to_string(kPoints)},
                      {"--frames", std::to_string(kFrames)},
                      {"--timed-frames", std::to_string(kTimed)},
                      {"--max-range", "8"},
                      {"--knn", "10"},
                      {"--tool", "builtin:pencil"}});
    std::vector<std::string> all = {"bench"};
    for (const auto& [flag, value] : flags) {
      all.push_back(flag);
      if (!value.empty()) all.push_back(value);
    }
    return all;
  }
  void expectRefused(Flags flags, int exit_code, const std::string& said) const {
    SCOPED_TRACE(said);
    flags["--out"] = path("refused.json");
    const ProgramResult result = runLab(arguments(flags));
    EXPECT_EQ(result.exit_code, exit_code) << result.err;
    EXPECT_NE(result.err.find(said), std::string::npos) << result.err;
    EXPECT_EQ(result.err.rfind("accessvdb: error[", 0), 0u) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << "not one line: " << result.err;
    EXPECT_FALSE(std::filesystem::exists(path("refused.json")));
  }
};

/// The columns of a CSV by their names.
std::vector<std::vector<double>> numbersOf(const std::string& csv, std::string& header) {
  std::istringstream lines(csv);
  std::getline(lines, header);
  std::vector<std::vector<double>> rows;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream cells(line);
    rows.emplace_back();
    for (std::string cell; std::getline(cells, cell, ',');) rows.back().push_back(std::stod(cell));
  }
  return rows;
}

TEST_F(Bench, ABudgetLeavesABacklog) {
  const ProgramResult result = runLab(
      arguments({{"--budget-points", "25"}, {"--out", path("bench.json")}, {"--per-frame", path("frames.csv")}}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json bench = json::parse(readText("bench.json"));
  EXPECT_EQ(bench["budget_points"], 25);
  EXPECT_GT(bench["backlog"]["largest_points"], 100);
  EXPECT_GT(bench["backlog"]["age_at_most_updates"], 1);
  EXPECT_LT(bench["backlog"]["largest_withheld_points"], bench["backlog"]["largest_points"]);
  EXPECT_LE(bench["per_frame"]["scored_points"]["max"], 25);
  expectRefused({{"--budget-points", "-1"}}, 2, "--budget-points");
}

TEST_F(Bench, FiguresAgreeWithEachOther) {
  const ProgramResult result = runLab(arguments({{"--out", path("bench.json")}, {"--per-frame", path("frames.csv")}}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json bench = json::parse(readText("bench.json"));
  EXPECT_EQ(bench["frames"], kFrames);
  EXPECT_EQ(bench["timed_frames"], kTimed);
  EXPECT_EQ(bench["points_per_frame"], kPoints);
  EXPECT_EQ(bench["device"], "cpu");
  EXPECT_EQ(bench["backend"], "cpu");
  EXPECT_EQ(bench["complete"], true);
  EXPECT_EQ(bench["voxel_m"], 0.1);
  EXPECT_EQ(bench["tau_m"], 0.4);
  EXPECT_EQ(bench["policy"], "exact");
  EXPECT_GT(bench["memory"]["host_peak_bytes"], bench["memory"]["host_before_bytes"]);
  EXPECT_EQ(bench["memory"]["device_peak_bytes"], 0);
  EXPECT_EQ(bench["memory_at_timed_begin"]["surface_points"], bench["surface_points"]["timed_begin"]);
  EXPECT_LE(bench["memory_at_timed_begin"]["host_bytes"], bench["memory"]["host_peak_bytes"]);
  EXPECT_LT(bench["memory_at_timed_begin"]["map_bytes"], bench["memory"]["map_bytes"]);
  EXPECT_EQ(bench["backlog"]["largest_points"], 0);
  for (const char* block : {"timing_ms", "timing_all_frames_ms"}) {
    double stages_ms = 0;
    for (const char* stage : {"frame", "integrate", "mirror", "update", "score"}) {
      const json& times = bench[block][stage];
      EXPECT_GT(times["mean"], 0.0) << stage;
      EXPECT_LE(times["p50"], times["p95"]) << stage;
      EXPECT_LE(times["p95"], times["p99"]) << stage;
      EXPECT_LE(times["p99"], times["max"]) << stage;
      EXPECT_LE(times["mean"], times["max"]) << stage;
      if (std::string(stage) != "frame") stages_ms += times["mean"].get<double>();
    }
    EXPECT_LE(stages_ms, bench[block]["frame"]["mean"].get<double>() + 1e-6) << block;
  }

  // Every return of every frame was used, and the map grew with them.
  std::string header;
  const auto rows = numbersOf(readText("frames.csv"), header);
  ASSERT_EQ(rows.size(), static_cast<std::size_t>(kFrames));
  EXPECT_EQ(header.rfind("n,frame_ms,integrate_ms,mirror_ms,update_ms,score_ms,points_used,touched_leaves", 0), 0u);
  const std::size_t points = rows.front().size() - 1;
  for (std::size_t n = 0; n < rows.size(); ++n) {
    EXPECT_EQ(rows[n][0], static_cast<double>(n));
    EXPECT_EQ(rows[n][6], kPoints);
    EXPECT_LE(rows[n][2] + rows[n][3] + rows[n][4] + rows[n][5], rows[n][1] * (1 + 1e-5)) << "six digits are written";
    EXPECT_GT(rows[n][points], n == 0 ? 0 : rows[n - 1][points]);
  }
  EXPECT_EQ(bench["surface_points"]["timed_begin"], rows[kFrames - kTimed - 1][points]);
  EXPECT_EQ(bench["surface_points"]["timed_end"], rows[kFrames - 1][points]);
  // The stages add up to the frame: in the median, because something may happen between two clock readings.
  std::vector<double> rest_ms;
  for (const auto& row : rows) rest_ms.push_back(row[1] - (row[2] + row[3] + row[4] + row[5]));
  std::sort(rest_ms.begin(), rest_ms.end());
  EXPECT_LE(rest_ms[rest_ms.size() / 2], 0.05 + 1e-5 * rows[kFrames / 2][1]);
  std::uint64_t labels = 0;
  for (const auto& [label, count] : bench["labels_at_end"].items()) labels += count.get<std::uint64_t>();
  EXPECT_EQ(labels, bench["surface_points"]["timed_end"].get<std::uint64_t>());
  EXPECT_GT(bench["labels_at_end"]["accessible"], 0);
  EXPECT_EQ(bench["per_frame"]["points_used"]["mean"], kPoints);
  // Figures cover only the timed frames. Columns 1 .. 5 are times, rounded to six digits; then counters, exact.
  const auto expectMeanAndMax = [&](const json& block, std::size_t column, std::size_t first, double rounding) {
    double sum = 0, largest = 0;
    for (std::size_t n = first; n < rows.size(); ++n) {
      sum += rows[n][column];
      largest = std::max(largest, rows[n][column]);
    }
    EXPECT_NEAR(block["mean"].get<double>(), sum / static_cast<double>(rows.size() - first), rounding * largest);
    EXPECT_NEAR(block["max"].get<double>(), largest, rounding * largest);
  };
  expectMeanAndMax(bench["timing_ms"]["frame"], 1, kFrames - kTimed, 1e-5);
  expectMeanAndMax(bench["timing_ms"]["score"], 5, kFrames - kTimed, 1e-5);
  expectMeanAndMax(bench["timing_all_frames_ms"]["frame"], 1, 0, 1e-5);
  expectMeanAndMax(bench["per_frame"]["touched_leaves"], 7, kFrames - kTimed, 1e-12);
  expectMeanAndMax(bench["per_frame"]["new_leaves"], 8, kFrames - kTimed, 1e-12);
}

/// With the flag, its figures are added to all others; without it, nothing of it shows.
TEST_F(Bench, TheMirrorOfDistancesHasFiguresOfItsOwn) {
  ASSERT_EQ(runLab(arguments({{"--out", path("without.json")}, {"--per-frame", path("without.csv")}})).exit_code, 0);
  const ProgramResult result =
      runLab(arguments({{"--out", path("with.json")}, {"--per-frame", path("with.csv")}, {"--mirror-distance", ""}}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json without = json::parse(readText("without.json")), with = json::parse(readText("with.json"));
  EXPECT_EQ(without["parameters"]["mirror_distance"], false);
  EXPECT_EQ(with["parameters"]["mirror_distance"], true);
  EXPECT_FALSE(without["timing_ms"].contains("distance_mirror"));
  EXPECT_FALSE(without["per_frame"].contains("distance_leaves"));
  EXPECT_FALSE(without["memory"].contains("distance_mirror_bytes"));
  EXPECT_GT(with["timing_ms"]["distance_mirror"]["mean"], 0.0);
  EXPECT_LE(with["per_frame"]["distance_leaves"]["mean"], with["per_frame"]["touched_leaves"]["mean"]);
  EXPECT_GT(with["per_frame"]["distance_mirror_bytes"]["mean"].get<double>(),
            66 * with["per_frame"]["distance_leaves"]["mean"].get<double>());
  EXPECT_GT(with["memory"]["distance_mirror_bytes"], with["memory"]["mirror_bytes"]);
  EXPECT_EQ(with["labels_at_end"], without["labels_at_end"]);
  EXPECT_EQ(with["per_frame"]["mirror_bytes"], without["per_frame"]["mirror_bytes"]);
  std::string header, header_with;
  const auto rows = numbersOf(readText("without.csv"), header),
             rows_with = numbersOf(readText("with.csv"), header_with);
  EXPECT_EQ(header_with, header + ",distance_mirror_ms,distance_leaves,distance_mirror_bytes");
  for (std::size_t n = 0; n < rows.size(); ++n) {
    ASSERT_EQ(rows_with[n].size(), rows[n].size() + 3);
    EXPECT_GT(rows_with[n].back(), 0);
  }
}

TEST_F(Bench, TheSameStreamOnAnyNumberOfThreads) {
  std::vector<std::vector<double>> first;
  for (const char* threads : {"1", "2"}) {
    const ProgramResult result = runLab(arguments({{"--threads", threads}, {"--per-frame", path("frames.csv")}}));
    ASSERT_EQ(result.exit_code, 0) << result.err;
    EXPECT_EQ(json::parse(result.out)["threads"], std::stoi(threads)) << "without --out the figures go to stdout";
    std::string header;
    auto rows = numbersOf(readText("frames.csv"), header);
    for (auto& row : rows) row.erase(row.begin(), row.begin() + 6);  // times differ, counters do not
    if (first.empty()) first = rows;
    EXPECT_EQ(rows, first);
  }
}

TEST_F(Bench, EndsAfterTheTimedPartWithShortest) {
  const ProgramResult result = runLab(arguments({{"--frames", "60"},
                                                 {"--timed-frames", "2"},
                                                 {"--min-surface-points", "2000"},
                                                 {"--shortest", ""},
                                                 {"--out", path("bench.json")}}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json bench = json::parse(readText("bench.json"));
  EXPECT_GE(bench["surface_points"]["timed_begin"], 2000);
  EXPECT_LT(bench["surface_points"]["timed_begin"], 2000 + kPoints);
  EXPECT_EQ(bench["timed_frames"], 2);
  EXPECT_EQ(bench["memory_at_timed_begin"]["surface_points"], bench["surface_points"]["timed_begin"]);
  EXPECT_LT(bench["frames"], 10);
}

/// The share of new points and the hits per voxel, computed again from the figures of every frame.
TEST_F(Bench, SaysHowOftenPlacesAreSeenAgain) {
  const ProgramResult result = runLab(arguments({{"--path", "orbit"},
                                                 {"--frames", "40"},
                                                 {"--timed-frames", "5"},
                                                 {"--min-surface-points", "3000"},
                                                 {"--max-new-percent", "50"},
                                                 {"--begin-by", "35"},
                                                 {"--shortest", ""},
                                                 {"--per-frame", path("frames.csv")},
                                                 {"--out", path("bench.json")}}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json bench = json::parse(readText("bench.json"));
  EXPECT_EQ(bench["stream"]["path"], "orbit");
  EXPECT_EQ(bench["stream"]["speed_m_s"], 1.0);
  std::string header;
  const auto rows = numbersOf(readText("frames.csv"), header);
  std::vector<std::string> names;
  std::istringstream cells(header);
  for (std::string name; std::getline(cells, name, ',');) names.push_back(name);
  const auto at = [&](std::size_t n, const std::string& name) {
    const auto column = std::find(names.begin(), names.end(), name);
    return column == names.end() ? -1 : rows[n][static_cast<std::size_t>(column - names.begin())];
  };
  const auto shareNew = [&](std::size_t begin, std::size_t end) {
    double added = 0, used = 0;
    for (std::size_t n = begin; n < end; ++n) {
      added += at(n, "surface_points") - (n == 0 ? 0 : at(n - 1, "surface_points"));
      used += at(n, "points_used");
    }
    return 100 * added / used;
  };
  const std::size_t begin = rows.size() - 5;
  std::size_t expected = 5;  // the first frame at which the points and the share before it allow the timed part
  while (expected < 35 && (at(expected - 1, "surface_points") < 3000 || shareNew(expected - 5, expected) > 50))
    ++expected;
  EXPECT_EQ(begin, expected);
  EXPECT_GT(begin, 5u);
  const json& density = bench["density"];
  EXPECT_DOUBLE_EQ(density["new_percent"].get<double>(), shareNew(begin, rows.size()));
  EXPECT_DOUBLE_EQ(density["new_percent_before"].get<double>(), shareNew(begin - 5, begin));
  EXPECT_EQ(density["new_percent_wanted"], 50.0);
  EXPECT_EQ(density["reached"], begin < 35 || shareNew(30, 35) <= 50);
  EXPECT_DOUBLE_EQ(density["hits_per_voxel"]["timed_end"].get<double>(),
                   static_cast<double>(kPoints * rows.size()) / at(rows.size() - 1, "surface_points"));
  for (std::size_t n = 0; n < rows.size(); ++n) {
    EXPECT_EQ(at(n, "new_points"), at(n, "surface_points") - (n == 0 ? 0 : at(n - 1, "surface_points")));
    EXPECT_GE(at(n, "flipped_voxels"), at(n, "changed_leaves")) << "a leaf is changed if one of its voxels flipped";
    EXPECT_GE(at(n, "dirty_points"), at(n, "moved_points"));
    EXPECT_GT(at(n, "moved_points"), 0);
  }
}

/// Same stream, same counters, one by one; only the times are others.
TEST_F(Bench, PipelinedDoesTheSameWork) {
  ASSERT_EQ(runLab(arguments({{"--out", path("one.json")}, {"--per-frame", path("one.csv")}})).exit_code, 0);
  const ProgramResult result =
      runLab(arguments({{"--out", path("two.json")}, {"--per-frame", path("two.csv")}, {"--pipelined", ""}}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json one = json::parse(readText("one.json")), two = json::parse(readText("two.json"));
  EXPECT_EQ(one["pipelined"], false);
  EXPECT_EQ(two["pipelined"], true);
  EXPECT_EQ(two["labels_at_end"], one["labels_at_end"]);
  std::string header_one, header_two;
  auto rows_one = numbersOf(readText("one.csv"), header_one), rows_two = numbersOf(readText("two.csv"), header_two);
  EXPECT_EQ(header_two, header_one);
  ASSERT_EQ(rows_two.size(), rows_one.size());
  for (std::size_t n = 0; n < rows_one.size(); ++n) {
    EXPECT_GT(rows_two[n][1], 0.0);
    rows_one[n].erase(rows_one[n].begin() + 1, rows_one[n].begin() + 6);
    rows_two[n].erase(rows_two[n].begin() + 1, rows_two[n].begin() + 6);
    EXPECT_EQ(rows_two[n], rows_one[n]) << n;
  }
  for (const json& bench : {one, two}) {
    EXPECT_NEAR(bench["frames_per_second"].get<double>() * bench["timing_ms"]["frame"]["mean"].get<double>(), 1000,
                0.1);
  }
}

/// The timed frames begin at the rate that was asked for, and no frame has the waiting in its time.
TEST_F(Bench, TimedFramesCanBeginAtTheRateOfAScanner) {
  constexpr double kPeriod_s = 0.3125;
  const auto began = std::chrono::steady_clock::now();
  const ProgramResult result = runLab(arguments({{"--scans-per-second", "3.2"},
                                                 {"--points-per-frame", "300"},
                                                 {"--frames", "5"},
                                                 {"--host-fusion", ""},
                                                 {"--max-device-memory", "64M"},
                                                 {"--out", path("bench.json")}}));
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_GE(took.count(), (kTimed - 1) * kPeriod_s);
  const json bench = json::parse(readText("bench.json"));
  EXPECT_EQ(bench["scans_per_second"], 3.2);
  EXPECT_EQ(bench["parameters"]["fuse_on_host"], true);
  EXPECT_EQ(bench["parameters"]["device_cache_bytes"], 64 << 20);
  double rest_ms = bench["timing_ms"]["frame"]["mean"];
  for (const char* stage : {"integrate", "mirror", "update", "score"}) {
    rest_ms -= bench["timing_ms"][stage]["mean"].get<double>();
  }
  EXPECT_LT(rest_ms, 1e3 * kPeriod_s / 4);
}

/// The timed part begins where --begin-by says, although there are too few points, and the record says so.
TEST_F(Bench, BeginsInAnyCaseByTheFrameThatWasAskedFor) {
  const ProgramResult result = runLab(arguments({{"--path", "hover"},
                                                 {"--frames", "60"},
                                                 {"--timed-frames", "2"},
                                                 {"--min-surface-points", "1000000"},
                                                 {"--begin-by", "3"},
                                                 {"--shortest", ""},
                                                 {"--out", path("bench.json")}}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json bench = json::parse(readText("bench.json"));
  EXPECT_EQ(bench["frames"], 5);
  EXPECT_EQ(bench["density"]["reached"], false);
  EXPECT_EQ(bench["stream"]["speed_m_s"], 0.01);
}

/// Leaving out updates before the timed part changes neither the stream nor the labels, and no timed frame is without.
TEST_F(Bench, WarmsUpWithFewerUpdates) {
  const Flags shortest = {
      {"--frames", "60"}, {"--timed-frames", "3"},       {"--min-surface-points", "1000000"}, {"--begin-by", "30"},
      {"--shortest", ""}, {"--out", path("every.json")}, {"--per-frame", path("every.csv")}};
  Flags fewer = shortest;
  fewer["--warm-up-update-every"] = "7";
  fewer["--out"] = path("fewer.json");
  fewer["--per-frame"] = path("fewer.csv");
  Flags later = shortest;  // as many frames as with the 20 that come between
  later["--begin-by"] = "50";
  for (const Flags& flags : {later, fewer}) ASSERT_EQ(runLab(arguments(flags)).exit_code, 0);
  const json every = json::parse(readText("every.json")), few = json::parse(readText("fewer.json"));
  EXPECT_EQ(every["warm_up_update_every"], 1);
  EXPECT_EQ(few["warm_up_update_every"], 7);
  EXPECT_EQ(few["frames"], 53);
  EXPECT_EQ(few["surface_points"], every["surface_points"]);
  EXPECT_EQ(few["labels_at_end"], every["labels_at_end"]);
  EXPECT_EQ(few["per_frame"]["label_changes"], every["per_frame"]["label_changes"]);
  std::string header;
  const auto rows = numbersOf(readText("fewer.csv"), header);
  ASSERT_EQ(rows.size(), 53u);
  for (std::size_t n = 0; n < rows.size(); ++n) {
    EXPECT_EQ(rows[n][5] > 0, n >= 30 || (n + 1) % 7 == 0) << "score of frame " << n;
  }
}

/// If the timed part never begins, the last frames are the timed ones: they have an update each, too.
TEST_F(Bench, AWarmUpEndsBeforeTheLastFrames) {
  const ProgramResult result = runLab(arguments({{"--frames", "40"},
                                                 {"--min-surface-points", "1000000"},
                                                 {"--shortest", ""},
                                                 {"--warm-up-update-every", "40"},
                                                 {"--out", path("bench.json")},
                                                 {"--per-frame", path("frames.csv")}}));
  EXPECT_EQ(result.exit_code, 4) << result.err;
  std::string header;
  const auto rows = numbersOf(readText("frames.csv"), header);
  ASSERT_EQ(rows.size(), 40u);
  for (std::size_t n = 0; n < rows.size(); ++n) EXPECT_EQ(rows[n][5] > 0, n >= 40 - kTimed - 20) << n;
}

TEST_F(Bench, TimesAllFramesIfThereAreFewerAndNamesWhatNeedsAGpu) {
  std::vector<std::string> without = arguments({{"--out", path("bench.json")}});
  const auto timed = std::ranges::find(without, "--timed-frames");
  without.erase(timed, timed + 2);
  const ProgramResult plain = runLab(without);
  ASSERT_EQ(plain.exit_code, 0) << plain.err;
  EXPECT_EQ(json::parse(readText("bench.json"))["timed_frames"], kFrames);
  EXPECT_EQ(plain.err.find("no effect"), std::string::npos) << plain.err;
  without.insert(without.end(), {"--host-fusion", "--max-device-memory", "1G"});
  const ProgramResult given = runLab(without);
  ASSERT_EQ(given.exit_code, 0) << given.err;
  for (const char* flag : {"--host-fusion", "--max-device-memory"}) {
    EXPECT_NE(given.err.find(std::string(flag) + " has no effect without a GPU"), std::string::npos) << given.err;
  }
}

TEST_F(Bench, TooFewPointsIsCode4AndKeepsTheFigures) {
  const ProgramResult result = runLab(arguments({{"--min-surface-points", "1000000"}, {"--out", path("bench.json")}}));
  EXPECT_EQ(result.exit_code, 4) << result.err;
  EXPECT_NE(result.err.find("error[bench.too_few_points]"), std::string::npos) << result.err;
  EXPECT_EQ(json::parse(readText("bench.json"))["surface_points"]["required"], 1000000);
}

TEST_F(Bench, RefusesInOneLine) {
  expectRefused({{"--scene", "torus"}}, 2, "--scene");
  expectRefused({{"--frames", "0"}}, 2, "--frames");
  expectRefused({{"--frames", "five"}}, 2, "--frames");
  expectRefused({{"--timed-frames", "8"}}, 2, "--timed-frames");
  expectRefused({{"--points-per-frame", "0"}}, 2, "--points-per-frame");
  expectRefused({{"--voxel", "0"}}, 2, "--voxel");
  expectRefused({{"--voxel", "nan"}}, 2, "--voxel");
  expectRefused({{"--tau", "0"}}, 2, "--tau");
  expectRefused({{"--policy", "both"}}, 2, "--policy");
  expectRefused({{"--speed", "0"}}, 2, "--speed");
  expectRefused({{"--speed", "nan"}}, 2, "--speed");
  expectRefused({{"--sensor-rate", "-10"}}, 2, "--sensor-rate");
  expectRefused({{"--max-range", "1e9"}}, 2, "--max-range");
  expectRefused({{"--range-noise", "-1"}}, 2, "--range-noise");
  expectRefused({{"--solid-foliage", "-1"}}, 2, "--solid-foliage");
  expectRefused({{"--tool", "builtin:spoon"}}, 2, "builtin:spoon");
  expectRefused({{"--threads", "-1"}}, 2, "--threads");
  expectRefused({{"--shortest", ""}}, 2, "--shortest");
  expectRefused({{"--path", "spiral"}}, 2, "--path");
  expectRefused({{"--scans-per-second", "nan"}}, 2, "--scans-per-second");
  expectRefused({{"--scans-per-second", "10"}, {"--pipelined", ""}}, 2, "--scans-per-second");
  expectRefused({{"--max-device-memory", "1M"}}, 2, "error[config.range] --max-device-memory: ");
  expectRefused({{"--points", "surface"}, {"--change", "full"}}, 2, "error[config.points] --points surface: ");
  expectRefused({{"--points", "surface"}, {"--policy", "paper"}}, 2, "error[config.points] --points surface: ");
  for (const char* count : {"--min-surface-points", "--seed"}) expectRefused({{count, "-5"}}, 2, count);
  expectRefused({{"--max-new-percent", "6"}}, 2, "--max-new-percent");
  expectRefused({{"--begin-by", "2"}}, 2, "--begin-by");
  const Flags shortest = {{"--shortest", ""}, {"--min-surface-points", "9"}};
  for (const char* bad : {"0", "-1", "nan", "101"}) {
    Flags flags = shortest;
    flags["--max-new-percent"] = bad;
    expectRefused(flags, 2, "--max-new-percent");
  }
  for (const char* bad : {"0", "4"}) {  // 7 frames, 4 of them timed
    Flags flags = shortest;
    flags["--begin-by"] = bad;
    expectRefused(flags, 2, "--begin-by");
  }
  expectRefused({{"--warm-up-update-every", "2"}}, 2, "--shortest");
  Flags too_late = shortest;  // 30 frames, 4 of them timed, and 20 that come before
  too_late["--frames"] = "30";
  too_late["--begin-by"] = "7";
  too_late["--warm-up-update-every"] = "2";
  expectRefused(too_late, 2, "--begin-by");
  for (const auto& [flag, value] : Flags{{"--budget-points", "9"}, {"--pipelined", ""}, {"--policy", "paper"}}) {
    Flags flags = shortest;
    flags["--warm-up-update-every"] = "2";
    flags[flag] = value;
    expectRefused(flags, 2, "--warm-up-update-every");
  }
  if (access("/dev/nvidiactl", F_OK) != 0) expectRefused({{"--device", "cuda"}}, 6, "cuda");
}

TEST_F(Bench, AStoppedRunKeepsTheFiguresOfWhatItDid) {
  ProgramSetup setup;
  setup.lab = true;
  setup.arguments = arguments({{"--frames", "20000"}, {"--out", path("bench.json")}});
  setup.signal_after = "replaying";  // said once there are frames
  setup.act = [](pid_t process) { kill(process, SIGINT); };
  const ProgramResult stopped = runProgram(setup);
  ASSERT_EQ(stopped.exit_code, 130) << stopped.err;
  const json bench = json::parse(readText("bench.json"));
  EXPECT_EQ(bench["complete"], false);
  EXPECT_GT(bench["frames"], 0);
  EXPECT_LT(bench["frames"], 20000);
}

}  // namespace
}  // namespace accessvdb::cli_test
