// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/json_file.h"

#include <ostream>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "io/streams/sha256.h"

namespace accessvdb::tiles {

namespace {

constexpr const char* kDigest = "sha256";

/// Of everything but the hash itself.
std::string digestOf(const Json& json) {
  const std::string text = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  internal::Sha256 sha256;
  sha256.update(text.data(), text.size());
  return internal::hexOf(sha256.digest());
}

}  // namespace

void writeJson(const std::filesystem::path& path, Json json) {
  json[kDigest] = digestOf(json);
  const std::string text = json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  io::writeFileDurably(path, [&](std::ostream& stream) { stream << text; });
}

void readJson(const std::filesystem::path& path, const std::string& what,
              const std::function<void(const Json&)>& take) {
  if (!io::isFile(path))
    throw InputError(what + ".missing", path.string(), "cannot be opened",
                     "Run the step before it first; they are plan, bin, run and merge");
  try {
    Json json = Json::parse(io::contentAt(path, UINT64_MAX));
    const std::string digest = json.at(kDigest);
    json.erase(kDigest);
    if (digest == digestOf(json)) return take(json);
  } catch (const Json::exception&) {
    // Neither read nor as expected: damaged as well.
  }
  throw InputError(what + ".damaged", path.string(), "is damaged, or another program's",
                   "Move it away and run this step again");
}

}  // namespace accessvdb::tiles
