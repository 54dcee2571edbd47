// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Writes a recording of ROS 2 from a folder of scans and poses, with the npm packages @mcap/core and
// @foxglove/rosmsg2-serialization, and the programs zstd, lz4 and sqlite3: none of them shares code with the project.
//   node write_ros2.mjs NPM_FOLDER SCANS OUT.mcap|OUT.db3 [name=value ...]
// clouds: sensor | world | livox | none      layout: see scan_folder.mjs      poses: odometry | pose | tf | none | late | second | jump | back
// compression: none | zstd | zstd-stream | lz4 | other      chunk: bytes, 0 = no chunks      index: yes | no
// times: names the field of the points' times, where scans have a column t (scan_folder.mjs)
// imu: x,y,z of what an IMU at rest feels in the first second, in the frame of the poses   imu_frame: its frame
// second: adds another topic with clouds of that name         frame: of the clouds
import { spawnSync } from 'node:child_process';
import { writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { resolve } from 'node:path';
import { definitionOf } from './message_definitions.mjs';
import { cloudMessage, headerOf, livoxMessage, readPoses, readScanFolder, xyz, xyzw } from './scan_folder.mjs';

const [npm, folder, out, ...rest] = process.argv.slice(2);
const wanted = Object.fromEntries(rest.map((word) => word.split(/=(.*)/s).slice(0, 2)));
const require = createRequire(resolve(npm, 'package.json'));
const { parse } = require('@foxglove/rosmsg');
const { MessageWriter } = require('@foxglove/rosmsg2-serialization');

const livox = wanted.clouds === 'livox';
const world = wanted.clouds === 'world';
const cloudType = livox ? 'livox_ros_driver2/CustomMsg' : 'sensor_msgs/PointCloud2';
const cloudTopic = world ? '/cloud_registered' : livox ? '/livox/lidar' : '/points';
const frame = wanted.frame ?? (world ? 'camera_init' : 'body');
const poses = wanted.poses ?? 'odometry';
const poseTopics = { pose: ['/pose', 'geometry_msgs/PoseStamped'], tf: ['/tf', 'tf2_msgs/TFMessage'], none: null };
const poseTopic = poses in poseTopics ? poseTopics[poses] : ['/Odometry', 'nav_msgs/Odometry'];

const topics = [];
const messages = []; // {topic, stamp_ns, bytes}
const writers = new Map();
function topicOf(name, type) {
  let id = topics.findIndex((topic) => topic.name === name);
  if (id < 0) id = topics.push({ name, type }) - 1;
  return id;
}
function add(name, type, stamp_ns, message) {
  if (!writers.has(type)) writers.set(type, new MessageWriter(parse(definitionOf(type), { ros2: true })));
  messages.push({ topic: topicOf(name, type), stamp_ns, bytes: writers.get(type).writeMessage(message) });
}

/// p_W = R(q) p + t, in double, as float32.
function toWorld(scan) {
  const [x, y, z, w] = scan.q;
  const points = new Float32Array(scan.points.length);
  for (let i = 0; i < points.length; i += 3) {
    const p = scan.points.slice(i, i + 3);
    if (p.every((value) => value === 0)) p.fill(NaN); // no return: nowhere in the world
    const u = [y * p[2] - z * p[1] + w * p[0], z * p[0] - x * p[2] + w * p[1], x * p[1] - y * p[0] + w * p[2]];
    const r = [y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0]];
    for (let axis = 0; axis < 3; ++axis) points[i + axis] = p[axis] + 2 * r[axis] + scan.t[axis];
  }
  return points;
}

const scans = readScanFolder(folder);
// More poses than scans: odometry that is faster than the scanner.
const allPoses = readPoses(folder);
const dense = poses === 'odometry' && allPoses.length > scans.length;
if (dense)
  for (const { stamp_ns, t, q } of allPoses)
    add(...poseTopic, stamp_ns, {
      header: headerOf(stamp_ns, 'camera_init'),
      child_frame_id: 'body',
      pose: { pose: { position: xyz(t), orientation: xyzw(q) }, covariance: new Float64Array(36) },
      twist: { twist: { linear: xyz([0, 0, 0]), angular: xyz([0, 0, 0]) }, covariance: new Float64Array(36) },
    });
if (wanted.imu)
  for (let i = 0; i < 200; ++i) {
    const stamp_ns = scans[0].stamp_ns + BigInt(i) * 5_000_000n;
    const noise = 0.05 * Math.sin(i);
    const [x, y, z] = wanted.imu.split(',').map(Number);
    add('/imu', 'sensor_msgs/Imu', stamp_ns, {
      header: headerOf(stamp_ns, wanted.imu_frame ?? 'imu_link'),
      orientation: xyzw([0, 0, 0, 1]),
      orientation_covariance: new Float64Array(9),
      angular_velocity: xyz([0, 0, 0]),
      angular_velocity_covariance: new Float64Array(9),
      linear_acceleration: xyz([x + noise, y - noise, z]),
      linear_acceleration_covariance: new Float64Array(9),
    });
  }
add('/chatter', 'std_msgs/String', scans[0].stamp_ns, { data: 'hello' });
scans.forEach((scan, i) => {
  const points = world ? toWorld(scan) : scan.points;
  const cloud = livox
    ? livoxMessage(scan.stamp_ns, frame, points, scan.times)
    : cloudMessage(scan.stamp_ns, frame, points, wanted.layout, scan.times, wanted.times);
  const t = poses === 'jump' && i >= scans.length / 2 ? [scan.t[0] + 100, scan.t[1], scan.t[2]] : scan.t;
  const pose = { position: xyz(t), orientation: xyzw(scan.q) };
  const stamp_ns = poses === 'back' && i === 2 ? scan.stamp_ns - 300_000_000n : scan.stamp_ns;
  const header = headerOf(stamp_ns, 'camera_init');
  const covariance = new Float64Array(36);
  if (poses === 'tf')
    add(...poseTopic, scan.stamp_ns, {
      transforms: [{ header, child_frame_id: 'base', transform: { translation: xyz(t), rotation: xyzw(scan.q) } }],
    });
  else if (poses === 'pose') add(...poseTopic, scan.stamp_ns, { header, pose });
  else if (poseTopic && !dense && !(poses === 'late' && i < 2) && !(poses === 'second' && i % 2 === 1))
    add(...poseTopic, scan.stamp_ns, {
      header,
      child_frame_id: 'body',
      pose: { pose, covariance },
      twist: { twist: { linear: xyz([0, 0, 0]), angular: xyz([0, 0, 0]) }, covariance },
    });
  if (poses === 'tf' && i === 0)
    add('/tf_static', 'tf2_msgs/TFMessage', scan.stamp_ns, {
      transforms: [
        {
          header: headerOf(scan.stamp_ns, 'base'),
          child_frame_id: 'body',
          transform: { translation: xyz([0, 0, 0]), rotation: xyzw([0, 0, 0, 1]) },
        },
      ],
    });
  if (wanted.clouds === 'none') return;
  add(cloudTopic, cloudType, scan.stamp_ns, cloud);
  if (wanted.second) add(wanted.second, cloudType, scan.stamp_ns, cloud);
});

function filtered(program, args, input) {
  const run = spawnSync(program, args, { input, maxBuffer: 1 << 30 });
  if (run.status !== 0) throw new Error(`${program}: ${run.error ?? run.stderr}`);
  return run.stdout;
}
/// zstd on a file knows how much there is, from a pipe it does not.
const compressors = {
  zstd: (data) => filtered('zstd', ['-1', '-c', '--no-check', `--stream-size=${data.length}`], data),
  'zstd-stream': (data) => filtered('zstd', ['-1', '-c', '--no-check'], data),
  lz4: (data) => filtered('lz4', ['-c', '-'], data),
  other: (data) => data,
};

async function writeMcap() {
  const { McapWriter } = require('@mcap/core');
  const parts = [];
  let position = 0n;
  const writable = {
    write: async (bytes) => {
      parts.push(Buffer.from(bytes));
      position += BigInt(bytes.length);
    },
    position: () => position,
  };
  const chunk = Number(wanted.chunk ?? 100_000);
  const index = wanted.index !== 'no';
  const compress = compressors[wanted.compression ?? 'zstd'];
  const writer = new McapWriter({
    writable,
    useChunks: chunk > 0,
    chunkSize: chunk,
    useStatistics: index,
    useSummaryOffsets: index,
    useMessageIndex: index,
    useChunkIndex: index,
    repeatSchemas: index,
    repeatChannels: index,
    compressChunk: compress
      ? (data) => ({
          compression: (wanted.compression ?? 'zstd').replace('-stream', ''),
          compressedData: compress(Buffer.from(data)),
        })
      : undefined,
  });
  await writer.start({ profile: 'ros2', library: 'test' });
  for (const topic of topics) {
    const schemaId = await writer.registerSchema({
      name: topic.type.replace('/', '/msg/'),
      encoding: 'ros2msg',
      data: Buffer.from(definitionOf(topic.type)),
    });
    topic.channel = await writer.registerChannel({
      schemaId,
      topic: topic.name,
      messageEncoding: wanted.encoding ?? 'cdr',
      metadata: new Map(),
    });
  }
  let sequence = 0;
  for (const { topic, stamp_ns, bytes } of messages)
    await writer.addMessage({
      channelId: topics[topic].channel,
      sequence: sequence++,
      logTime: stamp_ns,
      publishTime: stamp_ns,
      data: bytes,
    });
  await writer.end();
  writeFileSync(out, Buffer.concat(parts));
}

/// The tables of rosbag2_storage_sqlite3.
function writeDb3() {
  const text = (value) => `'${value.replaceAll("'", "''")}'`;
  const sql = [
    'CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,' +
      'serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL);',
    'CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, ' +
      'data BLOB NOT NULL);',
    'CREATE INDEX timestamp_idx ON messages (timestamp ASC);',
    'BEGIN;',
    ...topics.map(({ name, type }, id) => {
      const values = [id + 1, text(name), text(type.replace('/', '/msg/')), "'cdr'", "''"];
      return `INSERT INTO topics VALUES(${values});`;
    }),
    ...messages.map(({ topic, stamp_ns, bytes }) => {
      const blob = `X'${Buffer.from(bytes).toString('hex')}'`;
      return `INSERT INTO messages(topic_id,timestamp,data) VALUES(${[topic + 1, stamp_ns, blob]});`;
    }),
    'COMMIT;',
  ];
  filtered('sqlite3', [out], sql.join('\n'));
}

if (out.endsWith('.db3')) writeDb3();
else await writeMcap();
