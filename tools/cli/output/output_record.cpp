// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/output_record.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <ostream>

#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/path_facts.h"
#include "output/json_text.h"
#include "output/output_files.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char *kReport = "report.json", *kOutputs = "outputs", *kPath = "path", *kBytes = "bytes",
                     *kHash = "sha256_of_blocks";

/// The folder's report, if it is one of ours that has entries; else null.
Json reportWithOutputs(const fs::path& folder) {
  if (!isOwn(folder / kReport)) return nullptr;
  Json report = Json::parse(io::contentAt(folder / kReport), nullptr, false);
  if (!report.is_object() || !report.contains(kOutputs) || !report[kOutputs].is_array()) return nullptr;
  return report;
}

std::string pathOf(const Json& entry) {
  const bool has = entry.is_object() && entry.contains(kPath) && entry[kPath].is_string();
  return has ? entry[kPath].get<std::string>() : std::string();
}

}  // namespace

void addOutputs(OutputEntries& outputs, const fs::path& folder, const std::vector<std::string>& names) {
  for (const std::string& name : names) {
    if (io::isFile(folder / name))
      outputs.push_back({name, fs::file_size(folder / name), io::sha256OfBlocks(folder / name)});
  }
}

OutputEntries withEarlier(OutputEntries outputs, const fs::path& folder) {
  const Json report = reportWithOutputs(folder);
  if (!report.is_object()) return outputs;
  const std::size_t written = outputs.size();
  for (const Json& entry : report[kOutputs]) {
    const auto hash = entry.is_object() ? entry.find(kHash) : entry.end();
    const auto bytes = entry.is_object() ? entry.find(kBytes) : entry.end();
    const std::string name = pathOf(entry);
    if (name.empty() || hash == entry.end() || !hash->is_string() || bytes == entry.end()) continue;
    const bool again = std::any_of(outputs.begin(), outputs.begin() + static_cast<std::ptrdiff_t>(written),
                                   [&](const OutputEntry& output) { return output.name == name; });
    if (again || !bytes->is_number_unsigned() || !io::isFile(folder / name)) continue;
    outputs.push_back({name, bytes->get<std::uint64_t>(), hash->get<std::string>()});
  }
  return outputs;
}

Json jsonOf(const OutputEntries& outputs) {
  Json list = Json::array();
  for (const OutputEntry& output : outputs) {
    list.push_back({{kPath, output.name}, {kBytes, output.bytes}, {kHash, output.sha256_of_blocks}});
  }
  return list;
}

void recordOutput(const fs::path& folder, const fs::path& file) {
  const std::string name = nameInFolder(folder, file);
  if (name.empty() || !io::isFile(file)) return;
  Json report = reportWithOutputs(folder);
  if (!report.is_object()) return;
  OutputEntries entries;
  addOutputs(entries, folder, {name});
  const Json written = jsonOf(entries)[0];
  auto& outputs = report[kOutputs];
  const auto before = std::ranges::find_if(outputs, [&](const Json& entry) { return pathOf(entry) == name; });
  if (before == outputs.end()) {
    outputs.push_back(written);
  } else {
    *before = written;
  }
  const std::string text = jsonText(report, 2);
  io::writeFileDurably(folder / kReport, [&](std::ostream& out) { out << text << "\n"; });
}

std::string nameInFolder(const fs::path& folder, const fs::path& file) {
  std::error_code error;
  const fs::path parent = fs::absolute(file, error).parent_path();
  return !error && fs::equivalent(folder, parent, error) && !error ? file.filename().string() : std::string();
}

}  // namespace accessvdb::tools
