// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reads results that other verbs wrote as JSON, for the layers of the page.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"

namespace accessvdb::internal {

/// Walks through the file and remembers where it is, for messages such as "targets[2].approaches[0].roll".
class ResultText {
 public:
  using Json = nlohmann::ordered_json;
  ResultText(const Json& json, std::string path) : json_(json), path_(std::move(path)) {}

  /// What is wrong here; thrown, and told with the file's name.
  struct Wrong {
    std::string problem;
  };

  [[nodiscard]] ResultText at(const char* key) const {
    const std::string path = path_.empty() ? key : path_ + "." + key;
    if (!json_.is_object() || !json_.contains(key)) throw Wrong{"has no " + path};
    return {json_[key], path};
  }
  [[nodiscard]] std::vector<ResultText> list() const {
    if (!json_.is_array()) throw Wrong{"has no list at " + path_};
    std::vector<ResultText> parts;
    for (std::size_t n = 0; n < json_.size(); ++n) parts.push_back({json_[n], path_ + "[" + std::to_string(n) + "]"});
    return parts;
  }
  [[nodiscard]] std::string text() const {
    if (!json_.is_string()) throw Wrong{"has no text at " + path_};
    return json_.get<std::string>();
  }
  [[nodiscard]] bool yesOrNo() const {
    if (!json_.is_boolean()) throw Wrong{"has no true or false at " + path_};
    return json_.get<bool>();
  }
  [[nodiscard]] double number(double low, double high) const {
    const double value = json_.is_number() ? json_.get<double>() : std::numeric_limits<double>::quiet_NaN();
    if (!(value >= low && value <= high)) {
      throw Wrong{std::isfinite(value) ? "is out of range at " + path_ : "has no finite number at " + path_};
    }
    return value;
  }
  [[nodiscard]] std::uint64_t count(std::uint64_t most) const {
    if (!json_.is_number_unsigned() || json_.get<std::uint64_t>() > most) throw Wrong{"has no count at " + path_};
    return json_.get<std::uint64_t>();
  }
  [[nodiscard]] bool isNull() const { return json_.is_null(); }
  [[nodiscard]] const std::string& path() const { return path_; }

  template <std::size_t kCount>
  [[nodiscard]] std::array<double, kCount> numbers() const {
    const std::vector<ResultText> parts = list();
    if (parts.size() != kCount) throw Wrong{"does not have " + std::to_string(kCount) + " numbers at " + path_};
    std::array<double, kCount> values = {};
    constexpr double kMost = std::numeric_limits<double>::max();
    for (std::size_t n = 0; n < kCount; ++n) values[n] = parts[n].number(-kMost, kMost);
    return values;
  }
  /// Of "position", here.
  [[nodiscard]] Eigen::Vector3d place() const {
    const std::array<double, 3> p = at("position").numbers<3>();
    return {p[0], p[1], p[2]};
  }
  /// Of a pose here: x, y, z, then the unit quaternion, w first.
  [[nodiscard]] Json pose() const {
    /// Of the length of a quaternion from 1, as rounding to four digits may leave it.
    constexpr double kUnitTolerance = 1e-3;
    const Eigen::Vector3d p = place();
    const std::array<double, 4> q = at("orientation_wxyz").numbers<4>();
    const double length = Eigen::Vector4d(q[0], q[1], q[2], q[3]).norm();
    if (!(std::abs(length - 1) <= kUnitTolerance))
      throw Wrong{"has an orientation that is no unit quaternion at " + path_};
    return {p.x(), p.y(), p.z(), q[0] / length, q[1] / length, q[2] / length, q[3] / length};
  }

 private:
  const Json& json_;
  std::string path_;
};

/// The file of a result that is named by it or by its folder.
/// @param verb  of accessvdb, which wrote `verb`.json  @throws InputError "input.missing"
inline std::filesystem::path resultFile(const std::filesystem::path& path, const std::string& verb) {
  std::filesystem::path file = io::isFolder(path) ? path / (verb + ".json") : path;
  if (!io::isFile(file)) {
    throw InputError("input.missing", file.string(), "is no file", "Name the output folder of accessvdb " + verb);
  }
  return file;
}

/// @param read  called with the ResultText of the whole file  @throws InputError "input.VERB"
template <typename Read>
void readResult(const std::filesystem::path& file, const std::string& verb, const Read& read) {
  const auto fail = [&](const std::string& problem) {
    throw InputError("input." + verb, file.string(), problem, "Use the file as accessvdb " + verb + " wrote it");
  };
  const ResultText::Json json = ResultText::Json::parse(io::contentAt(file), nullptr, false);
  if (json.is_discarded()) fail("is not valid JSON");
  try {
    read(ResultText(json, ""));
  } catch (const ResultText::Wrong& wrong) {
    fail(wrong.problem);
  }
}

}  // namespace accessvdb::internal
