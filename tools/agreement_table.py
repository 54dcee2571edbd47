#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/evaluation.md, "Agreement of scans": recorded and simulated scans, right and with each kind of wrong
poses, given to `accessvdb advise`, which reads a few scans and says whether they agree.

    python3 tools/agreement_table.py --bin build/ci/bin --data DATA --out out/agreement

DATA has scans_poses_balm, kitti_00 and livox_mlcc; rows whose data are absent are left out by name."""
import argparse
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np


def quaternion(rotation):
    """x y z w of a rotation matrix: the eigenvector of Bar-Itzhack's matrix."""
    r = rotation
    k = np.array([[r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0], [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
                  [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
                  [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)]])
    _, vectors = np.linalg.eigh(k, UPLO="L")
    return vectors[:, -1]


def pose(translation, x, y, z, w):
    n = math.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / n, y / n, z / n, w / n
    t = np.eye(4)
    t[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    t[:3, 3] = translation
    return t


def turn(axis, degrees):
    a = math.radians(degrees)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    t = np.eye(4)
    t[i, i] = t[j, j] = math.cos(a)
    t[i, j], t[j, i] = -math.sin(a), math.sin(a)
    return t


def read_tum(path):
    rows = [line.split() for line in open(path) if line.strip() and not line.startswith("#")]
    return [(float(r[0]), pose([float(v) for v in r[1:4]], *map(float, r[4:8]))) for r in rows]


def write_tum(path, stamped, w_first=False):
    with open(path, "w") as out:
        for stamp, t in stamped:
            x, y, z, w = quaternion(t[:3, :3])
            q = (w, x, y, z) if w_first else (x, y, z, w)
            out.write(f"{stamp:.6f} " + " ".join(f"{v:.9f}" for v in (*t[:3, 3], *q)) + "\n")


def read_pcd(path):
    raw = open(path, "rb").read()
    end = raw.index(b"\n", raw.index(b"DATA")) + 1
    head = {line.split()[0]: line.split()[1:] for line in raw[:end].decode("latin1").split("\n")
            if line.strip() and not line.startswith("#")}
    kinds = {"F4": "<f4", "F8": "<f8", "U1": "u1", "U2": "<u2", "U4": "<u4", "I4": "<i4"}
    dtype = np.dtype([(name, kinds[t + s]) for name, t, s in zip(head["FIELDS"], head["TYPE"], head["SIZE"])])
    points = np.frombuffer(raw[end:end + dtype.itemsize * int(head["POINTS"][0])], dtype)
    return np.stack([points[c].astype(np.float64) for c in "xyz"], 1)


def write_pcd(path, points):
    head = ("# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH %d\nHEIGHT 1\n"
            "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS %d\nDATA binary\n" % (len(points), len(points)))
    open(path, "wb").write(head.encode() + np.ascontiguousarray(points, "<f4").tobytes())


def walk_poses():
    """Past two boxes and around two corners of a room, 10 Hz, 1 m/s, turning at 60 degrees a second."""
    stamped, x, y, yaw, stamp = [], -3.0, -2.0, 0.0, 0.0
    for straight, turned in ((5.0, 90), (3.5, 90), (5.0, 0)):
        for _ in range(int(straight * 10)):
            stamped.append((stamp, x, y, yaw))
            x, y, stamp = x + 0.1 * math.cos(yaw), y + 0.1 * math.sin(yaw), stamp + 0.1
        for _ in range(int(turned / 6)):
            stamped.append((stamp, x, y, yaw))
            yaw += math.radians(6)
            x, y, stamp = x + 0.05 * math.cos(yaw), y + 0.05 * math.sin(yaw), stamp + 0.1
    poses = []
    for stamp, x, y, yaw in stamped:
        t = turn("z", math.degrees(yaw))
        t[:3, 3] = (x, y, 1.2 + 0.05 * math.sin(3 * stamp))
        poses.append((stamp, t))
    return poses


def write_room(path):
    """An open room of 12 x 10 x 3 m with boxes, pillars and a bar, as OBJ."""
    boxes = [(-6, -5, -0.1, 6, 5, 0), (-6.1, -5, 0, -6, 5, 3), (6, -5, 0, 6.1, 5, 3), (-6, -5.1, 0, 6, -5, 3),
             (-6, 5, 0, 6, 5.1, 3), (-1, 0, 0, 0, 0.8, 1), (1.2, -0.6, 0, 1.8, 0.4, 1.9), (-4, 3.4, 0, -3.6, 3.8, 3),
             (4.5, -3, 0, 4.9, -2.6, 3), (-5, -4.5, 0.9, -2, -4.2, 1.1), (3, 3, 0, 5, 3.6, 0.7)]
    with open(path, "w") as out:
        for n, (x0, y0, z0, x1, y1, z1) in enumerate(boxes):
            for z in (z0, z1):
                for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)):
                    out.write(f"v {x} {y} {z}\n")
            for a, b, c, d in ((4, 3, 2, 1), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8)):
                out.write("f " + " ".join(str(8 * n + i) for i in (a, b, c)) + "\n")
                out.write("f " + " ".join(str(8 * n + i) for i in (a, c, d)) + "\n")


class Stream:
    """Scans, their names, and stamped poses of the sensor."""

    def __init__(self, scans, poses):
        self.scans, self.poses = scans, poses


def simulated(lab, out, *flags):
    if not (out / "poses.txt").exists():
        subprocess.run([lab, "simulate", "--out", out, "--quiet", *flags], check=True)
    scans = [read_pcd(p) for p in sorted((out / "scans").glob("*.pcd"))]
    return Stream(scans, read_tum(out / "poses.txt"))


def streams(lab, data, out):
    balm = data / "scans_poses_balm"
    if balm.exists():
        yield "BALM", Stream([read_pcd(balm / f"full{i}.pcd") for i in range(96, 108)], read_tum(balm / "poses_tum.txt"))
    mlcc = data / "livox_mlcc"
    if mlcc.exists():
        rows = [list(map(float, line.split())) for line in open(mlcc / "original_pose_2.json") if line.strip()]
        tx, ty, tz, w, x, y, z = rows[12]
        yield "MLCC (one scan)", Stream([read_pcd(mlcc / "lidar2_12.pcd")], [(12.0, pose((tx, ty, tz), x, y, z, w))])
    yield "orbit", simulated(lab, out / "orbit", "--scene", "pine", "--trajectory", "orbit", "--frames", "60",
                             "--range-noise", "0.02", "--tree-height", "6", "--radius", "5", "--height", "0.5")
    write_room(out / "room.obj")
    write_tum(out / "walk_poses.txt", walk_poses())
    yield "walk", simulated(lab, out / "walk", "--scene", str(out / "room.obj"), "--mesh-unit", "m", "--trajectory",
                            str(out / "walk_poses.txt"), "--range-noise", "0.02")


MOUNT = turn("z", 90) @ turn("y", 20)
MOUNT[:3, 3] = (0.1, 0.05, 0.15)


def extrinsic(t):
    """x,y,z,roll,pitch,yaw of a pose, R = Rz Ry Rx."""
    r = t[:3, :3]
    angles = (math.atan2(r[2, 1], r[2, 2]), -math.asin(r[2, 0]), math.atan2(r[1, 0], r[0, 0]))
    return ",".join(f"{v:.9g}" for v in (*t[:3, 3], *(math.degrees(a) for a in angles)))


def cases(stream):
    """Name, scans, poses, more flags, w first, names, words that the cure has."""
    scans, poses = stream.scans, stream.poses
    changed = lambda f: [(stamp, f(t)) for stamp, t in poses]
    padded = [f"{i:06d}" for i in range(len(scans))]
    yield "right", scans, poses, [], False, padded, None
    yield "right, jitter of 1 cm", scans, jittered(poses), [], False, padded, None
    yield "w first", scans, poses, [], True, padded, "quaternions are w x y z"
    yield "inverse poses", scans, changed(np.linalg.inv), [], False, padded, "poses are inverse"
    body = changed(lambda t: t @ np.linalg.inv(MOUNT))
    yield "right, extrinsic", scans, body, ["--extrinsic", extrinsic(MOUNT)], False, padded, None
    yield "inverse extrinsic", scans, body, ["--extrinsic", extrinsic(np.linalg.inv(MOUNT))], False, padded, \
        "--extrinsic is inverse"
    for axis in "xyz":
        for degrees in (90, 180):
            yield f"turned {degrees} about {axis}", scans, changed(lambda t: t @ turn(axis, degrees)), [], False, \
                padded, f"about its {axis} axis"
    yield "pitch 30", scans, changed(lambda t: t @ turn("y", 30)), [], False, padded, "about its y axis"
    yield "80 ms late", scans, poses, ["--time-offset", "0.08"], False, padded, "--time-offset"
    world = [points @ t[:3, :3].T + t[:3, 3] for points, (_, t) in zip(scans, poses)]
    yield "in the world already", world, poses, [], False, padded, "in the world frame already"
    yield "names not padded", scans, poses, [], False, [str(i) for i in range(len(scans))], "read right"


def jittered(poses):
    random = np.random.default_rng(3)
    moved = []
    for stamp, t in poses:
        t = t.copy()
        t[:3, 3] += random.normal(0, 0.01, 3)
        moved.append((stamp, t))
    return moved


def run(program, folder, scans, poses, flags, w_first, names):
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "scans").mkdir(parents=True)
    by_time = "--time-offset" in flags
    for points, name, (stamp, _) in zip(scans, names, poses):
        write_pcd(folder / "scans" / ((f"{stamp:.6f}" if by_time else name) + ".pcd"), points)
    write_tum(folder / "poses.txt", poses, w_first)
    done = subprocess.run([program, "advise", "--scans", folder / "scans", "--poses", folder / "poses.txt", "--out",
                           folder / "advice.toml", *flags], capture_output=True, text=True)
    return done.returncode, done.stderr


def outcome(code, text):
    ids = re.findall(r"(error|warning)\[((?:poses|scans|input)\.[a-z_.]+)\]", text)
    if code != 0:
        return "refused", ids
    return ("warned", ids) if ids else ("accepted", ids)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default="build/ci/bin", type=pathlib.Path, help="folder of accessvdb and accessvdb-lab")
    parser.add_argument("--data", default=os.environ.get("ACCESSVDB_TEST_DATA", "data"), type=pathlib.Path)
    parser.add_argument("--out", default="out/agreement", type=pathlib.Path)
    parser.add_argument("--only", help="rows whose name has this text")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows, titles, wrong = {}, [], 0
    for title, stream in streams(options.bin / "accessvdb-lab", options.data, options.out):
        titles.append(title)
        for name, scans, poses, flags, w_first, names, words in cases(stream):
            if options.only and options.only not in name:
                continue
            code, text = run(options.bin / "accessvdb", options.out / "case", scans, poses, flags, w_first, names)
            kind, ids = outcome(code, text)
            share = re.search(r"agreement of the scans: ([0-9.]+) %", text)
            cell = kind + ("" if not share else f", {share.group(1)} %")
            if words and words in text:
                cell += ", cure named"
            if name.startswith("right") != (kind == "accepted") and words != "read right":
                wrong += 1
                cell = "**" + cell + "**"
            rows.setdefault(name, {})[title] = cell
            print(f"{title:16s} {name:24s} {cell}  {' '.join(i for _, i in ids)}", file=sys.stderr)
    print("| scans | " + " | ".join(titles) + " |\n|---|" + "---|" * len(titles))
    for name, cells in rows.items():
        print(f"| {name} | " + " | ".join(cells.get(t, "-") for t in titles) + " |")
    print(f"\n{wrong} cells are not as they should be.")


if __name__ == "__main__":
    main()
