// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/las_units.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>

#include "accessvdb/error.h"
#include "io/clouds/epsg_units.h"
#include "io/clouds/scalar_type.h"
#include "io/clouds/wkt_tree.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

namespace accessvdb::io {
namespace {

constexpr const char* kReproject = "Reproject it into metres, for example by pdal translate with filters.reprojection";
constexpr double kFoot_m = 0.3048, kSurveyFoot_m = 1200.0 / 3937;

struct CodedUnit {
  int code;  ///< EPSG
  const char* name;
  double metres;  ///< 0: not read
};
constexpr CodedUnit kCodedUnits[] = {{9001, "metres", 1},
                                     {9002, "feet", kFoot_m},
                                     {9003, "US survey feet", kSurveyFoot_m},
                                     {9004, "modified American feet", 0},
                                     {9005, "Clarke's feet", 0},
                                     {9006, "Indian feet", 0},
                                     {9007, "Clarke's links", 0},
                                     {9014, "fathoms", 0},
                                     {9030, "nautical miles", 0},
                                     {9036, "kilometres", 0},
                                     {9070, "British feet of 1865", 0},
                                     {9095, "British feet of 1936", 0},
                                     {9102, "degrees", 0}};

[[noreturn]] void refuseUnit(const std::string& subject, const std::string& what) {
  throw InputError("input.unit", subject, what + "; read are metres, feet and US survey feet", kReproject);
}

[[noreturn]] void refuseGeographic(const std::string& subject, const std::string& by, bool geocentric) {
  throw InputError("input.geographic", subject,
                   geocentric ? by + " says that coordinates are geocentric, from the Earth's centre, where up is not z"
                              : by + " says that coordinates are geographic: longitude and latitude in degrees",
                   kReproject);
}

/// The unit that has this length, within the digits that files write.
const CodedUnit* unitOfLength(double metres) {
  for (const CodedUnit& unit : kCodedUnits)
    if (unit.metres > 0 && std::abs(metres / unit.metres - 1) < 2e-7) return &unit;
  return nullptr;
}

const CodedUnit* unitOfCode(int code) {
  const auto known = std::find_if(std::begin(kCodedUnits), std::end(kCodedUnits),
                                  [code](const CodedUnit& unit) { return unit.code == code; });
  return known == std::end(kCodedUnits) ? nullptr : known;
}

/// The unit of what EPSG numbers. @param unit  0: null
const CodedUnit* unitOfEpsg(int unit, int code, const std::string& subject, const char* of) {
  if (unit == 0) return nullptr;
  const CodedUnit* const known = unitOfCode(unit);
  if (known != nullptr && known->metres > 0) return known;
  refuseUnit(subject, std::string("has ") + of + " in " + (known != nullptr ? known->name : "a unit of another kind") +
                          " (EPSG:" + std::to_string(code) + " by its GeoKeys)");
}

LasUnits unitsFrom(const CodedUnit& horizontal, const CodedUnit& vertical) {
  LasUnits units;
  units.metres = {horizontal.metres, horizontal.metres, vertical.metres};
  if (horizontal.metres == 1 && vertical.metres == 1) return units;
  units.words = horizontal.name;
  if (horizontal.metres != vertical.metres) units.words += std::string(" (heights in ") + vertical.name + ")";
  return units;
}

/// Values of GeoKeys that are in the directory itself, in the list of doubles, and in the text.
struct GeoKeys {
  std::map<int, int> values = {};
  std::map<int, double> doubles = {};
  std::map<int, std::string> texts = {};
  bool twice = false;  ///< one key has two values; the last is here

  [[nodiscard]] int value(int key) const {
    const auto found = values.find(key);
    return found == values.end() ? 0 : found->second;
  }
};

std::optional<GeoKeys> geoKeysOf(const std::string& directory, const std::string& doubles, const std::string& texts) {
  constexpr std::size_t kEntry = 8;
  const auto number = [&](std::size_t at) { return int{loadScalar<std::uint16_t>(directory.data() + at)}; };
  if (directory.size() < kEntry) return std::nullopt;
  const auto count = static_cast<std::size_t>(number(6));
  if (directory.size() / kEntry < count + 1) return std::nullopt;
  GeoKeys keys;
  for (std::size_t i = 1; i <= count; ++i) {
    const int key = number(kEntry * i), place = number(kEntry * i + 2), value = number(kEntry * i + 6);
    if (place == 0) {
      keys.twice = keys.twice || (keys.values.contains(key) && keys.values[key] != value);
      keys.values[key] = value;
    }
    const auto offset = sizeof(double) * static_cast<std::size_t>(value);
    if (place == 34736 && offset + sizeof(double) <= doubles.size())
      keys.doubles[key] = loadScalar<double>(doubles.data() + offset);
    const auto begin = static_cast<std::size_t>(value);
    if (place == 34737 && begin < texts.size())
      keys.texts[key] = texts.substr(begin, static_cast<std::size_t>(number(kEntry * i + 4)));
  }
  return keys;
}

std::optional<GeoKeys> geoKeysOf(const LasProjection& projection) {
  return geoKeysOf(projection.geo_keys.value_or(""), projection.geo_doubles.value_or(""),
                   projection.geo_texts.value_or(""));
}

constexpr int kModelType = 1024, kCitation = 1026, kGeographicType = 2048, kProjectedType = 3072,
              kProjectedCitation = 3073, kLinearUnits = 3076, kLinearUnitSize = 3077, kVerticalType = 4096,
              kVerticalCitation = 4097, kVerticalUnits = 4099, kUserDefined = 32767;

/// The unit that a text has among its words: "NAD83 / Texas Central (ftUS)", "Units: US Survey Feet".
/// @param both  set where it has metres and feet: then it is not known which are of what
const CodedUnit* unitInWords(const std::string& text, bool& both) {
  bool metres = false, feet = false, survey = false;
  std::string word, before;
  for (const char c : inLowerCase(text) + " ") {
    if (c >= 'a' && c <= 'z') {
      word += c;
      continue;
    }
    if (word.empty()) continue;
    const auto is = [&word](std::initializer_list<std::string_view> words) {
      return std::find(words.begin(), words.end(), word) != words.end();
    };
    metres = metres || is({"m", "metre", "metres", "meter", "meters"});
    const bool of_survey = is({"ftus", "usft", "sft", "usfoot", "usfeet", "footus", "feetus"});
    feet = feet || of_survey || is({"ft", "foot", "feet", "ift", "intft", "ftint", "footintl", "feetintl"});
    // "US survey foot", "Foot_US", "US ft"
    const bool us_foot = (is({"us"}) && (before == "foot" || before == "feet" || before == "ft")) ||
                         (is({"ft", "foot", "feet"}) && (before == "us" || before == "survey"));
    survey = survey || of_survey || us_foot;
    before = word;
    word.clear();
  }
  both = both || (metres && feet);
  if (metres == feet) return nullptr;
  return unitOfCode(metres ? kEpsgMetre : survey ? kEpsgSurveyFoot : kEpsgFoot);
}

/// @return null where the keys do not say it
const CodedUnit* unitOfKey(const GeoKeys& keys, int key, const std::string& subject, const char* of) {
  const int code = keys.value(key);
  if (code == 0) return nullptr;
  const CodedUnit* const known = unitOfCode(code);
  if (known != nullptr && known->metres > 0) return known;
  if (code == kUserDefined && key == kLinearUnits) {
    const auto size = keys.doubles.find(kLinearUnitSize);
    const CodedUnit* const unit = size == keys.doubles.end() ? nullptr : unitOfLength(size->second);
    if (unit != nullptr) return unit;
  }
  refuseUnit(subject, std::string("has ") + of + " in " + (known != nullptr ? known->name : "a unit of another kind") +
                          " (" + std::to_string(code) + " by its GeoKeys)");
}

LasUnits unitsOfKeys(const GeoKeys& keys, const std::string& subject) {
  const int model = keys.value(kModelType);
  const bool only_geographic = model != 1 && keys.value(kGeographicType) != 0 && keys.value(kProjectedType) == 0 &&
                               keys.value(kLinearUnits) == 0;
  if (model == 2 || model == 3 || only_geographic) refuseGeographic(subject, "its GeoKeys", model == 3);
  // What the keys say counts before what the number of a system means, and this before words.
  bool unclear = false;
  const auto inWords = [&](int key) {
    const auto text = keys.texts.find(key);
    return text == keys.texts.end() ? nullptr : unitInWords(text->second, unclear);
  };
  const int projected = keys.value(kProjectedType), heights = keys.value(kVerticalType);
  const CodedUnit* horizontal = unitOfKey(keys, kLinearUnits, subject, "coordinates");
  if (horizontal == nullptr)
    horizontal = unitOfEpsg(epsgUnitOfProjection(projected), projected, subject, "coordinates");
  for (const int key : {kProjectedCitation, kCitation})
    if (horizontal == nullptr) horizontal = inWords(key);
  const bool assumed = horizontal == nullptr && (unclear || (projected != 0 && projected != kUserDefined));
  if (horizontal == nullptr) horizontal = unitOfCode(kEpsgMetre);
  const CodedUnit* vertical = unitOfKey(keys, kVerticalUnits, subject, "heights");
  if (vertical == nullptr) vertical = unitOfEpsg(epsgUnitOfHeights(heights), heights, subject, "heights");
  if (vertical == nullptr) vertical = inWords(kVerticalCitation);
  LasUnits units = unitsFrom(*horizontal, vertical != nullptr ? *vertical : *horizontal);
  if (assumed)
    units.doubt =
        (projected != 0 ? "the unit of its projection (" + std::to_string(projected) + " by its GeoKeys) is not said: "
                        : std::string("its GeoKeys name metres and feet: ")) +
        "coordinates are taken to be in metres";
  return units;
}

std::string unitName(const WktNode& unit) {
  return (unit.values.empty() ? "a unit without a name" : "'" + wordForMessage(unit.values[0]) + "'");
}

/// @return null where there is no unit
const CodedUnit* unitOfNode(const WktNode* unit, const std::string& subject, const char* of) {
  if (unit == nullptr) return nullptr;
  double metres = 0;
  const CodedUnit* const known =
      unit->values.size() >= 2 && parseNumber(unit->values[1], metres) && metres > 0 ? unitOfLength(metres) : nullptr;
  if (known == nullptr) refuseUnit(subject, std::string("has ") + of + " in " + unitName(*unit) + " by its WKT");
  return known;
}

const WktNode* lengthUnitIn(const WktNode& node) { return node.child({"LENGTHUNIT", "UNIT"}); }

/// The unit of one axis, or of all: in WKT 2 each may have its own.
const WktNode* unitOfAxis(const WktNode& crs, std::size_t axis) {
  std::size_t i = 0;
  for (const WktNode& child : crs.children) {
    if (child.keyword != "AXIS" || i++ != axis) continue;
    if (const WktNode* const own = lengthUnitIn(child)) return own;
  }
  return lengthUnitIn(crs);
}

/// What was found on the way down a tree.
struct WktUnits {
  const CodedUnit* horizontal = nullptr;
  const CodedUnit* vertical = nullptr;
};

bool isKind(const WktNode& node, std::initializer_list<std::string_view> keywords) {
  return std::find(keywords.begin(), keywords.end(), node.keyword) != keywords.end();
}

void collectUnits(const WktNode& node, const std::string& subject, WktUnits& found) {
  if (isKind(node, {"COMPD_CS", "COMPOUNDCRS", "BOUNDCRS", "SOURCECRS", "COORDINATEMETADATA"})) {
    for (const WktNode& child : node.children) collectUnits(child, subject, found);
  } else if (isKind(node, {"PROJCS", "PROJCRS", "PROJECTEDCRS", "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "LOCALCS",
                           "DERIVEDPROJCRS", "ENGINEERCRS"})) {
    found.horizontal = unitOfNode(unitOfAxis(node, 0), subject, "coordinates");
    const WktNode* const cs = node.child({"CS"});
    const bool three = cs != nullptr && cs->values.size() >= 2 && cs->values[1] == "3";
    if (three) found.vertical = unitOfNode(unitOfAxis(node, 2), subject, "heights");
  } else if (isKind(node, {"VERT_CS", "VERTCRS", "VERTICALCRS"})) {
    found.vertical = unitOfNode(unitOfAxis(node, 0), subject, "heights");
  } else if (isKind(node, {"GEOCCS"})) {
    refuseGeographic(subject, "its WKT", true);
  } else if (isKind(node, {"GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS"})) {
    const WktNode* const cs = node.child({"CS"});
    const std::string kind = cs == nullptr || cs->values.empty() ? "" : inLowerCase(cs->values[0]);
    refuseGeographic(subject, "its WKT", kind == "cartesian");
  }
}

/// EPSG's number of the projection in a tree, 0 where it has none.
int epsgOf(const WktNode& node) {
  if (isKind(node, {"COMPD_CS", "COMPOUNDCRS", "BOUNDCRS", "SOURCECRS", "COORDINATEMETADATA"})) {
    for (const WktNode& child : node.children)
      if (const int code = epsgOf(child)) return code;
    return 0;
  }
  if (!isKind(node, {"PROJCS", "PROJCRS", "PROJECTEDCRS"})) return 0;
  const WktNode* const id = node.child({"AUTHORITY", "ID"});
  double code = 0;
  if (id == nullptr || id->values.size() < 2 || id->values[0] != "EPSG" || !parseNumber(id->values[1], code)) return 0;
  return code > 0 && code < kUserDefined ? static_cast<int>(code) : 0;
}

/// Whether WKT and GeoKeys say different numbers of EPSG, or different units.
bool contradict(const LasProjection& projection, const WktNode& tree, const GeoKeys& keys) {
  const int by_wkt = epsgOf(tree), by_keys = keys.value(kProjectedType);
  if (by_wkt != 0 && by_keys != 0 && by_keys != kUserDefined && by_wkt != by_keys) return true;
  LasProjection wkt_alone = projection, keys_alone = projection;
  wkt_alone.geo_keys.reset();
  keys_alone.wkt.reset();
  try {
    const LasUnits a = lasUnits(wkt_alone, {}), b = lasUnits(keys_alone, {});
    if (!a.doubt.empty() || !b.doubt.empty()) return false;
    const bool heights = keys.value(kVerticalUnits) != 0;
    return a.metres[0] != b.metres[0] || (heights && a.metres[2] != b.metres[2]);
  } catch (const InputError&) {  // degrees or a unit that is not read, by one of them
    return true;
  }
}

/// GeoKeys that contradict themselves; empty if they do not.
std::string doubtIn(const GeoKeys& keys) {
  if (keys.twice) return "its GeoKeys have a key twice, with two values: the last one counts";
  const CodedUnit* const said = unitOfCode(keys.value(kLinearUnits));
  const CodedUnit* const of_code = unitOfCode(epsgUnitOfProjection(keys.value(kProjectedType)));
  if (said == nullptr || of_code == nullptr || said == of_code) return {};
  return "its GeoKeys say " + std::string(said->name) + ", but its projection (" +
         std::to_string(keys.value(kProjectedType)) + ") is in " + of_code->name + ": coordinates are taken to be in " +
         said->name;
}

}  // namespace

std::string wktText(const LasProjection& projection) {
  const std::string text = projection.wkt.value_or("");
  return text.substr(0, text.find('\0'));
}

LasSystem lasSystem(const LasProjection& projection) {
  const std::string text = wktText(projection);
  const auto tree = parseWkt(text);
  const auto keys = geoKeysOf(projection);
  LasSystem system = {tree.has_value(), keys.has_value(), {}};
  if (projection.cut_off) system.doubt = "its list of records is damaged: what follows there is not read";
  if (projection.repeated) system.doubt = "it has two records of one kind that say different systems: the first counts";
  if (keys && !doubtIn(*keys).empty()) system.doubt = doubtIn(*keys);
  if (projection.geo_keys && !keys) system.doubt = "its GeoKeys cannot be read and are left out";
  if (!text.empty() && !tree) system.doubt = "its WKT is not well formed and is left out";
  if (!tree || !keys || !contradict(projection, *tree, *keys)) return system;
  (projection.wkt_counts ? system.keys : system.wkt) = false;
  system.doubt = std::string("its WKT and its GeoKeys say different systems: by its header the ") +
                 (projection.wkt_counts ? "WKT counts, and the GeoKeys are" : "GeoKeys count, and the WKT is") +
                 " left out";
  return system;
}

LasUnits lasUnits(const LasProjection& projection, const std::string& subject) {
  LasUnits units;
  if (projection.cut_off)
    units.doubt = "its list of records is damaged, and none before the damage says the unit: it is taken to be metres";
  const auto ofKeys = [&]() -> std::optional<LasUnits> {
    if (!projection.geo_keys) return std::nullopt;
    const auto keys = geoKeysOf(projection);
    if (keys) return unitsOfKeys(*keys, subject);
    units.doubt = "its GeoKeys cannot be read: coordinates are taken to be in metres";
    return std::nullopt;
  };
  const auto ofWkt = [&]() -> std::optional<LasUnits> {
    const std::string text = wktText(projection);
    if (text.empty()) return std::nullopt;
    WktUnits found;
    if (const auto tree = parseWkt(text)) {
      collectUnits(*tree, subject, found);
      if (found.horizontal != nullptr)
        return unitsFrom(*found.horizontal, found.vertical != nullptr ? *found.vertical : *found.horizontal);
    }
    units.doubt = "its WKT names no unit that can be read: coordinates are taken to be in metres";
    return std::nullopt;
  };
  std::optional<LasUnits> said = projection.wkt_counts ? ofWkt() : ofKeys();
  if (!said) said = projection.wkt_counts ? ofKeys() : ofWkt();
  return said ? *said : units;
}

}  // namespace accessvdb::io
