// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/report.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <ostream>

#include "accessvdb/config.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/memory_prediction.h"
#include "output/output_files.h"

#include "output/json_text.h"

namespace accessvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

Json jsonTimes(const StageTimes& times) {
  return {{"mean", times.mean()},
          {"p50", times.percentile(0.50)},
          {"p95", times.percentile(0.95)},
          {"p99", times.percentile(0.99)},
          {"max", times.percentile(1.0)}};
}

/// Numbers and booleans as such, everything else as text (JSON has no infinity).
Json jsonValue(const std::string& text) {
  if (text == "true" || text == "false") return text == "true";
  const char* end = text.data() + text.size();
  std::int64_t integer = 0;
  if (auto parsed = std::from_chars(text.data(), end, integer); parsed.ec == std::errc() && parsed.ptr == end)
    return integer;
  double real = 0;
  if (auto parsed = std::from_chars(text.data(), end, real);
      parsed.ec == std::errc() && parsed.ptr == end && std::isfinite(real)) {
    return real;
  }
  return text;
}

Json jsonLive(const LiveReport& live) {
  const LiveStatus& status = live.status;
  Json dropped = Json::object();
  for (int i = 0; i < kNumScanDrops; ++i) {
    dropped[name(static_cast<ScanDrop>(i))] = status.dropped[static_cast<std::size_t>(i)];
  }
  Json answers = Json::array();
  for (const LiveAnswer& answer : live.commands.answers)
    answers.push_back(
        {{"id", Json::parse(answer.id)}, {"command", answer.command}, {"done", answer.done}, {"words", answer.words}});
  Json json = {
      {"published", status.published},
      {"taken", status.taken},
      {"late", status.late},
      {"waiting", status.waiting},
      {"dropped", dropped},
      {"paused", status.paused},
      {"all_closed", status.all_closed},
      {"waits_for_level", status.waits_for_level},
      {"resets", status.resets},
      {"commands",
       {{"received", live.commands.received},
        {"done", live.commands.done},
        {"refused", live.commands.refused},
        {"unanswered", live.commands.unanswered}}},
      {"answers", answers},
      {"malformed", live.malformed},
      {"lost", live.lost},
      {"poses",
       {{"received", status.poses},
        {"invalid", status.poses_invalid},
        {"repeated", status.poses_repeated},
        {"backwards", status.poses_backwards},
        {"other_frame", status.poses_other_frame}}},
      {"transforms",
       {{"received", status.transforms},
        {"invalid", status.transforms_invalid},
        {"other_parent", status.transforms_other_parent}}},
      {"frame", status.world_frame},
      {"sensor_chain", status.sensor_chain},
      {"points_in", status.points_in},
      {"points_used", status.points_used},
      {"excluded_returns", status.excluded_returns},
      {"unposed_returns", status.unposed_returns},
      {"by_times", status.by_times},
      {"motion", status.motion},
      {"surface_points", status.surface_points},
      {"memory",
       {{"bytes", status.memory_bytes},
        {"limit_bytes", status.memory_limit_bytes},
        {"full", status.memory_full},
        {"left_out_returns", status.left_out_returns}}},
      {"latency_ms", {{"p50", status.latency_p50_ms}, {"p99", status.latency_p99_ms}, {"max", status.latency_max_ms}}}};
  if (status.budget_ms > 0) {
    json["budget"] = {{"ms", status.budget_ms},
                      {"points", status.budget_points},
                      {"backlog", status.backlog},
                      {"withheld", status.withheld_points},
                      {"backlog_ms", status.backlog_ms},
                      {"backlog_max", status.backlog_max},
                      {"backlog_max_ms", status.backlog_max_ms},
                      {"backlog_steps", status.backlog_steps}};
  }
  if (const auto& rolling = status.rolling) {
    json["rolling"] = {{"tiles", rolling->tiles},          {"tiles_in_memory", rolling->tiles_in_memory},
                       {"saved", rolling->saved},          {"loaded", rolling->loaded},
                       {"unsaved", rolling->unsaved},      {"memory_short", rolling->memory_short},
                       {"lost_tiles", rolling->lost_tiles}};
    if (rolling->memory_short) json["rolling"]["fitting_range_m"] = rolling->fitting_range_m;
  }
  return json;
}

Json jsonAgreement(const io::ScanAgreement& agreement) {
  Json json = {{"verdict", io::name(agreement.verdict)}, {"scans", agreement.scans}};
  if (!agreement.why_not.empty()) json["why_not"] = agreement.why_not;
  if (agreement.pairs == 0) return json;
  const io::AgreementCounts& counts = agreement.counts;
  json["pairs"] = agreement.pairs;
  json["agreeing"] = counts.agreeing;
  json["contradicting"] = counts.contradicting;
  json["hidden"] = counts.hidden;
  json["beside"] = counts.beside;
  if (!agreement.outliers.empty()) json["outliers"] = agreement.outliers;
  return json;
}

std::filesystem::path folderOf(const std::filesystem::path& path) {
  return path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
}

}  // namespace

std::string liveJson(const LiveReport& live) { return jsonText(jsonLive(live), -1); }

double StageTimes::mean() const {
  if (samples_ms_.empty()) return 0;
  return std::accumulate(samples_ms_.begin(), samples_ms_.end(), 0.0) / static_cast<double>(samples_ms_.size());
}

double StageTimes::percentile(double share) const {
  if (samples_ms_.empty()) return 0;
  std::vector<double> sorted = samples_ms_;
  std::sort(sorted.begin(), sorted.end());
  const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(sorted.size())));
  return sorted[std::clamp<std::size_t>(rank, 1, sorted.size()) - 1];
}

void RunReport::add(const FrameStats& stats) {
  points_in += stats.points_in;
  points_used += stats.points_used;
  for (int reason = 0; reason < kNumDropReasons; ++reason) dropped[reason] += stats.dropped[reason];
  contradicted_platforms += stats.contradicted_platforms;
  if (stats.fused_on_device) ++scans_fused_on_device;
}

void RunReport::addScan(const FrameStats& stats, bool with_distance) {
  add(stats);
  integrate.add(stats.integrate_ms);
  mirror.add(stats.mirror_ms);
  changed_leaves.add(static_cast<double>(stats.changed_leaves));
  mirror_bytes.add(static_cast<double>(stats.mirror_bytes));
  if (!with_distance) return;
  distance_mirror.add(stats.distance_mirror_ms);
  distance_leaves.add(static_cast<double>(stats.distance_leaves));
  distance_mirror_bytes.add(static_cast<double>(stats.distance_mirror_bytes));
}

Eigen::AlignedBox3d countPoints(RunReport& report, const MemoryUse& memory, const SurfacePoints& points) {
  report.memory = memory;
  report.surface_points = points.size();
  report.labels = {};
  report.reasons = {};
  for (ReportedTool& tool : report.tools) tool.accessible = 0;
  Eigen::AlignedBox3d bounds_W;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const SurfacePoint point = points.at(n);
    ++report.labels[static_cast<std::size_t>(point.label)];
    ++report.reasons[static_cast<std::size_t>(point.reason)];
    for (std::size_t k = 0; k < report.tools.size(); ++k) report.tools[k].accessible += point.tools >> k & 1;
    bounds_W.extend(point.position_W);
  }
  return bounds_W;
}

void writeReport(const std::filesystem::path& path, const RunReport& report, const Messages& messages) {
  Json parameters = Json::object();
  for (const auto& [key, value] : report.parameters) parameters[key] = jsonValue(value);
  Json inputs = Json::array();
  for (const io::InputFile& file : report.inputs) inputs.push_back({{"path", file.path}, {"sha256", file.sha256}});
  // What an earlier run left is as that run says.
  const Json outputs = jsonOf(report.failure ? withEarlier(report.outputs, folderOf(path)) : report.outputs);
  Json dropped = Json::object();
  for (int i = 0; i < kNumDropReasons; ++i) dropped[name(static_cast<DropReason>(i))] = report.dropped[i];
  Json reasons = Json::object();
  for (int i = 1; i < kNumPointReasons; ++i) {
    const auto reason = static_cast<PointReason>(i);
    // Only --change full and --points surface have any.
    const bool rare = reason == PointReason::Changed || reason == PointReason::BesideSurface;
    if (rare && report.reasons[i] == 0) continue;
    reasons[name(reason)] = report.reasons[i];
  }
  const auto count = [&](PointLabel label) { return report.labels[static_cast<int>(label)]; };

  Json json = {
      {"schema", 1},
      {"version", ACCESSVDB_VERSION},
      {"exit_code", report.exit_code},
      {"device", report.device},
      {"parameters", parameters},
      {"inputs", inputs},
      {"outputs", outputs},
      {"counts",
       {{"scans", report.scans},
        {"points_in", report.points_in},
        {"points_used", report.points_used},
        {"dropped", dropped},
        {"surface_points", report.surface_points},
        {"accessible", count(PointLabel::Accessible)},
        {"blocked", count(PointLabel::Blocked)},
        {"unscored", count(PointLabel::Unscored)},
        {"reasons", reasons}}},
      {"timing_ms",
       {{"frame", jsonTimes(report.frame)},
        {"integrate", jsonTimes(report.integrate)},
        {"mirror", jsonTimes(report.mirror)},
        {"update", jsonTimes(report.update)},
        {"score", jsonTimes(report.score)}}},
      {"per_scan",
       {{"changed_leaves", jsonTimes(report.changed_leaves)}, {"mirror_bytes", jsonTimes(report.mirror_bytes)}}},
      {"memory",
       {{"host_peak_bytes", peakMemoryBytes()},
        {"device_peak_bytes", report.memory.device_peak_bytes},
        {"mirror_bytes", report.memory.mirror_bytes}}},
      {"map",
       {{"leaves", report.memory.leaves},
        {"active_voxels", report.memory.active_voxels},
        {"bytes", report.memory.map_bytes}}}};
  for (const ReportedTool& tool : report.tools) {
    json["tools"].push_back({{"name", tool.name},
                             {"tool", tool.tool},
                             {"tool_unit", tool.unit},
                             {"tool_tip", tool.tip},
                             {"tool_axis", tool.axis},
                             {"tool_up", tool.up},
                             {"sha256", tool.sha256},
                             {"orientations", tool.orientations},
                             {"rolls", tool.rolls},
                             {"max_collisions", tool.max_collisions}});
    if (tool.margin_m > 0) json["tools"].back()["margin_m"] = tool.margin_m;
    if (report.tiles) continue;  // tile.json and field.vdb have the rest
    json["tools"].back()["collision_limit"] = tool.collision_limit;
    json["tools"].back()["accessible"] = tool.accessible;
  }
  if (!report.distance_mirror.empty()) {
    json["timing_ms"]["distance_mirror"] = jsonTimes(report.distance_mirror);
    json["per_scan"]["distance_leaves"] = jsonTimes(report.distance_leaves);
    json["per_scan"]["distance_mirror_bytes"] = jsonTimes(report.distance_mirror_bytes);
    json["memory"]["distance_mirror_bytes"] = report.memory.distance_mirror_bytes;
  }
  if (!report.device_note_id.empty()) {
    json["device_note"] = {{"id", report.device_note_id}, {"text", report.device_note}};
  }
  if (isGpu(report.device)) json["scans_fused_on_device"] = report.scans_fused_on_device;
  if (report.agreement) json["agreement"] = jsonAgreement(*report.agreement);
  if (report.noise_points > 0) json["counts"]["noise_points"] = report.noise_points;
  if (report.resumed_after_scans) json["resumed_after_scans"] = *report.resumed_after_scans;
  if (report.predicted_bytes) json["memory"]["predicted_bytes"] = *report.predicted_bytes;
  for (const auto& [region, removal] : report.removals) {
    json["removed"].push_back({{"region", region},
                               {"as", name(removal.as)},
                               {"voxels", removal.voxels},
                               {"colliding_voxels", removal.colliding_voxels},
                               {"points", removal.points}});
  }
  if (report.tiles) {
    const TilesReport& tiles = *report.tiles;
    json["tiles"] = {{"tile_voxels", tiles.tile_voxels},
                     {"margin_voxels", tiles.margin_voxels},
                     {"done", tiles.done},
                     {"todo", tiles.todo},
                     {"split", tiles.split},
                     {"ray_bytes", tiles.ray_bytes},
                     {"seconds", tiles.seconds},
                     {"peak_bytes", tiles.peak_bytes}};
    Json poison = Json::array();
    for (const tiles::Poison& tile : tiles.poison) {
      poison.push_back({{"tile", tile.id.name()}, {"exit_code", tile.exit_code}, {"reason", tile.reason}});
    }
    json["tiles"]["poison"] = poison;
    json["partial"] = tiles.todo > 0;
  }
  if (report.live) json["live"] = jsonLive(*report.live);
  Json warnings = Json::array();
  for (const auto& [id, text] : messages.warnings()) warnings.push_back({{"id", id}, {"text", text}});
  json["warnings"] = warnings;
  json["notices"] = messages.notices();
  if (report.failure) {
    json["error"] = {{"id", report.failure->id},
                     {"subject", report.failure->subject},
                     {"problem", report.failure->problem},
                     {"advice", report.failure->advice}};
  }
  const std::string text = jsonText(json, 2);
  io::writeFileDurably(path, [&](std::ostream& out) { out << text << "\n"; });
}

void writeFailure(const std::string& out, bool keep, RunReport report, const Failure& failure,
                  const Messages& messages) {
  report.exit_code = failure.exit_code;
  report.failure = failure;
  const std::filesystem::path path = std::filesystem::path(out) / "report.json";
  try {
    if (std::filesystem::exists(path) && (keep || !isOwn(path))) return;
    if (!report.replaces_files && !withEarlier({}, out).empty()) return;
    io::prepareOutputFolder(out);
    writeReport(path, report, messages);
  } catch (const std::exception&) {
  }
}

}  // namespace accessvdb::tools
