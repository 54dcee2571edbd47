// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The page itself, made from src/report/page by the build.
#pragma once

#include <string_view>

namespace accessvdb::internal {

extern const std::string_view kPageHtml;    ///< with {{policy}}, {{style}}, {{points}}, {{facts}} and {{script}}
extern const std::string_view kPageStyle;   ///< one style sheet
extern const std::string_view kPageScript;  ///< one script

}  // namespace accessvdb::internal
