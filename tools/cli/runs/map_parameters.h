// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// `parameters` in report.json.
#pragma once

#include <vector>

#include "accessvdb/tool_tables.h"
#include "options/map_options.h"
#include "output/report.h"

namespace accessvdb::tools {

using ReportedParameters = decltype(RunReport::parameters);

/// @param tools  none: they are not read yet
[[nodiscard]] ReportedParameters reportedParameters(const MapOptions& options, const FieldParams& params,
                                                    const std::vector<ToolSpec>& tools = {});

}  // namespace accessvdb::tools
