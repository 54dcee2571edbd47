// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "gis/gdal_library.h"

#include <dlfcn.h>

#include <algorithm>

#include "accessvdb/error.h"
#include "gis/availability.h"

namespace accessvdb::gis {
namespace {

[[noreturn]] void failMissing(const std::string& problem) {
  throw UnusableInput("gdal.missing", "GDAL", problem, "On Debian and Ubuntu: apt install libgdal-dev, or libgdal32");
}

/// The C functions keep their meaning from 3.0 on; each minor version has a number of its own.
void* openLibrary() {
  constexpr int kNewest = 60, kOldest = 26;
  for (int number = kNewest; number >= kOldest; --number) {
    if (void* library = dlopen(("libgdal.so." + std::to_string(number)).c_str(), RTLD_NOW | RTLD_LOCAL)) return library;
  }
  return dlopen("libgdal.so", RTLD_NOW | RTLD_LOCAL);
}

Gdal loaded() {
  void* const library = openLibrary();
  if (library == nullptr) failMissing("its library libgdal.so is not installed");
  Gdal functions = {};
#define ACCESSVDB_GDAL_LOAD(name)                                                     \
  functions.name = reinterpret_cast<decltype(functions.name)>(dlsym(library, #name)); \
  if (functions.name == nullptr) failMissing("its library is too old: it has no " #name);
  ACCESSVDB_GDAL_FUNCTIONS(ACCESSVDB_GDAL_LOAD)
#undef ACCESSVDB_GDAL_LOAD
  functions.CPLPushErrorHandler(functions.CPLQuietErrorHandler);
  functions.GDALAllRegister();
  return functions;
}

}  // namespace

const Gdal& gdal() {
  static const Gdal functions = loaded();
  return functions;
}

void requireGdal() { (void)gdal(); }

void failOf(const std::string& what) {
  std::string words = gdal().CPLGetLastErrorMsg();
  std::replace(words.begin(), words.end(), '\n', ' ');
  throw OutputError("gdal.failed", "GDAL", "could not " + what + (words.empty() ? "" : ": " + words),
                    "Check the coordinate system and the free memory");
}

}  // namespace accessvdb::gis
