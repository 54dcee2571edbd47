# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Approaches in Blender: an arrow for each from pre-contact to contact, the tool in each of its poses, and what is
refused. Poses are held against Blender's own quaternions."""

import copy
import json
import os
import shutil
import unittest

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector

import accessvdb_import
from accessvdb_import.points_ply import read_points
from field_under_test import APPROACHES, FIELD, FIELD_IN_TILES, POINTS, WORK, run_tests

COPY, TILES = os.path.join(WORK, "approached_field"), os.path.join(WORK, "approached_tiles")
FILE = os.path.join(APPROACHES, "approaches.json")


def matrix_of(pose):
    """World from tool, by Blender."""
    return Matrix.Translation(Vector(pose["position"])) @ Quaternion(pose["orientation_wxyz"]).to_matrix().to_4x4()


def values(thing, name):
    numbers = np.empty(len(thing.data.vertices), np.int32)
    thing.data.attributes[name].data.foreach_get("value", numbers)
    return numbers


class Approaches(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        with open(FILE, encoding="utf-8") as stream:
            cls.content = json.load(stream)
        cls.targets = cls.content["targets"]
        cls.points = read_points(POINTS)

    def setUp(self):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        accessvdb_import.register()
        for folder, original in ((COPY, FIELD), (TILES, FIELD_IN_TILES)):
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(original, folder)

    def tearDown(self):
        accessvdb_import.unregister()

    def write(self, content, folder=COPY):
        with open(os.path.join(folder, "approaches.json"), "w", encoding="utf-8") as stream:
            json.dump(content, stream)

    def imported(self, path=COPY, **options):
        self.assertEqual(bpy.ops.import_scene.accessvdb(filepath=path, with_volume=False, **options), {"FINISHED"})
        bpy.context.view_layer.update()
        return [thing for thing in bpy.data.objects if "approach" in getattr(thing.data, "attributes", {})]

    def placed(self, thing, **options):
        bpy.context.view_layer.objects.active = thing
        self.assertEqual(bpy.ops.object.accessvdb_place_approach(**options), {"FINISHED"})
        bpy.context.view_layer.update()
        tool, = [each for each in bpy.data.objects if "accessvdb_target" in each]
        return tool

    def test_the_file_has_something_to_show(self):
        self.assertGreaterEqual(len(self.targets), 4)
        self.assertGreater(max(len(target["approaches"]) for target in self.targets), 1)

    def test_beside_the_field_or_elsewhere_or_not_at_all(self):
        self.assertEqual(self.imported(), [])
        arrows, = self.imported(approaches=FILE)
        self.assertIn("accessvdb_approaches", arrows.parent)
        self.assertEqual(len(self.imported(approaches=APPROACHES)), 2)
        shutil.copy(FILE, COPY)
        for path in (COPY, os.path.join(COPY, "approaches.json")):
            bpy.ops.wm.read_factory_settings(use_empty=True)
            self.assertEqual(len(self.imported(path)), 1)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.assertEqual(self.imported(with_approaches=False), [])

    def test_an_arrow_for_each_approach_from_pre_contact_to_contact(self):
        arrows, = self.imported(approaches=FILE)
        world = np.array(arrows.matrix_world)
        corners = np.array([tuple(vertex.co) for vertex in arrows.data.vertices]) @ world[:3, :3].T + world[:3, 3]
        target, approach = values(arrows, "target"), values(arrows, "approach")
        expected = {(n, k) for n, each in enumerate(self.targets) for k in range(len(each["approaches"]))}
        self.assertEqual(set(zip(target.tolist(), approach.tolist())), expected)
        for n, k in expected:
            own = corners[(target == n) & (approach == k)]
            pose = self.targets[n]["approaches"][k]
            tail, tip = (np.array(pose[name]["position"]) for name in ("pre_contact", "contact"))
            length = np.linalg.norm(tip - tail)
            along = (own - tail) @ (tip - tail) / length
            across = np.linalg.norm(own - tail - along[:, None] * (tip - tail) / length, axis=1)
            # Blender's floats, a few metres from its origin.
            self.assertLess(np.linalg.norm(own[np.argmax(along)] - tip), 2e-6)
            self.assertAlmostEqual(along.min(), 0, delta=2e-6)
            self.assertLess(across.max(), 0.06 * length)
            self.assertGreater(across[along < 0.9 * length].max(), 0.03 * length, "it has a head")
        # Closed, with all faces outwards: the volume is that of the arrows, and positive.
        volume = 0
        for polygon in arrows.data.polygons:
            a, *others = [corners[v] - corners[0] for v in polygon.vertices]
            volume += sum(np.linalg.det([a, b, c]) for b, c in zip(others, others[1:])) / 6
        self.assertGreater(volume, 0)
        edges = []
        for polygon in arrows.data.polygons:
            loop = list(polygon.vertices)
            edges += zip(loop, loop[1:] + loop[:1])
        self.assertEqual(len(set(edges)), len(edges), "no two faces run along an edge the same way")
        self.assertEqual(set(edges), {(b, a) for a, b in edges})

    def test_the_first_of_a_target_has_the_stronger_colour(self):
        arrows, = self.imported(approaches=FILE)
        approach = values(arrows, "approach")
        for polygon in arrows.data.polygons:
            self.assertEqual(polygon.material_index, 0 if approach[polygon.vertices[0]] == 0 else 1)
        first, other = (material.diffuse_color for material in arrows.data.materials)
        light = lambda colour: 0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2]
        self.assertLess(2 * light(first), light(other))
        for material in arrows.data.materials:
            node, = [each for each in material.node_tree.nodes if each.type == "BSDF_PRINCIPLED"]
            np.testing.assert_allclose(node.inputs["Base Color"].default_value, material.diffuse_color, atol=1e-6)

    def test_the_tool_stands_in_each_pose(self):
        arrows, = self.imported(approaches=FILE)
        for n, target in enumerate(self.targets):
            for k, approach in enumerate(target["approaches"]):
                for pose in ("pre_contact", "contact", "retreat"):
                    tool = self.placed(arrows, target=n, approach=k, pose=pose)
                    np.testing.assert_allclose(np.array(tool.matrix_world), np.array(matrix_of(approach[pose])), atol=2e-6)
                    self.assertEqual((tool["accessvdb_target"], tool["accessvdb_approach"], tool["accessvdb_pose"]), (n, k, pose))
        # By rule in contact, and the same tool as at a point.
        tool = self.placed(arrows, target=0)
        np.testing.assert_allclose(np.array(tool.matrix_world), np.array(matrix_of(self.targets[0]["approaches"][0]["contact"])), atol=2e-6)
        corners = sorted(tuple(vertex.co) for vertex in tool.data.vertices)
        self.assertEqual(bpy.ops.object.accessvdb_place_tool(point=self.targets[0]["point"]), {"FINISHED"})
        at_point, = [thing for thing in bpy.data.objects if "accessvdb_point" in thing]  # it took the other one's place
        self.assertEqual(sorted(tuple(vertex.co) for vertex in at_point.data.vertices), corners)

    def test_a_tool_that_tilts_and_rolls(self):
        content = copy.deepcopy(self.content)
        turn = Quaternion((0.5, 0.1, -0.7, 0.3)).normalized()
        for pose in ("pre_contact", "contact", "retreat"):
            content["targets"][1]["approaches"][0][pose]["orientation_wxyz"] = list(turn)
        self.write(content)
        arrows, = self.imported()
        tool = self.placed(arrows, target=1, pose="retreat")
        expected = matrix_of(content["targets"][1]["approaches"][0]["retreat"])
        np.testing.assert_allclose(np.array(tool.matrix_world), np.array(expected), atol=2e-6)

    def test_the_selected_arrow_is_the_approach(self):
        arrows, = self.imported(approaches=FILE)
        target, approach = values(arrows, "target"), values(arrows, "approach")
        n = next(n for n, each in enumerate(self.targets) if len(each["approaches"]) > 1)
        for row, vertex in enumerate(arrows.data.vertices):
            vertex.select = bool(target[row] == n and approach[row] == 1)
        tool = self.placed(arrows)
        self.assertEqual((tool["accessvdb_target"], tool["accessvdb_approach"]), (n, 1))
        for vertex in arrows.data.vertices:
            vertex.select = True
        self.assertPlacingRefused(arrows, "arrows are selected")

    def test_a_map_in_tiles(self):
        content, left = copy.deepcopy(self.content), []
        for tile in sorted(os.listdir(os.path.join(TILES, "tiles"))):
            points = os.path.join(TILES, "tiles", tile, "points.ply")
            if not os.path.isfile(points):
                continue
            places = read_points(points).positions_W()
            for n, target in enumerate(content["targets"]):
                same = np.flatnonzero((places == target["position"]).all(axis=1))
                if len(same) == 1:
                    target["point"] = int(same[0])
                    left.append(n)
        content["targets"] = [content["targets"][n] for n in sorted(set(left))]
        self.assertGreater(len(left), 1)
        self.write(content, TILES)
        arrows = self.imported(TILES)
        shown = {int(n) for thing in arrows for n in values(thing, "target")}
        self.assertEqual(shown, set(range(len(content["targets"]))))
        own = int(values(arrows[0], "target")[0])
        tool = self.placed(arrows[0], target=own)
        expected = matrix_of(content["targets"][own]["approaches"][0]["contact"])
        np.testing.assert_allclose(np.array(tool.matrix_world), np.array(expected), atol=2e-6)

    # What is refused ----------------------------------------------------------------------------------------------------

    def assertRefused(self, call, words):
        before = {name: len(getattr(bpy.data, name)) for name in ("objects", "collections", "meshes", "materials")}
        with self.assertRaises(RuntimeError) as refusal:
            call()
        lines = [line for line in str(refusal.exception).splitlines() if line.startswith("Error")]
        self.assertEqual(len(lines), 1, str(refusal.exception))
        self.assertIn(words, lines[0])
        self.assertNotIn("Traceback", str(refusal.exception))
        bpy.ops.outliner.orphans_purge(do_recursive=True)
        self.assertEqual({name: len(getattr(bpy.data, name)) for name in before}, before)

    def assertPlacingRefused(self, thing, words, **options):
        bpy.context.view_layer.objects.active = thing
        self.assertRefused(lambda: bpy.ops.object.accessvdb_place_approach(**options), words)

    def test_files_that_are_none_or_of_another_map(self):
        def changed(change):
            content = copy.deepcopy(self.content)
            change(content["targets"][1])
            return content

        def set_in(approach, pose, key, value):
            return changed(lambda target: target["approaches"][approach][pose].update({key: value}))

        moved = np.array(self.targets[1]["position"]) + [0.001, 0, 0]
        far = len(self.points)
        for words, content in (
                ("is no list of approaches", {}),
                ("is no list of approaches", [1]),
                ("is no list of approaches", {"targets": 3}),
                ("at targets[1].", changed(lambda target: target.pop("why"))),
                ("at targets[1].", changed(lambda target: target.update(point=-1))),
                ("at targets[1].", changed(lambda target: target.update(approaches=[]))),
                ("at targets[1].", changed(lambda target: target.update(position=[0, 0, float("nan")]))),
                ("at targets[1].approaches[0].", set_in(0, "retreat", "position", [0, float("inf"), 0])),
                ("at targets[1].approaches[0].", set_in(0, "retreat", "position", [0, None, 0])),
                ("no unit quaternion at targets[1].approaches[0]", set_in(0, "pre_contact", "orientation_wxyz", [1, 0, 0, 0.1])),
                ("contact is not at its target", set_in(0, "contact", "position", moved.tolist())),
                ("pre_contact is not at its target", set_in(0, "pre_contact", "position", [1e9, 0, 0])),
                ("target 1 is point", changed(lambda target: target.update(point=(target["point"] + 1) % far))),
                (f"target 1 is point {far}", changed(lambda target: target.update(point=far)))):
            with self.subTest(words=words):
                self.write(content)
                self.assertRefused(lambda: bpy.ops.import_scene.accessvdb(filepath=COPY, with_volume=False), words)
        with open(os.path.join(COPY, "approaches.json"), "wb") as stream:
            stream.write(b"\xff\xfe{")
        self.assertRefused(lambda: bpy.ops.import_scene.accessvdb(filepath=COPY), "is no list of approaches")
        self.assertRefused(lambda: bpy.ops.import_scene.accessvdb(filepath=COPY, approaches="/no/such.json"),
                           "Choose the output folder of accessvdb approaches")

    def test_approaches_that_are_none(self):
        self.imported()
        points = next(thing for thing in bpy.data.objects if thing.type == "MESH")
        self.assertPlacingRefused(points, "was imported without approaches", target=0)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.assertFalse(bpy.ops.object.accessvdb_place_approach.poll())
        self.write(self.content)
        arrows, = self.imported()
        self.assertPlacingRefused(arrows, f"no target {len(self.targets)}", target=len(self.targets))
        ways = len(self.targets[0]["approaches"])
        self.assertPlacingRefused(arrows, f"no approach {ways}: it has {ways}", target=0, approach=ways)
        self.assertPlacingRefused(arrows.parent, "No approach is chosen")
        # The file was written anew.
        self.write({**self.content, "targets": self.targets[1:]})
        self.assertPlacingRefused(arrows, "Import the field again", target=0)

    def test_an_approach_of_another_tool(self):
        content = copy.deepcopy(self.content)
        content["targets"][0]["tool"] = "saw"
        self.write(content)
        arrows, = self.imported()
        self.assertPlacingRefused(arrows, "for the tool saw, which is none of the run: hook", target=0)
        self.placed(arrows, target=0, source="PENCIL")
        self.placed(arrows, target=1)


run_tests()
