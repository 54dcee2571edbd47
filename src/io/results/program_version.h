// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The version that files name. A function, so that other files do not include the generated config.h, whose path
/// differs from build to build: ccache then knows them everywhere.
#pragma once

#include <string>

namespace accessvdb::internal {

[[nodiscard]] std::string programVersion();

}  // namespace accessvdb::internal
