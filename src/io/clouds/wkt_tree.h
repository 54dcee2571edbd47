// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Well-known text of coordinate systems, of both versions (OGC 01-009, ISO 19162), as a tree.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace accessvdb::io {

struct WktNode {
  std::string keyword;              ///< in capitals
  std::vector<std::string> values;  ///< quoted texts and plain words, in order
  std::vector<WktNode> children;

  [[nodiscard]] const WktNode* child(std::initializer_list<std::string_view> keywords) const;
};

/// @return nothing for text that is not well-known text
[[nodiscard]] std::optional<WktNode> parseWkt(std::string_view text);

}  // namespace accessvdb::io
