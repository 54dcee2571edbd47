// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/table_row.h"

#include <cstdio>

namespace accessvdb::eval {

const char* name(Requirement::Figure figure) {
  switch (figure) {
    case Requirement::Figure::Precision:
      return "P";
    case Requirement::Figure::Recall:
      return "R";
    case Requirement::Figure::F1:
      break;
  }
  return "F1";
}

double TableRow::value(Requirement::Figure figure) const {
  switch (figure) {
    case Requirement::Figure::Precision:
      return figures.precision();
    case Requirement::Figure::Recall:
      return figures.recall();
    case Requirement::Figure::F1:
      break;
  }
  return figures.f1();
}

std::optional<bool> TableRow::met() const {
  if (!must) return must_hold;
  const double reached = value(must->figure);
  return reached >= must->low && reached <= must->high && must_hold.value_or(true);
}

std::string TableRow::mustInWords() const {
  if (!must) return "";
  char text[64];
  if (must->high >= 100) {
    std::snprintf(text, sizeof text, "%s >= %.4g", name(must->figure), must->low);
  } else {
    std::snprintf(text, sizeof text, "%s %.4g .. %.4g", name(must->figure), must->low, must->high);
  }
  return text;
}

}  // namespace accessvdb::eval
