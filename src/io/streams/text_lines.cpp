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
constexpr std::string_view kDigits = "0123456789";

/// Text of two or four bytes per letter, with or without its mark; empty for any other.
const char* wideEncodingOf(std::string_view text) {
  using namespace std::string_view_literals;
  for (const auto& [mark, name] : {std::pair("\xff\xfe\0\0"sv, "UTF-32"),
                                   {"\0\0\xfe\xff"sv, "UTF-32"},
                                   {"\xff\xfe"sv, "UTF-16"},
                                   {"\xfe\xff"sv, "UTF-16"}})
    if (text.substr(0, mark.size()) == mark) return name;
  const auto isLetter = [](char c) { return (c >= 0x20 && c < 0x7f) || c == '\t' || c == '\r' || c == '\n'; };
  constexpr std::size_t kLooked = 64;
  text = text.substr(0, std::min(text.size(), kLooked) / 4 * 4);
  for (const std::size_t width : {std::size_t{4}, std::size_t{2}}) {
    for (const std::size_t place : {std::size_t{0}, width - 1}) {
      bool fits = text.size() >= 4;
      for (std::size_t i = 0; fits && i < text.size(); ++i)
        fits = i % width == place ? isLetter(text[i]) : text[i] == '\0';
      if (fits) return width == 4 ? "UTF-32" : "UTF-16";
    }
  }
  return "";
}

void refuseWideText(std::string_view beginning, const std::string& subject) {
  const std::string encoding = wideEncodingOf(beginning);
  if (encoding.empty()) return;
  throw InputError("input.encoding", subject, "is " + encoding + " text",
                   "Save it as UTF-8, for example with iconv -f " + encoding + " -t UTF-8");
}

/// "nan" and "inf" as runtimes of Windows printed them: 1.#QNAN, -1.#IND00, 1.#INF.
bool parseOldNonFinite(std::string_view token, double& value) {
  const bool minus = !token.empty() && token[0] == '-';
  if (minus) token.remove_prefix(1);
  if (!token.starts_with("1.#")) return false;
  std::string word;
  for (const char c : token.substr(3)) word += c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  word.erase(std::find_if(word.begin(), word.end(), [](char c) { return c >= '0' && c <= '9'; }), word.end());
  if (word != "QNAN" && word != "SNAN" && word != "IND" && word != "INF" && word != "NAN") return false;
  value = word == "INF" ? std::numeric_limits<double>::infinity() : std::numeric_limits<double>::quiet_NaN();
  if (minus) value = -value;
  return true;
}

/// "-2,6020" or "1,5e-3": one comma between digits and no point.
bool isCommaNumber(std::string_view cell) {
  if (!cell.empty() && (cell[0] == '-' || cell[0] == '+')) cell.remove_prefix(1);
  const std::size_t comma = cell.find(',');
  if (comma == std::string_view::npos || comma == 0 || cell.find('.') != std::string_view::npos) return false;
  if (cell.substr(0, comma).find_first_not_of(kDigits) != std::string_view::npos) return false;
  const std::string_view after = cell.substr(comma + 1);
  const std::size_t end = std::min(after.find_first_not_of(kDigits), after.size());
  return end > 0 && (end == after.size() || after[end] == 'e' || after[end] == 'E') &&
         after.find(',') == std::string_view::npos;
}

/// "4,002.345" or "5,399,998": groups of three digits behind the first. With one group there is a decimal point; else
/// it is a number with a decimal comma, or two numbers.
bool hasGroups(std::string_view cell, char separator, char point) {
  if (!cell.empty() && (cell[0] == '-' || cell[0] == '+')) cell.remove_prefix(1);
  const std::size_t end = std::min(cell.find(point), cell.size());
  if (end < cell.size() && cell.substr(end + 1).find_first_not_of(kDigits) != std::string_view::npos) return false;
  std::string_view whole = cell.substr(0, end);
  std::size_t groups = 0;
  for (; whole.size() > 4 && whole[whole.size() - 4] == separator; whole.remove_suffix(4), ++groups)
    if (whole.substr(whole.size() - 3).find_first_not_of(kDigits) != std::string_view::npos) return false;
  const bool first = !whole.empty() && whole.size() <= 3 && whole.find_first_not_of(kDigits) == std::string_view::npos;
  return first && (groups >= 2 || (groups == 1 && end < cell.size()));
}

bool isGroupedNumber(std::string_view cell) {
  return hasGroups(cell, ',', '.') || hasGroups(cell, '.', ',') || hasGroups(cell, '\'', '.');
}

/// A number that only the digits behind a decimal comma are: "0426".
bool isFraction(std::string_view token) {
  return token.size() > 1 && token[0] == '0' && token.find_first_not_of(kDigits) == std::string_view::npos;
}

}  // namespace

LineReader::LineReader(std::string_view text, std::string subject) : text_(text), subject_(std::move(subject)) {
  refuseWideText(text_, subject_);
  if (text_.substr(0, kByteOrderMark.size()) == kByteOrderMark) position_ = kByteOrderMark.size();
}

LineReader::LineReader(ByteSource& source, std::uint64_t begin, std::string subject)
    : source_(&source), subject_(std::move(subject)), position_(begin) {
  if (begin == 0) refuseWideText(source.view(0, 64), subject_);
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
    if (!terminated_ && window.size() > kMaxLineBytes) {
      if (window.find('\r') != std::string_view::npos) failCarriageReturns();
      fail("is longer than " + std::to_string(kMaxLineBytes) + " bytes", "Check that this is the right text file");
    }
  line = terminated_ ? window.substr(0, end) : window;
  position_ += line.size() + (terminated_ ? 1 : 0);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  return true;
}

void LineReader::fail(const std::string& problem, const std::string& advice) const {
  throw InputError("input.malformed", subject_, "line " + std::to_string(number_) + " " + problem, advice);
}

void LineReader::failCarriageReturns() const {
  fail("has carriage returns inside, as line ends of old computers", "Convert it, for example with mac2unix");
}

void LineReader::refuseCommasInNumbers(std::string_view line) const {
  if (hasThousandsSeparators(line))
    throw InputError("input.thousands_separator", subject_,
                     "line " + std::to_string(number_) + " has numbers with separators between thousands",
                     "Write them without: 4002.345, not 4,002.345");
  if (hasDecimalCommas(line))
    throw InputError("input.decimal_comma", subject_, "line " + std::to_string(number_) + " has decimal commas",
                     "Write decimal points, with blanks or semicolons between the numbers");
}

void LineReader::splitNumbers(std::string_view line, std::vector<std::string_view>& tokens) const {
  refuseCommasInNumbers(line);
  splitTokens(line, tokens);
}

bool hasDecimalCommas(std::string_view line) {
  if (line.find(',') == std::string_view::npos) return false;
  // Between quotes there is one value.
  for (std::size_t open = line.find('"'); open != std::string_view::npos; open = line.find('"', open)) {
    const std::size_t close = std::min(line.find('"', open + 1), line.size());
    if (isCommaNumber(line.substr(open + 1, close - open - 1))) return true;
    open = close + 1;
  }
  constexpr std::string_view kHard = " \t;\r";
  std::size_t cells = 0, with_comma = 0;
  bool commas_separate = false;
  for (std::size_t begin = line.find_first_not_of(kHard); begin != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(kHard, begin), line.size());
    std::string_view cell = line.substr(begin, end - begin);
    if (cell.size() > 1 && cell.back() == ',') cell.remove_suffix(1);  // "2,6, 0,1, 3"
    ++cells;
    with_comma += isCommaNumber(cell) ? 1 : 0;
    commas_separate = commas_separate || (cell.find(',') != std::string_view::npos && !isCommaNumber(cell));
    begin = line.find_first_not_of(kHard, end);
  }
  if (cells >= 3 && with_comma > 0 && !commas_separate) return true;
  // All separated by commas: "2,6020,0,0426" has numbers that nobody writes.
  if (line.find('.') != std::string_view::npos) return false;
  std::vector<std::string_view> tokens;
  splitTokens(line, tokens);
  return tokens.size() >= 6 && tokens.size() % 2 == 0 && std::any_of(tokens.begin(), tokens.end(), isFraction);
}

bool hasThousandsSeparators(std::string_view line) {
  if (line.find_first_of(",'") == std::string_view::npos) return false;
  constexpr std::string_view kHard = " \t;\r";
  std::size_t cells = 0, with_comma = 0, grouped = 0;
  bool sure = false;
  for (std::size_t begin = line.find_first_not_of(kHard); begin != std::string_view::npos;) {
    const bool quoted = line[begin] == '"';
    const std::size_t end =
        std::min(quoted ? line.find('"', begin + 1) : line.find_first_of(kHard, begin), line.size());
    std::string_view cell = line.substr(begin, end - begin);
    if (quoted) cell.remove_prefix(1);
    if (!quoted && cell.size() > 1 && cell.back() == ',') cell.remove_suffix(1);
    ++cells;
    with_comma += cell.find(',') != std::string_view::npos ? 1 : 0;
    if (isGroupedNumber(cell)) {
      if (quoted) return true;
      ++grouped;
      sure = sure || cell.find_first_of(".'") != std::string_view::npos;
    }
    begin = line.find_first_not_of(quoted ? " \t;,\r" : kHard, std::min(end + (quoted ? 1 : 0), line.size()));
  }
  // "1,200,300 255 0 1" is a point and a colour.
  return cells >= 3 && grouped > 0 && (sure || with_comma > 1);
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
  if (end != last || error == std::errc::invalid_argument) return parseOldNonFinite(token, value);
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

std::string inLowerCase(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return out;
}

bool isBlankOrComment(std::string_view line) {
  const std::size_t first = line.find_first_not_of(kSeparators);
  return first == std::string_view::npos || line[first] == '#';
}

}  // namespace accessvdb::io
