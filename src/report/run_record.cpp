// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/run_record.h"

#include <array>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "io/streams/input_file.h"

namespace accessvdb::internal {
namespace {

using Json = nlohmann::ordered_json;

/// A survey has many thousands of scans; the page names report.json for the rest.
constexpr std::size_t kMostInputs = 100;
constexpr std::uintmax_t kLargestReport = std::uintmax_t{256} << 20;

const Json& entry(const Json& object, const char* key) {
  static const Json kNone;
  if (!object.is_object()) return kNone;
  const auto found = object.find(key);
  return found == object.end() ? kNone : *found;
}

std::string textOf(const Json& value) { return value.is_string() ? value.get<std::string>() : std::string(); }

/// Texts, numbers and truth values of an object.
Json scalars(const Json& object) {
  Json kept = Json::object();
  if (!object.is_object()) return kept;
  for (const auto& [key, value] : object.items()) {
    if (value.is_primitive()) kept[key] = value;
  }
  return kept;
}

Json texts(const Json& list) {
  Json kept = Json::array();
  if (!list.is_array()) return kept;
  for (const Json& value : list) {
    if (value.is_string()) kept.push_back(value);
  }
  return kept;
}

Json warningsOf(const Json& list) {
  Json kept = Json::array();
  if (!list.is_array()) return kept;
  for (const Json& warning : list) {
    kept.push_back({{"id", textOf(entry(warning, "id"))}, {"text", textOf(entry(warning, "text"))}});
  }
  return kept;
}

}  // namespace

RunRecord RunRecord::read(const std::filesystem::path& folder) {
  RunRecord record;
  const std::filesystem::path path = folder / "report.json";
  if (!io::isFile(path)) return record;
  const auto fail = [&](const std::string& problem) {
    throw InputError("input.report", path.string(), problem, "Run accessvdb map again");
  };
  if (io::inputFileSize(path) > kLargestReport) fail("is too large");
  const Json json = Json::parse(io::contentAt(path, kLargestReport), nullptr, false);
  if (json.is_discarded() || !json.is_object()) fail("is not valid JSON");

  const Json& counts = entry(json, "counts");
  if (entry(counts, "surface_points").is_number_unsigned()) record.surface_points = counts["surface_points"];
  Json shown = Json::object();
  for (const char* key : {"version", "exit_code", "device"}) {
    if (entry(json, key).is_primitive()) shown[key] = entry(json, key);
  }
  shown["counts"] = scalars(counts);
  shown["dropped"] = scalars(entry(counts, "dropped"));
  shown["parameters"] = scalars(entry(json, "parameters"));
  shown["agreement"] = scalars(entry(json, "agreement"));
  shown["warnings"] = warningsOf(entry(json, "warnings"));
  shown["notices"] = texts(entry(json, "notices"));
  shown["error"] = scalars(entry(json, "error"));

  const Json& tools = entry(json, "tools");
  for (const Json& tool : tools.is_array() ? tools : Json::array()) {
    record.tool_files.push_back(textOf(entry(tool, "tool")));
  }
  if (record.tool_files.empty()) record.tool_files = {textOf(entry(entry(json, "parameters"), "tool"))};
  const Json& inputs = entry(json, "inputs");
  Json listed = Json::array();
  for (const Json& input : inputs.is_array() ? inputs : Json::array()) {
    const std::string file = textOf(entry(input, "path")), sha256 = textOf(entry(input, "sha256"));
    record.sha256_of[file] = sha256;
    if (listed.size() < kMostInputs) listed.push_back({{"path", file}, {"sha256", sha256}});
  }
  shown["inputs"] = listed;
  shown["inputs_total"] = inputs.is_array() ? inputs.size() : 0;
  record.shown = std::move(shown);
  return record;
}

}  // namespace accessvdb::internal
