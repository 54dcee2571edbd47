// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "survey/survey_world.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <utility>

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

Vector originOf(const Ply& points) {
  Vector origin = {};
  const std::size_t at = points.header.find("comment origin_W ");
  EXPECT_EQ(std::sscanf(points.header.c_str() + at, "comment origin_W %lf %lf %lf", &origin[0], &origin[1], &origin[2]),
            3);
  return origin;
}

double sectionOf(const Vector& p, const Vector& n, const Vector& origin, double v) {
  const auto dot = [](const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
  const auto cross = [](const Vector& a, const Vector& b) {
    return Vector{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  };
  if (dot(n, n) == 0) return 0.941 * v * v;
  Vector place;
  for (std::size_t k = 0; k < 3; ++k) {
    place[k] = (p[k] - origin[k]) / v + 0.5;  // voxels lie around whole numbers
    place[k] = std::clamp(place[k] - std::floor(place[k]), 1e-6, 1 - 1e-6);
  }
  Vector u = cross(n, std::abs(n[0]) < 0.9 ? Vector{1, 0, 0} : Vector{0, 1, 0});
  const double length = std::sqrt(dot(u, u));
  for (double& x : u) x /= length;
  const Vector w = cross(n, u);
  std::vector<Vector> corners;
  for (const auto& [along, across] : {std::pair{3, 3}, {-3, 3}, {-3, -3}, {3, -3}}) {
    corners.push_back({place[0] + along * u[0] + across * w[0], place[1] + along * u[1] + across * w[1],
                       place[2] + along * u[2] + across * w[2]});
  }
  for (std::size_t face = 0; face < 6; ++face) {
    const auto inside = [&](const Vector& q) { return face < 3 ? q[face] : 1 - q[face - 3]; };
    std::vector<Vector> left;
    for (std::size_t k = 0; k < corners.size(); ++k) {
      const Vector &a = corners[k], &b = corners[(k + 1) % corners.size()];
      const double of_a = inside(a), of_b = inside(b);
      if (of_a >= 0) left.push_back(a);
      if ((of_a >= 0) == (of_b >= 0)) continue;
      const double t = of_a / (of_a - of_b);
      left.push_back({a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])});
    }
    corners = left;
  }
  Vector twice = {};
  for (std::size_t k = 1; k + 1 < corners.size(); ++k) {
    Vector a, b;
    for (std::size_t i = 0; i < 3; ++i) a[i] = corners[k][i] - corners[0][i], b[i] = corners[k + 1][i] - corners[0][i];
    const Vector part = cross(a, b);
    for (std::size_t i = 0; i < 3; ++i) twice[i] += part[i];
  }
  return std::sqrt(dot(twice, twice)) / 2 * v * v;
}

}  // namespace accessvdb::survey_test
