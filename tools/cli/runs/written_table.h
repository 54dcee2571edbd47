// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// table.csv: points and square metres of a result, for each value of what its returns carried.
#pragma once

#include <filesystem>

#include "output/error_output.h"

namespace accessvdb::tools {

inline constexpr const char* kTableFile = "table.csv";

/// Writes it into the folder of a map, which holds its points and its report. @throws InputError, OutputError
void writeTable(const std::filesystem::path& folder, Messages& messages);

}  // namespace accessvdb::tools
