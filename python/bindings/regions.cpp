// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb/region.h and accessvdb/what_if.h.
#include "bindings/regions.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/what_if.h"
#include "bindings/arrays.h"
#include "bindings/parts.h"
#include "bindings/pickles.h"
#include "bindings/settings.h"
#include "bindings/snapshot.h"

namespace py = pybind11;

namespace accessvdb::python {

template <>
inline constexpr std::array kWords<RemovedAs> = {"unknown", "free"};

namespace {

std::vector<std::uint32_t> idsFrom(const char* name, const py::object& value) {
  std::vector<std::uint32_t> ids;
  for (const py::handle each : value) {
    ids.push_back(
        static_cast<std::uint32_t>(wholeNumberFrom(name, each, 0, std::numeric_limits<std::uint32_t>::max())));
  }
  return ids;
}

Region meshFrom(const py::object& vertices_W, const py::object& triangles) {
  const Positions vertices("vertices_W", vertices_W);
  const auto corners = realArray<double>("triangles", triangles, kAnyNumber, 3);
  std::vector<std::array<std::uint32_t, 3>> indices(static_cast<std::size_t>(corners.shape(0)));
  for (py::ssize_t n = 0; n < corners.shape(0); ++n) {
    for (py::ssize_t corner = 0; corner < 3; ++corner) {
      const double index = corners.at(n, corner);
      const bool good = index >= 0 && index < static_cast<double>(vertices.view().size()) && index == std::floor(index);
      indices[static_cast<std::size_t>(n)][static_cast<std::size_t>(corner)] =
          good ? static_cast<std::uint32_t>(index) : ~std::uint32_t{0};  // refused by Region::mesh
    }
  }
  return Region::mesh({vertices.view().begin(), vertices.view().end()}, std::move(indices));
}

void writeRegion(PickleWriter& pickle, const Region& region) {
  pickle(region.kind());
  switch (region.kind()) {
    case Region::Kind::Box:
      pickle(region.min_W());
      return pickle(region.max_W());
    case Region::Kind::Mesh:
      pickle(region.vertices_W());
      return pickle(region.triangles());
    case Region::Kind::Points:
      return pickle(region.ids());
  }
}

/// What it was made of: corners that are joined and ids that are in order stay as they are.
Region readRegion(PickleReader& pickle) {
  Region::Kind kind{};
  Eigen::Vector3d min_W, max_W;
  std::vector<Eigen::Vector3d> vertices_W;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::uint32_t> ids;
  pickle(kind);
  switch (kind) {
    case Region::Kind::Box:
      pickle(min_W);
      pickle(max_W);
      return Region::box(min_W, max_W);
    case Region::Kind::Mesh:
      pickle(vertices_W);
      pickle(triangles);
      return Region::mesh(std::move(vertices_W), std::move(triangles));
    case Region::Kind::Points:
      pickle(ids);
      return Region::points(std::move(ids));
  }
  pickle.refuse();
}

/// A what-if whose points are a snapshot, for Python to view.
struct KeptWhatIf {
  WhatIf counts;
  std::shared_ptr<FieldSnapshot> opens;
};

KeptWhatIf kept(WhatIf what_if, const AccessibilityField& field) {
  FieldSnapshot opens;
  opens.points = std::move(what_if.opens);
  opens.origin_W = field.origin_W();
  opens.voxel_size_m = field.params().tsdf.voxel_size_m;
  what_if.opens.clear();
  return {std::move(what_if), keep(std::move(opens))};
}

}  // namespace

void bindRegions(py::module_& module) {
  py::class_<Region> regions(module, "Region", "A part of a map: only what the map has observed belongs to it.");
  addPickles(regions, "Region", &writeRegion, &readRegion);
  regions
      .def_static(
          "box",
          [](const py::object& min_W, const py::object& max_W) {
            return Region::box(vector3("min_W", min_W), vector3("max_W", max_W));
          },
          py::arg("min_W"), py::arg("max_W"), "Voxels whose centres lie in a box.")
      .def_static("mesh", &meshFrom, py::arg("vertices_W"), py::arg("triangles"),
                  "Voxels whose centres lie inside a closed triangle mesh: (V, 3) vertices, (T, 3) indices.")
      .def_static(
          "points", [](const py::object& ids) { return Region::points(idsFrom("ids", ids)); }, py::arg("ids"),
          "Surface points by id, with the colliding voxels that are nearest to them.")
      .def("__repr__", [](const Region& region) { return "<accessvdb.Region: " + region.inWords() + ">"; });

  py::class_<Removal>(module, "Removal", "What remove_region() did.")
      .def_property_readonly("removed_as", [](const Removal& r) { return settingToPython(r.as); })
      .def_readonly("voxels", &Removal::voxels, "Observed voxels of the region.")
      .def_readonly("colliding_voxels", &Removal::colliding_voxels, "Those that blocked the tool.")
      .def_readonly("points", &Removal::points, "Surface points in them.")
      .def_readonly("flipped_voxels", &Removal::flipped_voxels)
      .def("__repr__", [](const Removal& r) {
        return "<accessvdb.Removal: " + std::to_string(r.voxels) + " voxels as " + name(r.as) + ">";
      });

  py::class_<KeptWhatIf>(module, "WhatIf", "Which points would open if parts of a map went.")
      .def_readonly("opens", &KeptWhatIf::opens,
                    "FieldSnapshot of the points that are blocked now and would be accessible, as they would be.")
      .def_property_readonly("voxels", [](const KeptWhatIf& w) { return w.counts.voxels; })
      .def_property_readonly("colliding_voxels", [](const KeptWhatIf& w) { return w.counts.colliding_voxels; })
      .def_property_readonly("points_gone", [](const KeptWhatIf& w) { return w.counts.points_gone; })
      .def_property_readonly("points_tried", [](const KeptWhatIf& w) { return w.counts.points_tried; })
      .def_property_readonly("direction_tests", [](const KeptWhatIf& w) { return w.counts.direction_tests; })
      .def_property_readonly("choose_ms", [](const KeptWhatIf& w) { return w.counts.choose_ms; })
      .def_property_readonly("score_ms", [](const KeptWhatIf& w) { return w.counts.score_ms; })
      .def("__repr__", [](const KeptWhatIf& w) {
        return "<accessvdb.WhatIf: " + std::to_string(w.opens->points.size()) + " points open>";
      });

  py::class_<Cut>(module, "Cut", "One step of an order of cuts.")
      .def_readonly("segment", &Cut::segment, "Index of the segment.")
      .def_property_readonly(
          "opens",
          [](const Cut& cut) {
            return py::array_t<std::uint32_t>(static_cast<py::ssize_t>(cut.opens.size()), cut.opens.data());
          },
          "(N,) uint32, ids that this cut opens, after those before it.")
      .def_readonly("points_gone", &Cut::points_gone)
      .def("__repr__", [](const Cut& cut) {
        return "<accessvdb.Cut of segment " + std::to_string(cut.segment) + ": " + std::to_string(cut.opens.size()) +
               " points open>";
      });
  py::class_<CutOrder>(module, "CutOrder", "In which order to cut: each step opens the most.")
      .def_readonly("cuts", &CutOrder::cuts)
      .def_readonly("left", &CutOrder::left, "Segments that open nothing by themselves once the cuts are made.")
      .def_readonly("left_together", &CutOrder::left_together, "Points that those would open if all of them went.")
      .def_readonly("what_ifs", &CutOrder::what_ifs)
      .def("__repr__", [](const CutOrder& order) {
        return "<accessvdb.CutOrder of " + std::to_string(order.cuts.size()) + " cuts>";
      });
}

void bindRegionCalls(py::class_<LockedField>& field) {
  field
      .def(
          "remove_region",
          [](LockedField& f, const Region& region, const py::object& removed_as) {
            const auto as = settingFrom<RemovedAs>("removed_as", removed_as);
            return f.run([&](AccessibilityField& locked) { return locked.removeRegion(region, as); });
          },
          py::arg("region"), py::kw_only(), py::arg("removed_as") = "unknown",
          "Takes out of the map what lies in a region. \"unknown\": it blocks until a scan sees through it; \"free\": "
          "it is free at once, and its points have reason CHANGED. All points are unscored until the next update().")
      .def(
          "what_if",
          [](LockedField& f, const std::vector<Region>& regions) {
            return f.run([&](AccessibilityField& locked) { return kept(locked.whatIf(regions), locked); });
          },
          py::arg("regions"),
          "Which points would open if all that lies in the regions went; changes nothing. Needs labels that are up to "
          "date: call update() until its backlog is 0.")
      .def(
          "order_cuts",
          [](LockedField& f, const std::vector<Region>& segments, const py::object& most_cuts) {
            const auto most = settingFrom<std::uint32_t>("most_cuts", most_cuts);
            std::vector<Segment> named;
            for (const Region& region : segments) named.push_back({"", region});
            return f.run([&](AccessibilityField& locked) { return orderCuts(locked, named, most); });
          },
          py::arg("segments"), py::kw_only(), py::arg("most_cuts") = 0,
          "Greedy: cuts the region that opens the most points, then the next, until none opens any.");
}

}  // namespace accessvdb::python
