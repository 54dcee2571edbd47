// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Scans and poses as `accessvdb simulate` and the tests write them, and their messages.
import { readFileSync, readdirSync } from 'node:fs';
import { join } from 'node:path';

const first_ns = 1_700_000_000_000_000_000n;

function pointsOf(file) {
  const bytes = readFileSync(file);
  const mark = bytes.indexOf('DATA ');
  const begin = bytes.indexOf('\n', mark) + 1;
  const header = bytes.toString('latin1', 0, begin);
  const count = Number(/^POINTS (\d+)/m.exec(header)[1]);
  const size = /^SIZE ([\d ]+)/m.exec(header)[1].split(' ').reduce((sum, one) => sum + Number(one), 0);
  const points = new Float32Array(3 * count);
  if (/^DATA binary$/m.test(header)) {
    for (let i = 0; i < count; ++i)
      for (let axis = 0; axis < 3; ++axis) points[3 * i + axis] = bytes.readFloatLE(begin + i * size + 4 * axis);
  } else {
    const words = bytes.toString('latin1', begin).trim().split(/\s+/);
    const columns = /^FIELDS (.*)$/m.exec(header)[1].split(' ').length;
    for (let i = 0; i < count; ++i)
      for (let axis = 0; axis < 3; ++axis) points[3 * i + axis] = Number(words[i * columns + axis]);
  }
  return points;
}

/// @return [{stamp_ns, points, t, q}], q is x y z w
export function readScanFolder(folder) {
  const poses = readFileSync(join(folder, 'poses.txt'), 'utf8')
    .split('\n')
    .filter((line) => line.trim() && !line.startsWith('#'))
    .map((line) => line.trim().split(/\s+/).map(Number));
  const files = readdirSync(join(folder, 'scans')).filter((name) => name.endsWith('.pcd')).sort();
  return files.map((name, i) => ({
    stamp_ns: first_ns + BigInt(Math.round(poses[i][0] * 1e9)),
    points: pointsOf(join(folder, 'scans', name)),
    t: poses[i].slice(1, 4),
    q: poses[i].slice(4, 8),
  }));
}

export const xyz = ([x, y, z]) => ({ x, y, z });
export const xyzw = ([x, y, z, w]) => ({ x, y, z, w });
export const headerOf = (stamp_ns, frame_id) => ({
  stamp: { sec: Number(stamp_ns / 1_000_000_000n), nanosec: Number(stamp_ns % 1_000_000_000n) },
  frame_id,
});

/// Layouts of PointCloud2: plain = x y z; padded = intensity z y x in 32 bytes; organised = two rows with a gap behind
/// each; double = float64.
export function cloudMessage(stamp_ns, frame, points, layout = 'plain') {
  const count = points.length / 3;
  const rows = layout === 'organised' && count % 2 === 0 ? 2 : 1;
  const wide = layout === 'double' ? 8 : 4;
  const offsets = layout === 'padded' ? { intensity: 0, z: 8, y: 16, x: 20 } : { x: 0, y: wide, z: 2 * wide };
  const point_step = layout === 'padded' ? 32 : 3 * wide;
  const row_step = (count / rows) * point_step + (layout === 'organised' ? 20 : 0);
  const data = Buffer.alloc(rows * row_step);
  for (let i = 0; i < count; ++i) {
    const row = Math.floor(i / (count / rows));
    const at = row * row_step + (i % (count / rows)) * point_step;
    ['x', 'y', 'z'].forEach((name, axis) => {
      if (wide === 8) data.writeDoubleLE(points[3 * i + axis], at + offsets[name]);
      else data.writeFloatLE(points[3 * i + axis], at + offsets[name]);
    });
  }
  return {
    header: headerOf(stamp_ns, frame),
    height: rows,
    width: count / rows,
    fields: Object.entries(offsets).map(([name, offset]) => ({
      name,
      offset,
      datatype: wide === 8 ? 8 : 7,
      count: 1,
    })),
    is_bigendian: layout === 'big',
    point_step,
    row_step,
    data: layout === 'short' ? data.subarray(0, data.length - 1) : data,
    is_dense: true,
  };
}

export function livoxMessage(stamp_ns, frame, points) {
  const list = [];
  for (let i = 0; i < points.length; i += 3)
    list.push({
      offset_time: 1000 * i,
      x: points[i],
      y: points[i + 1],
      z: points[i + 2],
      reflectivity: i % 256,
      tag: 16,
      line: i % 4,
    });
  return {
    header: headerOf(stamp_ns, frame),
    timebase: stamp_ns,
    point_num: list.length,
    lidar_id: 1,
    rsvd: [0, 0, 0],
    points: list,
  };
}
