// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "dds/subscription.h"

#include <algorithm>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <utility>

#include "dds/incoming_messages.h"

namespace accessvdb::dds {

void Subscription::on_data_available(fast::DataReader* from) {
  fast::SampleInfo info;
  while (from->take_next_sample(&message_, &info) == kDone) {
    if (!info.valid_data) continue;
    std::string problem;
    try {
      wanted.decode(type, message_);
    } catch (const std::exception& error) {  // of the message, or no memory for it
      problem = error.what();
    }
    const std::scoped_lock locked(lock_);
    ++state_.received;
    countLost(info.sample_identity);
    if (problem.empty()) continue;
    ++state_.malformed;
    state_.last_problem = std::move(problem);
  }
}

void Subscription::on_subscription_matched(fast::DataReader*, const fast::SubscriptionMatchedStatus& status) {
  const std::scoped_lock locked(lock_);
  state_.senders = static_cast<std::uint64_t>(std::max(status.current_count, 0));
}

void Subscription::setType(const std::string& ros_type) {
  type = ros_type;
  const std::scoped_lock locked(lock_);
  state_.type = ros_type;
  state_.senders = 0;
}

TopicState Subscription::state() const {
  const std::scoped_lock locked(lock_);
  return state_;
}

/// Each sender counts its messages: what is missing between two of them was lost, or too large to be accepted, of which
/// the middleware says nothing.
void Subscription::countLost(const rtps::SampleIdentity& message) {
  constexpr std::size_t kMostSenders = 512;
  if (last_of_.size() == kMostSenders && !last_of_.contains(message.writer_guid())) last_of_.clear();
  const std::uint64_t number = message.sequence_number().to64long();
  std::uint64_t& last = last_of_.try_emplace(message.writer_guid(), number).first->second;
  if (number > last + 1) state_.lost += number - last - 1;
  last = std::max(last, number);
}

void Discovery::want(const std::string& topic) { found_[ddsTopic(topic)]; }

void Discovery::onWriter(AnnouncedWriter writer) {
  constexpr std::size_t kMostSenders = 512;  // of one topic
  const std::scoped_lock locked(lock_);
  const auto wanted = found_.find(writer.topic);
  if (wanted == found_.end()) return;
  std::erase_if(wanted->second, [&](const Sender& known) { return known.id == writer.id; });
  if (writer.is_gone || wanted->second.size() == kMostSenders) return;
  wanted->second.push_back({writer.id, std::move(writer.type), writer.reliable, writer.latched});
}

std::vector<Sender> Discovery::sendersOf(const std::string& topic) {
  const std::scoped_lock locked(lock_);
  return found_[ddsTopic(topic)];
}

}  // namespace accessvdb::dds
