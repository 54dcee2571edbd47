// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Scans and poses as `accessvdb-lab simulate` and the tests write them, and their messages.
import { existsSync, readFileSync, readdirSync } from 'node:fs';
import { join } from 'node:path';

const first_ns = 1_700_000_000_000_000_000n;

/// x y z of all points, and the column t where there is one.
function pointsOf(file) {
  const bytes = readFileSync(file);
  const mark = bytes.indexOf('DATA ');
  const begin = bytes.indexOf('\n', mark) + 1;
  const header = bytes.toString('latin1', 0, begin);
  const count = Number(/^POINTS (\d+)/m.exec(header)[1]);
  const size = /^SIZE ([\d ]+)/m.exec(header)[1].split(' ').reduce((sum, one) => sum + Number(one), 0);
  const points = new Float32Array(3 * count);
  const fields = /^FIELDS (.*)$/m.exec(header)[1].split(' ');
  const timed = fields.length === 4 && fields[3] === 't';
  const times = new Uint32Array(count);
  if (/^DATA binary$/m.test(header)) {
    for (let i = 0; i < count; ++i) {
      for (let axis = 0; axis < 3; ++axis) points[3 * i + axis] = bytes.readFloatLE(begin + i * size + 4 * axis);
      if (timed) times[i] = bytes.readUInt32LE(begin + i * size + 12);
    }
  } else {
    const words = bytes.toString('latin1', begin).trim().split(/\s+/);
    const columns = fields.length;
    for (let i = 0; i < count; ++i)
      for (let axis = 0; axis < 3; ++axis) points[3 * i + axis] = Number(words[i * columns + axis]);
  }
  return { points, times: timed ? times : null };
}

const numbersIn = (file) =>
  readFileSync(file, 'utf8')
    .split('\n')
    .filter((line) => line.trim() && !line.startsWith('#'))
    .map((line) => line.trim().split(/\s+/).map(Number));
const stampOf = (seconds) => first_ns + BigInt(Math.round(seconds * 1e9));

/// @return [{stamp_ns, t, q}] of every line of poses.txt, q is x y z w
export function readPoses(folder) {
  return numbersIn(join(folder, 'poses.txt')).map((row) => ({
    stamp_ns: stampOf(row[0]),
    t: row.slice(1, 4),
    q: row.slice(4, 8),
  }));
}

/// One scan for each pose, or for each line of times.txt where there are more poses.
/// @return [{stamp_ns, points, times, t, q}], times in ns since the stamp, or null
export function readScanFolder(folder) {
  const poses = readPoses(folder);
  const timesFile = join(folder, 'times.txt');
  const stamps = existsSync(timesFile) ? numbersIn(timesFile).map((row) => stampOf(row[0])) : null;
  const files = readdirSync(join(folder, 'scans')).filter((name) => name.endsWith('.pcd')).sort();
  return files.map((name, i) => ({
    ...(stamps ? poses.find((pose) => pose.stamp_ns === stamps[i]) : poses[i]),
    ...pointsOf(join(folder, 'scans', name)),
  }));
}

export const xyz = ([x, y, z]) => ({ x, y, z });
export const xyzw = ([x, y, z, w]) => ({ x, y, z, w });
export const headerOf = (stamp_ns, frame_id) => ({
  stamp: { sec: Number(stamp_ns / 1_000_000_000n), nanosec: Number(stamp_ns % 1_000_000_000n) },
  frame_id,
});

/// Layouts of PointCloud2: plain = x y z; padded = intensity z y x in 32 bytes; organised = two rows with a gap behind
/// each; double = float64. Times, as drivers name them: t = uint32 ns (Ouster), time = float32 s (Velodyne), timestamp =
/// float64 s of the clock (Hesai), timestamps = float64 ns of the clock (Livox), offset_time = int32 us.
const timeFields = {
  t: { datatype: 6, put: (data, at, ns) => data.writeUInt32LE(ns, at) },
  time: { datatype: 7, put: (data, at, ns) => data.writeFloatLE(ns * 1e-9, at) },
  timestamp: { datatype: 8, put: (data, at, ns, stamp_ns) => data.writeDoubleLE(Number(stamp_ns) * 1e-9 + ns * 1e-9, at) },
  timestamps: { datatype: 8, put: (data, at, ns, stamp_ns) => data.writeDoubleLE(Number(stamp_ns) + ns, at) },
  offset_time: { datatype: 5, put: (data, at, ns) => data.writeInt32LE(Math.round(ns * 1e-3), at) },
};

/// @param times  ns since the stamp, or null @param timeName  see timeFields
export function cloudMessage(stamp_ns, frame, points, layout = 'plain', times = null, timeName = 't') {
  const count = points.length / 3;
  const rows = layout === 'organised' && count % 2 === 0 ? 2 : 1;
  const wide = layout === 'double' ? 8 : 4;
  const offsets = layout === 'padded' ? { intensity: 0, z: 8, y: 16, x: 20 } : { x: 0, y: wide, z: 2 * wide };
  const bare_step = layout === 'padded' ? 32 : 3 * wide;
  const point_step = bare_step + (times ? 8 : 0);
  const row_step = (count / rows) * point_step + (layout === 'organised' ? 20 : 0);
  const data = Buffer.alloc(rows * row_step);
  for (let i = 0; i < count; ++i) {
    const row = Math.floor(i / (count / rows));
    const at = row * row_step + (i % (count / rows)) * point_step;
    ['x', 'y', 'z'].forEach((name, axis) => {
      if (wide === 8) data.writeDoubleLE(points[3 * i + axis], at + offsets[name]);
      else data.writeFloatLE(points[3 * i + axis], at + offsets[name]);
    });
    if (times) timeFields[timeName].put(data, at + bare_step, times[i], stamp_ns);
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
    })).concat(times ? [{ name: timeName, offset: bare_step, datatype: timeFields[timeName].datatype, count: 1 }] : []),
    is_bigendian: layout === 'big',
    point_step,
    row_step,
    data: layout === 'short' ? data.subarray(0, data.length - 1) : data,
    is_dense: true,
  };
}

export function livoxMessage(stamp_ns, frame, points, times = null) {
  const list = [];
  for (let i = 0; i < points.length; i += 3)
    list.push({
      offset_time: times ? times[i / 3] : 0,
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
