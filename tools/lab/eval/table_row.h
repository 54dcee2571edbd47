// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One line of an evaluation table, with the figure printed in the paper and the one to be reached.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "eval/confusion.h"
#include "eval/scene_run.h"

namespace accessvdb::eval {

/// Figures as the paper prints them; percent. Absent if it prints none.
struct PaperFigures {
  std::optional<std::uint64_t> n;
  std::optional<double> gt_percent, precision, recall, f1;
};

/// A bound on one figure of a row, in percent: what this project requires of it.
struct Requirement {
  enum class Figure { Precision, Recall, F1 };
  Figure figure = Figure::F1;
  double low = 0, high = 100;

  [[nodiscard]] static Requirement atLeast(double f1) { return {Figure::F1, f1, 100}; }
  /// Within `width` points of the paper's figure.
  [[nodiscard]] static Requirement near(Figure figure, double printed, double width) {
    return {figure, printed - width, printed + width};
  }
};

enum class TableColumn { Paper, Product };  ///< which profile's constants the method used

struct TableRow {
  std::string table, scene;
  std::string method;   ///< "paper", "product", "hpr", "projective ..."
  std::string variant;  ///< what differs from the profile, in words; empty = nothing
  TableColumn column = TableColumn::Product;
  double voxel_m = 0;
  Confusion figures;
  PaperFigures paper;
  std::optional<Requirement> must;
  std::vector<std::pair<std::string, double>> more;  ///< further numbers by name ("labels_differ")
  std::optional<bool> must_hold;                     ///< a condition on `more`, if the row has one

  [[nodiscard]] double value(Requirement::Figure figure) const;
  /// Empty if nothing is required.
  [[nodiscard]] std::optional<bool> met() const;
  /// ">= 99.5 F1", "86.8 .. 94.8 F1"
  [[nodiscard]] std::string mustInWords() const;
};

[[nodiscard]] const char* name(Requirement::Figure figure);

}  // namespace accessvdb::eval
