# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Whether the figures of docs/tutorial.ipynb show the field: each point of a snapshot once, in the colour of its reason in the
report, the legend says so, and something of every colour is on the paper."""

import io
import re
from pathlib import Path

import numpy as np

import accessvdb

ROOT = Path(__file__).resolve().parents[2]


def colours_of_the_project():
    """{reason: (r, g, b)} as the library's pictures have them."""
    text = (ROOT / "src/io/results/label_colours.h").read_text().partition("colourOf(PointReason reason)")[2]
    rows = re.findall(r"case PointReason::(\w+):\s*return \{(\d+), (\d+), (\d+)\};", text)
    colours = {name.upper(): tuple(map(int, rgb)) for name, *rgb in rows}
    colours["CONFIDENCE"] = tuple(map(int, re.search(r"return \{(\d+), (\d+), (\d+)\};\s*\}\s*\}", text).groups()))
    return colours


def rgb_of(colour):
    from matplotlib.colors import to_rgb

    return tuple(round(255 * part) for part in to_rgb(colour))


def painted(figure):
    """{(r, g, b)} of the pixels."""
    data = io.BytesIO()
    figure.savefig(data, format="rgba", dpi=72)
    return set(map(tuple, np.frombuffer(data.getvalue(), np.uint8).reshape(-1, 4)[:, :3]))


def wrong_about(name, figure, marks, xy_of):
    """marks: {reason: (N, 2)} that have to be drawn.  xy_of: a drawn line's (N, 2) in the same terms."""
    (axes,) = figure.axes
    wrong, colours, legend = [], colours_of_the_project(), [text.get_text() for text in axes.get_legend().get_texts()]
    lines = [line for line in axes.lines if not line.get_label().startswith("_")]
    if [line.get_label() for line in lines] != legend:
        wrong.append(f"{name}: the legend is not of what is drawn")
    if not (axes.get_title() and (axes.name == "polar" or ("(m)" in axes.get_xlabel() and "(m)" in axes.get_ylabel()))):
        wrong.append(f"{name}: no title or no units")
    drawn = {line.get_label().partition(":")[0].upper(): line for line in lines}
    if set(drawn) != set(marks):
        return [*wrong, f"{name}: shows {sorted(drawn)}, not {sorted(marks)}"]
    pixels = painted(figure)
    for reason, line in drawn.items():
        xy = xy_of(line)
        if xy.shape != marks[reason].shape or not np.allclose(xy, marks[reason], rtol=0, atol=1e-6):
            wrong.append(f"{name}: {len(line.get_xdata())} marks of {reason} are not the {len(marks[reason])} of the field")
        if rgb_of(line.get_color()) != colours[reason]:
            wrong.append(f"{name}: {reason} is not in its colour")
        if colours[reason] not in pixels:
            wrong.append(f"{name}: nothing in the colour of {reason} is on the paper")
    return wrong


def wrong_in(names):
    """What is wrong, in words.  names: of the notebook, after it ran"""
    snapshot, why = names["snapshot"], names["why"]
    rows = {r.name: snapshot.records["position_W"][snapshot.records["reason"] == r, :2] for r in accessvdb.PointReason}
    rows = {reason: row for reason, row in rows.items() if len(row)}
    wrong = wrong_about("above", names["above"], rows, lambda line: line.get_xydata())

    ways = {r.name: why.direction_W[why.reason == r, :2] for r in accessvdb.PointReason}
    ways = {reason: way for reason, way in ways.items() if len(way)}
    wrong += wrong_about("ring", names["ring"], ways, lambda line: np.stack([np.cos(line.get_xdata()), np.sin(line.get_xdata())], axis=1))

    (axes,) = names["sure"].axes
    for label, patch in zip((accessvdb.PointLabel.ACCESSIBLE, accessvdb.PointLabel.BLOCKED), axes.patches):
        values = snapshot.access_probability[(snapshot.label == label) & (snapshot.access_probability >= 0)]
        heights = np.histogram(values, np.linspace(0, 1, 26))[0]
        outline = patch.get_path().vertices[:, 1]  # below 1: the ground of a logarithmic axis
        if heights.sum() != len(values) or set(outline[outline >= 1]) != set(heights[heights >= 1]):
            wrong.append(f"sure: the bars of {label.name} are not the counts of the field")
    if len(axes.patches) != 2 or not axes.get_xlabel() or not axes.get_ylabel() or axes.get_legend() is None:
        wrong.append("sure: two labels, both axes and a legend are to be there")
    return wrong
