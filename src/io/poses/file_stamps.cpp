// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/file_stamps.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <set>
#include <string_view>

#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

bool isNameDigit(char c) { return c >= '0' && c <= '9'; }

/// Digits of a name, from a place on.
std::size_t digitsAt(std::string_view text, std::size_t at) {
  std::size_t count = 0;
  while (at + count < text.size() && isNameDigit(text[at + count])) ++count;
  return count;
}

int wholeOf(std::string_view digits) {
  int value = 0;
  for (const char c : digits) value = 10 * value + (c - '0');
  return value;
}

/// 0.5 for "5", by as many digits as there are.
double fractionOf(std::string_view digits) {
  double value = 0;
  return parseNumber("0." + std::string(digits), value) ? value : 0;
}

/// Year, month, day, hour, minute and second with anything or nothing between them, then perhaps decimals.
std::optional<double> dateAt(std::string_view text, std::size_t at) {
  constexpr std::array<std::size_t, 6> kDigits = {4, 2, 2, 2, 2, 2};
  constexpr std::string_view kBetween = "-_.: T";
  std::array<int, 6> part = {};
  for (std::size_t i = 0; i < part.size(); ++i) {
    if (i > 0 && at < text.size() && kBetween.find(text[at]) != std::string_view::npos) ++at;
    if (digitsAt(text, at) < kDigits[i]) return std::nullopt;
    part[i] = wholeOf(text.substr(at, kDigits[i]));
    at += kDigits[i];
  }
  std::size_t decimals_at = at;
  if (at < text.size() && kBetween.find(text[at]) != std::string_view::npos) ++decimals_at;
  const std::size_t decimals = digitsAt(text, decimals_at);
  // Without a separator, what looks like a date may be a count of milliseconds: only whole thousands of parts fit.
  if (decimals_at == at && decimals % 3 != 0) return std::nullopt;
  if (decimals > 9 || part[0] < 1990 || part[0] > 2099 || part[3] > 23 || part[4] > 59 || part[5] > 60)
    return std::nullopt;
  const std::chrono::year_month_day day = std::chrono::year(part[0]) / part[1] / part[2];
  if (!day.ok()) return std::nullopt;
  const double days_s = 86400.0 * std::chrono::sys_days(day).time_since_epoch().count();
  double time_s = days_s + 3600 * part[3] + 60 * part[4] + part[5];
  if (decimals > 0) time_s += fractionOf(text.substr(decimals_at, decimals));
  // A zone that is said: Z, +02, +0200, +02:00.
  const std::size_t zone = decimals > 0 ? decimals_at + decimals : at;
  if (zone < text.size() && text[zone] == '+' && digitsAt(text, zone + 1) >= 2) {
    time_s -= 3600 * wholeOf(text.substr(zone + 1, 2));
    const std::size_t minutes = zone + 3 + (zone + 3 < text.size() && text[zone + 3] == ':' ? 1 : 0);
    if (digitsAt(text, minutes) >= 2) time_s -= 60 * wholeOf(text.substr(minutes, 2));
  }
  return time_s;
}

std::optional<double> dateIn(std::string_view stem) {
  for (std::size_t at = 0; at < stem.size(); ++at)
    if (isNameDigit(stem[at]) && (at == 0 || !isNameDigit(stem[at - 1])))
      if (const auto date_s = dateAt(stem, at)) return date_s;
  return std::nullopt;
}

/// Seconds and a part of one as two runs of digits: 1700000000_100000000.
struct TwoParts {
  std::string_view seconds, part;
  char between = '_';
};

/// What follows the digits is no part of the time: 1700000000.1_front.
std::string_view untilLastDigit(std::string_view stem) {
  const std::size_t last = stem.find_last_of("0123456789");
  return stem.substr(0, last == std::string_view::npos ? 0 : last + 1);
}

std::optional<TwoParts> twoPartsIn(std::string_view stem) {
  stem = untilLastDigit(stem);
  std::size_t part = stem.size();
  while (part > 0 && isNameDigit(stem[part - 1])) --part;
  if (part == 0 || std::string_view("_-.").find(stem[part - 1]) == std::string_view::npos) return std::nullopt;
  std::size_t seconds = part - 1;
  while (seconds > 0 && isNameDigit(stem[seconds - 1])) --seconds;
  TwoParts parts = {stem.substr(seconds, part - 1 - seconds), stem.substr(part), stem[part - 1]};
  if (parts.seconds.size() != 10 || parts.seconds[0] == '0' || parts.part.size() > 9) return std::nullopt;
  return parts;
}

/// Whether these are numbers behind the time of a recording: 1700000000_012 is followed by 1700000000_013.
bool areCounts(const std::vector<TwoParts>& all) {
  int least = wholeOf(all.front().part), most = least;
  for (const TwoParts& parts : all) {
    if (parts.seconds != all.front().seconds) return false;
    least = std::min(least, wholeOf(parts.part));
    most = std::max(most, wholeOf(parts.part));
  }
  constexpr double kMostStep = 10;
  return all.size() > 1 && most - least < kMostStep * static_cast<double>(all.size() - 1);
}

/// Parts of one length are decimals. Others are whole numbers without their leading zeros, of nanoseconds or what their
/// longest says, unless they can be decimals without zeros at their ends.
std::optional<FileStamps> twoPartStamps(const std::vector<std::string>& stems) {
  std::vector<TwoParts> all;
  std::size_t longest = 0, shortest = 9;
  bool zeros_last = false;
  for (const std::string& stem : stems) {
    const auto parts = twoPartsIn(stem);
    if (!parts) return std::nullopt;
    longest = std::max(longest, parts->part.size());
    shortest = std::min(shortest, parts->part.size());
    zeros_last = zeros_last || (parts->part.size() > 1 && parts->part.back() == '0');
    all.push_back(*parts);
  }
  const bool points = all.front().between == '.';
  if (!points && areCounts(all)) return std::nullopt;
  const bool decimals = longest == shortest ? points || longest % 3 == 0 : points && !zeros_last;
  if (!decimals && longest < 4) return std::nullopt;
  const double unit_s = longest > 6 ? 1e-9 : longest > 3 ? 1e-6 : 1e-3;
  FileStamps stamps;
  for (const TwoParts& parts : all) {
    double value_s = 0;
    if (decimals) {
      if (!parseNumber(std::string(parts.seconds) + "." + std::string(parts.part), value_s)) return std::nullopt;
    } else {
      value_s =
          wholeOf(parts.seconds.substr(0, 1)) * 1e9 + wholeOf(parts.seconds.substr(1)) + unit_s * wholeOf(parts.part);
    }
    stamps.stamps_s.push_back(value_s);
  }
  if (!decimals)
    stamps.words = std::string("seconds and ") +
                   (unit_s == 1e-9   ? "nano"
                    : unit_s == 1e-6 ? "micro"
                                     : "milli") +
                   "seconds, not padded";
  return stamps;
}

/// The number at the end.
std::optional<double> lastNumber_s(std::string_view stem) {
  std::size_t first = stem.size();
  std::size_t points = 0;
  while (first > 0 && (isNameDigit(stem[first - 1]) || (stem[first - 1] == '.' && points == 0))) {
    --first;
    points += stem[first] == '.' ? 1 : 0;
  }
  const std::string_view text = stem.substr(first);
  double value = 0;
  if (text.size() < 3 || text.front() == '.' || !parseNumber(text, value)) return std::nullopt;
  if (points == 1) return value;
  if (text.size() < 10 || text.front() == '0') return std::nullopt;
  if (text.size() >= 18) return value * 1e-9;
  if (text.size() >= 15) return value * 1e-6;
  if (text.size() >= 12) return value * 1e-3;
  return value;
}

/// The last number, whatever follows it; else, since a 2 may follow, the first that is long enough for a time.
std::optional<double> decimalStamp_s(std::string_view stem) {
  if (const auto last_s = lastNumber_s(untilLastDigit(stem))) return last_s;
  constexpr std::size_t kSecondsDigits = 10;
  for (std::size_t at = 0; at < stem.size(); at += std::max<std::size_t>(1, digitsAt(stem, at))) {
    const std::size_t digits = digitsAt(stem, at);
    if (digits < kSecondsDigits) continue;
    std::size_t end = at + digits;
    if (end < stem.size() && stem[end] == '.') end += 1 + digitsAt(stem, end + 1);
    if (end > at && stem[end - 1] == '.') --end;
    return lastNumber_s(stem.substr(at, end - at));
  }
  return std::nullopt;
}

template <typename Read>
std::optional<FileStamps> readAll(const std::vector<std::string>& stems, const Read& read) {
  FileStamps stamps;
  for (const std::string& stem : stems) {
    const auto stamp_s = read(stem);
    if (!stamp_s) return std::nullopt;
    stamps.stamps_s.push_back(*stamp_s);
  }
  return stamps;
}

}  // namespace

std::optional<std::uint64_t> fileNumber(const std::string& stem) {
  const std::size_t last = stem.find_last_of("0123456789");
  if (last == std::string::npos) return std::nullopt;
  std::size_t first = last;
  while (first > 0 && isNameDigit(stem[first - 1])) --first;
  std::uint64_t number = 0;
  if (!parseCount(std::string_view(stem).substr(first, last - first + 1), number)) return std::nullopt;
  return number;
}

std::optional<double> fileStamp_s(const std::string& stem) {
  const auto stamps = fileStamps({stem});
  return stamps ? std::optional(stamps->stamps_s.front()) : std::nullopt;
}

std::optional<FileStamps> fileStamps(const std::vector<std::string>& stems) {
  std::optional<FileStamps> stamps = readAll(stems, dateIn);
  if (stamps) {
    stamps->dates = true;
    stamps->words = "a date, UTC";
  }
  if (!stamps) stamps = twoPartStamps(stems);
  if (!stamps) stamps = readAll(stems, decimalStamp_s);
  if (!stamps) return std::nullopt;
  // The date of a recording, with numbers behind it, is no time of its scans.
  const std::set<double> different(stamps->stamps_s.begin(), stamps->stamps_s.end());
  constexpr double kLeastStep_s = 1e-4;
  const double span_s = *different.rbegin() - *different.begin();
  const bool few = stems.size() > 1 && (different.size() == 1 || 3 * different.size() < stems.size());
  if (few || span_s < kLeastStep_s * static_cast<double>(different.size() - 1)) return std::nullopt;
  return stamps;
}

bool sortDifferentlyAsText(const std::vector<std::string>& stems) {
  return !std::is_sorted(stems.begin(), stems.end());
}

}  // namespace accessvdb::io
