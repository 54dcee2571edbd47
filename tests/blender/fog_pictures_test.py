# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The fogs of field.vdb rendered by Cycles: voxels of known position show up where a camera written here projects them,
and the rest of the picture is empty.

The fog only glows, as strongly as the grid says, and absorbs nothing. So a pixel is the line integral of the grid, and
the picture's centroid is the projection of the centroid of the voxels, whatever Blender does between the two.
"""

import os
import unittest

import bpy
import numpy as np
from mathutils import Matrix

import accessvdb_import
from accessvdb_import.points_ply import read_points
from field_under_test import FIELD, FIELD_Y_UP, POINTS, VOLUME, WORK, run_tests

SIZE_PX = 256
DISTANCE_M = 0.6
WIDTH_M = 0.24  # shown by an orthographic picture
FOCAL_PX = 500.0
TOWARDS_CAMERA = np.array([0.55, -0.65, 0.75])
# Radius of the fog of one voxel, in voxels: Blender interpolates linearly, up to one voxel away on each axis.
REACH_VOXELS = np.sqrt(3)


class Camera:
    """A camera that looks at target_W. Rows of `axes` are its right, up and backward axes in the world."""

    def __init__(self, target_W, orthographic):
        back = TOWARDS_CAMERA / np.linalg.norm(TOWARDS_CAMERA)
        right = np.cross([0, 0, 1], back)
        right /= np.linalg.norm(right)
        self.axes = np.stack([right, np.cross(back, right), back])
        self.position_W = target_W + DISTANCE_M * back
        self.orthographic = orthographic

    def pixels(self, positions_W):
        """(n, 2): column from the left, row from the bottom, pixel centres at .5."""
        view = (positions_W - self.position_W) @ self.axes.T
        scale = SIZE_PX / WIDTH_M if self.orthographic else FOCAL_PX / -view[:, 2:]
        return SIZE_PX / 2 + scale * view[:, :2]

    def voxel_px(self, voxel_size_m):
        """Upper bound of a voxel's edge in pixels."""
        nearest_m = DISTANCE_M - 0.15
        return voxel_size_m * (SIZE_PX / WIDTH_M if self.orthographic else FOCAL_PX / nearest_m)

    def put(self, scene):
        camera = bpy.data.cameras.new("camera")
        camera.type = "ORTHO" if self.orthographic else "PERSP"
        camera.ortho_scale = WIDTH_M
        camera.sensor_width = 36.0
        camera.lens = 36.0 * FOCAL_PX / SIZE_PX
        camera.clip_start = 0.01
        thing = bpy.data.objects.new("camera", camera)
        matrix = np.eye(4)
        matrix[:3, :3] = self.axes.T
        matrix[:3, 3] = self.position_W
        thing.matrix_world = Matrix(matrix.tolist())
        scene.collection.objects.link(thing)
        scene.camera = thing


def fog_object(with_add_on, folder=FIELD):
    """The volume of the field in an empty scene, as placed by the add-on or by Blender."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if with_add_on:
        accessvdb_import.register()
        bpy.ops.import_scene.accessvdb(filepath=folder)
        accessvdb_import.unregister()
        for thing in [thing for thing in bpy.data.objects if thing.type == "MESH"]:
            bpy.data.objects.remove(thing)
        return next(thing for thing in bpy.data.objects if thing.type == "VOLUME")
    bpy.ops.object.volume_import(filepath=VOLUME)
    return bpy.context.active_object


def let_only_glow(thing, grid, strength):
    material = bpy.data.materials.new(grid)
    material.use_nodes = True
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    nodes.clear()
    value, times, glow, output = (nodes.new(kind) for kind in (
        "ShaderNodeAttribute", "ShaderNodeMath", "ShaderNodeEmission", "ShaderNodeOutputMaterial"))
    value.attribute_name = grid
    times.operation = "MULTIPLY"
    times.inputs[1].default_value = strength
    link(value.outputs["Fac"], times.inputs[0])
    link(times.outputs[0], glow.inputs["Strength"])
    link(glow.outputs[0], output.inputs["Volume"])
    thing.data.materials.clear()
    thing.data.materials.append(material)


def render(name, samples=16):
    """(SIZE_PX, SIZE_PX, 4) floats, linear, row 0 at the bottom."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.seed = 1
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.render.resolution_x = scene.render.resolution_y = SIZE_PX
    scene.render.resolution_percentage = 100
    scene.render.filter_size = 0.01  # no blur across pixels
    scene.render.film_transparent = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = os.path.join(WORK, name + ".exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath, check_existing=False)
    pixels = np.empty(SIZE_PX * SIZE_PX * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(SIZE_PX, SIZE_PX, 4)


def largest_near(picture, pixels):
    """The brightest of the 3 x 3 pixels around each position."""
    columns, rows = np.floor(pixels).astype(int).T
    padded = np.pad(picture, 1)
    return np.max([padded[rows + 1 + dy, columns + 1 + dx] for dy in (-1, 0, 1) for dx in (-1, 0, 1)], axis=0)


def distance_to_nearest(pixels):
    """(SIZE_PX, SIZE_PX): distance from each pixel's centre to the nearest position, by brute force."""
    y, x = np.mgrid[0:SIZE_PX, 0:SIZE_PX] + 0.5
    nearest = np.full((SIZE_PX, SIZE_PX), np.inf)
    for px, py in pixels:
        np.minimum(nearest, (x - px) ** 2 + (y - py) ** 2, out=nearest)
    return np.sqrt(nearest)


class FogPictures(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.points = read_points(POINTS)
        size_m = cls.points.voxel_size_m
        ijk = np.floor(cls.points.positions_L() / size_m + 0.5)
        cls.voxels_L = ijk * size_m
        labels = cls.points.records["label"]
        cls.pictures = {}
        cls.kept = {"density": labels >= 0, "accessible": labels == 1, "blocked": labels == 2}

    def picture_of(self, grid, with_add_on, orthographic, folder=FIELD):
        """The picture, the pixels of the voxels visible in it, and a voxel's edge in pixels."""
        size_m = self.points.voxel_size_m
        frame = self.points.origin_W if with_add_on else 0.0
        camera = Camera(self.voxels_L.mean(axis=0) + frame, orthographic)
        key = (grid, with_add_on, orthographic, folder)
        if key not in self.pictures:
            let_only_glow(fog_object(with_add_on, folder), grid, 1.0 / size_m)
            camera.put(bpy.context.scene)
            self.pictures[key] = render(f"{grid}_{len(self.pictures)}")[:, :, 0]
        picture = self.pictures[key]
        pixels = camera.pixels(self.voxels_L[self.kept[grid]] + frame)
        self.assertTrue((pixels > 2).all() and (pixels < SIZE_PX - 2).all(), "the test's camera misses the field")
        return picture, pixels, camera.voxel_px(size_m)

    def test_voxels_show_up_where_they_project_and_nothing_else_does(self):
        for grid in self.kept:
            with self.subTest(grid=grid):
                picture, pixels, voxel_px = self.picture_of(grid, with_add_on=True, orthographic=False)
                # A ray through the middle of a lone voxel meets at least 0.65 of a voxel's glow (along a diagonal).
                self.assertGreater(largest_near(picture, pixels).min(), 0.5)
                nearest_px = distance_to_nearest(pixels)
                empty = nearest_px > REACH_VOXELS * voxel_px + 1
                self.assertGreater(empty.mean(), 0.2)
                self.assertEqual(picture[empty].max(), 0.0)

    def centroid_offset_voxels(self, grid, with_add_on, folder=FIELD):
        picture, pixels, voxel_px = self.picture_of(grid, with_add_on, True, folder)
        y, x = np.mgrid[0:SIZE_PX, 0:SIZE_PX] + 0.5
        centroid = np.array([(x * picture).sum(), (y * picture).sum()]) / picture.sum()
        # The glow of n voxels, each v long and wide: nothing lost, nothing added.
        mass = picture.sum() / (len(pixels) * voxel_px ** 2)
        self.assertAlmostEqual(mass, 1.0, delta=0.03)
        return (centroid - pixels.mean(axis=0)) / voxel_px

    def test_the_add_on_places_the_fog_on_the_points(self):
        for grid in self.kept:
            with self.subTest(grid=grid):
                self.assertLess(np.abs(self.centroid_offset_voxels(grid, with_add_on=True)).max(), 0.05)

    def test_a_field_that_was_written_with_y_up_lies_in_the_same_place(self):
        self.assertLess(np.abs(self.centroid_offset_voxels("blocked", True, FIELD_Y_UP)).max(), 0.05)

    def test_without_the_add_on_it_is_off_by_half_a_voxel_at_most_on_each_axis(self):
        offset = self.centroid_offset_voxels("density", with_add_on=False)
        axes = Camera(np.zeros(3), True).axes
        half_voxel = axes[:2] @ np.array([0.5, 0.5, 0.5])
        drawn_in_cell = np.abs(offset - half_voxel).max() < 0.05
        drawn_around = np.abs(offset).max() < 0.05
        self.assertTrue(drawn_in_cell or drawn_around, f"off by {offset} voxels")

    def test_the_fog_ends_where_the_map_ends(self):
        # A voxel's fog reaches as far as the corners of a cube of two voxels, thinner towards them.
        reach = np.abs(Camera(np.zeros(3), True).axes[:2]).sum(axis=1)
        for grid in self.kept:
            with self.subTest(grid=grid):
                picture, pixels, voxel_px = self.picture_of(grid, with_add_on=True, orthographic=True)
                rows, columns = np.nonzero(picture > 0)
                below = (pixels.min(axis=0) - [columns.min(), rows.min()]) / voxel_px
                above = ([columns.max() + 1, rows.max() + 1] - pixels.max(axis=0)) / voxel_px
                self.assertLess(np.abs(below - reach).max(), 0.5)
                self.assertLess(np.abs(above - reach).max(), 0.5)

    def test_the_material_of_the_add_on_is_green_where_accessible_and_red_where_blocked(self):
        fog_object(with_add_on=True)
        world = bpy.data.worlds.new("light")
        world.use_nodes = True
        bpy.context.scene.world = world
        camera = Camera(self.voxels_L.mean(axis=0) + self.points.origin_W, True)
        camera.put(bpy.context.scene)
        picture = render("material")
        pixels = {name: camera.pixels(self.voxels_L[kept] + self.points.origin_W) for name, kept in self.kept.items()}
        voxel_px = camera.voxel_px(self.points.voxel_size_m)
        away = {name: distance_to_nearest(pixels[name]) for name in pixels}
        red, green, _, alpha = np.moveaxis(picture, 2, 0)
        only_green = (away["accessible"] < 0.5 * voxel_px) & (away["blocked"] > (REACH_VOXELS + 1) * voxel_px)
        only_red = (away["blocked"] < 0.5 * voxel_px) & (away["accessible"] > (REACH_VOXELS + 1) * voxel_px)
        for name, where in (("accessible", only_green), ("blocked", only_red)):
            self.assertGreater(where.sum(), 20, name)
        self.assertGreater(np.mean(green[only_green] > 1.5 * red[only_green]), 0.99)
        self.assertGreater(np.mean(red[only_red] > 1.5 * green[only_red]), 0.99)
        self.assertGreater(np.median(alpha[only_green | only_red]), 0.6)  # dense enough to be seen
        empty = away["density"] > REACH_VOXELS * voxel_px + 1
        self.assertEqual(alpha[empty].max(), 0.0)


run_tests()
