# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The surface points as a mesh of vertices with attributes, drawn as small balls by geometry nodes."""

import bpy
import numpy as np

from .materials import linear_from_srgb, point_material
from .points_ply import MARGINS, NO_SCORE, PROBABILITY, TOOLS

_BALL_SHARE = 0.5  # radius of a drawn point, as a share of the voxel size
_SCORE_OF_NONE = -1  # as in the grid "score"


def add_points(collection, points):
    """New mesh object in the field's local frame: vertex i is row i of points.ply."""
    mesh = bpy.data.meshes.new("points.ply")
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.positions_L().astype(np.float32).ravel())
    for name, kind, values in _attributes(points):
        attribute = mesh.attributes.new(name, kind, "POINT")
        attribute.data.foreach_set(_VALUE_OF_KIND[kind], values.ravel())
    mesh.update()
    mesh.materials.append(point_material())
    thing = bpy.data.objects.new("Accessibility points", mesh)
    collection.objects.link(thing)
    modifier = thing.modifiers.new("Draw points", "NODES")
    modifier.node_group = _ball_nodes(_BALL_SHARE * points.voxel_size_m, mesh.materials[0])
    return thing


_VALUE_OF_KIND = {"INT": "value", "FLOAT": "value", "FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color"}


def _attributes(points):
    """Name, kind and values of each vertex attribute."""
    records = points.records
    score = records["score"].astype(np.int32)
    score[score == NO_SCORE] = _SCORE_OF_NONE
    colour = np.ones((len(points), 4), np.float32)
    colour[:, :3] = linear_from_srgb(points.columns("red", "green", "blue").astype(np.float64))
    for name in TOOLS:
        if name in records.dtype.names:
            yield name, "INT", records[name].astype(np.int32)
    for name in points.carried():
        yield name, "INT", records[name].astype(np.int32)
    for name in MARGINS:
        if name in records.dtype.names:
            yield name, "FLOAT", records[name].astype(np.float32)
    if PROBABILITY in records.dtype.names:
        yield PROBABILITY, "FLOAT", records[PROBABILITY].astype(np.float32)
    yield "label", "INT", records["label"].astype(np.int32)
    yield "reason", "INT", records["reason"].astype(np.int32)
    yield "score", "INT", score
    yield "confidence", "FLOAT", records["confidence"].astype(np.float32)
    yield "stability", "FLOAT", records["stability"].astype(np.float32)
    yield "direction", "FLOAT_VECTOR", points.columns("dx", "dy", "dz").astype(np.float32)
    yield "surface_normal", "FLOAT_VECTOR", points.columns("nx", "ny", "nz").astype(np.float32)
    yield "colour", "FLOAT_COLOR", colour


def _ball_nodes(radius_m, material):
    group = bpy.data.node_groups.new("AccessVDB points", "GeometryNodeTree")
    if hasattr(group, "interface"):  # Blender 4.0 and later
        radius = group.interface.new_socket("Radius", in_out="INPUT", socket_type="NodeSocketFloat")
        group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
        group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        group.interface.move(radius, 2)
    else:
        group.inputs.new("NodeSocketGeometry", "Geometry")
        radius = group.inputs.new("NodeSocketFloat", "Radius")
        group.outputs.new("NodeSocketGeometry", "Geometry")
    radius.default_value = radius_m
    radius.min_value = 0.0
    nodes, link = group.nodes, group.links.new
    before, balls, paint, after = (nodes.new(kind) for kind in (
        "NodeGroupInput", "GeometryNodeMeshToPoints", "GeometryNodeSetMaterial", "NodeGroupOutput"))
    for column, node in enumerate((before, balls, paint, after)):
        node.location = (220 * column, 0)
    paint.inputs["Material"].default_value = material
    balls.inputs["Radius"].default_value = radius_m
    link(before.outputs["Geometry"], balls.inputs["Mesh"])
    link(before.outputs["Radius"], balls.inputs["Radius"])
    link(balls.outputs["Points"], paint.inputs["Geometry"])
    link(paint.outputs["Geometry"], after.inputs["Geometry"])
    return group
