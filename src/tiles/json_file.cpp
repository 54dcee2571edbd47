// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/json_file.h"

#include <fstream>
#include <ostream>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"

namespace accessvdb::tiles {

void writeJson(const std::filesystem::path& path, const Json& json) {
  const std::string text = json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  io::writeFileDurably(path, [&](std::ostream& stream) { stream << text; });
}

void readJson(const std::filesystem::path& path, const std::string& what,
              const std::function<void(const Json&)>& take) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream)
    throw InputError(what + ".missing", path.string(), "cannot be opened",
                     "Run the step before it first: accessvdb tile --help lists them");
  try {
    take(Json::parse(stream));
  } catch (const Json::exception& error) {
    throw InputError(what + ".damaged", path.string(), "is damaged", "Delete it and run this step again");
  }
}

}  // namespace accessvdb::tiles
