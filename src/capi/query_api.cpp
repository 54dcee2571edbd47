// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Batch queries in C.
#include <algorithm>
#include <cstring>
#include <span>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/c_api.h"
#include "accessvdb/pose_query.h"
#include "capi/arrays_in.h"
#include "capi/boundary.h"
#include "capi/handles.h"

namespace capi = accessvdb::capi;

namespace {

// Sizes of the first versions.
constexpr std::size_t kPointAnswerBytes1 = 40;
constexpr std::size_t kCapsuleBytes1 = 56;
constexpr std::size_t kCapsuleAnswerBytes1 = 16;
static_assert(sizeof(accessvdb_point_answer) >= kPointAnswerBytes1 && sizeof(accessvdb_capsule) >= kCapsuleBytes1 &&
              sizeof(accessvdb_capsule_answer) >= kCapsuleAnswerBytes1);

constexpr std::size_t kFitBytes1 = 16, kPathFitBytes1 = 16;
static_assert(sizeof(accessvdb_fit) >= kFitBytes1 && sizeof(accessvdb_path_fit) >= kPathFitBytes1);

/// Answers converted at a time, so that memory does not grow with the query.
constexpr std::size_t kAtATime = 1 << 16;

accessvdb_point_answer toC(const accessvdb::PointAnswer& answer) {
  accessvdb_point_answer c = {};
  c.distance_m = answer.distance_m;
  c.point_distance_m = answer.point_distance_m;
  Eigen::Map<Eigen::Vector3f>(c.direction_W) = answer.direction_W;
  c.point_id = answer.point_id;
  c.weight = answer.weight;
  c.direction = answer.direction;
  c.score = answer.score;
  c.label = static_cast<std::uint8_t>(answer.label);
  c.reason = static_cast<std::uint8_t>(answer.reason);
  c.unknown = answer.unknown;
  c.cleared = answer.cleared;
  return c;
}

accessvdb_capsule_answer toC(const accessvdb::CapsuleAnswer& answer) {
  accessvdb_capsule_answer c = {};
  c.min_distance_m = answer.min_distance_m;
  c.first_hit_t = answer.first_hit_t;
  c.collision = answer.collision;
  c.unknown = answer.unknown;
  c.valid = answer.valid;
  return c;
}

accessvdb_fit toC(const accessvdb::FitAnswer& answer) {
  accessvdb_fit c = {};
  c.collisions = answer.collisions;
  c.collision_limit = answer.collision_limit;
  c.unknown_voxels = answer.unknown_voxels;
  c.collision = answer.collision();
  c.unknown = answer.unknown();
  c.valid = answer.valid;
  c.free = answer.free();
  return c;
}

std::vector<Eigen::Isometry3d> posesFrom(const double* T_WT, std::size_t count) {
  capi::requireArray("T_WT", T_WT, count, 16 * sizeof(double), alignof(double));
  std::vector<Eigen::Isometry3d> poses(count);
  for (std::size_t n = 0; n < count; ++n) poses[n] = capi::poseFromC(T_WT + 16 * n);
  return poses;
}

/// Writes answers of the caller's version.
template <typename Answer>
void writeAnswers(std::span<const Answer> answers, unsigned char* out, std::size_t size) {
  for (std::size_t n = 0; n < answers.size(); ++n, out += size) {
    capi::writeRow(out, size, toC(answers[n]));
  }
}

}  // namespace

int accessvdb_field_query_points(accessvdb_field* field, const double* points_W, std::size_t count,
                                 accessvdb_point_answer* answers, std::size_t answer_size) noexcept {
  return capi::onField(field, [&] {
    capi::requireSize("answer_size", answer_size, kPointAnswerBytes1);
    const auto points = capi::vectors("points_W", points_W, count);
    capi::requireArray("answers", answers, count, answer_size, alignof(accessvdb_point_answer));
    const accessvdb::BatchQuery query = field->field.batchQuery();
    std::vector<accessvdb::PointAnswer> some(std::min(count, kAtATime));
    for (std::size_t first = 0; first < count; first += kAtATime) {
      const std::span part(some.data(), std::min(kAtATime, count - first));
      query.at(points.subspan(first, part.size()), part);
      writeAnswers<accessvdb::PointAnswer>(part, reinterpret_cast<unsigned char*>(answers) + first * answer_size,
                                           answer_size);
    }
  });
}

int accessvdb_field_query_capsules(accessvdb_field* field, const accessvdb_capsule* capsules, std::size_t capsule_size,
                                   std::size_t count, accessvdb_capsule_answer* answers,
                                   std::size_t answer_size) noexcept {
  return capi::onField(field, [&] {
    capi::requireSize("capsule_size", capsule_size, kCapsuleBytes1);
    capi::requireSize("answer_size", answer_size, kCapsuleAnswerBytes1);
    capi::requireArray("capsules", capsules, count, capsule_size, alignof(accessvdb_capsule));
    capi::requireArray("answers", answers, count, answer_size, alignof(accessvdb_capsule_answer));
    const accessvdb::BatchQuery query = field->field.batchQuery();
    std::vector<accessvdb::CapsuleQuery> questions(count);
    const auto* bytes = reinterpret_cast<const unsigned char*>(capsules);
    for (std::size_t n = 0; n < count; ++n, bytes += capsule_size) {
      accessvdb_capsule c = {};
      std::memcpy(&c, bytes, std::min(capsule_size, sizeof c));
      if (capsule_size > sizeof c) capi::requireZero("capsules", bytes + sizeof c, bytes + capsule_size);
      questions[n] = {Eigen::Map<const Eigen::Vector3d>(c.a_W), Eigen::Map<const Eigen::Vector3d>(c.b_W), c.radius_m};
    }
    writeAnswers<accessvdb::CapsuleAnswer>(query.along(questions), reinterpret_cast<unsigned char*>(answers),
                                           answer_size);
  });
}

int accessvdb_field_fits(accessvdb_field* field, const double* T_WT, std::size_t count, std::uint32_t tool,
                         int in_contact, accessvdb_fit* fits, std::size_t fit_size) noexcept {
  return capi::onField(field, [&] {
    capi::requireSize("fit_size", fit_size, kFitBytes1);
    capi::requireArray("fits", fits, count, fit_size, alignof(accessvdb_fit));
    const std::vector<accessvdb::FitAnswer> answers = field->field.poseQuery().fits(
        posesFrom(T_WT, count), {.tool = tool, .contact = capi::requireBool("in_contact", in_contact)});
    writeAnswers<accessvdb::FitAnswer>(answers, reinterpret_cast<unsigned char*>(fits), fit_size);
  });
}

int accessvdb_field_fits_along(accessvdb_field* field, const double* T_WT, std::size_t count, std::uint32_t tool,
                               accessvdb_path_fit* fit) noexcept {
  return capi::onField(field, [&] {
    capi::requirePointer("fit", fit);
    const capi::OptionalOut<accessvdb_path_fit, kPathFitBytes1> out("fit", fit);
    const accessvdb::PathFitAnswer answer = field->field.poseQuery().fitsAlong(posesFrom(T_WT, count), {.tool = tool});
    accessvdb_path_fit c = {};
    c.collision = answer.collision;
    c.unknown = answer.unknown;
    c.valid = answer.valid;
    c.free = answer.free();
    c.first_hit = answer.first_hit;
    out.write(c);
  });
}
