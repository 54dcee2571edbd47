#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Makes the corpus of fuzz_readers: small right files of every kind that is read, OUT/READER/SET/..., with TARGETS in each
set naming the files that are changed.

    python3 tests/campaign/corpus.py --bin build/ci/bin --out corpus

Recordings need node and python3-rosbag (tools/setup_debian.sh --tests) and are left out by name without them."""
import argparse
import math
import pathlib
import random
import shutil
import struct
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
RANDOM = random.Random(7)


def scene(count):
    """Points of a wall, a floor and a post, and where the sensor was."""
    points = []
    for i in range(count):
        a, b = RANDOM.uniform(-1.5, 1.5), RANDOM.uniform(0, 2)
        points.append(((3, a, b), (3 * b / 2, a, 0), (2.2 + 0.1 * math.cos(a), 0.3 + 0.1 * math.sin(a), b))[i % 3])
    return points


def target(folder, *names):
    with open(folder / "TARGETS", "a") as out:
        out.writelines(f"{name}\n" for name in names)


def put(out, reader, name, content, set_name=None):
    folder = out / reader / (set_name or name.replace("/", "_"))
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    target(folder, name)
    return folder


def pcd(points, kind="binary", fields="x y z", sizes="4 4 4", types="F F F", counts="1 1 1", width=None):
    n = len(points)
    head = (f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\nCOUNT {counts}\nWIDTH {n}\nHEIGHT 1\n"
            f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {kind}\n").encode()
    if kind == "ascii":
        return head + "".join("%.4f %.4f %.4f\n" % p for p in points).encode()
    if kind == "binary":
        return head + b"".join(struct.pack("<3f", *p) for p in points)
    raw = b"".join(struct.pack(f"<{n}f", *(p[axis] for p in points)) for axis in range(3))
    packed = b"".join(bytes([len(raw[i:i + 32]) - 1]) + raw[i:i + 32] for i in range(0, len(raw), 32))  # LZF, literals
    return head + struct.pack("<II", len(packed), len(raw)) + packed


def ply(points, kind, properties, rows):
    head = f"ply\nformat {kind} 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property {t} {n}\n" for t, n in properties) + "end_header\n"
    if kind == "ascii":
        return (head + "".join(" ".join(str(v) for v in row) + "\n" for row in rows)).encode()
    codes = {"float": "f", "double": "d", "uchar": "B", "int": "i"}
    order = "<" if "little" in kind else ">"
    return head.encode() + b"".join(struct.pack(order + "".join(codes[t] for t, _ in properties), *row) for row in rows)


def las(points, minor=2, form=1, records=b"", count=0):
    header = 375 if minor == 4 else 227
    extra = {1: 28, 6: 30}[form]
    out = bytearray(header)
    out[0:4] = b"LASF"
    out[24:26] = bytes([1, minor])
    struct.pack_into("<HII", out, 94, header, header + len(records), count)
    struct.pack_into("<BHI", out, 104, form, extra, len(points))
    struct.pack_into("<3d3d", out, 131, 1e-3, 1e-3, 1e-3, 0, 0, 0)
    for axis in range(3):
        values = [p[axis] for p in points]
        struct.pack_into("<2d", out, 179 + 16 * axis, max(values), min(values))
    if minor == 4:
        struct.pack_into("<Q", out, 247, len(points))
    body = b""
    for i, p in enumerate(points):
        record = bytearray(extra)
        struct.pack_into("<3i", record, 0, *(round(v * 1000) for v in p))
        record[14] = 1
        record[15 if form == 1 else 16] = 2
        struct.pack_into("<d", record, 20 if form == 1 else 22, 1000 + 0.01 * i)
        body += bytes(record)
    return bytes(out) + records + body


def geo_keys():
    keys = struct.pack("<12H", 1, 1, 0, 2, 1024, 0, 1, 1, 3076, 0, 1, 9001)
    return struct.pack("<H16sHH32s", 0, b"LASF_Projection", 34735, len(keys), b"keys") + keys


def wkt():
    text = b'PROJCS["x",GEOGCS["y",UNIT["degree",0.0174532925199433]],UNIT["metre",1]]\0'
    return struct.pack("<H16sHH32s", 0, b"LASF_Projection", 2112, len(text), b"wkt") + text


def quaternion(yaw):
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def scans_folder(folder, names, points=60):
    for name in names:
        path = folder / "scans" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(pcd(scene(points)))


def poses(out):
    stamps = [1700000000 + 0.1 * i for i in range(6)]
    places = [(0.1 * i, -0.2 * i, 1.0) for i in range(6)]
    rows = [(t, p, quaternion(0.1 * i)) for i, (t, p) in enumerate(zip(stamps, places))]

    def add(name, text, scan_names):
        folder = put(out, "poses", "poses.txt", text, name)
        scans_folder(folder, scan_names)

    stamped = [f"{t:.6f}.pcd" for t in stamps]
    numbered = [f"{i:06d}.pcd" for i in range(6)]
    add("tum", "".join(f"{t:.6f} " + " ".join("%.6f" % v for v in (*p, *q)) + "\n" for t, p, q in rows), stamped)
    add("euroc", "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []\n" + "".join(
        f"{round(t * 1e9)}," + ",".join("%.6f" % v for v in (*p, q[3], *q[:3])) + "\n" for t, p, q in rows), stamped)
    matrix = lambda p, yaw: [[math.cos(yaw), -math.sin(yaw), 0, p[0]], [math.sin(yaw), math.cos(yaw), 0, p[1]], [0, 0, 1, p[2]]]
    lines = [matrix(p, 0.1 * i) for i, p in enumerate(places)]
    flat = lambda rows_: " ".join("%.6f" % v for row in rows_ for v in row)
    add("kitti", "".join(flat(m) + "\n" for m in lines), numbered)
    add("kitti16", "".join(flat(m) + " 0 0 0 1\n" for m in lines), numbered)
    add("hba", "".join(" ".join("%.6f" % v for v in (*p, q[3], *q[:3])) + "\n" for _, p, q in rows), numbered)
    add("balm", "".join("\n".join(",".join("%.6f" % v for v in row) + "," for row in m) + f"\n0,0,0,{t:.6f},\n"
                        for m, (t, _, _) in zip(lines, rows)), numbered)


def meshes(out):
    corners = [(x, y, z) for x in (0, 0.4) for y in (-0.05, 0.05) for z in (-0.05, 0.05)]
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
             (1, 5, 7), (1, 7, 3)]
    put(out, "mesh", "binary.stl", b"x" * 80 + struct.pack("<I", 12) + b"".join(
        struct.pack("<12fH", 0, 0, 0, *corners[a], *corners[b], *corners[c], 0) for a, b, c in faces))
    put(out, "mesh", "ascii.stl", "solid box\n" + "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join("vertex %g %g %g\n" % corners[i] for i in f) + "endloop\nendfacet\n"
        for f in faces) + "endsolid box\n")
    put(out, "mesh", "box.obj", "".join("v %g %g %g\n" % c for c in corners) + "".join(
        "f %d %d %d\n" % tuple(i + 1 for i in f) for f in faces))
    put(out, "mesh", "box.off", "OFF\n8 12 0\n" + "".join("%g %g %g\n" % c for c in corners) + "".join(
        "3 %d %d %d\n" % f for f in faces))
    put(out, "mesh", "box.ply", "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 12\nproperty list uchar int vertex_indices\nend_header\n" + "".join("%g %g %g\n" % c for c in corners) +
        "".join("3 %d %d %d\n" % f for f in faces))
    data = b"".join(struct.pack("<3f", *c) for c in corners) + b"".join(struct.pack("<3H", *f) for f in faces)
    document = ('{"asset":{"version":"2.0"},"buffers":[{"byteLength":%d}],"bufferViews":[{"buffer":0,"byteOffset":0,'
                '"byteLength":96},{"buffer":0,"byteOffset":96,"byteLength":72}],"accessors":[{"bufferView":0,"componentType":'
                '5126,"count":8,"type":"VEC3","min":[0,-0.05,-0.05],"max":[0.4,0.05,0.05]},{"bufferView":1,"componentType":5123,'
                '"count":36,"type":"SCALAR"}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],'
                '"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}],"scene":0}' % len(data)).encode()
    document += b" " * (-len(document) % 4)
    put(out, "mesh", "box.glb", struct.pack("<4sII", b"glTF", 2, 28 + len(document) + len(data)) +
        struct.pack("<I4s", len(document), b"JSON") + document + struct.pack("<I4s", len(data), b"BIN\0") + data)
    put(out, "mesh", "box.dae", '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version='
        '"1.4.1"><asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="b"><mesh><source '
        'id="p"><float_array id="a" count="24">' + " ".join("%g" % v for c in corners for v in c) + '</float_array>'
        '<technique_common><accessor source="#a" count="8" stride="3"><param name="X" type="float"/><param name="Y" type='
        '"float"/><param name="Z" type="float"/></accessor></technique_common></source><vertices id="v"><input semantic='
        '"POSITION" source="#p"/></vertices><triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>' +
        " ".join(str(i) for f in faces for i in f) + '</p></triangles></mesh></geometry></library_geometries>'
        '<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#b"/></node></visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>')


def clouds(out):
    points = scene(120)
    put(out, "pcd", "ascii.pcd", pcd(points, "ascii"))
    put(out, "pcd", "binary.pcd", pcd(points))
    put(out, "pcd", "compressed.pcd", pcd(points, "binary_compressed"))
    xyz = [("float", "x"), ("float", "y"), ("float", "z")]
    put(out, "ply", "ascii.ply", ply(points, "ascii", xyz, points))
    put(out, "ply", "little.ply", ply(points, "binary_little_endian", xyz + [("uchar", "intensity")],
                                      [(*p, 9) for p in points]))
    put(out, "ply", "big.ply", ply(points, "binary_big_endian", [("double", n) for _, n in xyz], points))
    rays = [(*p, 0 - p[0], 0 - p[1], 1 - p[2]) for p in points]
    put(out, "rays", "rays.ply", ply(points, "binary_little_endian", xyz + [("float", n) for n in ("nx", "ny", "nz")], rays))
    put(out, "las", "old.las", las(points))
    put(out, "las", "new.las", las(points, 4, 6, geo_keys(), 1))
    put(out, "las", "wkt.las", las(points, 4, 6, wkt(), 1))
    put(out, "xyz", "plain.xyz", "".join("%.4f %.4f %.4f\n" % p for p in points))
    put(out, "xyz", "table.xyz", "X,Y,Z,Intensity\n" + "".join("%.4f,%.4f,%.4f,7\n" % p for p in points))
    put(out, "bin", "scan.bin", b"".join(struct.pack("<4f", *p, 0.5) for p in points))
    put(out, "ptx", "two.ptx", "".join(
        f"6\n5\n{k} 0 1\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{k} 0 1 1\n" +
        "".join("%.4f %.4f %.4f 0.5\n" % (p[0] - k, p[1], p[2] - 1) for p in points[30 * k:30 * k + 30]) for k in range(2)))


def tables(out):
    points = scene(80)
    folder = put(out, "trajectory", "walk.txt", "".join("%.4f %.4f %.4f 1\n" % (999 + 0.1 * i, 0.05 * i, -0.1 * i)
                                                        for i in range(40)), "walk")
    (folder / "scans.las").write_bytes(las(points))
    folder = put(out, "trajectory", "named.txt", "time,x,y,z,roll\n" + "".join(
        "%.4f,%.4f,%.4f,1,0\n" % (999 + 0.1 * i, 0.05 * i, -0.1 * i) for i in range(40)), "named")
    (folder / "scans.las").write_bytes(las(points))
    folder = put(out, "stations", "stations.txt", "a.xyz 0 0 1\nb.xyz 1 0 1\n", "two")
    (folder / "scans").mkdir()
    for name in "ab":
        (folder / "scans" / f"{name}.xyz").write_text("".join("%.4f %.4f %.4f\n" % p for p in points))
    put(out, "orientations", "list.txt", "yaw pitch roll\n" + "".join("%d %d 0\n" % (30 * a, 5 * a - 30) for a in range(12)))
    put(out, "boxes", "boxes.txt", "# name and corners\npost 2 0 0 2.5 0.5 2\nwall 2.9,-2,0,3.1,2,2\n")
    put(out, "toml", "map.toml", '# how to map\n[map]\nvoxel = 0.2\ntau = "2v"\ndirections = 8\nrange-noise = 0.02\nchange = "block"\n'
        'device = "cpu"\n')
    put(out, "positions", "at.txt", "3 0 1\n2.2,0.4,1\n# a comment\n0 0 0\n")
    put(out, "segments", "labelled.ply", ply(points, "binary_little_endian", [("float", "x"), ("float", "y"), ("float", "z"),
        ("int", "segment")], [(*p, i % 3) for i, p in enumerate(points)]))
    put(out, "segments", "text.ply", ply(points, "ascii", [("float", "x"), ("float", "y"), ("float", "z"), ("int", "tree_id")],
                                         [(*p, i % 3) for i, p in enumerate(points)]))


def results(out, program):
    """A field, a state, a folder in tiles, a report: what the program itself wrote."""
    work = out / "work"
    scans_folder(work, [f"{i:06d}.pcd" for i in range(4)], 400)
    (work / "poses.txt").write_text("".join("1 0 0 %g 0 1 0 0 0 0 1 1\n" % (0.05 * i) for i in range(4)))
    common = [program, "map", "--scans", work / "scans", "--poses", work / "poses.txt", "--tool", "builtin:pruner", "--device",
              "cpu", "--quiet", "--directions", "8", "--tau", "2v", "--allow-disagreement"]
    field, state, tiles = out / "field" / "whole", out / "state" / "state", out / "tiles" / "tiles"
    subprocess.run([*common, "--voxel", "0.2", "--out", field, "--checkpoint", work / "state"], check=True)
    target(field, "field.vdb", "field_points.vdb", "points.ply")
    shutil.copytree(field, out / "report" / "whole")
    (out / "report" / "whole" / "TARGETS").write_text("report.json\npoints.ply\n")
    state.mkdir(parents=True)
    for path in (work / "state").iterdir():
        shutil.copy(path, state)
        if path.suffix == ".avst":
            target(state, path.name)
    subprocess.run([*common, "--voxel", "0.2", "--tiles", "25.6", "--keep-rays", "--out", tiles], check=True)
    target(tiles, *(str(p.relative_to(tiles)) for p in sorted(tiles.rglob("*"))
                    if p.is_file() and p.suffix != ".png" and p.name != "TARGETS"))
    shutil.rmtree(work)


def recordings(out, scans_poses):
    here = HERE.parent / "recordings"
    npm = HERE.parent.parent / "build" / "npm"
    made = []
    for name, options in (("a.mcap", "chunk=0"), ("b.mcap", "compression=zstd chunk=700"),
                          ("c.mcap", "compression=lz4 clouds=livox index=no poses=tf"), ("a.db3", "poses=tf"), ("a.bag", ""),
                          ("b.bag", "compression=lz4 chunk=700 clouds=livox"), ("c.bag", "compression=bz2 poses=tf")):
        folder = out / "recording" / name.replace(".", "_")
        folder.mkdir(parents=True)
        writer = ["/usr/bin/python3", here / "write_ros1.py"] if name.endswith("bag") else ["node", here / "write_ros2.mjs", npm]
        command = [*map(str, writer), str(scans_poses), str(folder / name), *options.split()]
        if shutil.which(command[0]) is None or subprocess.run(command, capture_output=True).returncode != 0:
            shutil.rmtree(folder)
            print(f"corpus: left out {name}: its writer is missing", file=sys.stderr)
            continue
        target(folder, name)
        made.append(name)
    return made


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default="build/ci/bin", type=pathlib.Path)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    options = parser.parse_args()
    if options.out.exists():
        shutil.rmtree(options.out)
    options.out.mkdir(parents=True)
    clouds(options.out)
    poses(options.out)
    meshes(options.out)
    tables(options.out)
    results(options.out, options.bin.resolve() / "accessvdb")
    flight = options.out / "flight"
    scans_folder(flight, [f"{1700000000 + 0.1 * i:.6f}.pcd" for i in range(4)], 30)
    (flight / "poses.txt").write_text("".join(f"{1700000000 + 0.1 * i:.6f} 0 {0.1 * i} 1 0 0 0 1\n" for i in range(4)))
    recordings(options.out, flight)
    shutil.rmtree(flight)


if __name__ == "__main__":
    main()
