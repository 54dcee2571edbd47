// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Changes of files as damage, other programs and other people make them: of bytes, of numbers in binary headers, of
/// lines and words of text.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <random>
#include <span>
#include <string>
#include <string_view>

namespace accessvdb::campaign {

class Mutator {
 public:
  explicit Mutator(std::uint64_t seed) : random_(seed) {}

  std::string operator()(std::string bytes) {
    for (std::size_t times = 1 + below(4); times > 0; --times) {
      if (bytes.empty()) bytes = "x";
      // Headers decide how the rest is read: half of the changes go into the first bytes.
      const std::size_t reach = below(2) == 0 ? std::min<std::size_t>(bytes.size(), 512) : bytes.size();
      if (isText(bytes, reach) && below(3) != 0) {
        changeText(bytes, below(reach));
      } else {
        const std::size_t at = below(reach), kind = below(6);
        if (kind > 2 || !(kind == 0 ? changeChoice(bytes, at) : changeCount(bytes, at))) changeBytes(bytes, at);
      }
    }
    return bytes;
  }

  /// A number below `limit`, which is above 0.
  std::size_t below(std::size_t limit) { return std::uniform_int_distribution<std::size_t>(0, limit - 1)(random_); }

 private:
  static bool isText(const std::string& bytes, std::size_t reach) {
    for (std::size_t i = 0; i < reach; ++i) {
      const auto c = static_cast<unsigned char>(bytes[i]);
      if (c < 9 || (c > 13 && c < 32) || c > 126) return false;
    }
    return true;
  }

  /// A byte that looks like one of a few: a label, a type, a reason.
  bool changeChoice(std::string& bytes, std::size_t at) {
    const std::size_t end = std::min(at + kFar, bytes.size());
    while (at < end && (bytes[at] <= 0 || bytes[at] > 3)) ++at;
    if (at == end) return false;
    bytes[at] = static_cast<char>(below(4));
    return true;
  }

  /// Four bytes that look like a count, a length or an offset: the first from `at` on, if there is one not far away.
  bool changeCount(std::string& bytes, std::size_t at) {
    for (const std::size_t end = std::min(at + kFar, bytes.size()); at + 4 <= end; ++at) {
      std::uint32_t number = 0;
      std::memcpy(&number, bytes.data() + at, 4);
      if (number == 0 || number > (1U << 20) || (number & 0xff) == 0) continue;
      const std::uint32_t others[] = {number + 1,   number - 1, 2 * number, 16 * number,
                                      number << 12, 0x7fffffff, ~0U,        0};
      number = others[below(std::size(others))];
      std::memcpy(bytes.data() + at, &number, 4);
      return true;
    }
    return false;
  }

  void changeBytes(std::string& bytes, std::size_t at) {
    switch (below(7)) {
      case 0:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
        break;
      case 1:
        bytes[at] = static_cast<char>(below(256));
        break;
      case 2: {  // a count, a length or an offset
        constexpr std::uint64_t kNumbers[] = {0,
                                              1,
                                              0x7fffffff,
                                              0xffffffff,
                                              0x40000000,
                                              0x80000000,
                                              0x10000,
                                              0xffff,
                                              ~std::uint64_t{0},
                                              std::uint64_t{1} << 62,
                                              0x7fc00000,
                                              0x7f800000,
                                              0x7ff0000000000000,
                                              0x7ff8000000000000};
        const std::uint64_t number = kNumbers[below(std::size(kNumbers))];
        const std::size_t size = std::size_t{2} << below(3);
        if (at + size <= bytes.size()) std::memcpy(bytes.data() + at, &number, size);
        break;
      }
      case 3: {  // a little more or less
        if (at + 4 > bytes.size()) break;
        std::uint32_t number = 0;
        std::memcpy(&number, bytes.data() + at, 4);
        number += static_cast<std::uint32_t>(below(9)) - 4;
        std::memcpy(bytes.data() + at, &number, 4);
        break;
      }
      case 4:
        bytes.resize(at + 1);
        break;
      case 5:
        bytes.insert(at, bytes.substr(below(bytes.size()), 1 + below(300)));
        break;
      default:
        bytes.erase(at, 1 + below(40));
    }
  }

  void changeText(std::string& bytes, std::size_t at) {
    constexpr std::array<std::string_view, 24> kWords = {"nan",        "-nan(ind)",
                                                         "1.#QNAN",    "inf",
                                                         "-inf",       "1e400",
                                                         "-1e400",     "1e-400",
                                                         "0x10",       "1,5",
                                                         "-1",         "0",
                                                         "",           "99999999999999999999",
                                                         "4294967295", "18446744073709551615",
                                                         "-0.0",       "#",
                                                         "\"",         "{",
                                                         "}",          "\xef\xbb\xbf",
                                                         "null",       "a b"};
    const std::size_t line = bytes.rfind('\n', at) == std::string::npos ? 0 : bytes.rfind('\n', at) + 1;
    const std::size_t found = bytes.find('\n', at);
    const std::size_t line_end = found == std::string::npos ? bytes.size() : found + 1;
    switch (below(6)) {
      case 0: {  // another word
        const std::size_t begin = bytes.find_last_of(" ,;\t\n\"", at), end = bytes.find_first_of(" ,;\t\n\"", at);
        const std::size_t from = begin == std::string::npos ? 0 : begin + 1;
        const std::size_t to = end == std::string::npos ? bytes.size() : end;
        bytes.replace(from, to > from ? to - from : 0, kWords[below(kWords.size())]);
        break;
      }
      case 1:
        bytes.erase(line, line_end - line);
        break;
      case 2:
        bytes.insert(line, bytes.substr(line, line_end - line));
        break;
      case 3:  // other separators, from here on
        for (char& c : std::span(bytes).subspan(line, line_end - line))
          if (c == ' ' || c == ',') c = ",; \t"[below(4)];
        break;
      case 4:  // lines of other systems
        bytes.insert(line_end > 0 ? line_end - 1 : 0, "\r");
        break;
      default:  // capitals
        if (bytes[at] >= 'a' && bytes[at] <= 'z') bytes[at] = static_cast<char>(bytes[at] - 32);
    }
  }

  static constexpr std::size_t kFar = 400;
  std::mt19937_64 random_;
};

}  // namespace accessvdb::campaign
