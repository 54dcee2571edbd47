// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bags/recording.h"

#include <algorithm>

namespace accessvdb::bags {
namespace {

/// The most that MCAP can have; a robot has a few hundred.
constexpr std::size_t kMostTopics = 65536;
constexpr std::uint64_t kMostNameBytes = std::uint64_t{8} << 20;

}  // namespace

std::optional<std::size_t> Recording::addTopic(std::string_view name, std::string_view type,
                                               std::string_view encoding) {
  std::string plain_type(type);
  if (const auto middle = plain_type.find("/msg/"); middle != std::string::npos) plain_type.erase(middle, 4);
  std::string key = std::string(name) + '\0' + plain_type + '\0' + std::string(encoding);
  if (const auto known = index_.find(key); known != index_.end()) return known->second;
  name_bytes_ += key.size();
  if (topics_.size() >= kMostTopics || name_bytes_ > kMostNameBytes) return std::nullopt;
  index_.emplace(std::move(key), topics_.size());
  topics_.push_back({std::string(name), std::move(plain_type), std::string(encoding)});
  return topics_.size() - 1;
}

void Recording::count(std::size_t topic, std::int64_t logged_ns) {
  Topic& counted = topics_[topic];
  counted.first_ns = counted.messages == 0 ? logged_ns : std::min(counted.first_ns, logged_ns);
  counted.last_ns = counted.messages == 0 ? logged_ns : std::max(counted.last_ns, logged_ns);
  ++counted.messages;
}

std::string wordFrom(std::string_view bytes) {
  std::string word(bytes.substr(0, 64));
  for (char& c : word)
    if (c < 0x20 || c > 0x7e) c = '?';
  return bytes.size() > 64 ? word + "..." : word;
}

}  // namespace accessvdb::bags
