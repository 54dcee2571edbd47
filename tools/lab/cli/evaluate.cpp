// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb-lab evaluate: the tables, from simulated scans against exact ground truth.
#include <csignal>
#include <filesystem>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "eval/table_files.h"
#include "eval/tables.h"
#include "lab_verbs.h"
#include "options/command_line.h"
#include "options/options.h"
#include "output/output_files.h"
#include "output/stop_signal.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

std::string tableList() {
  std::string list;
  for (const std::string& name : eval::tableNames()) list += (list.empty() ? "" : ", ") + name;
  return list;
}

void say(const eval::TableResults& results, const fs::path& out, Messages& messages) {
  std::size_t met = 0;
  std::string missed;
  std::size_t missed_count = 0;
  for (const eval::TableRow& row : results.rows) {
    if (!row.met()) continue;
    if (*row.met()) {
      ++met;
      continue;
    }
    ++missed_count;
    messages.notice("missed: " + row.table + ", " + row.scene + " at " + numberText(1000 * row.voxel_m) + " mm, " +
                    row.method + (row.variant.empty() ? "" : ", " + row.variant) + ": " +
                    (row.must ? row.mustInWords() + ", reached " + numberText(row.value(row.must->figure))
                              : std::string("this row's condition is not met")));
  }
  messages.notice(std::to_string(results.rows.size()) + " rows; requirements: " + std::to_string(met) + " met, " +
                  std::to_string(missed_count) + " missed");
  messages.notice("done in " + numberText(results.seconds) + " s; wrote tables.json and tables.md into " +
                  out.string());
}

}  // namespace

std::string labCommandLine(const std::string& verb, const Arguments& arguments) {
  std::string line = std::string(kLab) + " " + verb;
  for (const std::string& argument : arguments) line += " " + argument;
  return printable(line);
}

int runEvaluate(const Arguments& arguments, Messages& messages) {
  if (wantsPseudoTruth(arguments)) return runPseudoTruth(arguments, messages);
  CommonOptions common;
  std::vector<std::string> tables;
  std::string out, cache, change = "block", points = "all";
  bool no_pictures = false;
  FlagParser flags(kLab);
  flags.describe("evaluate",
                 "Simulates the scenes of the paper's tables, maps them, and compares every label with exact ground "
                 "truth.",
                 "accessvdb-lab evaluate --table fast --out out/eval\n"
                 "  accessvdb-lab evaluate --pseudo-truth scans/ --poses poses.txt --tool builtin:pruner --voxel 0.03 "
                 "--out out/   (recordings; its flags: evaluate --pseudo-truth --help)");
  addCommonOptions(flags, common);
  flags.list("--table", tables,
             "which tables: " + tableList() +
                 "; several with commas. all: every table but the "
                 "pine; fast: a few rows, in less than a minute on an idle machine",
             ',');
  flags.option("--out", &out, "folder for tables.json, tables.md and the pictures");
  flags.option("--scan-cache", &cache,
               "folder that keeps simulated scans between runs; they are made again when they no "
               "longer match");
  flags.option("--change", &change, "how the product's profile follows a world that changes: block, off or full");
  flags.option(
      "--points", &points,
      "which points the product's profile scores, and the tables count: all, or surface (map --points surface)");
  flags.flag("--no-pictures", no_pictures, "leave out the pictures of the scenes");
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);
  if (tables.empty()) {
    throw InvalidArgument("usage.missing", "--table", "is missing; the tables are " + tableList(),
                          "See accessvdb-lab evaluate --help");
  }
  if (out.empty()) throw InvalidArgument("usage.missing", "--out", "is missing", "Name a folder for the tables");

  if (change != "block" && change != "off" && change != "full") {
    throw InvalidArgument("usage.word", "--change", "\"" + change + "\" is not known", "Use block, off or full");
  }
  if (points != "all" && points != "surface") {
    throw InvalidArgument("usage.word", "--points", "\"" + printable(points) + "\" is not known", "Use all or surface");
  }
  eval::TableOptions options;
  options.points_of_surface = points == "surface";
  options.change = change == "off" ? ChangeMode::Off : change == "full" ? ChangeMode::Full : ChangeMode::Block;
  options.tables = tables;
  eval::checkTableNames(tables);  // before any folder is created
  const Paths outputs = inFolder(out, {"tables.json", "tables.md"});
  requireNoInputs(outputs, {common.config});
  requireOwn(outputs);
  io::prepareOutputFolder(out);
  watchStopSignals();
  options.threads = common.threads;
  options.backend = common.device == "cpu"    ? BackendKind::Cpu
                    : common.device == "cuda" ? BackendKind::Cuda
                                              : BackendKind::Auto;
  options.scan_folder = cache;
  if (!no_pictures) options.picture_folder = fs::path(out) / "pictures";
  options.observer.say = [&messages](const std::string& line) { messages.notice(line); };
  options.observer.stop = [] { return stopSignal() != 0; };
  const eval::TableResults results = eval::makeTables(options);

  const eval::TableOrigin origin = {{"command", labCommandLine("evaluate", arguments)},
                                    {"version", ACCESSVDB_VERSION},
                                    {"machine", eval::machineInWords()},
                                    {"threads", common.threads > 0 ? std::to_string(common.threads) : "all"},
                                    {"device", results.device.empty() ? common.device : results.device}};
  if (!results.rows.empty()) {
    eval::writeTablesJson(fs::path(out) / "tables.json", results, origin);
    eval::writeTablesMarkdown(fs::path(out) / "tables.md", results, origin);
    say(results, out, messages);
  }
  if (results.failure) std::rethrow_exception(results.failure);
  if (!results.stopped) return 0;
  const int signal = stopSignal();
  messages.notice(std::string("stopped by ") + stopSignalName() +
                  (results.rows.empty() ? "; nothing to save" : "; finished rows are saved"));
  return 128 + signal;
}

}  // namespace accessvdb::tools
