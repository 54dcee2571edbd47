// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Attributes that returns carry (attributes.h), in the records of a file: which fields they are, and their values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/clouds/scalar_type.h"

namespace accessvdb::io {

/// A number in each record.
struct RecordField {
  std::string name = {};
  std::uint64_t offset = 0;  ///< bytes from the beginning of the record
  ScalarType type = ScalarType::Uint8;
  unsigned shift = 0, bits = 0;           ///< of a part of a byte; 0 bits: all of it
  std::optional<double> no_data = {};     ///< stands for "none"
  double scale = 1, offset_of_value = 0;  ///< value = scale * stored + offset
};

/// Names of what is not in a record: its number in the file, and the file's among those that are read.
inline constexpr const char *kRowName = "@row", *kScanName = "@scan";

/// Names differ by program: case, underscores and CloudCompare's "scalar_" do not matter, "class" is "classification".
[[nodiscard]] bool isSameField(std::string_view a, std::string_view b);

class CarriedFields;

/// Which of the attributes that are wanted a series of files has at all.
class CarriedCheck {
 public:
  explicit CarriedCheck(std::vector<std::string> wanted) : missing_(std::move(wanted)) {}
  /// @param fields  of the file `subject`; null: its format has none @throws InvalidArgument "carry.format"
  void note(const CarriedFields* fields, const std::string& subject);
  [[nodiscard]] bool hasAll() const {
    return missing_.empty() || missing_.front().starts_with('@');  // those come last, and need not be there
  }
  /// @param doubt  about what a file says of its fields; empty if there is none
  /// @throws UnusableInput "carry.missing" if there is one that none of the files had
  void require(const std::string& doubt = {}) const;

 private:
  std::vector<std::string> missing_;
  std::string subject_, present_;  ///< the first file, and what it has
};

class CarriedFields {
 public:
  CarriedFields() = default;
  /// @param all  of the file's records  @param wanted  names, in order  @param subject  the file, for messages
  /// @param scan  number of the file, for kScanName
  CarriedFields(const std::vector<RecordField>& all, const std::vector<std::string>& wanted, std::string subject,
                std::int32_t scan = 0);

  [[nodiscard]] std::size_t size() const { return fields_.size(); }
  /// Which of those that are wanted the file lacks.
  [[nodiscard]] std::vector<std::string> missing() const;
  /// All that it has, with blanks between them.
  [[nodiscard]] const std::string& present() const { return present_; }

  /// Appends a row of values: whole numbers, or kNoAttribute.
  /// @throws InputError "carry.value" for a value that is no whole number of 32 bits
  /// @param row  the record's number in the file
  void append(const char* record, bool big_endian, std::uint64_t row, std::vector<std::int32_t>& to) const;
  /// The same where the values are already numbers. @param numberOf  (index into `all`) -> double
  template <typename NumberOf>
  void appendNumbers(const NumberOf& numberOf, std::uint64_t row, std::vector<std::int32_t>& to) const {
    for (std::size_t n = 0; n < fields_.size(); ++n) {
      to.push_back(index_[n] ? whole(n, numberOf(*index_[n])) : besides(n, row));
    }
  }

 private:
  /// The value of what is not in the record.
  [[nodiscard]] std::int32_t besides(std::size_t n, std::uint64_t row) const;
  [[nodiscard]] std::int32_t whole(std::size_t n, double stored) const;

  std::vector<std::string> wanted_;
  std::vector<RecordField> fields_;                ///< [wanted]
  std::vector<std::optional<std::size_t>> index_;  ///< [wanted] into `all`
  std::vector<char> is_int32_;                     ///< [wanted] stored as the number that it is
  std::string subject_, present_;
  std::int32_t scan_ = 0;
};

}  // namespace accessvdb::io
