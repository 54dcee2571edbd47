// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/state/state_head.h"

#include <array>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/params_rows.h"
#include "accessvdb/tool_spec.h"
#include "field/state/rules_version.h"
#include "hostdev/direction_mask.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kMostText = 1024, kMostCarried = 64;

/// Writes values, exactly as they are.
class Encoder {
 public:
  template <typename Value>
  void operator()(const Value& value) {
    static_assert(std::is_arithmetic_v<Value> || std::is_enum_v<Value>);
    const auto* bytes = reinterpret_cast<const char*>(&value);
    bytes_.insert(bytes_.end(), bytes, bytes + sizeof value);
  }
  template <typename Value, std::size_t kCount>
  void operator()(const std::array<Value, kCount>& values) {
    for (const Value& value : values) (*this)(value);
  }
  template <typename Enum>
  void oneOf(const Enum& value, Enum /*last*/) {
    (*this)(value);
  }
  void operator()(const std::string& text) {
    (*this)(static_cast<std::uint32_t>(text.size()));
    bytes_.insert(bytes_.end(), text.begin(), text.end());
  }
  template <typename Value>
  bool has(const std::optional<Value>& value) {
    (*this)(static_cast<std::uint8_t>(value.has_value()));
    return value.has_value();
  }
  template <typename Value>
  void size(const std::vector<Value>& values, std::size_t /*most*/) {
    (*this)(static_cast<std::uint32_t>(values.size()));
  }
  [[nodiscard]] std::vector<char> take() { return std::move(bytes_); }

 private:
  std::vector<char> bytes_;
};

/// Reads them back; after a value that cannot be, ok() is false and all others stay as they are.
class Decoder {
 public:
  explicit Decoder(const std::vector<char>& bytes) : bytes_(bytes) {}

  template <typename Value>
  void operator()(Value& value) {
    static_assert(std::is_arithmetic_v<Value>);
    if constexpr (std::is_same_v<Value, bool>) {
      std::uint8_t byte = 0;
      (*this)(byte);
      ok_ = ok_ && byte <= 1;
      value = byte == 1;
    } else {
      take(&value, sizeof value);
    }
  }
  template <typename Value, std::size_t kCount>
  void operator()(std::array<Value, kCount>& values) {
    for (Value& value : values) (*this)(value);
  }
  template <typename Enum>
  void oneOf(Enum& value, Enum last) {
    std::underlying_type_t<Enum> number = 0;
    (*this)(number);
    ok_ = ok_ && number >= 0 && number <= static_cast<std::underlying_type_t<Enum>>(last);
    if (ok_) value = static_cast<Enum>(number);
  }
  void operator()(std::string& text) {
    std::uint32_t size = 0;
    (*this)(size);
    ok_ = ok_ && size <= kMostText;
    if (!ok_) return;
    text.resize(size);
    take(text.data(), size);
  }
  template <typename Value>
  bool has(std::optional<Value>& value) {
    bool present = false;
    (*this)(present);
    if (ok_ && present) value.emplace();
    return ok_ && present;
  }
  template <typename Value>
  void size(std::vector<Value>& values, std::size_t most) {
    std::uint32_t size = 0;
    (*this)(size);
    ok_ = ok_ && size <= most;
    if (ok_) values.resize(size);
  }
  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] bool atEnd() const { return ok_ && at_ == bytes_.size(); }

 private:
  void take(void* to, std::size_t bytes) {
    ok_ = ok_ && bytes <= bytes_.size() - at_;
    if (!ok_) return;
    std::memcpy(to, bytes_.data() + at_, bytes);
    at_ += bytes;
  }

  const std::vector<char>& bytes_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

template <typename Code, typename... Values>
void visitAll(Code& code, Values&... values) {
  (code(values), ...);
}

template <typename Code, typename Orientation>
void visitOrientation(Code& code, Orientation& orientation) {
  auto& [R_WT, yaw_rad, pitch_rad, roll_rad] = orientation;
  for (Eigen::Index n = 0; n < 9; ++n) code(R_WT.data()[n]);
  visitAll(code, yaw_rad, pitch_rad, roll_rad);
}

template <typename Code, typename Set>
void visitOrientations(Code& code, Set& set) {
  auto& [kind, pitch_min_deg, pitch_max_deg, step_deg, with_yaw, list] = set;
  code.oneOf(kind, OrientationKind::List);
  visitAll(code, pitch_min_deg, pitch_max_deg, step_deg, with_yaw);
  code.size(list, OrientationSet::kMost);
  for (auto& orientation : list) visitOrientation(code, orientation);
}

/// A field of a struct of parameters that is not saved in its place.
template <typename Row>
constexpr bool kSkipped =
    // A state may go on elsewhere.
    Row::template is<&FieldParams::backend> || Row::template is<&FieldParams::threads> ||
    Row::template is<&FieldParams::fuse_on_host> || Row::template is<&FieldParams::device_cache_bytes> ||
    Row::template is<&ApproachParams::orientations> ||  // see visitRest
    Row::template is<&FieldParams::carry> || Row::template is<&ApproachParams::rolls> ||
    Row::template is<&ChangeParams::free_for_s> ||  // see visitFullChange
    Row::template is<&TsdfParams::clear_rays_m> || Row::template is<&TsdfParams::platform_radius_m> ||
    Row::template is<&ScoringParams::point_spacing_m>;

template <typename Code, typename Params>
void visitParams(Code& code, Params& params) {
  forEachRow<std::remove_const_t<Params>>([&]<typename Row>(const Row&) {
    auto& value = params.*Row::member;
    using Value = std::remove_cvref_t<decltype(value)>;
    if constexpr (ParamStruct<Value>) {
      visitParams(code, value);
    } else if constexpr (Row::template is<&FieldParams::window>) {
      if (!code.has(value)) return;
      auto& [core_low, core_high] = *value;  // by name: a new field does not compile before it has a place here
      visitAll(code, core_low, core_high);
    } else if constexpr (Row::template is<&FieldParams::origin_W>) {
      if (code.has(value)) code(*value);
    } else if constexpr (!kSkipped<Row>) {
      if constexpr (std::is_enum_v<Value>) {
        code.oneOf(value, static_cast<Value>(kEnumWords<Value>.size() - 1));
      } else {
        code(value);
      }
    }
  });
}

/// What a program needs to refuse a state that it cannot read.
template <typename Code, typename Head>
void visitFirst(Code& code, Head& head) {
  visitAll(code, head.schema, head.rules_version, head.version, head.tool_sha256);
}

template <typename Code, typename Head>
void visitFullChange(Code& code, Head& head) {
  visitAll(code, head.params.change.free_for_s, head.age_s, head.leaves_with_before, head.gone_scans, head.cell_blocks,
           head.gone_points);
}

template <typename Code, typename Head>
void visitCarried(Code& code, Head& head) {
  code.size(head.params.carry, kMostCarried);
  for (auto& attribute : head.params.carry) {
    code(attribute.name);
    code.oneOf(attribute.keep, Keep::First);
  }
  visitAll(code, head.split_points, head.votes);
}

template <typename Code, typename Head>
void visitRest(Code& code, Head& head) {
  visitParams(code, head.params);
  if (head.tool_sha256.starts_with(kToolListMark)) {
    code.size(head.tools, kMostTools);
    for (auto& tool : head.tools) {
      visitAll(code, tool.name, tool.sha256, tool.orientations, tool.rolls, tool.max_collisions, tool.view_words);
    }
  }
  if (plainSchema(head.schema) != kStateSchema) visitOrientations(code, head.params.approach.orientations);
  if (plainSchema(head.schema) == kRolledStateSchema) code(head.params.approach.rolls);
  if (code.has(head.origin_W)) {
    visitAll(code, (*head.origin_W)[0], (*head.origin_W)[1], (*head.origin_W)[2]);
  }
  if (code.has(head.latest_stamp_s)) code(*head.latest_stamp_s);
  visitAll(code, head.updated, head.scans, head.leaves, head.leaves_with_values, head.leaves_with_votes, head.points,
           head.poses, head.left_out_leaves, head.closed_cubes, head.closed_doublings);
  if (isFullChangeSchema(head.schema)) visitFullChange(code, head);
  if (isCarryingSchema(head.schema)) visitCarried(code, head);
  if (isScoredSchema(head.schema)) code(head.scored_words);
  if (isSpacedSchema(head.schema)) code(head.params.scoring.point_spacing_m);
  if (isCompactSchema(head.schema))
    visitAll(code, head.voxel_bytes, head.params.tsdf.clear_rays_m, head.params.tsdf.platform_radius_m);
}

bool isPlausible(const StateHead& head) {
  if (uncompactSchema(head.schema) != uncompactSchema(stateSchemaOf(head.params, head.isScored()))) return false;
  if (head.isScored() && (!head.updated || head.scored_words > kMostTools * kernels::kMostWideDirections / 64))
    return false;
  if (head.tool_sha256.starts_with(kToolListMark) != (head.tools.size() > 1)) return false;
  for (const SavedTool& tool : head.tools) {
    if (tool.view_words > kernels::kMostWideDirections / 64) return false;
  }
  const ChangeParams& change = head.params.change;
  if (head.cell_blocks > head.points || head.gone_points > head.points) return false;
  // Each scan ages a map by 2 T at most. Above that, doubles would not tell short times from none.
  constexpr double kMostGenerations = 2 * 4294967296.0;
  if (!(head.age_s >= 0 && head.age_s <= kMostGenerations * change.free_for_s)) return false;
  if (head.leaves_with_before > head.leaves) return false;
  if (!std::isfinite(change.free_for_s) && (head.age_s > 0 || head.leaves_with_before > 0)) return false;
  if (head.params.update.policy == UpdatePolicy::Paper || head.params.tsdf.region == UpdateRegion::Projective) {
    return false;
  }
  constexpr double kFarthestOrigin_m = 1.1e8;  // the gate takes 1e8 m, then rounds to voxels
  if (head.origin_W && !(head.origin_W->allFinite() && head.origin_W->lpNorm<Eigen::Infinity>() <= kFarthestOrigin_m)) {
    return false;
  }
  const std::uint64_t columns = head.params.carry.size();
  if (isCarryingSchema(head.schema) != (columns > 0)) return false;
  if (head.split_points > head.points * columns || head.votes > columns * std::uint64_t{~std::uint32_t{0}})
    return false;
  if (head.points >= ~std::uint32_t{0} || head.poses >= ~std::uint32_t{0}) return false;  // ids have 32 bits
  if (head.leaves_with_values > head.leaves || head.leaves_with_votes > head.leaves_with_values) return false;
  if (head.leaves_with_votes > 0 && head.params.change.mode == ChangeMode::Off) return false;
  if (head.latest_stamp_s && !std::isfinite(*head.latest_stamp_s)) return false;
  try {
    static_cast<void>(head.params.resolved());
  } catch (const Error&) {
    return false;
  }
  return true;
}

}  // namespace

std::uint64_t viewBytesPerPoint(const StateHead& head) {
  std::uint64_t bytes = 0;
  for (const SavedTool& tool : head.tools) bytes += tool.view_words * sizeof(std::uint64_t);
  return bytes;
}

std::vector<char> bytesOf(const StateHead& head) {
  Encoder encoder;
  visitFirst(encoder, head);
  visitRest(encoder, head);
  return encoder.take();
}

std::optional<StateHead> headFrom(const std::vector<char>& bytes) {
  Decoder decoder(bytes);
  StateHead head;
  head.params.approach.rolls = 1;  // not the rule: files without a number are of tools that did not roll
  visitFirst(decoder, head);
  if (!decoder.ok()) return std::nullopt;
  if (!isStateSchema(head.schema) || head.rules_version != kRulesVersion) return head;
  visitRest(decoder, head);
  if (!decoder.atEnd() || !isPlausible(head)) return std::nullopt;
  return head;
}

}  // namespace accessvdb::internal
