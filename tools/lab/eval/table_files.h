// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tables as files.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "eval/tables.h"

namespace accessvdb::eval {

/// Where and how the tables were made, as name and text pairs: command, machine, version, ...
using TableOrigin = std::vector<std::pair<std::string, std::string>>;

/// Processor and number of threads of this machine, as text.
[[nodiscard]] std::string machineInWords();

/// tables.json: {"schema":1,"origin":{..},"finished":[..],"rows":[..]}; rows as in docs/evaluation.md.
void writeTablesJson(const std::filesystem::path& path, const TableResults& results, const TableOrigin& origin);
/// tables.md: paper, paper profile and product profile side by side. @throws OutputError (both)
void writeTablesMarkdown(const std::filesystem::path& path, const TableResults& results, const TableOrigin& origin);

}  // namespace accessvdb::eval
