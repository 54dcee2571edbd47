// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// plan.json, and what a plan needs to know before anything is read.
#include <algorithm>
#include <array>
#include <sstream>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tiles.h"
#include "field/scan_gate.h"
#include "field/tools/window_margins.h"
#include "io/streams/sha256.h"
#include "tiles/first_difference.h"
#include "tiles/json_file.h"
#include "tiles/plan_lock.h"
#include "tiles/tile_grid.h"
#include "tool/tool_kernel.h"

namespace accessvdb::tiles {
namespace {

constexpr int kSchema = 1;

std::filesystem::path planFile(const std::filesystem::path& out) { return out / "plan.json"; }

Json flightContent(const Flight& flight) {
  Json inputs = Json::array();
  for (const PlannedInput& input : flight.inputs) {
    inputs.push_back({{"path", input.path}, {"bytes", input.bytes}, {"sha256", input.sha256}});
  }
  Json content = {{"options", flight.options}, {"inputs", inputs}};
  if (!flight.poses_in_effect.empty()) {
    content["poses_in_effect"] = flight.poses_in_effect;
    content["poses_in_effect_sha256"] = flight.poses_in_effect_sha256;
  }
  return content;
}

/// What determines the results, in the order in which differences are to be named.
Json content(const Plan& plan, std::size_t flights) {
  Json of_flights = Json::array();
  for (std::size_t n = 0; n < flights; ++n) of_flights.push_back(flightContent(plan.flights[n]));
  return {{"program", plan.program},         {"parameters", plan.parameters},
          {"tool", plan.tool_name},          {"tool_sha256", plan.tool_sha256},
          {"origin_W", plan.origin_W},       {"voxel_size_m", plan.voxel_size_m},
          {"tile_voxels", plan.tile_voxels}, {"margin_voxels", plan.margin_voxels},
          {"bin_bytes", plan.bin_bytes},     {"flights", of_flights}};
}

/// Bytes as pairs of hexadecimal digits: JSON holds text alone.
std::string hexText(const std::string& bytes) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string text;
  for (const char c : bytes) {
    const auto byte = static_cast<unsigned char>(c);
    text += {kDigits[byte >> 4], kDigits[byte & 15]};
  }
  return text;
}
std::string bytesOfHex(const std::string& text) {
  std::string bytes;
  for (std::size_t n = 0; n + 1 < text.size(); n += 2) {
    bytes += static_cast<char>(std::stoi(text.substr(n, 2), nullptr, 16));
  }
  return bytes;
}

Json frameJson(const SurveyFrame& frame) {
  return {{"wkt", hexText(frame.wkt)},
          {"geo_keys", hexText(frame.geo_keys)},
          {"geo_doubles", hexText(frame.geo_doubles)},
          {"geo_texts", hexText(frame.geo_texts)},
          {"wkt_counts", frame.wkt_counts},
          {"unit_m", {frame.unit_m.x(), frame.unit_m.y(), frame.unit_m.z()}},
          {"year", frame.year},
          {"day", frame.day},
          {"adjusted_gps_time", frame.adjusted_gps_time},
          {"first_returns", frame.first_returns}};
}
SurveyFrame frameFrom(const Json& json) {
  SurveyFrame frame;
  const auto text = [&](const char* name) { return bytesOfHex(json.at(name).get<std::string>()); };
  frame.wkt = text("wkt");
  frame.geo_keys = text("geo_keys");
  frame.geo_doubles = text("geo_doubles");
  frame.geo_texts = text("geo_texts");
  json.at("wkt_counts").get_to(frame.wkt_counts);
  for (std::size_t axis = 0; axis < 3; ++axis) frame.unit_m[static_cast<int>(axis)] = json.at("unit_m").at(axis);
  json.at("year").get_to(frame.year);
  json.at("day").get_to(frame.day);
  json.at("adjusted_gps_time").get_to(frame.adjusted_gps_time);
  json.at("first_returns").get_to(frame.first_returns);
  return frame;
}

}  // namespace

std::uint64_t Plan::steps() const {
  std::uint64_t steps = 0;
  for (const Flight& flight : flights) steps += flight.stamps_s.size();
  return steps;
}

std::size_t Plan::flightOf(std::uint64_t step) const {
  std::size_t flight = 0;
  while (flight + 1 < flights.size() && step >= flights[flight].stamps_s.size()) {
    step -= flights[flight++].stamps_s.size();
  }
  return flight;
}

Plan identified(Plan plan) {
  plan.ids.clear();
  for (std::size_t flights = 0; flights <= plan.flights.size(); ++flights) {
    std::string text;
    try {
      text = content(plan, flights).dump();
    } catch (const Json::exception&) {  // replaced bytes would name other files when the plan is read again
      throw UnusableInput("plan.name", "",
                          "a name of a scan, its folder or the tool is not UTF-8, as plan.json must be", "Rename it");
    }
    internal::Sha256 sha256;
    sha256.update(text.data(), text.size());
    std::string id = internal::hexOf(sha256.digest());
    if (flights == 0) {
      plan.method_id = std::move(id);
    } else {
      plan.ids.push_back(std::move(id));
    }
  }
  return plan;
}

TileMargins tileMargins(const std::vector<ToolSpec>& tools, const FieldParams& params, const TableProgress& progress) {
  if (params.tsdf.clear_rays_m > 0 || params.tsdf.platform_radius_m > 0) {
    throw InvalidArgument("tiles.clear_rays", "clear_rays_m", "reaches farther than what tiles share",
                          "Map in one piece, or leave it and platform_radius_m out");
  }
  internal::WindowMargins reach;
  for (const ToolSpec& spec : tools) {
    const FieldParams resolved = toolParams(spec, params).resolved();
    reach = internal::unionOf(
        reach, internal::windowMargins(internal::ToolKernel::make(spec.tool, resolved, progress), resolved));
  }
  return marginsFrom(reach);
}

TileMargins marginsFrom(const internal::WindowMargins& reach) {
  const FieldWindow window = {{0, 0}, {FieldWindow::kEdge, FieldWindow::kEdge}};
  TileMargins margins;
  margins.returns_voxels = -internal::returnsOf(window, reach).low[0];
  margins.least_tile_voxels = FieldWindow::kEdge;
  while (margins.least_tile_voxels < 2 * margins.returns_voxels) margins.least_tile_voxels *= 2;
  return margins;
}

std::array<double, 3> originOf(io::ScanSequence& scans, const FieldParams& params) {
  internal::ScanGate gate(params.resolved().tsdf);
  for (std::size_t step = 0; step < scans.size(); ++step) {
    const io::ScanRecord record = scans.read(step);
    FrameStats stats;
    if (record.points_W.empty()) {
      gate.gate(record.points_S, record.T_W_S, stats);
    } else {
      gate.gate(record.points_W, record.origins_W, stats);
    }
    if (gate.hasOrigin()) return {gate.origin_W().x(), gate.origin_W().y(), gate.origin_W().z()};
  }
  throw UnusableInput("scans.no_returns", "", "no scan has a usable return", "Check the scans");
}

void writePlan(const std::filesystem::path& out, const Plan& plan) {
  Json json = {{"schema", kSchema}, {"id", identified(plan).id()}};
  json.update(content(plan, plan.flights.size()));
  if (const SurveyFrame& frame = plan.frame; frame.hasSystem() || frame.first_returns) json["frame"] = frameJson(frame);
  for (std::size_t n = 0; n < plan.flights.size(); ++n) {
    Json& flight = json["flights"][n];
    flight["stamps_s"] = plan.flights[n].stamps_s;
    flight["settings"] = Json::array();
    for (const auto& [name, value] : plan.flights[n].settings) flight["settings"].push_back({name, value});
  }
  const PlanLock lock(out, PlanLock::Kind::ToWrite);
  writeJson(planFile(out), json);
}

bool hasPlan(const std::filesystem::path& out) { return io::isThere(planFile(out), ErrorCode::Output); }

Plan readPlan(const std::filesystem::path& out) {
  Plan plan;
  std::string id;
  readJson(planFile(out), "plan", [&](const Json& json) {
    if (json.at("schema").get<int>() != kSchema) {
      throw UnusableInput("plan.version", planFile(out).string(), "was written by another version of accessvdb",
                          "Use that version, or start again with tiles::removePlan");
    }
    json.at("id").get_to(id);
    json.at("program").get_to(plan.program);
    json.at("parameters").get_to(plan.parameters);
    json.at("tool").get_to(plan.tool_name);
    json.at("tool_sha256").get_to(plan.tool_sha256);
    json.at("origin_W").get_to(plan.origin_W);
    json.at("voxel_size_m").get_to(plan.voxel_size_m);
    json.at("tile_voxels").get_to(plan.tile_voxels);
    json.at("margin_voxels").get_to(plan.margin_voxels);
    json.at("bin_bytes").get_to(plan.bin_bytes);
    if (json.contains("frame")) plan.frame = frameFrom(json.at("frame"));
    for (const Json& from : json.at("flights")) {
      Flight flight;
      from.at("options").get_to(flight.options);
      for (const Json& input : from.at("inputs")) {
        flight.inputs.push_back({input.at("path"), input.at("bytes"), input.at("sha256")});
      }
      if (from.contains("poses_in_effect")) {
        from.at("poses_in_effect").get_to(flight.poses_in_effect);
        from.at("poses_in_effect_sha256").get_to(flight.poses_in_effect_sha256);
      }
      from.at("stamps_s").get_to(flight.stamps_s);
      for (const Json& setting : from.at("settings")) flight.settings.emplace_back(setting.at(0), setting.at(1));
      plan.flights.push_back(std::move(flight));
    }
  });
  const std::int32_t edges = plan.tile_voxels / FieldWindow::kEdge;
  const bool usable = edges > 0 && plan.tile_voxels % FieldWindow::kEdge == 0 && (edges & (edges - 1)) == 0;
  plan = identified(std::move(plan));
  if (!usable || plan.flights.empty() || plan.id() != id) {
    throw InputError("plan.damaged", planFile(out).string(), "is damaged", "Start again with tiles::removePlan");
  }
  return plan;
}

void requireSame(const Plan& wanted, const Plan& found, const std::filesystem::path& out) {
  const auto refuse = [&](const std::string& difference, const char* cure = "") {
    throw UnusableInput(
        "plan.changed", out.string(), "holds tiles of another run: " + difference,
        std::string("Use the same scans, tool and parameters, another folder, or tiles::removePlan") + cure);
  };
  if (wanted.program != found.program) refuse("version " + found.program + " instead of " + wanted.program);
  if (wanted.parameters != found.parameters) refuse(firstDifference(found.parameters, wanted.parameters));
  if (wanted.tool_name != found.tool_name || wanted.tool_sha256 != found.tool_sha256) refuse("another tool");
  if (wanted.origin_W != found.origin_W) refuse("another origin");
  if (wanted.flights.size() != found.flights.size()) {
    refuse(std::to_string(found.flights.size()) + " flights instead of " + std::to_string(wanted.flights.size()));
  }
  for (std::size_t n = 0; n < wanted.flights.size(); ++n) {
    const Flight &now = wanted.flights[n], &then = found.flights[n];
    if (now.poses_in_effect != then.poses_in_effect) {
      refuse("its poses were corrected", "; what is left of it is done by accessvdb tile bin, run and merge");
    }
    if (now.options != then.options) refuse(firstDifference(then.options, now.options));
    if (now.inputs.size() != then.inputs.size()) {
      refuse(std::to_string(then.inputs.size()) + " input files instead of " + std::to_string(now.inputs.size()));
    }
    for (std::size_t k = 0; k < now.inputs.size(); ++k) {
      const PlannedInput &file = now.inputs[k], &before = then.inputs[k];
      const char* const cure =
          before.sha256.empty()
              ? ""
              : "; with corrected poses, accessvdb tile plan OUT ScanInputOptions::poses FILE goes on";
      if (file.path != before.path) refuse("input " + before.path + " instead of " + file.path, cure);
      if (file.bytes != before.bytes || file.sha256 != before.sha256) refuse(file.path + " has changed since", cure);
    }
  }
  if (wanted.id() != found.id()) refuse("tiles of another size");
}

}  // namespace accessvdb::tiles
