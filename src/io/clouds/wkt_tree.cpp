// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/wkt_tree.h"

#include <algorithm>

namespace accessvdb::io {
namespace {

constexpr int kMostLevels = 64;

class WktParser {
 public:
  explicit WktParser(std::string_view text) : text_(text) {}

  std::optional<WktNode> whole() {
    WktNode root;
    if (!node(root, word(), 0)) return std::nullopt;
    skipBlanks();
    return at_ == text_.size() ? std::optional(std::move(root)) : std::nullopt;
  }

 private:
  void skipBlanks() {
    // Records are often filled up with zeros.
    while (at_ < text_.size() && (text_[at_] == ' ' || (text_[at_] >= '\t' && text_[at_] <= '\r') || text_[at_] == 0))
      ++at_;
  }
  bool take(char c) {
    skipBlanks();
    if (at_ == text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }
  std::string word() {
    skipBlanks();
    const std::size_t end = std::min(text_.find_first_of("[](),\" \t\r\n", at_), text_.size());
    std::string out(text_.substr(at_, end - at_));
    at_ = end;
    return out;
  }
  /// What follows a keyword. @return false for what is not well-known text
  bool node(WktNode& to, std::string keyword, int level) {
    const bool square = take('[');
    if (keyword.empty() || (!square && !take('(')) || level > kMostLevels) return false;
    for (char& c : keyword)
      if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
    to.keyword = std::move(keyword);
    const char close = square ? ']' : ')';
    for (bool first = true; !take(close); first = false) {
      if (!first && !take(',')) return false;
      skipBlanks();
      if (at_ < text_.size() && text_[at_] == '"') {
        std::size_t end = text_.find('"', at_ + 1);
        while (end != std::string_view::npos && text_.substr(end, 2) == "\"\"") end = text_.find('"', end + 2);
        if (end == std::string_view::npos) return false;
        to.values.emplace_back(text_.substr(at_ + 1, end - at_ - 1));
        at_ = end + 1;
        continue;
      }
      std::string plain = word();
      skipBlanks();
      if (at_ < text_.size() && (text_[at_] == '[' || text_[at_] == '(')) {
        to.children.emplace_back();
        if (!node(to.children.back(), std::move(plain), level + 1)) return false;
      } else {
        if (plain.empty()) return false;
        to.values.push_back(std::move(plain));
      }
    }
    return true;
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

}  // namespace

const WktNode* WktNode::child(std::initializer_list<std::string_view> keywords) const {
  for (const WktNode& one : children)
    if (std::find(keywords.begin(), keywords.end(), one.keyword) != keywords.end()) return &one;
  return nullptr;
}

std::optional<WktNode> parseWkt(std::string_view text) { return WktParser(text).whole(); }

}  // namespace accessvdb::io
