# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The tool at a point: the vertices against the library's own, the matrix against the yaw of the point. Saves the
positions of the tool's corners, for tool_collisions_test.py to compare with what the library counted there."""

import json
import math
import os
import subprocess
import unittest

import bpy
import numpy as np

import accessvdb_import
import hook
from accessvdb_import.points_ply import read_points
from field_under_test import FIELD, PLACED_TOOLS, POINTS, SOURCE, TOOL, WORK, run_tests

TOOL_VERTICES = os.environ["TOOL_VERTICES"]


def library_vertices(*arguments):
    """(n, 3) of a tool in the tool frame, metres, as in the C++ library."""
    text = subprocess.run([TOOL_VERTICES, *map(str, arguments)], check=True, capture_output=True, text=True).stdout
    return np.array([[float(word) for word in line.split()] for line in text.splitlines()])


def vertices_of(thing):
    return np.array([tuple(vertex.co) for vertex in thing.data.vertices])


class ToolPlacement(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        accessvdb_import.register()
        bpy.ops.import_scene.accessvdb(filepath=FIELD)
        cls.mesh = next(thing for thing in bpy.data.objects if thing.type == "MESH")
        cls.points = read_points(POINTS)
        cls.directed = np.nonzero(cls.points.records["dx"] ** 2 + cls.points.records["dy"] ** 2 > 0.5)[0]

    def placed(self, point, **options):
        bpy.context.view_layer.objects.active = self.mesh
        self.assertEqual(bpy.ops.object.accessvdb_place_tool(point=point, **options), {"FINISHED"})
        tools = [thing for thing in bpy.data.objects if "accessvdb_point" in thing]
        self.assertEqual(len(tools), 1)
        bpy.context.view_layer.update()
        return tools[0]

    def assertSameVertices(self, found, expected):
        """Compared as sets, because each side joins and orders vertices in its own way; to a micrometre."""
        gaps = np.linalg.norm(found[:, None] - expected[None], axis=2)
        self.assertLess(gaps.min(axis=0).max(), 1e-6)
        self.assertLess(gaps.min(axis=1).max(), 1e-6)

    def test_the_mesh_of_the_run_has_the_vertices_that_the_library_used(self):
        expected = library_vertices(TOOL, hook.UNIT, *hook.TIP, *hook.AXIS, *hook.UP)
        self.assertGreaterEqual(len(expected), 8)
        self.assertSameVertices(vertices_of(self.placed(int(self.directed[0]))), expected)

    def test_a_pose_that_is_askew_gives_the_same_vertices_as_in_the_library(self):
        tip, axis, up = (12.5, -3.0, 70.0), (0.3, -0.8, 0.5), (0.9, 0.2, -0.4)
        tool = self.placed(int(self.directed[0]), source="FILE", tool=TOOL, unit="mm", tip=tip, axis=axis, up=up)
        self.assertSameVertices(vertices_of(tool), library_vertices(TOOL, "mm", *tip, *axis, *up))

    def test_a_quaternion_places_a_tool_that_tilts(self):
        from accessvdb_import.points_ply import Points
        from accessvdb_import.tool_frame import placement_L

        dtype = [(name, "<f8" if name in "xyz" else "<f4") for name in
                 ("x", "y", "z", "dx", "dy", "dz", "qw", "qx", "qy", "qz")] + [("reason", "u1")]
        # Rz(90) Ry(-45) Rx(180): along +y, up by 45 degrees, upside down.
        half = math.sqrt(0.5)
        q = [0.0, 0.0, 0.0, 0.0]
        for axis, degrees in ((2, 90), (1, -45), (0, 180)):
            turn = [math.cos(math.radians(degrees / 2)), 0, 0, 0]
            turn[1 + axis] = math.sin(math.radians(degrees / 2))
            a, b = (q, turn) if any(q) else ((1, 0, 0, 0), turn)
            q = [a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                 a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                 a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
                 a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]]
        row = np.array([(1, 2, 3, 0, half, half, *q, 0)], dtype=dtype)
        matrix = placement_L(Points(row, np.array([1.0, 0, 0]), 0.1, {}), 0)
        expected = [[0, 1, 0, 0], [half, 0, half, 2], [half, 0, -half, 3], [0, 0, 0, 1]]
        np.testing.assert_allclose(matrix, expected, atol=1e-6)
        row["qw"] = 3
        with self.assertRaisesRegex(accessvdb_import.points_ply.FieldError, "unit quaternion"):
            placement_L(Points(row, np.zeros(3), 0.1, {}), 0)

    def test_every_kind_of_mesh_file_keeps_its_axes(self):
        at, faces = hook.corners(), list(hook.triangles())
        indices = [[at.index(corner) for corner in face] for face in faces]
        obj, ply = os.path.join(WORK, "hook.obj"), os.path.join(WORK, "hook.ply")
        with open(obj, "w", encoding="utf-8") as stream:
            stream.writelines(f"v {x} {y} {z}\n" for x, y, z in at)
            stream.writelines(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in indices)
        with open(ply, "w", encoding="utf-8") as stream:
            stream.write(f"ply\nformat ascii 1.0\nelement vertex {len(at)}\nproperty float x\nproperty float y\n"
                         f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\n"
                         "end_header\n")
            stream.writelines(f"{x} {y} {z}\n" for x, y, z in at)
            stream.writelines(f"3 {a} {b} {c}\n" for a, b, c in indices)
        pose = {"unit": "mm", "tip": hook.TIP, "axis": hook.AXIS, "up": hook.UP}
        for path in (TOOL, obj, ply):
            with self.subTest(path=os.path.basename(path)):
                tool = self.placed(int(self.directed[0]), source="FILE", tool=path, **pose)
                expected = library_vertices(path, "mm", *hook.TIP, *hook.AXIS, *hook.UP)
                self.assertSameVertices(vertices_of(tool), expected)

    def test_the_built_in_tools_are_those_of_the_library(self):
        for source, name in (("PENCIL", "builtin:pencil"), ("PRUNER", "builtin:pruner")):
            with self.subTest(tool=name):
                tool = self.placed(int(self.directed[0]), source=source)
                self.assertSameVertices(vertices_of(tool), library_vertices(name))
                edges = {}
                for polygon in tool.data.polygons:
                    for edge in polygon.edge_keys:
                        edges[edge] = edges.get(edge, 0) + 1
                self.assertEqual(set(edges.values()), {2})  # closed

    def test_the_tip_lies_on_the_point_and_the_body_along_its_direction(self):
        records = self.points.records
        yaws = set()
        for point in self.directed[:: len(self.directed) // 40]:
            matrix = np.array(self.placed(int(point), source="PENCIL").matrix_world)
            np.testing.assert_allclose(matrix[:3, 3], self.points.positions_W()[point], atol=1e-6)
            np.testing.assert_allclose(matrix[:3, 0], [records[name][point] for name in ("dx", "dy", "dz")], atol=1e-6)
            yaw_rad = math.radians(records["yaw"][point])
            np.testing.assert_allclose(matrix[:3, 1], [-math.sin(yaw_rad), math.cos(yaw_rad), 0], atol=1e-6)
            np.testing.assert_allclose(matrix[:3, 2], [0, 0, 1], atol=1e-6)
            yaws.add(round(math.degrees(yaw_rad)))
        self.assertGreater(len(yaws), 15)  # many directions, in all quadrants
        self.assertEqual({int(yaw % 360 // 90) for yaw in yaws}, {0, 1, 2, 3})

    def test_the_selected_vertex_is_the_point(self):
        point = int(self.directed[11])
        for row, vertex in enumerate(self.mesh.data.vertices):
            vertex.select = row == point
        self.assertEqual(self.placed(-1)["accessvdb_point"], point)
        self.assertEqual(self.placed(int(self.directed[12]))["accessvdb_point"], int(self.directed[12]))
        bpy.context.view_layer.objects.active = self.mesh
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="DESELECT")
        bpy.ops.object.mode_set(mode="OBJECT")
        self.mesh.data.vertices[point].select = True
        bpy.ops.object.mode_set(mode="EDIT")
        try:
            self.assertEqual(bpy.ops.object.accessvdb_place_tool(), {"FINISHED"})
        finally:
            bpy.ops.object.mode_set(mode="OBJECT")
        tools = [thing["accessvdb_point"] for thing in bpy.data.objects if "accessvdb_point" in thing]
        self.assertEqual(tools, [point])

    def test_earlier_tools_stay_if_asked_for(self):
        self.placed(int(self.directed[0]))
        bpy.context.view_layer.objects.active = self.mesh
        bpy.ops.object.accessvdb_place_tool(point=int(self.directed[1]), keep=True)
        self.assertEqual(len([thing for thing in bpy.data.objects if "accessvdb_point" in thing]), 2)
        self.placed(int(self.directed[2]))

    def test_nothing_of_the_importers_stays_behind(self):
        self.placed(int(self.directed[0]))
        before = (len(bpy.data.objects), len(bpy.data.meshes), bpy.context.view_layer.objects.active)
        self.placed(int(self.directed[1]))
        self.assertEqual((len(bpy.data.objects), len(bpy.data.meshes), bpy.context.view_layer.objects.active), before)

    def test_leaves_the_corners_of_placed_tools(self):
        reason_tool = np.nonzero(self.points.records["reason"] == 6)[0]
        accessible = np.nonzero(self.points.records["label"] == 1)[0]
        placed = []
        for point in list(reason_tool[:: len(reason_tool) // 25]) + list(accessible[:: len(accessible) // 25]):
            tool = self.placed(int(point))
            world = np.array(tool.matrix_world)
            vertices_W = vertices_of(tool) @ world[:3, :3].T + world[:3, 3]
            placed.append({"point": int(point), "vertices_W": vertices_W.tolist(),
                           "faces": [list(polygon.vertices) for polygon in tool.data.polygons]})
        with open(PLACED_TOOLS, "w", encoding="utf-8") as stream:
            json.dump(placed, stream)
        self.assertGreaterEqual(len(placed), 50)


run_tests()
