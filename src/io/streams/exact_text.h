// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Numbers as text and back, whatever the locale.
#pragma once

#include <array>
#include <charconv>
#include <optional>
#include <string>
#include <system_error>

namespace accessvdb::internal {

/// Shortest text that reads back as the same double.
inline std::string exactText(double value) {
  std::array<char, 40> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

/// Nothing where the text is more than the number, or less.
template <typename Number>
std::optional<Number> numberIn(const std::string& text) {
  Number value = {};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace accessvdb::internal
