// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Coordinate systems that are given by hand: by PROJ's program, which is not needed for anything else.
#include <string>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/scan_io.h"
#include "io/clouds/decoder_pipe.h"
#include "io/clouds/las_units.h"
#include "io/clouds/wkt_tree.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

constexpr const char* kProjInfo = "projinfo";
constexpr const char* kNeeds = "needs PROJ's program projinfo, which is not installed";

/// What PROJ makes of a definition: well-known text as LAS has it. @throws InputError "las.crs"
std::string byProj(const std::string& definition, const std::string& crs) {
  try {
    const auto source = openProgram(definition, std::string(kProjInfo) + " -q --single-line -o WKT1:GDAL");
    std::string text;
    for (std::string_view part = source->view(0, 1); !part.empty(); part = source->view(text.size(), 1)) text += part;
    source->checkAtEnd();
    text.erase(text.find_last_not_of(" \r\n\t") + 1);
    if (parseWkt(text)) return text;
  } catch (const InputError&) {  // what the program says is about its own options
  }
  throw InputError("las.crs", crs, "is no coordinate system that PROJ knows",
                   "Use a code such as EPSG:32632, or a file with well-known text");
}

}  // namespace

std::string crsWkt(const std::string& crs) { return crsFrame(crs).wkt; }

SurveyFrame crsFrame(const std::string& crs) {
  const bool proj = isInstalled(kProjInfo);
  std::string wkt;
  if (isFile(crs)) {
    wkt = readInputFile(crs, std::size_t{1} << 20);
    wkt.erase(wkt.find_last_not_of(" \r\n\t\0") + 1);
    if (!parseWkt(wkt)) {
      throw InputError("las.crs", forMessage(crs), "contains no well-known text", "Use a code such as EPSG:32632");
    }
    if (proj) (void)byProj("@" + crs, forMessage(crs));
  } else {
    if (!proj) throw InputError("las.crs", forMessage(crs), kNeeds, "apt install proj-bin, or give a file with WKT");
    wkt = byProj(crs, forMessage(crs));
  }
  LasProjection projection;
  projection.wkt = wkt;
  projection.wkt_counts = true;
  const LasUnits units = lasUnits(projection, forMessage(crs));  // refuses degrees, and units that are not read
  if (!units.doubt.empty()) {
    throw InputError("las.crs", forMessage(crs), "names no unit of length that can be read",
                     "Use a projected coordinate system");
  }
  SurveyFrame frame;
  frame.wkt = wkt;
  frame.wkt_counts = true;
  frame.unit_m = units.metres;
  return frame;
}

}  // namespace accessvdb::io
