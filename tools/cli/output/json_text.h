// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// JSON as text, for files and stdout: the only place of the program that makes it, since names of files and text from
/// them need not be UTF-8, and JSON must be.
#pragma once

#include <string>

namespace accessvdb::tools {

/// @param json  of nlohmann::json or ordered_json; bytes that are not UTF-8 become U+FFFD
/// @param indent  blanks per level; -1 = all in one line
template <typename JsonT>
[[nodiscard]] std::string jsonText(const JsonT& json, int indent) {
  return json.dump(indent, ' ', false, JsonT::error_handler_t::replace);
}

}  // namespace accessvdb::tools
