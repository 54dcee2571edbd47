# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Approaches as one mesh of arrows, each from the pre-contact pose to contact, in the field's local frame."""

import bpy
import numpy as np

from .materials import arrow_material

#: Vertex attributes: number of the target and of its approach, from 0, as in approaches.csv.
TARGET, APPROACH = "target", "approach"

_SIDES = 12
# Shares of the length: the radii of shaft and head, and where the head begins.
_SHAFT, _HEAD, _NECK = 0.014, 0.05, 0.74


def add_arrows(collection, targets, origin_W):
    """New mesh object, with the first approach of each target in a stronger colour than the others."""
    vertices, faces, materials, numbers = [], [], [], []
    shape, shape_faces = _unit_arrow()
    for target in targets:
        for way, approach in enumerate(target.approaches):
            tail, tip = (approach[name][:3, 3] - origin_W for name in ("pre_contact", "contact"))
            # The head points along -x of the tool, the way that it travels.
            length_m = np.linalg.norm(tip - tail)
            faces += [tuple(len(numbers) + corner for corner in face) for face in shape_faces]
            vertices.append(tail + length_m * shape @ _axes_along(tip - tail, approach["contact"][:3, :3]).T)
            materials += [0 if way == 0 else 1] * len(shape_faces)
            numbers += [(target.number, way)] * len(shape)
    mesh = bpy.data.meshes.new("approaches.json")
    mesh.from_pydata(np.concatenate(vertices).tolist() if vertices else [], [], faces)
    for first in (True, False):
        mesh.materials.append(arrow_material(first))
    mesh.polygons.foreach_set("material_index", np.array(materials, dtype=np.int32))
    for column, name in enumerate((TARGET, APPROACH)):
        attribute = mesh.attributes.new(name, "INT", "POINT")
        attribute.data.foreach_set("value", np.array([row[column] for row in numbers], dtype=np.int32))
    mesh.update()
    thing = bpy.data.objects.new("Approaches", mesh)
    collection.objects.link(thing)
    return thing


def _axes_along(way, rotation):
    """(3, 3): x along the way, y and z across it, near those of the tool."""
    length_m = np.linalg.norm(way)
    if not length_m > 0:
        return rotation
    x = way / length_m
    z = rotation[:, 2] - rotation[:, 2].dot(x) * x
    if not np.linalg.norm(z) > 1e-6:
        z = rotation[:, 1] - rotation[:, 1].dot(x) * x
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _unit_arrow():
    """Vertices, (n, 3), from the origin to (1, 0, 0), and faces."""
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    rings = [np.stack([np.full(_SIDES, x), radius * np.cos(angles), radius * np.sin(angles)], axis=1)
             for x, radius in ((0, _SHAFT), (_NECK, _SHAFT), (_NECK, _HEAD))]
    tail, tip = 3 * _SIDES, 3 * _SIDES + 1
    faces = []
    for side in range(_SIDES):
        after = (side + 1) % _SIDES
        faces.append((tail, after, side))
        for ring in (0, _SIDES):
            faces.append((ring + side, ring + after, ring + _SIDES + after, ring + _SIDES + side))
        faces.append((2 * _SIDES + side, 2 * _SIDES + after, tip))
    return np.concatenate([*rings, np.zeros((1, 3)), [[1.0, 0, 0]]]), faces
