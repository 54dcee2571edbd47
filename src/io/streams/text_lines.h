// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Text input without a locale: lines (LF or CRLF, byte order mark, length cap) and numbers (std::from_chars). UTF-16
/// and UTF-32 are refused by name.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/streams/byte_source.h"

namespace accessvdb::io {

inline constexpr std::size_t kMaxLineBytes = std::size_t{1} << 16;

/// Walks over the lines of a text that it does not own.
class LineReader {
 public:
  /// @param subject  the file's name for messages @throws InputError "input.encoding"
  LineReader(std::string_view text, std::string subject);
  /// The lines of a source from a byte on; a line is valid until the next one is read.
  LineReader(ByteSource& source, std::uint64_t begin, std::string subject);
  /// The next line without its end, or false. @throws InputError for a line over kMaxLineBytes
  bool next(std::string_view& line);
  /// Continues behind the line with this number that ends at this byte.
  void seek(std::uint64_t offset, std::size_t number) {
    position_ = offset;
    number_ = number;
  }
  [[nodiscard]] std::size_t number() const { return number_; }      ///< of the last line, from 1
  [[nodiscard]] std::uint64_t offset() const { return position_; }  ///< first byte after the last line
  [[nodiscard]] bool terminated() const { return terminated_; }     ///< the last line ended with a line feed
  [[nodiscard]] const std::string& subject() const { return subject_; }
  /// @throws InputError "input.malformed" naming the last line
  [[noreturn]] void fail(const std::string& problem, const std::string& advice = "Check the file") const;
  /// @throws InputError naming the line, which has lines ended by carriage returns in it
  [[noreturn]] void failCarriageReturns() const;
  /// @throws InputError "input.decimal_comma" or "input.thousands_separator" naming the line
  void refuseCommasInNumbers(std::string_view line) const;
  /// splitTokens of a line of numbers, after refuseCommasInNumbers.
  void splitNumbers(std::string_view line, std::vector<std::string_view>& tokens) const;

 private:
  std::string_view text_;
  ByteSource* source_ = nullptr;  ///< instead of the text
  std::string subject_;
  std::uint64_t position_ = 0;
  std::size_t number_ = 0;
  bool terminated_ = true;
};

/// Splits at blanks, tabs, commas and semicolons.
void splitTokens(std::string_view line, std::vector<std::string_view>& tokens);
/// Parses the whole token as a number; nan and inf are numbers in the spellings of all C libraries ("-nan(ind)",
/// "1.#QNAN"), 1e999 is inf, hexadecimal is not a number.
[[nodiscard]] bool parseNumber(std::string_view token, double& value);
[[nodiscard]] bool parseCount(std::string_view token, std::uint64_t& value);
/// Whether the numbers of a line have decimal commas: "2,6 0,1 3" or "2,60,0,05", but not "2,0,3" or "2,3 4".
[[nodiscard]] bool hasDecimalCommas(std::string_view line);
/// Whether a number of a line has its thousands apart: "4,002.345 7 1", "5.399.998,547 7 1", but not "4,002.345,1".
[[nodiscard]] bool hasThousandsSeparators(std::string_view line);
/// The text with A to Z in lower case.
[[nodiscard]] std::string inLowerCase(std::string_view text);
/// Whether a line is blank, or a comment beginning with #.
[[nodiscard]] bool isBlankOrComment(std::string_view line);

}  // namespace accessvdb::io
