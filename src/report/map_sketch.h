// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points seen along an axis, as cells of an SVG.
#pragma once

#include <string>

#include "accessvdb/program/result_page.h"

namespace accessvdb::internal {

/// Seen from above, and along the shorter side: two <figure> elements with a scale; nothing if there are no points.
[[nodiscard]] std::string sketchesOf(const io::ResultPage& page);

}  // namespace accessvdb::internal
