# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""What the add-on refuses: one clear line as Blender's error, and an unchanged scene."""

import json
import os
import shutil
import unittest

import bpy
import numpy as np

import accessvdb_import
from accessvdb_import.points_ply import read_points
from field_under_test import FIELD, POINTS, TOOL, WORK, run_tests

COPY = os.path.join(WORK, "refused_field")


def contents():
    return {name: len(getattr(bpy.data, name)) for name in
            ("objects", "collections", "meshes", "volumes", "materials", "node_groups", "cameras", "images")}


class AddOnRefusals(unittest.TestCase):
    def setUp(self):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        accessvdb_import.register()
        shutil.rmtree(COPY, ignore_errors=True)
        shutil.copytree(FIELD, COPY)

    def tearDown(self):
        accessvdb_import.unregister()

    def file(self, name):
        return os.path.join(COPY, name)

    def assertRefused(self, call, words):
        before = contents()
        with self.assertRaises(RuntimeError) as refusal:
            call()
        lines = [line for line in str(refusal.exception).splitlines() if line.startswith("Error")]
        self.assertEqual(len(lines), 1, str(refusal.exception))
        self.assertIn(words, lines[0])
        self.assertNotIn("Traceback", str(refusal.exception))
        bpy.ops.outliner.orphans_purge(do_recursive=True)
        self.assertEqual(contents(), before)

    def assertImportRefused(self, words, path=COPY):
        self.assertRefused(lambda: bpy.ops.import_scene.accessvdb(filepath=path), words)

    def assertPlacingRefused(self, words, **options):
        self.assertRefused(lambda: bpy.ops.object.accessvdb_place_tool(**options), words)

    def test_missing_folders_and_files(self):
        self.assertImportRefused("there is no such file or folder", os.path.join(WORK, "no", "such"))
        self.assertImportRefused("contains no field.vdb", WORK)
        os.remove(self.file("points.ply"))
        self.assertImportRefused("contains no points.ply")

    def test_the_points_for_houdini(self):
        self.assertImportRefused("Choose field.vdb next to it", self.file("field_points.vdb"))

    def test_a_volume_that_is_no_volume(self):
        with open(self.file("field.vdb"), "wb") as stream:
            stream.write(b"no volume at all")
        self.assertImportRefused("is not a .vdb file")

    def test_a_volume_that_is_cut_off(self):
        # Blender 3.4 itself dies of an uncaught exception on some of these.
        size = os.path.getsize(self.file("field.vdb"))
        for length in [size - 1, size // 2, 5000, 300, 60, 8]:
            with open(self.file("field.vdb"), "r+b") as stream:
                stream.truncate(length)
            self.assertImportRefused("is damaged or truncated")
        with open(self.file("field.vdb"), "r+b") as stream:
            stream.truncate(0)
        self.assertImportRefused("is not a .vdb file")

    def test_a_volume_with_something_after_its_end(self):
        with open(self.file("field.vdb"), "ab") as stream:
            stream.write(b"more")
        self.assertImportRefused("4 bytes after the last grid")

    def test_a_volume_of_another_program(self):
        # The points for Houdini are a valid .vdb without fogs.
        os.replace(self.file("field_points.vdb"), self.file("field.vdb"))
        self.assertImportRefused("is not a field of AccessVDB (no grid 'density'; grids: points)")

    def test_points_of_another_run(self):
        with open(self.file("points.ply"), "rb") as stream:
            data = stream.read()
        self.assertIn(b"voxel_size_m 0.004\n", data)
        with open(self.file("points.ply"), "wb") as stream:
            stream.write(data.replace(b"voxel_size_m 0.004\n", b"voxel_size_m 0.005\n"))
        self.assertImportRefused("from different runs")

    def test_damaged_points(self):
        with open(self.file("points.ply"), "r+b") as stream:
            stream.truncate(2000)
        self.assertImportRefused("bytes of points, but the header says")

    def test_an_empty_field_is_imported(self):
        with open(self.file("points.ply"), "rb") as stream:
            data = stream.read()
        end = data.index(b"end_header\n") + 11
        count = b"element vertex %d" % len(read_points(POINTS))
        with open(self.file("points.ply"), "wb") as stream:
            stream.write(data[:end].replace(count, b"element vertex 0"))
        self.assertEqual(bpy.ops.import_scene.accessvdb(filepath=COPY), {"FINISHED"})
        self.assertPlacingRefusedOnMesh("There is no point 0", point=0)

    def assertPlacingRefusedOnMesh(self, words, **options):
        bpy.context.view_layer.objects.active = next(thing for thing in bpy.data.objects if thing.type == "MESH")
        self.assertPlacingRefused(words, **options)

    def test_placing_needs_a_field(self):
        self.assertFalse(bpy.ops.object.accessvdb_place_tool.poll())

    def test_points_that_no_tool_can_be_placed_at(self):
        bpy.ops.import_scene.accessvdb(filepath=COPY)
        points = read_points(POINTS)
        self.assertPlacingRefusedOnMesh(f"There is no point {len(points)}", point=len(points))
        without = int(np.argmax(np.abs(points.columns("dx", "dy", "dz")).sum(axis=1) == 0))
        self.assertEqual(points.records["dx"][without], 0)
        self.assertPlacingRefusedOnMesh(f"Point {without} has no best direction (reason: normal)", point=without)

    def test_no_vertex_or_several_are_selected(self):
        bpy.ops.import_scene.accessvdb(filepath=COPY)
        mesh = next(thing for thing in bpy.data.objects if thing.type == "MESH")
        for rows in ((), (3, 4)):
            for row, vertex in enumerate(mesh.data.vertices):
                vertex.select = row in rows
            self.assertPlacingRefusedOnMesh(f"{len(rows)} vertices are selected")
        bpy.context.view_layer.objects.active = mesh.parent
        self.assertPlacingRefused("No point is chosen")

    def placing_with(self, words, **options):
        if not bpy.data.volumes:
            bpy.ops.import_scene.accessvdb(filepath=COPY)
        accessible = int(np.argmax(read_points(POINTS).records["label"] == 1))
        self.assertPlacingRefusedOnMesh(words, point=accessible, **options)

    def test_tools_that_are_none(self):
        bad_stl, bad_obj = os.path.join(WORK, "bad.stl"), os.path.join(WORK, "cloud.obj")
        with open(bad_stl, "wb") as stream:
            stream.write(b"solid but not")
        with open(bad_obj, "w", encoding="utf-8") as stream:
            stream.write("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
        self.placing_with("No tool mesh is chosen", source="FILE")
        self.placing_with("there is no such file", source="FILE", tool="/no/such.stl")
        self.placing_with("Convert it to STL, OBJ or PLY", source="FILE", tool=self.file("report.json"))
        self.placing_with("bad.stl", source="FILE", tool=bad_stl)
        self.placing_with("has no faces", source="FILE", tool=bad_obj)

    def test_poses_that_are_none(self):
        self.placing_with("Check its unit", source="FILE", tool=TOOL, unit="m")
        self.placing_with("axis and up are parallel", source="FILE", tool=TOOL, axis=(0, 0, 2), up=(0, 0, -1))
        self.placing_with("axis or up is zero", source="FILE", tool=TOOL, axis=(0, 0, 0))

    def test_runs_whose_tool_is_not_known(self):
        with open(self.file("report.json"), encoding="utf-8") as stream:
            report = json.load(stream)
        report["parameters"]["tool"] = "gone.stl"
        with open(self.file("report.json"), "w", encoding="utf-8") as stream:
            json.dump(report, stream)
        self.placing_with("gone.stl: the run's tool mesh cannot be found")
        report["parameters"]["tool"] = "builtin:hammer"
        with open(self.file("report.json"), "w", encoding="utf-8") as stream:
            json.dump(report, stream)
        self.placing_with("no built-in tool with this name")
        with open(self.file("report.json"), "w", encoding="utf-8") as stream:
            stream.write("{")
        self.placing_with("cannot be read as the report")
        os.remove(self.file("report.json"))
        self.placing_with("contains no report.json")

    def test_a_field_that_was_computed_anew_after_the_import(self):
        bpy.ops.import_scene.accessvdb(filepath=COPY)
        with open(self.file("points.ply"), "rb") as stream:
            data = stream.read()
        end = data.index(b"end_header\n") + 11
        count = len(read_points(POINTS))
        with open(self.file("points.ply"), "wb") as stream:
            stream.write(data[:end].replace(b"element vertex %d" % count, b"element vertex 10"))
            stream.write(data[end:end + 10 * (len(data) - end) // count])
        self.placing_with("Import the field again")


run_tests()
