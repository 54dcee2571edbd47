// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/tables.h"

#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <set>

#include "accessvdb/error.h"
#include "eval/table_context.h"

namespace accessvdb::eval {
namespace {

struct Table {
  const char* name;
  bool in_all;
  void (*make)(TableContext&);
};

constexpr Table kTables[] = {
    {"fast", false, makeFastTable},
    {"oracle", true, makeOracleTable},
    {"voxel", true, makeVoxelTable},
    {"clamping", true, makeClampingTable},
    {"ring", true, makeRingTable},
    {"noise", true, makeNoiseTable},
    {"frames", true, makeFramesTable},
    {"directions", true, makeDirectionsTable},
    {"form", true, makeFormTable},
    {"unseen", true, makeUnseenTable},
    {"unfiltered", true, makeUnfilteredTable},
    {"incremental", true, makeIncrementalTable},
    {"motion", true, makeMotionTable},
    {"orientations", true, makeOrientationsTable},
    {"margins", true, makeMarginsTable},
    {"approaches", true, makeApproachesTable},
    {"hpr", true, makeHprTable},
    {"projective", true, makeProjectiveTable},
    {"pseudo_truth", false, makePseudoTruthTable},
    {"change", false, makeChangeTable},
    {"gone", false, makeGoneTable},
    {"fits", false, makeFitsTable},
    {"plans", false, makePlansTable},
    {"views", false, makeViewsTable},
    {"probability", false, makeProbabilityTable},
    {"probability_pine", false, makeProbabilityPineTable},
    {"fit_probability", false, makeProbabilityFit},
    {"pine", false, makePineTable},
    {"pine_forms", false, makePineFormTable},
};

std::set<std::string> wantedTables(const std::vector<std::string>& asked) {
  std::string known;
  for (const std::string& name : tableNames()) known += (known.empty() ? "" : ", ") + name;
  std::set<std::string> wanted;
  for (const std::string& name : asked) {
    bool found = name == "all";
    for (const Table& table : kTables) {
      if (name != table.name && !(name == "all" && table.in_all)) continue;
      wanted.insert(table.name);
      found = true;
    }
    if (!found) {
      throw InvalidArgument("evaluate.table", name, "there is no table with this name; the tables are " + known,
                            "See accessvdb-lab evaluate --help");
    }
  }
  if (wanted.empty()) throw InvalidArgument("evaluate.table", "", "no table was named; the tables are " + known);
  return wanted;
}

}  // namespace

std::vector<std::string> tableNames() {
  std::vector<std::string> names = {"all"};
  for (const Table& table : kTables) names.emplace_back(table.name);
  return names;
}

void checkTableNames(const std::vector<std::string>& names) { (void)wantedTables(names); }

TableResults makeTables(const TableOptions& options) {
  const std::set<std::string> wanted = wantedTables(options.tables);
  const auto start = std::chrono::steady_clock::now();
  // Simulation and truth run outside a field's own arena, so the limit has to be set for all of them.
  const std::size_t threads = options.threads > 0
                                  ? static_cast<std::size_t>(options.threads)
                                  : tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
  ScanStore scans(options.scan_folder, options.observer);
  SceneRunner runner(scans, options.backend, options.threads, options.observer, options.change,
                     options.points_of_surface);
  TableResults results;
  TableContext context{options, scans, runner, results.rows, results.device};
  try {
    for (const Table& table : kTables) {
      if (wanted.count(table.name) == 0) continue;
      options.observer.say(std::string("table ") + table.name);
      table.make(context);
      results.finished.emplace_back(table.name);
    }
    if (!options.picture_folder.empty()) drawScenes(context);
  } catch (const StopRequested&) {
    results.stopped = true;
  } catch (...) {
    results.stopped = true;
    results.failure = std::current_exception();
  }
  if (results.device.empty()) results.device = runner.device();
  results.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return results;
}

}  // namespace accessvdb::eval
