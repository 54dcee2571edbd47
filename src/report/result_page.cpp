// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/program/result_page.h"

#include <string_view>

#include "report/map_sketch.h"
#include "report/text_coding.h"

namespace accessvdb::io {
namespace {

constexpr std::string_view kStyle = R"(
:root { color-scheme: light dark; --line: #8884; --quiet: #6a6f76; }
body { max-width: 900px; margin: 32px auto; padding: 0 20px; font: 15px/1.5 system-ui, sans-serif; }
h1 { margin: 0; font-size: 26px; overflow-wrap: anywhere; }
h2 { margin: 28px 0 8px; font-size: 17px; }
.kind, .quiet, figcaption, footer { color: var(--quiet); font-size: 13px; margin: 0; }
.warning { border-left: 4px solid #d97706; padding: 4px 12px; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: 5px 12px 5px 0; border-bottom: 1px solid var(--line); overflow-wrap: anywhere; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
figure { margin: 16px 0; break-inside: avoid; }
figure svg { display: block; width: 100%; max-height: 80vh; }
.bar { fill: currentColor; }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; padding: 0; list-style: none; }
.legend svg { width: 12px; height: 12px; margin-right: 6px; }
)";

/// Text that can stand between tags and in attributes.
std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string element(std::string_view tag, std::string_view text, std::string_view kind = {}) {
  std::string html = "<";
  html.append(tag);
  if (!kind.empty()) html.append(" class=\"").append(kind).append("\"");
  html.append(">").append(escaped(text)).append("</").append(tag).append(">");
  return html;
}

bool isNumber(std::string_view text) {
  return !text.empty() && text.find_first_not_of("0123456789.+-") == std::string_view::npos;
}

std::string tableOf(const ResultPage::Table& table) {
  std::string html = element("h2", table.heading) + "\n<table><thead><tr>";
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    const bool numbers = !table.rows.empty() && isNumber(table.rows.front()[c]);
    html += element("th", table.columns[c], numbers ? "number" : "");
  }
  html += "</tr></thead><tbody>\n";
  for (const std::vector<std::string>& row : table.rows) {
    html += "<tr>";
    for (const std::string& cell : row) html += element("td", cell, isNumber(cell) ? "number" : "");
    html += "</tr>\n";
  }
  return html + "</tbody></table>\n";
}

std::string legendOf(const std::vector<ResultPage::Mark>& marks) {
  std::string html = "<ul class=\"legend\">";
  for (const ResultPage::Mark& mark : marks) {
    html += "<li><svg viewBox=\"0 0 1 1\"><path fill=\"" + escaped(mark.colour) + "\" d=\"M0 0h1v1H0z\"/></svg>" +
            escaped(mark.name) + "</li>";
  }
  return html + "</ul>\n";
}

}  // namespace

std::string htmlOf(const ResultPage& page) {
  const std::string title = page.title.empty() ? page.kind : page.title;
  std::string html =
      "<!DOCTYPE html>\n<!-- Copyright Contributors to the AccessVDB project\n     SPDX-License-Identifier: "
      "Apache-2.0\n"
      "     One file: nothing is loaded from anywhere, and the policy below allows no script. -->\n"
      "<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta http-equiv=\"Content-Security-Policy\" content=\"" +
      escaped("default-src 'none'; style-src " + internal::policyHash(kStyle) +
              "; base-uri 'none'; form-action 'none'") +
      "\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n" + element("title", title) +
      "\n<style>" + std::string(kStyle) + "</style>\n</head>\n<body>\n<header>" +
      (page.title.empty() ? "" : element("p", page.kind, "kind")) + element("h1", title);
  const std::string of = page.client + (page.client.empty() || page.site.empty() ? "" : " · ") + page.site;
  if (!of.empty()) html += element("p", of);
  html += "</header>\n";
  for (const std::string& sentence : page.sentences) html += element("p", sentence) + "\n";
  for (const std::string& warning : page.warnings) html += element("p", warning, "warning") + "\n";
  if (const std::string sketches = internal::sketchesOf(page); !sketches.empty()) {
    html += element("h2", "Where") + "\n" + legendOf(page.marks) + sketches;
  }
  for (const ResultPage::Table& table : page.tables) {
    if (!table.rows.empty()) html += tableOf(table);
  }
  return html + "</body>\n</html>\n";
}

}  // namespace accessvdb::io
