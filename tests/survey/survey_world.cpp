// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "survey/survey_world.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>

#include "large/walk_scans.h"

namespace accessvdb::survey_test {

void writeLabelledWalk(const std::filesystem::path& file) {
  const std::filesystem::path plain = file.string() + ".plain";
  large_test::writeRayCloud(plain, {});
  std::ifstream in(plain, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const std::string end = "end_header\n";
  const std::size_t begin = bytes.find(end);
  std::ofstream out(file, std::ios::binary);
  out << bytes.substr(0, begin) << "property int tree_id\nproperty uchar class\nproperty float loudness\n" << end;
  std::int32_t row = 0;
  for (std::size_t at = begin + end.size(); at + 24 <= bytes.size(); at += 24, ++row) {
    float p[3];
    std::memcpy(p, bytes.data() + at, sizeof p);
    const std::int32_t tree = row % 7 == 0 ? -1 : static_cast<std::int32_t>(std::floor(p[0] / 0.7f));
    const std::uint8_t what = row % 5 == 0 ? 6 : p[2] < 0 ? 2 : 5;
    const float loudness = 0.25f + static_cast<float>(row % 3);
    out.write(bytes.data() + at, 24);
    out.write(reinterpret_cast<const char*>(&tree), sizeof tree);
    out.write(reinterpret_cast<const char*>(&what), sizeof what);
    out.write(reinterpret_cast<const char*>(&loudness), sizeof loudness);
  }
  out.close();
  std::filesystem::remove(plain);
}

Ply::Ply(const std::string& bytes) {
  const std::string end = "end_header\n";
  const std::size_t begin = bytes.find(end) + end.size();
  header = bytes.substr(0, begin);
  struct Property {
    std::string type, name;
  };
  std::vector<Property> properties;
  std::istringstream lines(header);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string word;
    words >> word;
    if (word == "element") words >> word >> rows;
    if (word == "property") {
      Property& property = properties.emplace_back();
      words >> property.type >> property.name;
      names.push_back(property.name);
    }
  }
  std::size_t at = begin;
  const auto take = [&]<typename T>(T value) {
    if (at + sizeof value <= bytes.size()) std::memcpy(&value, bytes.data() + at, sizeof value);
    at += sizeof value;
    return static_cast<double>(value);
  };
  for (std::size_t row = 0; row < rows; ++row) {
    for (const auto& [type, name] : properties) {
      column[name].push_back(type == "double"   ? take(double{})
                             : type == "float"  ? take(float{})
                             : type == "int"    ? take(std::int32_t{})
                             : type == "uint"   ? take(std::uint32_t{})
                             : type == "ushort" ? take(std::uint16_t{})
                                                : take(std::uint8_t{}));
    }
  }
  EXPECT_EQ(at, bytes.size()) << "rows and header differ";
}

std::vector<std::map<std::string, std::string>> parsedCsv(const std::string& text) {
  std::vector<std::map<std::string, std::string>> rows;
  std::vector<std::string> names;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::vector<std::string> cells(1);
    for (const char c : line) {
      if (c == ',') {
        cells.emplace_back();
      } else {
        cells.back() += c;
      }
    }
    if (names.empty()) {
      names = cells;
      continue;
    }
    EXPECT_EQ(cells.size(), names.size()) << line;
    for (std::size_t n = 0; n < names.size() && n < cells.size(); ++n) {
      if (n == 0) rows.emplace_back();
      rows.back()[names[n]] = cells[n];
    }
  }
  return rows;
}

Exact exactly(const std::string& decimal, int decimals) {
  const std::size_t point = std::min(decimal.find('.'), decimal.size());
  std::string digits = decimal.substr(0, point) + (point < decimal.size() ? decimal.substr(point + 1) : "");
  const std::size_t behind = point < decimal.size() ? decimal.size() - point - 1 : 0;
  EXPECT_LE(behind, static_cast<std::size_t>(decimals)) << decimal;
  digits.append(static_cast<std::size_t>(decimals) - behind, '0');
  return std::stoull(digits);
}

}  // namespace accessvdb::survey_test
