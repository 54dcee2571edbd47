// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <charconv>

#include "accessvdb/error.h"
#include "accessvdb/tiles.h"

namespace accessvdb::tiles {

std::string TileId::name() const {
  return std::to_string(x) + "_" + std::to_string(y) + (quarters.empty() ? "" : "." + quarters);
}

TileId TileId::parse(const std::string& name) {
  TileId id;
  const auto number = [end = name.data() + name.size()](const char* from, std::int32_t& value) {
    const auto [rest, error] = std::from_chars(from, end, value);
    return error == std::errc() ? rest : nullptr;
  };
  const char* rest = number(name.data(), id.x);
  if (rest != nullptr && *rest == '_') rest = number(rest + 1, id.y);
  if (rest != nullptr && *rest == '.') id.quarters = rest + 1;
  // What reads back as something else, such as "01_2", is no name of a tile either.
  if (id.name() != name || id.quarters.find_first_not_of("0123") != std::string::npos) {
    throw InvalidArgument("usage.tile", name, "is not the name of a tile",
                          "Use a name that accessvdb tile list prints");
  }
  return id;
}

std::array<TileId, 4> TileId::split() const {
  std::array<TileId, 4> parts = {*this, *this, *this, *this};
  for (std::size_t n = 0; n < parts.size(); ++n) parts[n].quarters += static_cast<char>('0' + n);
  return parts;
}

FieldWindow TileId::window(std::int32_t tile_voxels) const {
  std::int32_t edge = tile_voxels;
  std::array<std::int32_t, 2> low = {x * edge, y * edge};
  for (const char digit : quarters) {
    edge /= 2;
    if (digit == '1' || digit == '3') low[0] += edge;
    if (digit == '2' || digit == '3') low[1] += edge;
  }
  return {low, {low[0] + edge, low[1] + edge}};
}

}  // namespace accessvdb::tiles
