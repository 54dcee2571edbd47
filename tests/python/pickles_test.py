# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Tools, regions, snapshots and parameters in other processes: a copy has the bits of what it is a copy of and gives the
same labels; a pickle of another version, or a damaged one, is refused in one line."""

import copy
import multiprocessing
import pickle
import tempfile
import unittest
from pathlib import Path

import numpy as np

import accessvdb
import walls

WAYS = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    **{f"protocol {n}": lambda thing, n=n: pickle.loads(pickle.dumps(thing, n)) for n in range(2, 6)},
}
# A sheet with a hole in it and twice the same triangle: repaired, and with notes.
STL = "solid tool\n" + "".join(
    "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners) + "endloop\nendfacet\n"
    for corners in [((0, 0, 0), (90, 0, 10), (90, 40, 0))] * 2 + [((0, 0, 0), (90, 40, 0), (0, 40, 3))]
) + "endsolid tool\n"


def properties(thing):
    """Everything that an object of the module says of itself, arrays as their bytes. `records` has no more than the columns,
    and bytes between them that mean nothing."""
    said = {"repr": repr(thing)}
    for name, member in vars(type(thing)).items():
        if isinstance(member, property) and name != "records":
            value = getattr(thing, name)
            values = value.items() if isinstance(value, dict) else [("", value)]
            for key, part in values:
                said[name, key] = (part.dtype.str, part.shape, part.tobytes()) if isinstance(part, np.ndarray) else part
    return said


def differences(one, other):
    """Names only: unittest would compare a million bytes letter by letter."""
    return sorted(str(name) for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def labels(tool):
    """In another process: of the corner with this tool."""
    field = accessvdb.AccessibilityField(tool, {"tsdf": {"voxel_size_m": walls.VOXEL_M}, "threads": 1})
    T_W_S = walls.pose()
    field.integrate_scan(walls.scan(T_W_S), T_W_S)
    field.update()
    return field.snapshot()


def what_opens(work):
    params, region = work
    field = walls.field(frames=1, **{"tsdf": params.tsdf, "approach": params.approach, "threads": 1})
    what_if = field.what_if([region])
    return what_if.opens, what_if.voxels


def from_state(made, state):
    return made.__new__(made).__setstate__(state)


class Pickles(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        stl = Path(cls.folder.name, "sheet of metal.stl")
        stl.write_text(STL)
        pruner = accessvdb.ToolGeometry.builtin("builtin:pruner")
        cls.tools = [pruner, pruner.grown_by(0.05), accessvdb.ToolGeometry.from_mesh(stl, "mm", tip=(90, 20, 0))]
        cube = np.array([[x, y, z] for x in (2.9, 3.1) for y in (-0.4, -0.1) for z in (-0.5, 0.5)])
        sides = [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 7, 3], [1, 5, 7]]  # fmt: skip
        cls.regions = [
            accessvdb.Region.box((2.9, -0.4, -0.5), (3.4, -0.1, 0.5)),
            accessvdb.Region.mesh(np.concatenate([cube, cube]), [[a, b + 8, c] for a, b, c in sides]),
            accessvdb.Region.points([7, 3, 7, 12]),
        ]

    def assert_same(self, again, thing):
        self.assertIs(type(again), type(thing))
        self.assertIsNot(again, thing)
        self.assertEqual(differences(properties(again), properties(thing)), [])
        self.assertTrue(again.__getstate__() == thing.__getstate__())

    def test_every_way_gives_the_same(self):
        notes = self.tools[2].notes
        self.assertFalse(self.tools[2].watertight)
        self.assertIn("1 duplicate triangles removed", notes)
        specs = [accessvdb.ToolSpec(self.tools[1], orientations="sphere:45", rolls=3, name="arm", max_collisions=-1)]
        fields = [walls.field(), walls.field(approach={"orientations": "sphere:45", "rolls": 2})]
        snapshots = [field.snapshot() for field in fields]
        snapshots.append(accessvdb.AccessibilityField(self.tools[0]).snapshot())
        for thing in [*self.tools, *self.regions, *specs, *snapshots]:
            for name, way in WAYS.items():
                with self.subTest(thing, way=name):
                    again = way(thing)
                    if isinstance(thing, accessvdb.ToolSpec):
                        self.assert_same(again.tool, thing.tool)
                        self.assertEqual(repr(again), repr(thing))
                        self.assertTrue(again.__getstate__() == thing.__getstate__())
                    else:
                        self.assert_same(again, thing)
        self.assertGreater((snapshots[1].orientation_WT[:, 3] != 0).sum(), 50)

    def test_snapshots_with_what_returns_carry(self):
        field = walls.field(frames=0, carry=["tree", "species"])
        T_W_S = walls.pose()
        points = walls.scan(T_W_S)
        rows = np.random.default_rng(1).integers(-5, 5, (len(points), 2))
        field.integrate_scan(points, T_W_S, attributes=rows)
        field.update()
        snapshot = field.snapshot()
        again = pickle.loads(pickle.dumps(snapshot))
        self.assertEqual(list(again.attributes), ["tree", "species"])
        self.assert_same(again, snapshot)
        del snapshot, field
        with self.assertRaises(ValueError):
            again.label[0] = 1

    def test_parameters(self):
        many = accessvdb.FieldParams(
            tsdf={"voxel_size_m": 0.1 + 0.2, "max_weight": 4095, "projective": {"box_max_W_m": (1e-300, -0.0, 1 / 3)}},
            approach={"orientations": [[0, 0, 0], [90, 45, 10]], "viewpoints": True, "rolls": 7},
            scoring={"form": "surface_samples", "max_collisions": -1},
            update={"seed": 2**64 - 1, "policy": "paper"},
            change={"mode": "full", "free_for_s": 5e9},
            backend="cpu",
            threads=3,
            carry=["tree_id", "species"],
        )
        for params in (accessvdb.FieldParams(), accessvdb.FieldParams.paper(0.002), many, many.tsdf, many.approach):
            for name, way in WAYS.items():
                with self.subTest(params, way=name):
                    again = way(params)
                    self.assertEqual(again, params)
                    self.assertEqual(repr(again), repr(params))
                    self.assertEqual(again.__getstate__(), params.__getstate__())
                    self.assertIsNot(again, params)
        again = pickle.loads(pickle.dumps(many))
        again.tsdf.voxel_size_m = 0.5
        self.assertEqual(many.tsdf.voxel_size_m, 0.1 + 0.2)

    def test_other_processes(self):
        """A tool is the same there: so are its labels, also where it is the tool of a state that was saved here."""
        regions = [self.regions[0], self.regions[1]]
        params = accessvdb.FieldParams(tsdf={"voxel_size_m": walls.VOXEL_M}, approach={"orientations": "sphere:45"})
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            there = pool.map(labels, self.tools[:2])
            opened = pool.map(what_opens, [(params, region) for region in regions])
        for tool, snapshot in zip(self.tools, there):
            self.assert_same(snapshot, labels(tool))
        self.assertNotEqual(there[0].label.tobytes(), there[1].label.tobytes())
        for region, (opens, voxels) in zip(regions, opened):
            here, voxels_here = what_opens((params, region))
            self.assert_same(opens, here)
            self.assertEqual(voxels, voxels_here)
            self.assertGreater(voxels, 0)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "field.avst")
            field = walls.field(frames=1)
            field.save_state(file)
            tool = pickle.loads(pickle.dumps(accessvdb.ToolGeometry.builtin("builtin:pruner")))
            self.assert_same(accessvdb.AccessibilityField.load_state(file, tool).snapshot(), field.snapshot())

    def test_other_versions_are_refused(self):
        for thing in (self.tools[0], self.regions[0], accessvdb.FieldParams(), walls.field(frames=1).snapshot()):
            version, *rest = thing.__getstate__()
            self.assertTrue(version.startswith(accessvdb.__version__ + " "))
            for other in ("0.0.9 (1)", version + "0", ""):
                with self.assertRaisesRegex(accessvdb.InputError, f"it was pickled by version {other.split(' ')[0]}") as caught:
                    from_state(type(thing), (other, *rest))
                self.assertEqual(caught.exception.id, "pickle.version")
                self.assertEqual(len(str(caught.exception).splitlines()), 1)

    def refused(self, made, state):
        with self.assertRaisesRegex(accessvdb.InputError, "its pickle is damaged") as caught:
            from_state(made, state)
        self.assertEqual((caught.exception.id, caught.exception.subject), ("pickle.damaged", made.__name__))
        self.assertEqual(len(str(caught.exception).splitlines()), 1)

    def test_damage_is_refused(self):
        for thing in (*self.regions, accessvdb.ChangeParams(), self.tools[2]):
            made, (version, digest, content) = type(thing), thing.__getstate__()
            for at in range(len(content)):
                broken = bytearray(content)
                broken[at] ^= 1 << at % 8
                self.refused(made, (version, digest, bytes(broken)))
            for at in range(len(digest)):
                broken = bytearray(digest)
                broken[at] ^= 1 << at % 8
                self.refused(made, (version, bytes(broken), content))
            self.refused(made, (version, digest, content[:-1]))
            self.refused(made, (version, digest, content + b"\0"))
            for state in ((), (1,), (version,), (version, digest), (version, digest, content, 1), (version, digest, None)):
                self.refused(made, state)
        # Whole, and of another class.
        self.refused(accessvdb.ToolGeometry, self.regions[0].__getstate__())
        # In a pickle's bytes: what is not in its frame is in ours.
        data = pickle.dumps(self.regions[1])
        at = data.index(self.regions[1].__getstate__()[2]) + 100
        with self.assertRaises(accessvdb.InputError):
            pickle.loads(data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :])

    def test_fields_are_not_pickled(self):
        field = walls.field(frames=1)
        for call in (copy.copy, copy.deepcopy, pickle.dumps):
            with self.assertRaises(TypeError):
                call(field)


if __name__ == "__main__":
    unittest.main()
