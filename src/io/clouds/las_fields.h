// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The numbers in a record of LAS: the dimensions of its format, and the extra bytes behind them.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "io/clouds/carried_fields.h"
#include "io/clouds/las_header.h"

namespace accessvdb::io {

/// Whole numbers of the format, then what the record of extra bytes describes; what it gets wrong is left out.
/// @param extra_bytes  LasProjection::extra_bytes, or empty
[[nodiscard]] std::vector<RecordField> lasFields(const LasFileHeader& header, std::string_view extra_bytes);

}  // namespace accessvdb::io
