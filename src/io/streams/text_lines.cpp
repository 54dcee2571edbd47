// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/streams/text_lines.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <utility>

#include "accessvdb/error.h"

namespace accessvdb::io {
namespace {

constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
constexpr std::string_view kSeparators = " \t,;\r";

}  // namespace

LineReader::LineReader(std::string_view text, std::string subject) : text_(text), subject_(std::move(subject)) {
  if (text_.substr(0, kByteOrderMark.size()) == kByteOrderMark) position_ = kByteOrderMark.size();
}

LineReader::LineReader(ByteSource& source, std::uint64_t begin, std::string subject)
    : source_(&source), subject_(std::move(subject)), position_(begin) {
  if (source.view(begin, kByteOrderMark.size()).substr(0, kByteOrderMark.size()) == kByteOrderMark)
    position_ += kByteOrderMark.size();
}

bool LineReader::next(std::string_view& line) {
  std::string_view window;
  if (source_ != nullptr) {
    window = source_->view(position_, kMaxLineBytes + 1).substr(0, kMaxLineBytes + 1);
  } else if (position_ < text_.size()) {
    window = text_.substr(position_, kMaxLineBytes + 1);
  }
  if (window.empty()) return false;
  ++number_;
  const std::size_t end = window.find('\n');
  terminated_ = end != std::string_view::npos;
  if (!terminated_ && window.size() > kMaxLineBytes)
    fail("is longer than " + std::to_string(kMaxLineBytes) + " bytes", "Check that this is the right text file");
  line = terminated_ ? window.substr(0, end) : window;
  position_ += line.size() + (terminated_ ? 1 : 0);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  return true;
}

void LineReader::fail(const std::string& problem, const std::string& advice) const {
  throw InputError("input.malformed", subject_, "line " + std::to_string(number_) + " " + problem, advice);
}

void splitTokens(std::string_view line, std::vector<std::string_view>& tokens) {
  tokens.clear();
  std::size_t begin = line.find_first_not_of(kSeparators);
  while (begin != std::string_view::npos) {
    const std::size_t end = line.find_first_of(kSeparators, begin);
    tokens.push_back(line.substr(begin, end == std::string_view::npos ? end : end - begin));
    begin = end == std::string_view::npos ? end : line.find_first_not_of(kSeparators, end);
  }
}

bool parseNumber(std::string_view token, double& value) {
  if (token.size() > 1 && token[0] == '+' && token[1] != '-') token.remove_prefix(1);
  const char* const last = token.data() + token.size();
  const auto [end, error] = std::from_chars(token.data(), last, value);
  if (end != last || error == std::errc::invalid_argument) return false;
  if (error == std::errc::result_out_of_range) {
    // from_chars leaves the value alone and does not tell underflow from overflow: a negative exponent or a leading
    // zero means small.
    const std::size_t digit = token.find_first_of("0123456789.");
    const bool small = token.find("e-") != std::string_view::npos || token.find("E-") != std::string_view::npos ||
                       token[digit] == '0' || token[digit] == '.';
    value = small ? 0.0 : std::numeric_limits<double>::infinity();
    if (token[0] == '-') value = -value;
  }
  return true;
}

bool parseCount(std::string_view token, std::uint64_t& value) {
  const char* const last = token.data() + token.size();
  const auto [end, error] = std::from_chars(token.data(), last, value);
  return error == std::errc() && end == last;
}

bool isBlankOrComment(std::string_view line) {
  const std::size_t first = line.find_first_not_of(kSeparators);
  return first == std::string_view::npos || line[first] == '#';
}

}  // namespace accessvdb::io
