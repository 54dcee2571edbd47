// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/table_files.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>
#include <thread>

#include "accessvdb/field_io.h"

namespace accessvdb::eval {
namespace {

using Json = nlohmann::ordered_json;
bool isPseudo(const std::string& table) { return table == "pseudo_truth"; }

std::string number(double value, const char* format = "%.1f") {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

/// 12345 -> "12,345"
std::string grouped(std::uint64_t value) {
  std::string text = std::to_string(value);
  std::string out;
  for (std::size_t n = 0; n < text.size(); ++n) {
    if (n > 0 && (text.size() - n) % 3 == 0) out += ',';
    out += text[n];
  }
  return out;
}

Json toJson(const TableRow& row) {
  Json json = {{"table", row.table},
               {"scene", row.scene},
               {"method", row.method},
               {"variant", row.variant},
               {"profile", row.column == TableColumn::Paper ? "paper" : "product"},
               {"voxel_m", row.voxel_m},
               {"n", row.figures.points()},
               {"gt_accessible_percent", row.figures.truthPercent()},
               {"precision", row.figures.precision()},
               {"recall", row.figures.recall()},
               {"f1", row.figures.f1()},
               {"true_accessible", row.figures.true_accessible},
               {"false_accessible", row.figures.false_accessible},
               {"false_blocked", row.figures.false_blocked},
               {"true_blocked", row.figures.true_blocked}};
  Json paper = Json::object();
  if (row.paper.n) paper["n"] = *row.paper.n;
  if (row.paper.gt_percent) paper["gt_accessible_percent"] = *row.paper.gt_percent;
  if (row.paper.precision) paper["precision"] = *row.paper.precision;
  if (row.paper.recall) paper["recall"] = *row.paper.recall;
  if (row.paper.f1) paper["f1"] = *row.paper.f1;
  if (!paper.empty()) json["paper"] = paper;
  for (const auto& [key, value] : row.more) json[key] = value;
  if (row.must) json["must"] = row.mustInWords();
  if (row.met()) json["met"] = *row.met();
  return json;
}

std::string printedCell(const PaperFigures& paper) {
  const auto part = [](const std::optional<double>& value) { return value ? number(*value) : std::string("-"); };
  if (!paper.n && !paper.f1 && !paper.precision) return "";
  return (paper.n ? grouped(*paper.n) : "-") + " / " + part(paper.gt_percent) + " / " + part(paper.precision) + " / " +
         part(paper.recall) + " / " + part(paper.f1);
}

std::string figuresCell(const TableRow* row) {
  if (row == nullptr) return "";
  const Confusion& c = row->figures;
  std::string cell = grouped(c.points()) + " / " + number(c.truthPercent()) + " / " + number(c.precision(), "%.2f") +
                     " / " + number(c.recall(), "%.2f") + " / **" + number(c.f1(), "%.2f") + "**";
  for (const auto& [key, value] : row->more) {
    std::string words = key;
    std::replace(words.begin(), words.end(), '_', ' ');
    cell += "; " + words + " " +
            number(value, value < 1e7 && value == static_cast<double>(static_cast<long>(value)) ? "%.0f" : "%.3g");
  }
  return cell;
}

std::string metCell(const TableRow* row) {
  if (row == nullptr || !row->met()) return "";
  return (row->must ? row->mustInWords() + ": " : std::string()) + (*row->met() ? "met" : "**missed**");
}

bool sameCase(const TableRow& a, const TableRow& b) {
  const auto other = [](const TableRow& row) {
    return row.method == "paper" || row.method == "product" ? "" : row.method;
  };
  return a.table == b.table && a.scene == b.scene && a.voxel_m == b.voxel_m && a.variant == b.variant &&
         other(a) == other(b);
}

/// One line of a table: both profiles of a case, if both were run.
struct Line {
  const TableRow* paper = nullptr;
  const TableRow* product = nullptr;
  [[nodiscard]] const TableRow& any() const { return paper != nullptr ? *paper : *product; }
};

std::vector<Line> pairUp(const std::vector<TableRow>& rows, const std::string& table) {
  std::vector<Line> lines;
  for (const TableRow& row : rows) {
    if (row.table != table) continue;
    const auto slot = [&row](Line& line) -> const TableRow*& {
      return row.column == TableColumn::Paper ? line.paper : line.product;
    };
    const auto found = std::find_if(lines.begin(), lines.end(),
                                    [&](Line& line) { return sameCase(line.any(), row) && slot(line) == nullptr; });
    Line& line = found != lines.end() ? *found : lines.emplace_back();
    slot(line) = &row;
  }
  return lines;
}

/// What a table has in place of the truth that the head of the file describes.
std::string noteOf(const std::string& table) {
  if (!isPseudo(table)) return "";
  return "Judged by pseudo truth: the same tool, directions, positions and normals, in the world that the dense half "
         "of "
         "the recording shows.\nA point is not judged where that half has no surface, or where the answer hangs on "
         "space "
         "that it did not see (undecided). Difference:\nF1 less the exact F1 of the same points.\n\n";
}

std::string markdown(const TableResults& results, const TableOrigin& origin) {
  std::ostringstream out;
  const bool exact =
      std::any_of(results.rows.begin(), results.rows.end(), [](const TableRow& row) { return !isPseudo(row.table); });
  out << (exact ? "# Evaluation against exact ground truth\n\n" : "# Evaluation by pseudo ground truth\n\n");
  for (const auto& [key, text] : origin) out << "- " << key << ": " << text << "\n";
  out << "- time: " << number(results.seconds, "%.0f") << " s" << (results.stopped ? ", stopped before the end" : "")
      << "\n";
  std::uint64_t met = 0, missed = 0;
  for (const TableRow& row : results.rows) {
    if (row.met()) ++(*row.met() ? met : missed);
  }
  out << "- requirements: " << met << " met, " << missed << " missed\n\n"
      << "Cells are N / accessible in truth / precision / recall / **F1**, in percent. N counts the surface points "
         "with "
         "enough observations. The truth\nis the tool against the scene's exact distance over every direction, at the "
         "point's stored position and with the method's own normal\nunless a line says otherwise.\n";
  std::vector<std::string> tables;
  for (const TableRow& row : results.rows) {
    if (std::find(tables.begin(), tables.end(), row.table) == tables.end()) tables.push_back(row.table);
  }
  for (const std::string& table : tables) {
    out << "\n## " << table << "\n\n"
        << noteOf(table) << "| scene | voxel | case | paper, printed | paper profile | | product profile | |\n"
        << "|---|---|---|---|---|---|---|---|\n";
    for (const Line& line : pairUp(results.rows, table)) {
      const TableRow& row = line.any();
      std::string what = row.method == "paper" || row.method == "product" ? row.variant : row.method;
      if (what != row.variant && !row.variant.empty()) what += ", " + row.variant;
      out << "| " << row.scene << " | " << number(1000 * row.voxel_m, "%g") << " mm | " << what << " | "
          << printedCell(row.paper) << " | " << figuresCell(line.paper) << " | " << metCell(line.paper) << " | "
          << figuresCell(line.product) << " | " << metCell(line.product) << " |\n";
    }
  }
  return out.str();
}

}  // namespace

std::string machineInWords() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  std::string model = "unknown processor";
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.rfind("model name", 0) != 0) continue;
    model = line.substr(line.find(':') + 2);
    break;
  }
  return model + ", " + std::to_string(std::thread::hardware_concurrency()) + " threads";
}

void writeTablesJson(const std::filesystem::path& path, const TableResults& results, const TableOrigin& origin) {
  Json json = {{"schema", 1}};
  for (const auto& [key, text] : origin) json["origin"][key] = text;
  json["seconds"] = results.seconds;
  json["stopped"] = results.stopped;
  json["finished"] = results.finished;
  json["rows"] = Json::array();
  for (const TableRow& row : results.rows) json["rows"].push_back(toJson(row));
  io::writeFileDurably(path, [&json](std::ostream& out) {
    out << json.dump(1, ' ', false, decltype(json)::error_handler_t::replace) << "\n";
  });
}

void writeTablesMarkdown(const std::filesystem::path& path, const TableResults& results, const TableOrigin& origin) {
  io::writeFileDurably(path, [&](std::ostream& out) { out << markdown(results, origin); });
}

}  // namespace accessvdb::eval
