// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Attributes of points, from those of their returns (attributes.h). As all of a point they depend on the set of
/// returns of each scan, not on their order; only between first returns at the same place does the order decide.
///
/// A point whose returns all agree takes 4 bytes and a bit per attribute: how many they are is known anyway. Of the
/// others each value with its count takes 12 bytes more.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/attributes.h"
#include "points/chunked_array.h"

namespace accessvdb::internal {

/// Returns of one scan by point.
struct ReturnsOfPoints {
  std::span<const std::uint32_t> ids;         ///< of the points
  std::span<const std::uint32_t> begin;       ///< [ids + 1] of each point's returns in `returns`
  std::span<const std::uint32_t> returns;     ///< numbers of returns; each point's are sorted by position
  std::span<const std::uint32_t> first_ties;  ///< [ids] how many of its returns are at the place of the first one
  std::uint32_t first_new = 0;                ///< points from this id on had no return before
};

class PointAttributes {
 public:
  explicit PointAttributes(std::vector<CarriedAttribute> carried);

  [[nodiscard]] std::size_t columns() const { return carried_.size(); }
  [[nodiscard]] const std::vector<CarriedAttribute>& carried() const { return carried_; }
  [[nodiscard]] std::int32_t value(std::uint32_t id, std::size_t column) const;

  /// @param values  [returns x columns], row by row  @param returnsOf  (id) -> returns of a point, with these ones
  template <typename ReturnsOf>
  void add(const ReturnsOfPoints& scan, std::span<const std::int32_t> values, std::uint32_t points,
           const ReturnsOf& returnsOf) {
    const std::vector<std::uint32_t>& split = addAgreeing(scan, values, points);
    for (const std::uint32_t n : split) addSplit(scan, values, n, returnsOf(scan.ids[n]));
  }

  /// One value of a column, with how many returns have it.
  struct Vote {
    std::int32_t value;
    std::uint32_t returns;
  };
  /// Of a point whose returns do not agree, by value; of others empty.
  void votes(std::uint32_t id, std::size_t column, std::vector<Vote>& to) const;
  [[nodiscard]] std::uint64_t voteCount(std::size_t column) const { return columns_[column].pool.size(); }

  /// Appends points of a saved store, with what value() says of each. @param values  [points x columns], row by row
  void restore(std::span<const std::int32_t> values);
  /// After restore(). @param votes  as votes() gave them  @return false if no field can have them
  [[nodiscard]] bool restoreVotes(std::uint32_t id, std::size_t column, std::span<const Vote> votes);

  [[nodiscard]] std::uint64_t bytes() const;

 private:
  static constexpr std::uint32_t kEnd = ~std::uint32_t{0};
  struct Node {
    Vote vote;
    std::uint32_t next;
  };
  struct Column {
    ChunkedArray<std::int32_t> value;   ///< of all returns; where split, the first node
    ChunkedArray<std::uint64_t> split;  ///< a bit per point: its returns do not agree
    ChunkedArray<Node> pool;            ///< lists of votes, by value
  };

  [[nodiscard]] static bool isSplit(const Column& column, std::uint32_t id) {
    return (column.split[id / 64] >> (id % 64) & 1) != 0;
  }
  const std::vector<std::uint32_t>& addAgreeing(const ReturnsOfPoints& scan, std::span<const std::int32_t> values,
                                                std::uint32_t points);
  void addSplit(const ReturnsOfPoints& scan, std::span<const std::int32_t> values, std::uint32_t n,
                std::uint32_t returns);
  void grow(std::uint32_t points);
  static void addVote(Column& column, std::uint32_t id, const Vote& vote);
  static void makeSplit(Column& column, std::uint32_t id);

  std::vector<CarriedAttribute> carried_;
  std::vector<Column> columns_;
  std::vector<std::uint8_t> is_split_;  ///< of the points of a scan
  std::vector<std::uint32_t> split_;
};

}  // namespace accessvdb::internal
