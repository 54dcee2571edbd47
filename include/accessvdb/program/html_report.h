// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A field as one HTML page that opens by double click, without a network and without installing anything
/// (docs/report.md).
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {
class ToolGeometry;
}  // namespace accessvdb

namespace accessvdb::io {

/// A tool as the page draws it at the point that is clicked.
struct DrawnTool {
  const ToolGeometry* geometry = nullptr;  ///< null: not drawn; must live as long as the call
  std::filesystem::path file = {};         ///< it was read from; empty for built-in tools
};

struct HtmlReportOptions {
  /// Most points that are drawn; where there are more, one per cell of a grid and reason is. At least kLeastPoints.
  std::uint64_t most_points = 1'000'000;
  /// One for each tool of the field, in its order, or none at all.
  std::vector<DrawnTool> tools = {};
  /// approaches.json of the map, or its folder, to be shown in place; empty: none.
  std::filesystem::path approaches = {};
  /// views.json, or its folder, likewise; empty: none.
  std::filesystem::path views = {};
  /// What the page is called, for whom it is and of which place; empty: the folder's name, and nothing.
  std::string title = {}, client = {}, site = {};
  bool allow_changed = false;  ///< draw files that are not as they were written, too (output_check.h)
  static constexpr std::uint64_t kLeastPoints = 1000;
};

/// What went into the page.
struct HtmlReport {
  std::uint64_t points = 0, drawn = 0;  ///< surface points of the field, and those in the page
  double cell_m = 0;                    ///< edge of the thinning grid; 0 where all points are drawn
  /// Id and text: the folder's files contradict each other or have changed, the tool is not that of the run.
  std::vector<std::pair<std::string, std::string>> warnings;
  std::vector<std::string> notices;  ///< what was read without hashes
};

/// Writes the page of an output folder of `map`, whole or in tiles (read one at a time). The same folder gives the same
/// bytes.
/// @throws InvalidArgument (options, another number of tools), InputError (no such folder, files that were damaged or
/// changed, "input.approaches", "input.views"), UnusableInput "approaches.other_map", OutputError
ACCESSVDB_API HtmlReport writeHtmlReport(const std::filesystem::path& html, const std::filesystem::path& folder,
                                         const HtmlReportOptions& options = {});

}  // namespace accessvdb::io
