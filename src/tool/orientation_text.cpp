// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Orientation sets from text: "sphere:12.5", and lists in files.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <map>
#include <string_view>

#include "accessvdb/error.h"
#include "accessvdb/orientations.h"

namespace accessvdb {
namespace {

constexpr const char* kForms = "Use yaw, pitch:MIN:MAX:STEP, sphere:STEP, sphere:STEP+yaw or list:FILE";
constexpr std::size_t kMostLineBytes = 4096;

bool isNumber(std::string_view word, double& value) {
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size();
}

/// Numbers with colons between them. @return whether there are as many as `numbers` has room for
template <std::size_t kCount>
bool areNumbers(std::string_view text, std::array<double, kCount>& numbers) {
  for (std::size_t n = 0; n < kCount; ++n) {
    const std::size_t colon = text.find(':');
    if ((n + 1 < kCount) != (colon != std::string_view::npos)) return false;
    if (!isNumber(text.substr(0, colon), numbers[n])) return false;
    if (colon != std::string_view::npos) text.remove_prefix(colon + 1);
  }
  return true;
}

std::vector<std::string_view> wordsOf(std::string_view line) {
  std::vector<std::string_view> words;
  constexpr std::string_view kBlanks = " \t\r,;";
  for (std::size_t begin = line.find_first_not_of(kBlanks); begin != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(kBlanks, begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(kBlanks, end);
  }
  return words;
}

/// A list file, one line after the other.
class ListReader {
 public:
  explicit ListReader(const std::filesystem::path& file) : name_(file.string()) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(file, error)) {
      throw InputError("input.missing", name_, "is not a readable file", "Name a list of orientations");
    }
    stream_.open(file, std::ios::binary);
    if (!stream_) throw InputError("input.unreadable", name_, "cannot be opened", "Check its permissions");
  }

  /// The words of the next line that is not blank or a comment; none at the end.
  std::vector<std::string_view> next() {
    while (readLine()) {
      const std::vector<std::string_view> words = wordsOf(line_);
      if (!words.empty() && words.front().front() != '#') return words;
    }
    return {};
  }
  [[noreturn]] void fail(const std::string& problem, const std::string& advice) const {
    throw InputError("orientations.malformed", name_, problem, advice);
  }
  [[noreturn]] void failAtLine(const std::string& problem, const std::string& advice) const {
    fail("line " + std::to_string(number_) + " " + problem, advice);
  }
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  bool readLine() {
    line_.clear();
    bool any = false;
    for (int c = stream_.get(); c != std::char_traits<char>::eof(); c = stream_.get()) {
      any = true;
      if (c == '\n') break;
      if (line_.size() == kMostLineBytes) {
        ++number_;
        failAtLine("is longer than " + std::to_string(kMostLineBytes) + " bytes", "Check that it is a text file");
      }
      line_.push_back(static_cast<char>(c));
    }
    if (stream_.bad()) throw InputError("input.unreadable", name_, "cannot be read", "Check the disk");
    if (any) ++number_;
    return any;
  }

  std::string name_, line_;
  std::ifstream stream_;
  std::size_t number_ = 0;
};

/// What makes two orientations the same one: the rotation in the precision of results.
std::array<float, 9> keyOf(const ToolOrientation& orientation) {
  std::array<float, 9> key;
  for (std::size_t n = 0; n < 9; ++n) key[n] = static_cast<float>(orientation.R_WT.data()[n]) + 0.0f;
  return key;
}

ToolOrientation orientationIn(const ListReader& reader, const std::vector<std::string_view>& words, bool angles) {
  std::array<double, 4> numbers = {};
  const std::size_t wanted = angles ? 3 : 4;
  bool good = words.size() == wanted;
  for (std::size_t n = 0; n < wanted && good; ++n) good = isNumber(words[n], numbers[n]);
  if (!good) reader.failAtLine("is not " + std::to_string(wanted) + " numbers", "Check the list");
  try {
    return angles ? orientationOf(numbers[0], numbers[1], numbers[2])
                  : orientationOf(numbers[0], numbers[1], numbers[2], numbers[3]);
  } catch (const InvalidArgument& error) {
    reader.failAtLine("has " + error.problem(), error.advice());
  }
}

}  // namespace

OrientationSet OrientationSet::parse(const std::string& text) {
  const auto refuse = [&](const std::string& problem) {
    throw InvalidArgument("orientations.text", "orientations", "\"" + text + "\" " + problem, kForms);
  };
  const std::size_t colon = std::min(text.find(':'), text.size());
  const std::string kind = text.substr(0, colon), rest = text.substr(std::min(colon + 1, text.size()));
  OrientationSet set;
  if (kind == "yaw" && colon == text.size()) return set;
  if (kind == "pitch") {
    std::array<double, 3> numbers;
    if (!areNumbers(rest, numbers)) refuse("is not pitch:MIN:MAX:STEP in degrees");
    set = pitch(numbers[0], numbers[1], numbers[2]);
  } else if (kind == "sphere") {
    constexpr std::string_view kWithYaw = "+yaw";
    const bool with_yaw = rest.ends_with(kWithYaw);
    std::array<double, 1> step;
    if (!areNumbers(std::string_view(rest).substr(0, rest.size() - (with_yaw ? kWithYaw.size() : 0)), step)) {
      refuse("is not sphere:STEP or sphere:STEP+yaw in degrees");
    }
    set = sphere(step[0], with_yaw);
  } else if (kind == "list" && !rest.empty()) {
    return read(rest);
  } else {
    refuse("is not a set of orientations");
  }
  return set;
}

OrientationSet OrientationSet::read(const std::filesystem::path& file, int* twins) {
  ListReader reader(file);
  const std::vector<std::string_view> head = reader.next();
  const auto is = [&](std::initializer_list<std::string_view> words) { return std::ranges::equal(head, words); };
  constexpr const char* kHeads = "Begin it with a line \"yaw pitch roll\" (degrees) or \"qw qx qy qz\"";
  if (head.empty()) reader.fail("is empty", kHeads);
  const bool angles = is({"yaw", "pitch", "roll"});
  if (!angles && !is({"qw", "qx", "qy", "qz"})) reader.fail("does not say what its numbers are", kHeads);
  std::vector<ToolOrientation> list;
  std::map<std::array<float, 9>, int> known;
  int repeated = 0;
  for (std::vector<std::string_view> words = reader.next(); !words.empty(); words = reader.next()) {
    const ToolOrientation orientation = orientationIn(reader, words, angles);
    if (!known.try_emplace(keyOf(orientation), 1).second) {
      ++repeated;
      continue;
    }
    if (list.size() == static_cast<std::size_t>(kMost)) {
      throw ResourceLimit("orientations.count", reader.name(),
                          "has more than " + std::to_string(kMost) + " orientations",
                          "Shorten the list, for example to every second orientation");
    }
    list.push_back(orientation);
  }
  if (list.empty()) reader.fail("holds no orientation", "Write one a line after the first line");
  if (twins != nullptr) *twins = repeated;
  return of(std::move(list));
}

}  // namespace accessvdb
