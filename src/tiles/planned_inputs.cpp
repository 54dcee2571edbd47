// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/planned_inputs.h"

#include <filesystem>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "io/streams/input_file.h"

namespace accessvdb::tiles {
namespace {

[[noreturn]] void refuseChanged(const std::string& path) {
  throw UnusableInput("plan.changed", path, "has changed since the plan was made",
                      "Restore it, or start again with tiles::removePlan");
}

}  // namespace

PlannedInputs::PlannedInputs(const Plan& plan) : plan_(plan) {
  for (const Flight& flight : plan.flights) {
    for (const PlannedInput& input : flight.inputs) planned_.emplace(input.path, &input);
  }
}

void PlannedInputs::note(const std::string& given_path) {
  if (given_path == last_given_path_) return;
  last_given_path_ = given_path;
  const std::string path = std::filesystem::absolute(given_path).lexically_normal().string();
  // While the file is still in the system's cache. The last one, or a single cloud, is hashed at the end.
  hashLast();
  last_path_ = path;
  const auto planned = planned_.find(path);
  if (planned == planned_.end() || !io::isFile(path) || io::inputFileSize(path) != planned->second->bytes)
    refuseChanged(path);
}

void PlannedInputs::hashLast() {
  if (!last_path_.empty() && !sha256_.contains(last_path_)) sha256_.emplace(last_path_, io::sha256OfFile(last_path_));
}

std::vector<io::InputFile> PlannedInputs::all(const std::filesystem::path& out,
                                              const std::vector<io::InputFile>& before) const {
  std::vector<io::InputFile> inputs;
  for (const Flight& flight : plan_.flights) {
    for (const PlannedInput& input : flight.inputs) {
      const auto known = sha256_.find(input.path);
      const std::string sha256 = !input.sha256.empty()    ? input.sha256
                                 : known != sha256_.end() ? known->second
                                                          : io::sha256OfFile(input.path);
      inputs.push_back({input.path, sha256});
    }
    if (!flight.poses_in_effect.empty()) {
      inputs.push_back({(out / flight.poses_in_effect).string(), flight.poses_in_effect_sha256});
    }
  }
  for (std::size_t n = 0; n < before.size() && n < inputs.size(); ++n) {
    if (before[n].path == inputs[n].path && before[n].sha256 != inputs[n].sha256) refuseChanged(inputs[n].path);
  }
  return inputs;
}

}  // namespace accessvdb::tiles
