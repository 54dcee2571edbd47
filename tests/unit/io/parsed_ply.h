// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A PLY parser that knows nothing about our layout.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

namespace accessvdb::test {

inline std::string contentOf(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Columns by name, as doubles.
struct ParsedPly {
  std::vector<std::string> names, comments;
  std::vector<std::vector<double>> rows;
  explicit ParsedPly(const std::string& bytes) {
    const std::string mark = "end_header\n";
    const std::size_t body = bytes.find(mark) + mark.size();
    std::istringstream header(bytes.substr(0, body));
    std::vector<std::string> types;
    std::size_t count = 0;
    for (std::string line; std::getline(header, line);) {
      std::istringstream words(line);
      std::string key, a, b;
      words >> key >> a >> b;
      if (key == "comment") comments.push_back(line);
      if (key == "element") count = std::stoul(b);
      if (key == "property") types.push_back(a), names.push_back(b);
    }
    const char* at = bytes.data() + body;
    for (std::size_t row = 0; row < count; ++row) {
      rows.emplace_back();
      for (const std::string& type : types) {
        const auto take = [&](auto value) {
          std::memcpy(&value, at, sizeof(value));
          at += sizeof(value);
          rows.back().push_back(static_cast<double>(value));
        };
        if (type == "double") take(double{});
        if (type == "float") take(float{});
        if (type == "uchar") take(std::uint8_t{});
        if (type == "ushort") take(std::uint16_t{});
        if (type == "uint") take(std::uint32_t{});
      }
    }
    EXPECT_EQ(at, bytes.data() + bytes.size());
  }
};

}  // namespace accessvdb::test
