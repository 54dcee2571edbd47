// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Bytes as text that may stand in a page.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace accessvdb::internal {

[[nodiscard]] std::string base64(std::string_view bytes);
/// zlib's format at its best compression. @throws InternalError
[[nodiscard]] std::string deflated(std::string_view bytes);
/// What a content security policy calls a piece of text: "'sha256-...'".
[[nodiscard]] std::string policyHash(std::string_view text);
/// JSON that a <script> element may hold: ASCII only, which leaves no U+2028 or U+2029, and no '<', so that nothing in
/// it can end the element.
[[nodiscard]] std::string scriptJson(const nlohmann::ordered_json& json);

}  // namespace accessvdb::internal
