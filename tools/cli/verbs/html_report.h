// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The page for a browser, for the verbs `report` and `map --html`.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "accessvdb/program/html_report.h"
#include "options/options.h"
#include "options/page_options.h"
#include "output/error_output.h"

namespace accessvdb::tools {

struct PageSources {
  std::filesystem::path html, folder;
  std::vector<io::DrawnTool> tools;         ///< to be drawn
  std::uint64_t most_points = 0;            ///< 0 = the library's limit
  std::filesystem::path approaches, views;  ///< to be shown; empty: none
  bool allow_changed = false;               ///< of the folder's files
  PageHeader header;
};
/// Writes the page, and says what it holds and what is odd about it. @throws what io::writeHtmlReport() throws
void writePage(const PageSources& sources, Messages& messages);

}  // namespace accessvdb::tools
