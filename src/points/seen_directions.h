// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The directions that surface points were seen from (docs/PAPER_MAP.md, "Surface points"): kept as bits, or as the
/// sensor positions that bits are computed from. SeenDirections chooses between the two; nothing else asks which it is.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "accessvdb/params.h"
#include "hostdev/direction_mask.h"
#include "launch/direction_table.h"
#include "points/chunked_array.h"

namespace accessvdb::internal {

using kernels::DirectionMask;

/// Up to eight sensor positions that saw a point (paper profile).
struct Viewpoints {
  static constexpr int kMost = 8;
  std::array<std::uint32_t, kMost> pose = {};  ///< indices into the poses of the store
  std::uint32_t count = 0;
};

/// What is saved of a point's seen directions; one of the three.
struct StoredSeen {
  DirectionMask mask = {};
  std::vector<std::uint64_t> wide;  ///< for a wide set (kernels::isWide); else empty
  Viewpoints views;

  [[nodiscard]] std::span<const std::uint64_t> words() const {
    return wide.empty() ? std::span<const std::uint64_t>(mask.word) : std::span<const std::uint64_t>(wide);
  }
  /// Room for this many words, all 0.
  std::span<std::uint64_t> clearWords(std::size_t count);
};

/// The cones around directions in which a position counts as seen.
class ViewCones {
 public:
  ViewCones(kernels::DirectionTable table, double cos_min);

  [[nodiscard]] int numDirections() const { return table_.numDirections(); }
  [[nodiscard]] std::size_t words() const { return words_; }  ///< of 64 directions
  /// Calls found(w, bits) for each word w of directions; a bit is set if the cone at one position contains the other.
  /// Does nothing if both are the same.
  template <typename Found>
  void forEachWord(const Eigen::Vector3f& from_L, const Eigen::Vector3f& to_L, Found&& found) const;

 private:
  kernels::DirectionTable table_;
  std::size_t words_;
  float cos_min_;
};

/// Seen directions as bits, of a set of any size. Ids are those of the store. Many threads may work on different
/// points.
class SeenBits {
 public:
  explicit SeenBits(ViewCones cones) : cones_(std::move(cones)) {}

  void grow(std::size_t points) { seen_.growRaw(points * cones_.words()); }
  void clear(std::uint32_t id);
  void prefetch(std::uint32_t id) const;
  /// Adds a return. @param pose  number of q_L among the poses  @return true if the seen directions changed
  bool add(std::uint32_t id, const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L, std::uint32_t pose);
  /// Adds the bits of a point to others. @param words  [directionWords()]
  void join(std::uint32_t id, const Eigen::Vector3f& first_L, std::span<std::uint64_t> words) const;

  [[nodiscard]] StoredSeen stored(std::uint32_t id) const;
  /// Whether add() could have led to this.
  [[nodiscard]] bool canBe(const StoredSeen& stored) const;
  void restore(std::uint32_t id, const StoredSeen& stored);

  /// Adds sensor positions, where they are kept. @return number of the first one
  std::uint32_t addPoses(std::span<const Eigen::Vector3f> /*q_L*/) { return 0; }
  [[nodiscard]] const ChunkedArray<Eigen::Vector3f>& poses() const;
  [[nodiscard]] std::uint64_t bytes() const { return seen_.bytes(); }

 private:
  [[nodiscard]] std::size_t at(std::uint32_t id) const { return std::size_t{id} * cones_.words(); }

  ViewCones cones_;
  ChunkedArray<std::uint64_t> seen_;  ///< [words n]
};

/// Seen directions as viewpoints, which bits are computed from whenever they are asked for.
class SeenFromViewpoints {
 public:
  explicit SeenFromViewpoints(ViewCones cones) : cones_(std::move(cones)) {}

  // As for SeenBits.
  void grow(std::size_t points) { viewpoints_.growRaw(points); }
  void clear(std::uint32_t id) { viewpoints_[id] = {}; }
  void prefetch(std::uint32_t /*id*/) const {}
  bool add(std::uint32_t id, const Eigen::Vector3f& p_L, const Eigen::Vector3f& q_L, std::uint32_t pose);
  void join(std::uint32_t id, const Eigen::Vector3f& first_L, std::span<std::uint64_t> words) const;
  [[nodiscard]] StoredSeen stored(std::uint32_t id) const { return {{}, {}, viewpoints_[id]}; }
  [[nodiscard]] bool canBe(const StoredSeen& stored) const;
  void restore(std::uint32_t id, const StoredSeen& stored) { viewpoints_[id] = stored.views; }
  std::uint32_t addPoses(std::span<const Eigen::Vector3f> q_L);
  [[nodiscard]] const ChunkedArray<Eigen::Vector3f>& poses() const { return poses_; }
  [[nodiscard]] std::uint64_t bytes() const { return viewpoints_.bytes() + poses_.bytes(); }

 private:
  ViewCones cones_;
  ChunkedArray<Viewpoints> viewpoints_;
  ChunkedArray<Eigen::Vector3f> poses_;  ///< one per scan, or one per ray for ray clouds
};

class SeenDirections {
 public:
  SeenDirections(const ApproachParams& resolved, kernels::DirectionTable table);

  [[nodiscard]] int numDirections() const { return num_directions_; }
  /// Words of bits per point.
  [[nodiscard]] int directionWords() const { return (num_directions_ + 63) / 64; }
  [[nodiscard]] bool isWide() const { return kernels::isWide(num_directions_); }

  /// Calls work(form) with a SeenBits& or a SeenFromViewpoints&: for work on many points, which then asks only once.
  template <typename Work>
  void inItsForm(Work&& work) {
    std::visit(std::forward<Work>(work), form_);
  }

  void prefetch(std::uint32_t id) const {
    std::visit([&](const auto& form) { form.prefetch(id); }, form_);
  }
  /// The bits of a point; none of a wide set.
  [[nodiscard]] DirectionMask mask(std::uint32_t id, const Eigen::Vector3f& first_L) const;
  /// Adds the bits of a point to others, of a set of any size. @param words  [directionWords()]
  void join(std::uint32_t id, const Eigen::Vector3f& first_L, std::span<std::uint64_t> words) const {
    std::visit([&](const auto& form) { form.join(id, first_L, words); }, form_);
  }
  [[nodiscard]] StoredSeen stored(std::uint32_t id) const {
    return std::visit([&](const auto& form) { return form.stored(id); }, form_);
  }
  [[nodiscard]] bool canBe(const StoredSeen& stored) const {
    return std::visit([&](const auto& form) { return form.canBe(stored); }, form_);
  }
  /// Kept with viewpoints only.
  [[nodiscard]] const ChunkedArray<Eigen::Vector3f>& poses() const {
    return std::visit(
        [](const auto& form) -> const auto& { return form.poses(); }, form_);
  }
  [[nodiscard]] std::uint64_t bytes() const {
    return std::visit([](const auto& form) { return form.bytes(); }, form_);
  }

 private:
  using Form = std::variant<SeenBits, SeenFromViewpoints>;
  static Form formFor(const ApproachParams& resolved, kernels::DirectionTable table);

  int num_directions_;
  Form form_;
};

}  // namespace accessvdb::internal
