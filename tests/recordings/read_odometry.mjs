// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Prints the odometry of an MCAP file, as @mcap/core and @foxglove/rosmsg2-serialization read it.
//   node read_odometry.mjs NPM_FOLDER FILE.mcap TOPIC
import { spawnSync } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { resolve } from 'node:path';
import { definitionOf } from './message_definitions.mjs';

const [npm, file, topic] = process.argv.slice(2);
const require = createRequire(resolve(npm, 'package.json'));
const { McapStreamReader } = require('@mcap/core');
const { parse } = require('@foxglove/rosmsg');
const { MessageReader } = require('@foxglove/rosmsg2-serialization');

const zstd = (data) => spawnSync('zstd', ['-d', '-c'], { input: data, maxBuffer: 1 << 30 }).stdout;
const reader = new McapStreamReader({ decompressHandlers: { zstd } });
reader.append(readFileSync(file));
const messages = new MessageReader(parse(definitionOf('nav_msgs/Odometry'), { ros2: true }));
const channels = new Set();
for (let record; (record = reader.nextRecord()); ) {
  if (record.type === 'Channel' && record.topic === topic) channels.add(record.id);
  if (record.type !== 'Message' || !channels.has(record.channelId)) continue;
  const { header, child_frame_id, pose } = messages.readMessage(record.data);
  const { position: p, orientation: q } = pose.pose;
  const stamp_ns = BigInt(header.stamp.sec) * 1_000_000_000n + BigInt(header.stamp.nanosec ?? header.stamp.nsec);
  console.log(stamp_ns.toString(), header.frame_id, child_frame_id, p.x, p.y, p.z, q.x, q.y, q.z, q.w);
}
