#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""A survey of any size from a few scans: the same scans again at the places of a grid, as links, with shifted poses.

    accessvdb-lab simulate --scene pine --frames 60 --out tree/
    tools/repeat_scans.py tree/ survey/ --copies 1100 --spacing 8
    accessvdb map --scans survey/scans --poses survey/poses.txt --tool builtin:pruner --voxel 0.05 --max-memory 4G --out out/

Reads FROM/scans and FROM/poses.txt (TUM: t x y z qx qy qz qw, sensor to world, metres). One copy after the other, row
by row, so that the stamps rise along the survey.
"""
import argparse
import math
import os
import pathlib
import sys


def read_poses(path: pathlib.Path) -> list[list[str]]:
    poses = [line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]
    if not poses or any(len(pose) != 8 for pose in poses):
        sys.exit(f"repeat_scans: {path} is not a TUM pose file")
    return poses


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=pathlib.Path, metavar="FROM", help="folder with scans/ and poses.txt")
    parser.add_argument("target", type=pathlib.Path, metavar="TO", help="new folder")
    parser.add_argument("--copies", type=int, required=True)
    parser.add_argument("--spacing", type=float, required=True, help="metres between copies")
    parser.add_argument("--line", action="store_true", help="along x instead of on a square grid")
    given = parser.parse_args()

    poses = read_poses(given.source / "poses.txt")
    scans = sorted((given.source / "scans").iterdir())
    if len(scans) != len(poses):
        sys.exit(f"repeat_scans: {len(scans)} scans but {len(poses)} poses")
    (given.target / "scans").mkdir(parents=True)
    columns = given.copies if given.line else math.ceil(math.sqrt(given.copies))
    total_bytes = 0
    with open(given.target / "poses.txt", "w", encoding="ascii") as out:
        for copy in range(given.copies):
            shift = (given.spacing * (copy % columns), given.spacing * (copy // columns))
            for number, (scan, pose) in enumerate(zip(scans, poses)):
                stamp = f"{(copy * len(scans) + number) / 10:.6f}"
                os.link(scan, given.target / "scans" / f"{stamp.zfill(16)}{scan.suffix}")
                total_bytes += scan.stat().st_size
                x, y = (float(pose[1 + axis]) + shift[axis] for axis in range(2))
                out.write(" ".join([stamp, repr(x), repr(y), *pose[3:]]) + "\n")
    print(f"{given.copies * len(scans)} scans, {total_bytes / 1e9:.1f} GB")


if __name__ == "__main__":
    main()
