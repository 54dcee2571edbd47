// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/live_commands.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "output/error_output.h"
#include "output/json_text.h"

namespace accessvdb::tools {
namespace {

using Json = nlohmann::json;

constexpr std::array<const char*, 8> kNames = {"save",  "checkpoint", "reset",      "remove",
                                               "pause", "resume",     "approaches", "views"};
constexpr std::size_t kMostWaiting = 100, kMostWords = 300;
/// While so many answers have not been published, what comes is only counted.
constexpr std::size_t kMostUnpublished = 200;

const char* nameOf(LiveCommandKind kind) { return kNames[static_cast<std::size_t>(kind)]; }

/// @param problem  what is wrong with it, if there is something @return nothing then
Json objectIn(const std::string& text, std::string& problem) {
  problem = "is no JSON object";
  try {
    Json message = Json::parse(text);
    if (!message.is_object()) return {};
    problem = "";
    return message;
  } catch (const Json::out_of_range&) {
    problem = "has a number that does not fit";
  } catch (const Json::exception&) {  // no JSON
  }
  return {};
}

/// Numbers and short texts are ids; whatever else was sent is none.
std::string idOf(const Json& message) {
  constexpr std::size_t kMostBytes = 100;
  const auto id = message.find("id");
  if (id == message.end() || !(id->is_number() || id->is_string())) return "null";
  std::string text = jsonText(*id, -1);
  return text.size() <= kMostBytes ? text : "null";
}

/// @return what is wrong with it; nothing if it was read
std::optional<std::string> readBox(const Json& message, LiveCommand& command) {
  const auto box = message.find("box");
  const bool fits = box != message.end() && box->is_array() && box->size() == 6 &&
                    std::all_of(box->begin(), box->end(), [](const Json& value) { return value.is_number(); });
  if (!fits) return "\"box\" must be six numbers: x0, y0, z0, x1, y1, z1 in metres";
  for (std::size_t axis = 0; axis < 3; ++axis) {
    command.min_W[static_cast<Eigen::Index>(axis)] = (*box)[axis].get<double>();
    command.max_W[static_cast<Eigen::Index>(axis)] = (*box)[axis + 3].get<double>();
  }
  const auto as = message.find("as");
  if (as == message.end() || *as == "unknown") return std::nullopt;
  if (*as != "free") return "\"as\" must be \"unknown\" or \"free\"";
  command.removed_as = RemovedAs::Free;
  return std::nullopt;
}

/// A positive number that is there. @return nothing if it is another
std::optional<double> numberAt(const Json& message, const char* name, double most) {
  const auto found = message.find(name);
  if (found == message.end() || !found->is_number()) return std::nullopt;
  const auto value = found->get<double>();
  return value > 0 && value <= most ? std::optional(value) : std::nullopt;
}

/// What approaches and views are asked for alike: how many, from where, how near. @param options  of either
/// @param more  what else this command knows  @return what is wrong with it; nothing if it was read
template <typename Options>
std::optional<std::string> readAsked(const Json& message, const std::string& more, Options& options) {
  constexpr double kMost = 1000, kWithin_m = 10;
  const std::array<std::string_view, 6> known = {"id", "command", "most", "from", "within", more};
  for (const auto& [key, value] : message.items()) {
    if (std::ranges::find(known, key) == known.end())
      return "\"" + printable(key.substr(0, 40)) + "\" is not known; there are most, from, within and " + more;
  }
  if (message.contains("most")) {
    const auto most = numberAt(message, "most", kMost);
    if (!most || *most < 1) return "\"most\" must be a number from 1 to 1000";
    options.most = static_cast<std::size_t>(*most);
  }
  if (const auto from = message.find("from"); from != message.end()) {
    const bool fits = from->is_array() && from->size() == 3 &&
                      std::all_of(from->begin(), from->end(), [](const Json& value) { return value.is_number(); });
    if (!fits) return "\"from\" must be three numbers: x, y, z in metres";
    options.from_W = Eigen::Vector3d((*from)[0].get<double>(), (*from)[1].get<double>(), (*from)[2].get<double>());
    options.within_m = kWithin_m;
  }
  if (message.contains("within")) {
    const auto within_m = numberAt(message, "within", 1e6);
    if (!within_m || !options.from_W) return "\"within\" must be metres, with \"from\"";
    options.within_m = *within_m;
  }
  return std::nullopt;
}

std::optional<std::string> readApproach(const Json& message, ApproachOptions& options) {
  if (auto wrong = readAsked(message, "allow_unknown", options)) return wrong;
  if (const auto unknown = message.find("allow_unknown"); unknown != message.end()) {
    if (!unknown->is_boolean()) return "\"allow_unknown\" must be true or false";
    options.allow_unknown = unknown->get<bool>();
  }
  return std::nullopt;
}

std::optional<std::string> readView(const Json& message, ViewOptions& options) {
  if (auto wrong = readAsked(message, "body", options)) return wrong;
  if (message.contains("body")) {
    const auto body_m = numberAt(message, "body", 100);
    if (!body_m) return "\"body\" must be the radius of what carries the sensor, metres";
    options.body_radius_m = *body_m;
  }
  return std::nullopt;
}

}  // namespace

void LiveCommands::receive(const std::string& text) {
  LiveAnswer refused;
  const Json message = objectIn(text, refused.words);
  LiveCommand command;
  const bool object = message.is_object();
  if (object) refused.id = command.id = idOf(message);
  const auto word = object ? message.find("command") : message.end();
  if (!object) {  // said already
  } else if (word == message.end() || !word->is_string()) {
    refused.words = "has no \"command\"";
  } else {
    refused.command = printable(word->get<std::string>().substr(0, 40));
    const auto known = std::find(kNames.begin(), kNames.end(), word->get<std::string>());
    if (known == kNames.end()) {
      refused.words = "is not known; there are save, checkpoint, reset, remove, pause, resume, approaches and views";
    } else {
      command.kind = static_cast<LiveCommandKind>(known - kNames.begin());
      if (command.kind == LiveCommandKind::Remove) refused.words = readBox(message, command).value_or("");
      if (command.kind == LiveCommandKind::Approaches)
        refused.words = readApproach(message, command.approach).value_or("");
      if (command.kind == LiveCommandKind::Views) refused.words = readView(message, command.view).value_or("");
    }
  }
  const std::scoped_lock locked(lock_);
  ++report_.received;
  if (unpublished_ >= kMostUnpublished) {
    ++report_.unanswered;
    return;
  }
  if (refused.words.empty() && waiting_.size() == kMostWaiting)
    refused.words = "comes while " + std::to_string(kMostWaiting) + " others wait";
  if (refused.words.empty()) {
    waiting_.push_back(std::move(command));
  } else {
    add(std::move(refused));
  }
}

void LiveCommands::beginTurn() {
  const std::scoped_lock locked(lock_);
  of_turn_ = std::min(waiting_.size(), kMostOfTurn);
}

std::optional<LiveCommand> LiveCommands::next() {
  const std::scoped_lock locked(lock_);
  if (of_turn_ == 0) return std::nullopt;
  --of_turn_;
  LiveCommand command = std::move(waiting_.front());
  waiting_.pop_front();
  return command;
}

void LiveCommands::answer(const LiveCommand& command, bool done, const std::string& words) {
  const std::scoped_lock locked(lock_);
  add({command.id, nameOf(command.kind), done, words});
}

void LiveCommands::add(LiveAnswer answer) {
  answer.words = printable(answer.words.substr(0, kMostWords));
  ++(answer.done ? report_.done : report_.refused);
  answers_.push_back(std::move(answer));
  ++unpublished_;
  forgetOld();
}

void LiveCommands::forgetOld() {
  while (answers_.size() > std::max(kOfPage, unpublished_)) answers_.pop_front();
}

/// With the last answers before that one.
LiveCommandReport LiveCommands::page(std::size_t end) const {
  LiveCommandReport page = report_;
  const std::size_t begin = end - std::min(end, kOfPage);
  for (std::size_t n = begin; n < end; ++n) page.answers.push_back(answers_[n]);
  return page;
}

LiveCommandReport LiveCommands::report() const {
  const std::scoped_lock locked(lock_);
  return page(answers_.size());
}

std::vector<LiveCommandReport> LiveCommands::takePages() {
  const std::scoped_lock locked(lock_);
  std::vector<LiveCommandReport> pages;
  std::size_t said = answers_.size() - unpublished_;
  do {
    said = std::min(said + kOfPage, answers_.size());
    pages.push_back(page(said));
  } while (said < answers_.size());
  unpublished_ = 0;
  forgetOld();
  return pages;
}

bool LiveCommands::hasNews() const {
  const std::scoped_lock locked(lock_);
  return unpublished_ > 0;
}

}  // namespace accessvdb::tools
