# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Materials of the field's objects: fog, coloured points, tool."""

import bpy

from .points_ply import LABELS

# sRGB bytes, as in every file and picture of AccessVDB, by label.
_SRGB = {"unscored": (150, 152, 156), "accessible": (46, 160, 67), "blocked": (215, 58, 60)}
# A voxel lets through exp(-3) = 5 % of the light, whatever its size.
_OPTICAL_DEPTH_OF_VOXEL = 3.0
# Light emitted by the fog itself, so that it is not black in a scene without lamps.
_FOG_GLOW = 0.3


def linear_from_srgb(byte):
    """0..255 in sRGB to 0..1 in the linear space of Blender's colours; a number or an array."""
    value = byte / 255.0
    return ((value + 0.055) / 1.055) ** 2.4 * (value > 0.04045) + value / 12.92 * (value <= 0.04045)


def label_colour(label):
    """Linear RGBA of a label's name."""
    return tuple(float(linear_from_srgb(byte)) for byte in _SRGB[label]) + (1.0,)


def fog_material(voxel_size_m):
    """Green where accessible, red where blocked; as dense as the two grids say."""
    material, nodes, link = _empty_material("AccessVDB fog")
    grid = {}
    for row, label in enumerate(LABELS[1:]):
        grid[label] = nodes.new("ShaderNodeAttribute")
        grid[label].attribute_name = label
        grid[label].location = (-900, 200 - 250 * row)
    total = _math(nodes, link, "ADD", grid["accessible"].outputs["Fac"], grid["blocked"].outputs["Fac"], (-650, 100))
    # Where both overlap, the share of blocked fog determines the colour.
    nonzero = _math(nodes, link, "MAXIMUM", total.outputs[0], 1e-6, (-450, -50))
    share = _math(nodes, link, "DIVIDE", grid["blocked"].outputs["Fac"], nonzero.outputs[0], (-250, -150))
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.location = (-50, -150)
    ramp.color_ramp.elements[0].color = label_colour("accessible")
    ramp.color_ramp.elements[1].color = label_colour("blocked")
    link(share.outputs[0], ramp.inputs["Fac"])
    density = _math(nodes, link, "MULTIPLY", total.outputs[0], _OPTICAL_DEPTH_OF_VOXEL / voxel_size_m, (0, 150))
    density.label = "Density (3 / voxel size)"
    glow = _math(nodes, link, "MULTIPLY", density.outputs[0], _FOG_GLOW, (200, 50))
    glow.label = "Glow"
    fog = nodes.new("ShaderNodeVolumePrincipled")
    fog.location = (450, 100)
    fog.inputs["Density Attribute"].default_value = ""
    link(ramp.outputs["Color"], fog.inputs["Color"])
    link(ramp.outputs["Color"], fog.inputs["Emission Color"])
    link(density.outputs[0], fog.inputs["Density"])
    link(glow.outputs[0], fog.inputs["Emission Strength"])
    _output(nodes, link, fog.outputs["Volume"], "Volume")
    return material


def point_material():
    """The colour of each point, from its attribute."""
    material, nodes, link = _empty_material("AccessVDB points")
    colour = nodes.new("ShaderNodeAttribute")
    colour.attribute_name = "colour"
    colour.location = (-300, 0)
    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Roughness"].default_value = 0.8
    link(colour.outputs["Color"], surface.inputs["Base Color"])
    _output(nodes, link, surface.outputs["BSDF"], "Surface")
    return material


def tool_material():
    """Amber: neither of the colours of the labels."""
    material, nodes, link = _empty_material("AccessVDB tool")
    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Base Color"].default_value = (0.80, 0.45, 0.05, 1.0)
    surface.inputs["Roughness"].default_value = 0.5
    _output(nodes, link, surface.outputs["BSDF"], "Surface")
    return material


def _empty_material(name):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    return material, tree.nodes, tree.links.new


def _math(nodes, link, operation, first, second, location):
    node = nodes.new("ShaderNodeMath")
    node.operation = operation
    node.location = location
    for socket, value in zip(node.inputs, (first, second)):
        if isinstance(value, float):
            socket.default_value = value
        else:
            link(value, socket)
    return node


def _output(nodes, link, shader, socket):
    output = nodes.new("ShaderNodeOutputMaterial")
    output.location = (750, 100)
    link(shader, output.inputs[socket])
