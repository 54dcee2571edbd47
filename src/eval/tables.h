// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tables of `accessvdb evaluate`: the paper's and our own.
#pragma once

#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/params.h"
#include "eval/scene_run.h"
#include "eval/table_row.h"

namespace accessvdb::eval {

struct TableOptions {
  std::vector<std::string> tables;  ///< names, "all" (every table but the pine) or "fast" (a subset in minutes)
  BackendKind backend = BackendKind::Auto;
  int threads = 0;                       ///< 0 = all
  std::filesystem::path scan_folder;     ///< where simulated scans are kept between runs; empty = nowhere
  std::filesystem::path picture_folder;  ///< where pictures of the scenes go; empty = none are made
  Observer observer;
};

struct TableResults {
  std::vector<TableRow> rows;
  std::vector<std::string> finished;  ///< tables, in order; the rows of an unfinished one are kept too
  bool stopped = false;
  std::exception_ptr failure;  ///< what ended the run early, if anything but a stop did; the rows made before it stand
  double seconds = 0;
  std::string device;  ///< of the fields, "cpu" or "cuda:NAME"; empty where none was made
};

/// Every name that `tables` may hold, in the order in which they are made.
[[nodiscard]] std::vector<std::string> tableNames();

/// @throws InvalidArgument for a name that is not among them, or for none at all
void checkTableNames(const std::vector<std::string>& names);

/// What a run throws comes back as `failure`. @throws InvalidArgument for an unknown table, before anything is made
[[nodiscard]] TableResults makeTables(const TableOptions& options);

}  // namespace accessvdb::eval
