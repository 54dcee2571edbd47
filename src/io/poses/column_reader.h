// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Text in columns, as pose files, trajectories and lists of stations are: a line of names is believed, a first line
/// with the count is checked, comments are stepped over, and separators are blanks, tabs, commas or semicolons.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/poses/column_names.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {

class ColumnReader {
 public:
  struct Wanted {
    const char* id;        ///< begins the ids of errors: "poses"
    const char* what;      ///< for messages: "A trajectory has a time and a position in each line"
    const char* names;     ///< what a line of names has to name
    bool pose = false;     ///< a quaternion or a matrix, too
    bool time = false;     ///< needed
    bool counted = false;  ///< there may be a first line with the count
  };
  ColumnReader(LineReader& lines, const Wanted& wanted) : lines_(lines), wanted_(wanted) {}

  /// The next row; at the end, checks the count. @throws InputError "input.malformed"; UnusableInput ID.geographic
  bool next();
  [[nodiscard]] const std::vector<std::string_view>& cells() const { return cells_; }
  [[nodiscard]] std::size_t line() const { return lines_.number(); }
  /// A cell of the row as a number. @throws InputError "input.malformed"
  [[nodiscard]] double number(std::size_t column) const;
  /// Known from the first row on.
  [[nodiscard]] const std::optional<NamedColumns>& names() const { return names_; }
  /// What was stepped over or believed, for notices: the line of names, the count, decimal commas.
  [[nodiscard]] std::vector<std::string> notices() const;
  /// The line of names as it stands in the file, for messages.
  [[nodiscard]] std::string namesInWords() const;

 private:
  void takeNames(std::string_view line, bool comment);
  void settleNames();
  void split(std::string_view line);
  [[noreturn]] void refuseNames(const std::string& problem) const;

  LineReader& lines_;
  Wanted wanted_;
  std::vector<std::string_view> cells_;
  std::string plain_;  ///< the line without quotes
  std::string row_;    ///< with points for decimal commas
  std::optional<NamedColumns> names_;
  std::string names_text_;
  std::size_t names_line_ = 0;
  bool names_in_comment_ = false, decimal_commas_ = false;
  std::optional<std::uint64_t> count_;
  std::uint64_t rows_ = 0;
};

/// Seconds in one unit of these times: as said, else by their size, which for times since 1970 leaves no doubt, else by
/// the steps between them where they cannot be seconds.
/// @throws InputError "input.malformed" where what is said cannot be
[[nodiscard]] double timeUnit_s(const std::vector<double>& times, const std::optional<double>& said_s,
                                const std::string& subject);

}  // namespace accessvdb::io
