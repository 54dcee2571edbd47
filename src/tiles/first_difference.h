// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace accessvdb::tiles {

/// The first parameter that only one of two texts has, or that has another value. @param then, now  "name value" lines
[[nodiscard]] std::string firstDifference(const std::string& then, const std::string& now);

}  // namespace accessvdb::tiles
