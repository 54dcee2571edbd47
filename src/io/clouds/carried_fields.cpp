// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/carried_fields.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <utility>

#include "accessvdb/attributes.h"
#include "accessvdb/error.h"

namespace accessvdb::io {
namespace {

std::string plainName(std::string_view name) {
  std::string plain;
  for (const char c : name) {
    if (c == '_' || c == ' ') continue;
    plain += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  }
  if (plain.starts_with("scalar") && plain.size() > 6) plain.erase(0, 6);
  return plain == "class" ? "classification" : plain;
}

}  // namespace

bool isSameField(std::string_view a, std::string_view b) { return a == b || plainName(a) == plainName(b); }

CarriedFields::CarriedFields(const std::vector<RecordField>& all, const std::vector<std::string>& wanted,
                             std::string subject, std::int32_t scan)
    : wanted_(wanted), subject_(std::move(subject)), scan_(scan) {
  for (const RecordField& field : all)
    if (!field.name.empty() && !field.name.starts_with('@')) present_ += (present_.empty() ? "" : " ") + field.name;
  for (const std::string& name : wanted) {
    auto found = std::find_if(all.begin(), all.end(), [&](const RecordField& field) { return field.name == name; });
    if (found == all.end()) {
      found = std::find_if(all.begin(), all.end(), [&](const RecordField& f) { return isSameField(f.name, name); });
    }
    const bool there = found != all.end();
    fields_.push_back(there ? *found : RecordField{});
    const RecordField& field = fields_.back();
    is_int32_.push_back(there && field.type == ScalarType::Int32 && field.bits == 0 && !field.no_data &&
                        field.scale == 1 && field.offset_of_value == 0);
    index_.push_back(there ? std::optional(static_cast<std::size_t>(found - all.begin())) : std::nullopt);
  }
}

std::vector<std::string> CarriedFields::missing() const {
  std::vector<std::string> missing;
  for (std::size_t n = 0; n < wanted_.size(); ++n) {
    if (!index_[n] && !wanted_[n].starts_with('@')) missing.push_back(wanted_[n]);
  }
  return missing;
}

void CarriedCheck::note(const CarriedFields* fields, const std::string& subject) {
  std::erase_if(missing_, [](const std::string& name) { return name.starts_with('@'); });
  if (missing_.empty()) return;
  if (fields == nullptr) {
    throw InvalidArgument("carry.format", subject, "is of a format without attributes that can be carried",
                          "Use LAS, PLY, PCD, or a recording with PointCloud2");
  }
  if (subject_.empty()) {
    subject_ = subject;
    present_ = fields->present();
  }
  const std::vector<std::string> here = fields->missing();
  std::erase_if(missing_,
                [&](const std::string& name) { return std::find(here.begin(), here.end(), name) == here.end(); });
}

void CarriedCheck::require(const std::string& doubt) const {
  if (missing_.empty() || subject_.empty()) return;
  throw UnusableInput(
      "carry.missing", subject_,
      "has no " + missing_.front() + ", nor has any other scan" + (doubt.empty() ? "" : " (" + doubt + ")"),
      "Name one of: " + present_);
}

std::int32_t CarriedFields::besides(std::size_t n, std::uint64_t row) const {
  if (wanted_[n] == kScanName) return scan_;
  if (wanted_[n] != kRowName) return kNoAttribute;
  if (row <= static_cast<std::uint64_t>(-static_cast<std::int64_t>(kNoAttribute + 1))) {
    return static_cast<std::int32_t>(row);
  }
  throw InputError("carry.index", subject_, "has more than 2147483647 rows, the most that a column of rows can number",
                   "Split the file, or leave out ScanInputOptions::index");
}

std::int32_t CarriedFields::whole(std::size_t n, double stored) const {
  const RecordField& field = fields_[n];
  if (std::isnan(stored) || (field.no_data && stored == *field.no_data)) return kNoAttribute;
  const bool scaled = field.scale != 1 || field.offset_of_value != 0;
  const double value = scaled ? field.scale * stored + field.offset_of_value : stored;
  if (value >= kNoAttribute && value <= -static_cast<double>(kNoAttribute + 1) && value == std::floor(value)) {
    return static_cast<std::int32_t>(value);
  }
  std::array<char, 32> text;
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  throw InputError("carry.value", subject_,
                   "has the " + wanted_[n] + " " + std::string(text.data(), end) +
                       ", which is no whole number of 32 bits: most returns of a point have no such value in common",
                   "Carry classes and numbers of trees, or round the values first");
}

void CarriedFields::append(const char* record, bool big_endian, std::uint64_t row,
                           std::vector<std::int32_t>& to) const {
  for (std::size_t n = 0; n < fields_.size(); ++n) {
    if (!index_[n]) {
      to.push_back(besides(n, row));
      continue;
    }
    const RecordField& field = fields_[n];
    if (is_int32_[n] != 0) {  // most are: what follows would take ten times as long
      to.push_back(loadScalar<std::int32_t>(record + field.offset, big_endian));
    } else if (field.bits != 0) {
      const auto byte = static_cast<unsigned char>(record[field.offset]);
      to.push_back(static_cast<std::int32_t>(byte >> field.shift & ((1u << field.bits) - 1)));
    } else {
      to.push_back(whole(n, loadScalar(record + field.offset, field.type, big_endian)));
    }
  }
}

}  // namespace accessvdb::io
