// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tables of `accessvdb-lab evaluate`: the paper's and this project's.
#pragma once

#include <exception>
#include <string>
#include <vector>

#include "eval/table_options.h"
#include "eval/table_row.h"

namespace accessvdb::eval {

struct TableResults {
  std::vector<TableRow> rows;
  std::vector<std::string> finished;  ///< tables, in order; the rows of an unfinished one are kept too
  bool stopped = false;
  std::exception_ptr failure;  ///< what ended the run early, other than a stop; the rows made before remain valid
  double seconds = 0;
  std::string device;  ///< the fields' device, "cpu" or "cuda:NAME"; empty if no field was made
};

/// All names allowed in `tables`, in the order in which they are made.
[[nodiscard]] std::vector<std::string> tableNames();

/// @throws InvalidArgument for an unknown name, or for none at all
void checkTableNames(const std::vector<std::string>& names);

/// Exceptions of a run are returned as `failure`. @throws InvalidArgument for an unknown table, before anything is made
[[nodiscard]] TableResults makeTables(const TableOptions& options);

}  // namespace accessvdb::eval
