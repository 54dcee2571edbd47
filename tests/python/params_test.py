# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Parameters: every field of accessvdb/params.h, with its default, as attribute, keyword and key of a dict."""

import copy
import math
import os
import re
import unittest
from pathlib import Path

import numpy as np

import accessvdb

# For every field, a valid value other than its default.
OTHER = {
    "TsdfParams": {
        "voxel_size_m": 0.07,
        "truncation_distance_m": 0.37,
        "range_noise_m": 0.06,
        "min_range_m": 0.3,
        "max_range_m": 21.0,
        "region": "full_cube",
        "projective": {"bin_rad": 0.01},
        "cone_cos_min": 0.93,
        "clamp_min_m": -0.05,
        "max_weight": 77,
        "cleared_radius_voxels": 1.5,
        "cleared_begin_tau": 0.75,
        "cleared_end_tau": 3.5,
        "clear_rays_m": 12.0,
        "platform_radius_m": 0.5,
    },
    "ApproachParams": {
        "num_directions": 90,
        "normal_cone_rad": 1.1,
        "observation_cos_min": 0.3,
        "arm_tau": (0.5, 1.5, 2.5),
        "corridor_length_m": 1.75,
        "coarse_to_fine": True,
        "viewpoints": True,
        "orientations": "sphere:15",
        "rolls": 4,
    },
    "ScoringParams": {
        "collision_distance_m": 0.012,
        "self_exclusion_voxels": 2.5,
        "form": "surface_samples",
        "surface_samples": 500,
        "max_collisions": 3,
        "neighbours": 12,
        "mean_positions": False,
        "join_neighbour_views": False,
        "neighbourhood_weight": False,
        "confidence_half_weight": 4.0,
        "confidence_min": 0.3,
        "point_spacing_m": 0.06,
    },
    "UpdateParams": {
        "policy": "paper",
        "budget_points": 1000,
        "changed_voxel_sample": 128,
        "changed_voxel_radius_voxels": 2.0,
        "requeue_motion_m": 0.2,
        "stability_min": 0.6,
        "seed": 2**64 - 1,
    },
    "ChangeParams": {"mode": "off", "free_for_s": 45.0},
    "ProjectiveParams": {
        "bin_rad": 0.01,
        "in_front": True,
        "empty_is_free": True,
        "guarded": True,
        "cleared_band": True,
        "elevation_min_rad": -0.2,
        "elevation_max_rad": 0.8,
        "box_min_W_m": (-1.0, -2.0, -3.0),
        "box_max_W_m": (1.0, 2.0, 3.0),
    },
}
# Tiles of a larger map are made by programs in C++.
NOT_IN_PYTHON = {"origin_W", "window"}
PARTS = {
    "tsdf": "TsdfParams",
    "approach": "ApproachParams",
    "scoring": "ScoringParams",
    "update": "UpdateParams",
    "change": "ChangeParams",
}


def fields_of_header():
    """{struct: [field, ...]} of params.h, read as text."""
    header = Path(os.environ["SOURCE"], "include/accessvdb/params.h").read_text()
    header = re.sub(r"//.*", "", header)
    structs = {}
    for name, body in re.findall(r"^struct (?:ACCESSVDB_API )?(\w+) \{(.*?)^\};", header, re.DOTALL | re.MULTILINE):
        fields = []
        for statement in body.split(";"):
            if "(" in statement.split("=")[0] or not statement.strip(" \n}"):
                continue  # a function
            declaration = re.sub(r"\{[^}]*\}", "", statement).strip()  # {0.6, 1.25} has commas of its own
            while "<" in declaration:
                declaration = re.sub(r"<[^<>]*>", "", declaration)
            first, *more = declaration.split(",")
            fields.append(re.match(r"[\w:]+\s+(\w+)", first.strip()).group(1))
            fields += [re.match(r"\s*(\w+)", other).group(1) for other in more]
        structs[name] = fields
    return structs


def lines(params):
    return dict(line.split(" ", 1) for line in params.describe().splitlines())


class Params(unittest.TestCase):
    def test_every_field_of_the_header(self):
        structs = fields_of_header()
        self.assertEqual(set(structs), {*OTHER, "FieldParams"})
        for name, fields in structs.items():
            here = {f for f in vars(getattr(accessvdb, name)) if isinstance(vars(getattr(accessvdb, name))[f], property)}
            expected = set(fields) - NOT_IN_PYTHON if name == "FieldParams" else set(fields)
            self.assertEqual(here, expected, name)
        self.assertLess(NOT_IN_PYTHON, set(structs["FieldParams"]))
        for name, values in OTHER.items():
            self.assertEqual(list(values), structs[name], "the table of this test")

    def test_set_and_get(self):
        for name, values in OTHER.items():
            make = getattr(accessvdb, name)
            plain = make()
            for field, value in values.items():
                if field == "projective":
                    continue
                with self.subTest(f"{name}.{field}"):
                    self.assertNotEqual(getattr(plain, field), value)
                    by_keyword = make(**{field: value})
                    self.assertEqual(getattr(by_keyword, field), value)
                    by_attribute = make()
                    setattr(by_attribute, field, value)
                    self.assertEqual(getattr(by_attribute, field), value)
                    self.assertEqual(by_keyword, by_attribute)
                    self.assertNotEqual(by_keyword, plain)
                    others = [f for f in values if f != field]
                    self.assertEqual([getattr(by_keyword, f) for f in others], [getattr(plain, f) for f in others])
            self.assertEqual(eval(repr(make(**values)).replace("inf", "math.inf")), make(**values))
            self.assertIsNotNone(math.inf)

    def test_they_reach_the_library(self):
        plain = lines(accessvdb.FieldParams())
        reached = set()
        for part, name in PARTS.items():
            for field, value in OTHER[name].items():
                if field == "free_for_s":  # only with "full"
                    described = lines(accessvdb.FieldParams(change={"mode": "full", field: value}))
                    self.assertEqual((described["change"], described[field]), ("full", "45"))
                    continue
                described = lines(accessvdb.FieldParams(**{part: {field: value}}))
                changed = {key for key in plain if plain[key] != described.get(key)}  # some have no line when off
                # Only of those that are not yaw, roll, are spaced, clear more than a band.
                if field in ("orientations", "rolls", "point_spacing_m", "clear_rays_m", "platform_radius_m"):
                    self.assertNotIn(field, plain)
                    self.assertEqual(float(described[field]) if isinstance(value, float) else described[field], value if isinstance(value, float) else str(value))
                    continue
                self.assertEqual(len(changed), 0 if field == "projective" else 1, field)
                reached |= changed
        self.assertEqual(reached, set(plain))
        projective = accessvdb.FieldParams(tsdf={"region": "projective", "projective": OTHER["ProjectiveParams"]})
        self.assertEqual(lines(projective)["projective_box_max_W_m"], "1 2 3")
        # And a field from these.
        params = accessvdb.FieldParams(tsdf=OTHER["TsdfParams"], threads=2, backend="cpu")
        field = accessvdb.AccessibilityField(accessvdb.ToolGeometry.builtin("builtin:pencil"), params)
        self.assertEqual(field.params.describe(), params.resolved().describe())
        self.assertEqual((field.params.threads, field.params.backend), (2, "cpu"))

    def test_orientations_in_every_form(self):
        make = accessvdb.ApproachParams
        self.assertEqual(make().orientations, "yaw")
        rows = make(orientations=[[0, 0, 0], [90, 45, 10]])
        self.assertRegex(rows.orientations, "^list:2:[0-9a-f]{16}$")
        self.assertEqual(rows, make(orientations=np.array([[0, 0, 0], [90, 45, 10]])))
        self.assertNotEqual(rows, make(orientations=[[0, 0, 0], [90, 45, 11]]))
        self.assertRegex(make(orientations=[[1, 0, 0, 0]]).orientations, "^list:1:")
        for bad in ("all", "sphere:", [[1, 2]], [[1, 1, 0, 0]], [[0, 91, 0]], 3, None):
            with self.subTest(bad), self.assertRaises(accessvdb.InvalidArgument):
                make(orientations=bad)
        with self.assertRaises(accessvdb.InvalidArgument):
            accessvdb.FieldParams(approach={"orientations": "sphere:0"}).resolved()
        with self.assertRaises(accessvdb.ResourceLimit):
            accessvdb.FieldParams(approach={"orientations": "sphere:3"}).resolved()

    def test_parts_are_references(self):
        params = accessvdb.FieldParams()
        params.tsdf.voxel_size_m = 0.25
        params.tsdf.projective.bin_rad = 0.125
        self.assertEqual(params.tsdf.voxel_size_m, 0.25)
        self.assertEqual(params.tsdf.projective.bin_rad, 0.125)
        tsdf = params.tsdf
        del params
        self.assertEqual(tsdf.voxel_size_m, 0.25)  # keeps its owner alive

    def test_copies_are_independent(self):
        for make in (copy.copy, copy.deepcopy):
            params = accessvdb.FieldParams(tsdf={"voxel_size_m": 0.25})
            other = make(params)
            self.assertEqual(params, other)
            other.tsdf.voxel_size_m = 0.5
            self.assertEqual(params.tsdf.voxel_size_m, 0.25)
        field = accessvdb.AccessibilityField(accessvdb.ToolGeometry.builtin("builtin:pencil"), params)
        field.params.tsdf.voxel_size_m = 1
        self.assertEqual(field.params.tsdf.voxel_size_m, 0.25)

    def test_paper_and_rules(self):
        paper = accessvdb.FieldParams.paper(0.002)
        self.assertEqual((paper.tsdf.voxel_size_m, paper.tsdf.region, paper.update.policy), (0.002, "full_cube", "paper"))
        self.assertEqual(accessvdb.FieldParams().tsdf.truncation_distance_m, 0)
        self.assertEqual(accessvdb.FieldParams(tsdf={"voxel_size_m": 0.05}).resolved().tsdf.truncation_distance_m, 0.2)

    def test_numpy_numbers(self):
        params = accessvdb.TsdfParams(
            voxel_size_m=np.float32(0.25), max_weight=np.int64(12), min_range_m=np.array(0.5), max_range_m=7
        )
        self.assertEqual((params.voxel_size_m, params.max_weight, params.min_range_m, params.max_range_m), (0.25, 12, 0.5, 7))
        self.assertTrue(accessvdb.ApproachParams(viewpoints=np.bool_(True), arm_tau=np.ones(3)).viewpoints)

    def test_misuse(self):
        table = [
            (accessvdb.TsdfParams, {"voxel_size": 0.1}, 'has no setting "voxel_size". Known settings: voxel_size_m, '),
            (accessvdb.TsdfParams, {"voxel_size_m": "0.1"}, "voxel_size_m: needs a number, not str."),
            (accessvdb.TsdfParams, {"voxel_size_m": None}, "needs a number, not NoneType"),
            (accessvdb.TsdfParams, {"voxel_size_m": True}, "needs a number, not bool"),
            (accessvdb.TsdfParams, {"voxel_size_m": 1j}, "needs a number, not complex"),
            (accessvdb.TsdfParams, {"voxel_size_m": np.zeros(2)}, "needs a number, not numpy.ndarray"),
            (accessvdb.TsdfParams, {"max_weight": -1}, "-1 is outside 0 .. 4294967295"),
            (accessvdb.TsdfParams, {"max_weight": 2**80}, "is outside 0 .. 4294967295"),
            (accessvdb.TsdfParams, {"max_weight": 3.0}, "needs a whole number, not float"),
            (accessvdb.TsdfParams, {"region": "cone"}, "'cone' is not one of \"double_cone\", \"full_cube\""),
            (accessvdb.TsdfParams, {"region": 1}, "not int"),
            (accessvdb.TsdfParams, {"projective": 3}, "a dict of its settings, not int"),
            (accessvdb.ApproachParams, {"num_directions": 2**31}, "is outside"),
            (accessvdb.ApproachParams, {"arm_tau": (1, 2)}, "arm_tau: has shape (2,) instead of (3,)"),
            (accessvdb.ApproachParams, {"arm_tau": 1}, "arm_tau: has shape ()"),
            (accessvdb.ApproachParams, {"viewpoints": 1}, "needs True or False, not int"),
            (accessvdb.UpdateParams, {"seed": -1}, "-1 is outside 0 .. 18446744073709551615"),
            (accessvdb.UpdateParams, {"seed": 2**64}, "is outside"),
            (accessvdb.FieldParams, {"tsdf": accessvdb.ApproachParams()}, "TsdfParams: needs an object of this class"),
            (accessvdb.FieldParams, {"tsdf": {3: 4}}, 'TsdfParams: has no setting "3"'),
            (accessvdb.FieldParams, {"backend": "gpu"}, "'gpu' is not one of \"auto\", \"cpu\", \"cuda\""),
        ]
        for make, settings, text in table:
            with self.subTest(settings):
                with self.assertRaises(accessvdb.InvalidArgument) as caught:
                    make(**settings)
                self.assertIn(text, str(caught.exception))
                made = make()
                for name, value in settings.items():
                    if hasattr(made, name):
                        with self.assertRaises(accessvdb.InvalidArgument):
                            setattr(made, name, value)
                self.assertEqual(made, make())  # unchanged
        pencil = accessvdb.ToolGeometry.builtin("builtin:pencil")
        for bad in (3, "fast", [0.1], accessvdb.TsdfParams()):
            with self.assertRaises(accessvdb.InvalidArgument):
                accessvdb.AccessibilityField(pencil, bad)
        with self.assertRaises(TypeError):
            accessvdb.TsdfParams(0.1)
        with self.assertRaises(AttributeError):
            accessvdb.TsdfParams().voxel_size = 0.1
        for value in (math.nan, -1, 0, math.inf):
            with self.assertRaises(accessvdb.InvalidArgument):
                accessvdb.AccessibilityField(pencil, {"tsdf": {"voxel_size_m": value}})


if __name__ == "__main__":
    unittest.main()
