// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/column_reader.h"

#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"
#include "io/clouds/point_times.h"
#include "io/median.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

constexpr std::string_view kBlank = " \t\r,;";

bool isComment(std::string_view line) { return line[0] == '#' || line[0] == '%' || line.starts_with("//"); }

bool isNumber(std::string_view token) {
  double value = 0;
  return parseNumber(token, value);
}

/// 0,5 1,25 or 0,5;1,25: a comma within each number, and something else between them. Stricter than
/// hasDecimalCommas(): rows of poses in CSV may be whole numbers.
bool numbersHaveCommas(std::string_view line) {
  std::size_t numbers = 0, commas = 0;
  for (std::size_t begin = line.find_first_not_of(" \t;\r"); begin != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(" \t;\r", begin), line.size());
    std::string token(line.substr(begin, end - begin));
    const std::size_t comma = token.find(',');
    if (comma != std::string::npos) {
      const auto isDigit = [](char c) { return c >= '0' && c <= '9'; };
      if (comma == 0 || comma + 1 == token.size() || !isDigit(token[comma - 1]) || !isDigit(token[comma + 1]))
        return false;
      token[comma] = '.';
      ++commas;
    }
    if (!isNumber(token)) return false;
    ++numbers;
    begin = line.find_first_not_of(" \t;\r", end);
  }
  return numbers > 1 && 2 * commas >= numbers;
}

/// Without quotes, as in point files: between them, separators are part of the cell. One separator stays, and those
/// in cells become something else.
std::string unquotedLine(std::string_view line) {
  std::string plain;
  const bool paired = std::count(line.begin(), line.end(), '"') % 2 == 0;
  const auto walk = [&](const auto& take) {
    bool inside = false;
    for (const char c : line) {
      if (c == '"') {
        inside = paired && !inside;
      } else {
        take(c, inside);
      }
    }
  };
  char separator = ' ';
  for (const char candidate : {'\t', ',', ';'})
    walk([&](char c, bool inside) {
      if (!inside && c == candidate) separator = candidate;
    });
  walk([&](char c, bool inside) {
    if (separator == ' ') {
      plain += inside && (c == ' ' || c == '\t') ? '_' : c;
    } else if (inside) {
      plain += c == ';' ? ' ' : c;
    } else {
      plain += c == separator ? ';' : c;
    }
  });
  return plain;
}

/// Rotations that names say to be angles, or a vector along their axis.
bool hasAngles(std::string_view names) {
  std::vector<std::string_view> words;
  std::string text = inLowerCase(names);
  for (char& c : text) c = (c >= 'a' && c <= 'z') || c == ' ' ? c : ' ';
  splitTokens(text, words);
  return std::any_of(words.begin(), words.end(), [](std::string_view word) {
    for (const std::string_view angle : {"roll", "pitch", "yaw", "rpy", "ypr", "euler", "heading", "azimuth", "omega",
                                         "phi", "kappa", "rotvec", "rodrigues", "angle", "axis", "rx", "rz"})
      if (word == angle || (word.starts_with(angle) && angle.size() > 2)) return true;
    return false;
  });
}

}  // namespace

void ColumnReader::refuseNames(const std::string& problem) const {
  throw InputError("input.malformed", lines_.subject(),
                   "line " + std::to_string(names_line_) + " (" + namesInWords() + ") " + problem,
                   std::string("Name ") + wanted_.names + ", or remove the line");
}

std::string ColumnReader::namesInWords() const { return forMessage(names_text_, 200); }

void ColumnReader::takeNames(std::string_view line, bool comment) {
  std::optional<NamedColumns> found = parseColumnNames(line);
  if (!found && comment) return;
  if (!found) lines_.fail(std::string("is neither numbers nor a header that names ") + wanted_.names, wanted_.what);
  names_ = std::move(found);
  names_text_ = line;
  names_line_ = lines_.number();
  names_in_comment_ = comment;
}

/// Whether the names are of these columns is seen at the first row. A comment that names other columns is only a
/// comment, unless it has as many names as there are columns.
void ColumnReader::settleNames() {
  if (!names_) return;
  const std::size_t cells = cells_.size();
  if (names_in_comment_ && names_->count > cells)
    names_->moveLeft(std::min(names_->first_known, names_->count - cells));
  const bool same = names_->count == cells;
  if (names_->geographic && (same || !names_in_comment_)) {
    if (!wanted_.time || names_->hasTime())
      throw UnusableInput(std::string(wanted_.id) + ".geographic", lines_.subject(),
                          "line " + std::to_string(names_line_) + " names latitude and longitude",
                          "Export it in the projection of the cloud, in metres");
  }
  const bool complete =
      (wanted_.pose ? names_->hasPose() : names_->hasPosition()) && (!wanted_.time || names_->hasTime());
  if (names_in_comment_ && !same && (!complete || names_->last(wanted_.pose) >= cells)) {
    names_.reset();
    return;
  }
  if (!complete) {
    const bool is_sentence = 2 * names_->known < names_->count;
    if (names_in_comment_ && (!wanted_.pose || is_sentence)) {
      names_.reset();
      return;
    }
    if (wanted_.pose && names_->hasPosition() && hasAngles(names_text_))
      throw InputError("input.malformed", lines_.subject(),
                       "line " + std::to_string(names_line_) + " (" + namesInWords() +
                           ") gives rotations as angles, of which there are several kinds and orders",
                       "Convert them to quaternions, qx qy qz qw");
    refuseNames(std::string("does not name ") + wanted_.names);
  }
  if (names_->conflict == "feet") refuseNames("has positions in feet, of which there are several kinds: write metres");
  if (!names_->conflict.empty()) refuseNames("names two columns " + names_->conflict);
  // Fewer names than columns: the others are behind, or else the first one would be among the names.
  if (wanted_.pose && names_->count < cells && names_->time != 0 && names_->index != 0)
    refuseNames("names " + std::to_string(names_->count) + " columns, but there are " + std::to_string(cells));
  if (names_->last(wanted_.pose) >= cells)
    refuseNames("names " + std::to_string(names_->count) + " columns, but line " + std::to_string(lines_.number()) +
                " has " + std::to_string(cells));
}

void ColumnReader::split(std::string_view line) {
  if (rows_ == 0) decimal_commas_ = numbersHaveCommas(line);
  if (decimal_commas_) {
    row_ = line;
    std::replace(row_.begin(), row_.end(), ',', '.');
    line = row_;
  }
  if (names_) {  // cells may be empty, or text with blanks
    std::vector<std::string_view> strict = strictCells(line);
    if (strict.size() == names_->count + 1 && strict.back().empty()) strict.pop_back();
    if (strict.size() == names_->count) {
      cells_ = std::move(strict);
      return;
    }
  }
  splitTokens(line, cells_);
}

bool ColumnReader::next() {
  std::string_view line;
  while (lines_.next(line)) {
    if (line.find('"') != std::string_view::npos) {
      plain_ = unquotedLine(line);
      line = plain_;
    }
    const std::size_t begin = line.find_first_not_of(kBlank);
    if (begin == std::string_view::npos) continue;
    if (isComment(line.substr(begin))) {
      if (rows_ == 0) takeNames(line.substr(begin), true);
      continue;
    }
    if (rows_ == 0) {
      splitTokens(line, cells_);
      if (std::none_of(cells_.begin(), cells_.end(), isNumber) && (!names_ || names_in_comment_)) {
        takeNames(line, false);
        continue;
      }
      std::uint64_t count = 0;
      if (wanted_.counted && !count_ && cells_.size() == 1 && parseCount(cells_[0], count)) {
        count_ = count;
        continue;
      }
    }
    split(line);
    if (++rows_ == 1) settleNames();
    return true;
  }
  // Matrices take three or four lines, or five in a .log.
  const bool counted =
      count_ && (rows_ == *count_ || rows_ == 3 * *count_ || rows_ == 4 * *count_ || rows_ == 5 * *count_);
  if (count_ && !counted)
    throw InputError("input.malformed", lines_.subject(),
                     "announces " + std::to_string(*count_) + " lines and has " + std::to_string(rows_),
                     "Copy the file again, or correct the count in its first line");
  return false;
}

double ColumnReader::number(std::size_t column) const {
  if (column >= cells_.size())
    lines_.fail("has " + std::to_string(cells_.size()) + " columns, too few for " +
                    (names_ ? "those that line " + std::to_string(names_line_) + " names" : wanted_.names),
                wanted_.what);
  double value = 0;
  if (!parseNumber(cells_[column], value))
    lines_.fail("has '" + wordForMessage(cells_[column]) + "' where a number is needed", wanted_.what);
  return value;
}

std::vector<std::string> ColumnReader::notices() const {
  std::vector<std::string> notices;
  if (names_)
    notices.push_back(std::string(wanted_.id) + ": columns as line " + std::to_string(names_line_) + " names them (" +
                      namesInWords() + ")");
  if (count_)
    notices.push_back(std::string(wanted_.id) + ": the first line with a number is the count, " +
                      std::to_string(*count_));
  if (decimal_commas_) notices.push_back(std::string(wanted_.id) + ": commas are decimal");
  return notices;
}

double timeUnit_s(const std::vector<double>& times, const std::optional<double>& said_s, const std::string& subject) {
  std::vector<double> finite, steps;
  for (const double time : times)
    if (std::isfinite(time)) finite.push_back(time);
  if (finite.empty()) return said_s.value_or(1);
  for (std::size_t i = 1; i < finite.size(); ++i)
    if (finite[i] != finite[i - 1]) steps.push_back(std::abs(finite[i] - finite[i - 1]));
  const double size = std::abs(median(finite)), step = steps.empty() ? 0 : median(steps);
  constexpr double kUnits[] = {1e-3, 1e-6, 1e-9};
  constexpr double kYear1999_s = 9.2e8, kYear2128_s = 5e9, kMostSeconds = 1e11, kLongestStep_s = 2;
  std::optional<double> by_size, by_step;
  for (const double unit : kUnits) {
    if (size * unit >= kYear1999_s && size * unit < kYear2128_s) by_size = unit;
    if (!by_step && step * unit > 0 && step * unit <= kLongestStep_s) by_step = unit;
  }
  // 1e11 s are 3 000 years: not seconds, whatever is said.
  const bool seconds = size < kMostSeconds;
  if (!said_s || (*said_s == 1 && !seconds)) {
    if (seconds) return 1;
    if (by_size) return *by_size;
    return by_step.value_or(1e-9);
  }
  // Times of a day and more of decimals that would be steps of nanoseconds.
  if (step > 0 && step * *said_s < 1e-5 && step <= kLongestStep_s && seconds)
    throw InputError("input.malformed", subject,
                     std::string("names its times as ") + timeUnitName(*said_s) + ", but they look like seconds",
                     "Correct the unit in the line of names");
  return *said_s;
}

}  // namespace accessvdb::io
