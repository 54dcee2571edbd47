# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The add-on, installed from a zip like a user would, imports the field: objects, counts, attributes, positions."""

import json
import os
import re
import shutil
import unittest
import zipfile

import bpy
import numpy as np

from accessvdb_import.points_ply import NO_SCORE, REASONS, read_points
from field_under_test import FIELD, FIELD_IN_TILES, GRIDS, POINTS, SOURCE, VOLUME, WORK, run_tests

MODULE = "accessvdb_import"


def zip_of_add_on():
    path = os.path.join(WORK, f"{MODULE}.zip")
    folder = os.path.join(SOURCE, "tools", "blender")
    with zipfile.ZipFile(path, "w") as archive:
        for name in sorted(os.listdir(os.path.join(folder, MODULE))):
            if name.endswith((".py", ".toml")):
                archive.write(os.path.join(folder, MODULE, name), f"{MODULE}/{name}")
    return path


class AddOnImport(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        bpy.ops.preferences.addon_install(filepath=zip_of_add_on(), overwrite=True)
        bpy.ops.preferences.addon_enable(module=MODULE)
        cls.points = read_points(POINTS)

    def setUp(self):
        for data in (bpy.data.collections, bpy.data.objects, bpy.data.meshes, bpy.data.volumes, bpy.data.materials,
                     bpy.data.node_groups):
            for thing in list(data):
                data.remove(thing)

    def imported(self, path=FIELD, **options):
        self.assertEqual(bpy.ops.import_scene.accessvdb(filepath=path, **options), {"FINISHED"})
        bpy.context.view_layer.update()
        return {thing.type: thing for thing in bpy.data.objects}

    def test_it_is_installed_and_in_the_menu(self):
        self.assertIn(MODULE, bpy.context.preferences.addons)
        self.assertTrue(bpy.ops.import_scene.accessvdb.get_rna_type())
        drawn = bpy.types.TOPBAR_MT_file_import.draw._draw_funcs
        self.assertTrue([function for function in drawn if function.__module__.startswith(MODULE)])

    def test_a_field_becomes_a_volume_points_and_an_empty_that_holds_both(self):
        things = self.imported()
        self.assertEqual(set(things), {"VOLUME", "MESH", "EMPTY"})
        self.assertEqual(len(bpy.data.objects), 3)
        for kind in ("VOLUME", "MESH"):
            self.assertEqual(things[kind].parent, things["EMPTY"])
        self.assertEqual([collection.name for collection in bpy.context.scene.collection.children], ["field"])
        self.assertEqual(set(bpy.data.collections["field"].objects), set(things.values()))
        self.assertEqual(list(things["EMPTY"]["accessvdb_origin_W"]), self.points.origin_W.tolist())

    def test_folder_volume_and_points_file_all_open_the_field(self):
        for path in (FIELD, FIELD + os.sep, VOLUME, POINTS):
            self.setUp()
            self.assertEqual(set(self.imported(path)), {"VOLUME", "MESH", "EMPTY"}, path)

    def test_a_map_in_tiles_becomes_one_part_for_each_tile(self):
        with open(os.path.join(FIELD_IN_TILES, "field.json"), encoding="utf-8") as stream:
            tiles = [tile for tile in json.load(stream)["tiles"] if tile["points"] > 0]
        self.assertGreater(len(tiles), 1)
        for path in (FIELD_IN_TILES, os.path.join(FIELD_IN_TILES, "field.json")):
            self.setUp()
            self.imported(path)
            kinds = [thing.type for thing in bpy.data.objects]
            self.assertEqual(sorted(kinds), sorted(["VOLUME", "MESH", "EMPTY"] * len(tiles)))
            whole, = bpy.context.scene.collection.children
            self.assertEqual((whole.name, len(whole.children)), ("field_in_tiles", len(tiles)))
            meshes = [thing for thing in bpy.data.objects if thing.type == "MESH"]
            places = np.concatenate([[tuple(thing.matrix_world @ v.co) for v in thing.data.vertices] for thing in meshes])
            expected = self.points.records
            expected = np.stack([expected["x"], expected["y"], expected["z"]], axis=1)
            self.assertEqual(places.shape, expected.shape)
            # Blender's floats, a few metres from its origin.
            self.assertLess(abs(np.sort(places, axis=0) - np.sort(expected, axis=0)).max(), 1e-5)

    def test_the_tool_of_a_tile_is_that_of_the_run(self):
        self.imported(FIELD_IN_TILES)
        mesh = next(thing for thing in bpy.data.objects if thing.type == "MESH")
        label = np.empty(len(mesh.data.vertices), np.int32)
        mesh.data.attributes["label"].data.foreach_get("value", label)
        bpy.context.view_layer.objects.active = mesh
        point = int(np.argmax(label == 1)) if (label == 1).any() else int(np.argmax(label == 2))
        self.assertEqual(bpy.ops.object.accessvdb_place_tool(point=point), {"FINISHED"})

    def test_parts_can_be_left_out(self):
        self.assertEqual(set(self.imported(with_points=False)), {"VOLUME", "EMPTY"})
        self.setUp()
        self.assertEqual(set(self.imported(with_volume=False)), {"MESH", "EMPTY"})

    def test_the_volume_has_every_grid_and_a_material_of_the_two_fogs(self):
        volume = self.imported()["VOLUME"].data
        volume.grids.load()
        self.assertEqual({grid.name for grid in volume.grids}, set(GRIDS))
        nodes = volume.materials[0].node_tree.nodes
        self.assertEqual({node.attribute_name for node in nodes if node.type == "ATTRIBUTE"}, {"accessible", "blocked"})

    def test_the_points_are_those_of_the_file(self):
        thing = self.imported()["MESH"]
        records, mesh = self.points.records, thing.data
        self.assertEqual(len(mesh.vertices), len(records))
        self.assertGreater(len(records), 1000)
        world = np.array(thing.matrix_world)
        # Blender has floats: the positions are within a micrometre, the attributes the same bits.
        for row in range(0, len(records), 7):
            found_W = world[:3, :3] @ np.array(mesh.vertices[row].co) + world[:3, 3]
            np.testing.assert_allclose(found_W, self.points.positions_W()[row], atol=1e-6)
            for name in ("label", "reason", "confidence", "stability", "access_probability"):
                self.assertEqual(mesh.attributes[name].data[row].value, records[name][row], name)
            score = int(records["score"][row])
            self.assertEqual(mesh.attributes["score"].data[row].value, -1 if score == NO_SCORE else score)
            self.assertEqual(tuple(mesh.attributes["direction"].data[row].vector),
                             tuple(records[row][["dx", "dy", "dz"]]))
            self.assertEqual(tuple(mesh.attributes["surface_normal"].data[row].vector),
                             tuple(records[row][["nx", "ny", "nz"]]))

    def test_the_colours_are_those_of_the_file_to_a_byte(self):
        mesh = self.imported()["MESH"].data
        colours = np.empty(4 * len(mesh.vertices), np.float32)
        mesh.attributes["colour"].data.foreach_get("color", colours)
        linear = colours.reshape(-1, 4)[:, :3].astype(float)
        srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
        np.testing.assert_array_equal(np.rint(255 * srgb), self.points.columns("red", "green", "blue"))

    def test_reasons_have_the_colours_of_the_pictures(self):
        material = self.imported()["MESH"].data.materials[0]
        group, = (node.node_tree for node in material.node_tree.nodes if node.type == "GROUP")
        ramp, = (node.color_ramp for node in group.nodes if node.type == "VALTORGB")
        attribute, = (node for node in group.nodes if node.type == "ATTRIBUTE")
        self.assertEqual(attribute.attribute_name, "reason")
        # As the program has them.
        with open(os.path.join(SOURCE, "src", "io", "results", "label_colours.h"), encoding="utf-8") as stream:
            of_reason = stream.read().split("colourOf(PointReason reason)")[1]
        cases = dict(re.findall(r"case PointReason::(\w+):\s+return \{([\d, ]+)\}", of_reason))
        for number, name in enumerate(REASONS):
            expected = [int(byte) for byte in cases.get(name.title().replace("_", ""), "150, 152, 156").split(",")]
            linear = np.array(ramp.evaluate((number + 0.5) / len(REASONS))[:3])
            srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
            self.assertEqual(np.rint(255 * srgb).astype(int).tolist(), expected, name)
        mix = material.node_tree.nodes["By reason"]
        self.assertEqual(mix.inputs[0].default_value, 0.0)
        base, = (node.inputs["Base Color"] for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
        self.assertEqual(base.links[0].from_node, mix)
        # What is linked is what its type of data uses: the colour of the points first, then that of the reason.
        used = [socket for socket in mix.inputs if socket.enabled and socket.is_linked]
        self.assertEqual([socket.links[0].from_node.type for socket in used], ["ATTRIBUTE", "GROUP"])

    def test_what_the_returns_carried_is_an_attribute(self):
        with open(POINTS, "rb") as stream:
            header, rows = stream.read().split(b"\nend_header\n", 1)
        header = header.replace(b"\nelement vertex", b"\ncomment carry tree_id\nelement vertex") + b"\nproperty int tree_id"
        records = self.points.records
        wide = np.empty(len(records), np.dtype(records.dtype.descr + [("tree_id", "<i4")]))
        for name in records.dtype.names:
            wide[name] = records[name]
        wide["tree_id"] = np.arange(len(records)) - 7
        folder = os.path.join(WORK, "carried")
        os.makedirs(folder, exist_ok=True)
        shutil.copy(VOLUME, folder)
        with open(os.path.join(folder, "points.ply"), "wb") as stream:
            stream.write(header + b"\nend_header\n" + wide.tobytes())
        mesh = self.imported(os.path.join(folder, "points.ply"), with_volume=False)["MESH"].data
        values = np.empty(len(records), np.int32)
        mesh.attributes["tree_id"].data.foreach_get("value", values)
        np.testing.assert_array_equal(values, wide["tree_id"])
        np.testing.assert_array_equal(rows[:8], wide.tobytes()[:8])

    def test_the_points_are_drawn_one_ball_each_of_half_a_voxel(self):
        thing = self.imported()["MESH"]
        evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
        self.assertFalse(evaluated.data is not None and len(evaluated.data.vertices))
        clouds = [item.object.data for item in bpy.context.evaluated_depsgraph_get().object_instances
                  if item.object.type == "POINTCLOUD"]
        self.assertEqual([len(cloud.points) for cloud in clouds], [len(self.points)])
        radius = clouds[0].attributes["radius"].data
        self.assertAlmostEqual(radius[0].value, 0.5 * self.points.voxel_size_m, delta=1e-7)
        self.assertIn("colour", clouds[0].attributes)

    def test_it_lies_at_its_world_position_or_at_the_origin(self):
        origin_W = self.points.origin_W
        self.assertGreater(np.abs(origin_W).max(), 0.1)
        for at_world_position, expected in ((True, origin_W), (False, np.zeros(3))):
            self.setUp()
            things = self.imported(at_world_position=at_world_position)
            np.testing.assert_allclose(things["EMPTY"].matrix_world.translation, expected, atol=1e-6)
            half_voxel = 0.5 * self.points.voxel_size_m if bpy.app.version < (4, 5, 0) else 0.0
            np.testing.assert_allclose(things["VOLUME"].matrix_world.translation, expected - half_voxel, atol=1e-6)

    def test_two_fields_can_be_open(self):
        self.imported()
        self.imported()
        self.assertEqual(len(bpy.data.objects), 6)

    def test_it_can_be_disabled_and_enabled_again(self):
        bpy.ops.preferences.addon_disable(module=MODULE)
        self.assertFalse(hasattr(bpy.types, "IMPORT_SCENE_OT_accessvdb"))
        bpy.ops.preferences.addon_enable(module=MODULE)
        self.imported()


run_tests()
