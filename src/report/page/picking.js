// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Which point is under the cursor, and which points are inside the tool.

// The nearest of the discs that cover the place; beside all of them, the disc that is nearest on the screen, up to a few
// pixels away. @return index, or -1
function pointAt(points, camera, painter, hidden, x_px, y_px) {
  const BESIDE_PX = 6;
  const m = camera.toClip(), {positions, looks, count} = points;
  const half_width = camera.width / 2, half_height = camera.height / 2;
  const disc_px_m = painter.disc_m() * camera.focal_px();
  const {near} = camera.depths();
  let found = -1, found_w = Infinity, beside = -1, beside_px = BESIDE_PX;
  for (let index = 0, k = 0; index < count; ++index, k += 3) {
    if (hidden >> (looks[4 * index] >> 2) & 1) continue;
    const x = positions[k], y = positions[k + 1], z = positions[k + 2];
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (w < near) continue;
    const dx = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w * half_width + half_width - x_px;
    if (dx > 60 || dx < -60) continue;
    const dy = half_height - (m[1] * x + m[5] * y + m[9] * z + m[13]) / w * half_height - y_px;
    const nearness = Math.min(1, 2 * w / camera.distance);
    const radius_px = clamp(disc_px_m / w * nearness * nearness, Painter.LEAST_PX / 2, Painter.MOST_PX / 2);
    const away_px = Math.hypot(dx, dy) - radius_px;
    if (away_px <= 0) {
      if (w < found_w) [found, found_w] = [index, w];
    } else if (away_px < beside_px) {
      [beside, beside_px] = [index, away_px];
    }
  }
  return found >= 0 ? found : beside;
}

// The tool's mesh and the cells that it fills, in its own frame.
class Tool {
  static async unpack(facts) {
    const tool = new Tool();
    const mesh = await inflated(facts.mesh.data);
    tool.vertices = new Float32Array(mesh.buffer, 0, 3 * facts.mesh.vertices);
    tool.triangles = new Uint32Array(mesh.buffer, 12 * facts.mesh.vertices, 3 * facts.mesh.triangles);
    tool.bits = await inflated(facts.cells.data);
    tool.cells = facts.cells;
    tool.reach_m = facts.reach_m;
    tool.facts = facts;
    return tool;
  }

  // Whether a place in the tool's frame is in a filled cell. A cell is centred on its whole numbers.
  fills(x, y, z) {
    const {edge_m, min, size} = this.cells;
    const i = Math.round(x / edge_m) - min[0], j = Math.round(y / edge_m) - min[1], k = Math.round(z / edge_m) - min[2];
    if (i < 0 || j < 0 || k < 0 || i >= size[0] || j >= size[1] || k >= size[2]) return false;
    const bit = (k * size[1] + j) * size[0] + i;
    return (this.bits[bit >> 3] >> (bit & 7) & 1) === 1;
  }

  // Marks the drawn points inside the tool with its tip at `origin`. @return their number
  mark(points, frame, origin) {
    const {positions, looks, count} = points, reach2 = (this.reach_m + this.cells.edge_m) ** 2;
    let inside = 0;
    for (let index = 0, k = 0; index < count; ++index, k += 3) {
      const dx = positions[k] - origin[0], dy = positions[k + 1] - origin[1], dz = positions[k + 2] - origin[2];
      let mark = 0;
      if (dx * dx + dy * dy + dz * dz <= reach2) {
        const d = [dx, dy, dz];
        if (this.fills(dot(frame.x, d), dot(frame.y, d), dot(frame.z, d))) mark = 1;
      }
      inside += mark;
      looks[4 * index + 3] = looks[4 * index + 3] & ~1 | mark;
    }
    return inside;
  }
}

function unmark(points) {
  for (let to = 3; to < 4 * points.count; to += 4) points.looks[to] &= ~1;
}
