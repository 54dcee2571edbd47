# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Materials of the field's objects: fog, coloured points, tool."""

import bpy

from .points_ply import LABELS, REASONS

# sRGB bytes, as in every file and picture of AccessVDB, by label.
_SRGB = {"unscored": (150, 152, 156), "accessible": (46, 160, 67), "blocked": (215, 58, 60)}
# The same by reason.
_SRGB_OF_REASON = {
    "none": (0, 158, 115), "confidence": (150, 152, 156), "normal": (204, 121, 167), "unseen": (86, 180, 233),
    "unknown": (0, 114, 178), "arm": (230, 159, 0), "tool": (213, 94, 0), "changed": (240, 228, 66),
    "beside_surface": (205, 207, 211),
}
# Whether it is the first of its target.
_SRGB_OF_ARROW = {True: (0, 114, 178), False: (86, 180, 233)}
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


def reason_colours():
    """A node group whose colour is that of the point's reason."""
    group = bpy.data.node_groups.new("AccessVDB reason", "ShaderNodeTree")
    if hasattr(group, "interface"):  # Blender 4.0 and later
        group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    else:
        group.outputs.new("NodeSocketColor", "Color")
    nodes, link = group.nodes, group.links.new
    reason = nodes.new("ShaderNodeAttribute")
    reason.attribute_name = "reason"
    reason.location = (-600, 0)
    # Each reason has an equal part of the ramp.
    middle = _math(nodes, link, "ADD", reason.outputs["Fac"], 0.5, (-400, 0))
    place = _math(nodes, link, "DIVIDE", middle.outputs[0], float(len(REASONS)), (-200, 0))
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.interpolation = "CONSTANT"
    ramp.color_ramp.elements.remove(ramp.color_ramp.elements[1])
    for number, name in enumerate(REASONS):
        stop = ramp.color_ramp.elements[0] if number == 0 else ramp.color_ramp.elements.new(number / len(REASONS))
        stop.color = tuple(float(linear_from_srgb(byte)) for byte in _SRGB_OF_REASON[name]) + (1.0,)
    link(place.outputs[0], ramp.inputs["Fac"])
    after = nodes.new("NodeGroupOutput")
    after.location = (300, 0)
    link(ramp.outputs["Color"], after.inputs["Color"])
    return group


def point_material():
    """The colour of each point by its label or, with the factor of the node "By reason" at 1, by its reason."""
    material, nodes, link = _empty_material("AccessVDB points")
    colour = nodes.new("ShaderNodeAttribute")
    colour.attribute_name = "colour"
    colour.location = (-300, 0)
    surface = nodes.new("ShaderNodeBsdfPrincipled")
    surface.inputs["Roughness"].default_value = 0.8
    reason = nodes.new("ShaderNodeGroup")
    reason.node_tree = reason_colours()
    reason.location = (-300, -250)
    chosen = nodes.new("ShaderNodeMix")
    chosen.data_type = "RGBA"
    chosen.name = chosen.label = "By reason"
    chosen.location = (-100, 0)
    # By number: the node has sockets of each name for every type of data.
    factor, first, second, result = chosen.inputs[0], chosen.inputs[6], chosen.inputs[7], chosen.outputs[2]
    factor.default_value = 0.0
    link(colour.outputs["Color"], first)
    link(reason.outputs["Color"], second)
    link(result, surface.inputs["Base Color"])
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


def arrow_material(first):
    """Blue for the first approach of a target, light blue for its others: colour-blind people can tell them apart, and
    neither is a colour of a label or the tool."""
    name = "AccessVDB first approach" if first else "AccessVDB other approach"
    material, nodes, link = _empty_material(name)
    surface = nodes.new("ShaderNodeBsdfPrincipled")
    colour = tuple(float(linear_from_srgb(byte)) for byte in _SRGB_OF_ARROW[first]) + (1.0,)
    surface.inputs["Base Color"].default_value = colour
    surface.inputs["Roughness"].default_value = 0.6
    material.diffuse_color = colour  # without lamps and nodes, too
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
