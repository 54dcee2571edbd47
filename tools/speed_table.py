#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Prints the table of frame times in docs/benchmarks/README.md from records of gpu_suite.sh, beside the paper's:

    tools/speed_table.py docs/benchmarks/RECORD.json [RECORD.json ...]

A figure is taken from the first of the records that has it; "-" if none has. Only the standard library is needed.
"""
import json
import sys

# The paper's table of runtimes, RTX 4090: mean and 95th percentile in ms of its sequences with 3.2 and 3.5 M points.
PAPER = {
    20: "29.7 (45.7) / 32.4 (52.0)",
    10: "41.2 (63.5) / 38.3 (66.6)",
    5: "42.5 (71.4) / 36.0 (62.2)",
}
PATHS = {
    "flight": "flight, never the same place twice",
    "slow": "slow flight",  # with its speed
    "orbit": "orbit around a group of pines",
    "hover": "hovering",
}
PAPERS_BUDGET = 20000


def path_of(row):
    """Its name in PATHS; records made before --path have flights only."""
    path = row["stream"].get("path", "flight")
    return "slow" if path == "flight" and row["stream"]["speed_m_s"] < 1 else path


def matches(row, path, voxel_mm, policy, pipelined):
    """Whether a row of a record is the one of the table."""
    return (
        path_of(row) == path
        and round(1000 * row["voxel_m"]) == voxel_mm
        and abs(row["tau_m"] - 0.1) < 1e-9
        and row["policy"] == policy
        and row["budget_points"] == (PAPERS_BUDGET if policy == "paper" else 0)
        and row.get("pipelined", False) == pipelined
        and float(row.get("parameters", {}).get("point_spacing_m", 0)) == 0  # --points surface
    )


def find(rows, *what):
    found = [row for row in rows if matches(row, *what)]
    return found[0] if found else None


def times(row):
    if row is None:
        return "-"
    frame = row["timing_ms"]["frame"]
    return f"{frame['mean']:.0f} ({frame['p95']:.0f})"


def rate(row):
    return "-" if row is None else f"{row['frames_per_second']:.0f}"


def share_new(row):
    if row is None:
        return "-"
    points = row["surface_points"]
    new = points["timed_end"] - points["timed_begin"]
    share = 100 * new / (row["timed_frames"] * row["points_per_frame"])
    return f"{share:.0f} %" if share >= 10 else f"{share:.1f} %"


def points(row):
    return "-" if row is None else f"{row['surface_points']['timed_begin'] * 1e-6:.1f} M"


def moved(row):
    if row is None or "moved_points" not in row["per_frame"]:
        return "-"
    return f"{row['per_frame']['moved_points']['mean'] * 1e-6:.2f} M"


def main(arguments):
    if not arguments:
        sys.exit(__doc__)
    rows = []
    for record in arguments:
        with open(record, encoding="utf-8") as file:
            rows += json.load(file)["bench"]
    print(
        "| milliseconds, mean (p95) | voxel | points | new points | points moved | exact | exact, pipelined, frames/s "
        "| the paper's policy, 20 000 points | the paper, 3.2 M / 3.5 M points |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for path, name in PATHS.items():
        for voxel_mm, printed in PAPER.items():
            exact = find(rows, path, voxel_mm, "exact", False)
            at = f" at {exact['stream']['speed_m_s']:g} m/s" if path == "slow" and exact else ""
            cells = [
                name + at,
                f"{voxel_mm} mm",
                points(exact),
                share_new(exact),
                moved(exact),
                times(exact),
                rate(find(rows, path, voxel_mm, "exact", True)),
                times(find(rows, path, voxel_mm, "paper", False)),
                printed,
            ]
            print("| " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main(sys.argv[1:])
