// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Unpacks what src/report/point_packer.h packs.

const NONE = 65535;  // no direction, no score
const NO_NORMAL = 255, NO_PROBABILITY = 255;
const PLANES = {id: 0, position: 4, state: 16, direction: 17, score: 19, confidence: 21, normal: 22, tool: 23, tools: 24};

function bytesOfBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let n = 0; n < bytes.length; ++n) bytes[n] = binary.charCodeAt(n);
  return bytes;
}

async function inflated(base64) {
  const stream = new Blob([bytesOfBase64(base64)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class Points {
  constructor(facts) {
    const total = facts.points.drawn;
    this.facts = facts;
    this.count = 0;  // unpacked so far
    this.begins = [];  // first point of each block
    this.ids = new Uint32Array(total);
    this.positions = new Float32Array(3 * total);  // metres from the anchor, which keeps them exact enough as floats
    this.looks = new Uint8Array(4 * total);        // state, confidence, normal, inside the tool + 2 room
    this.directions = new Uint16Array(total);
    this.scores = new Uint16Array(total);
    this.planes = 23;
    if (facts.tools) {
      this.planes = 28;
      this.states = new Uint8Array(total);  // of any tool
      this.stands_for = new Uint8Array(total);
      this.reached_by = new Uint32Array(total);  // a bit for each tool
    }
    this.probabilities = new Uint8Array(total).fill(NO_PROBABILITY);  // in half percents
    if (hasProbability(facts)) this.probability_plane = this.planes++;
    const frame = facts.frame;
    const middle = facts.bounds ? scaled(add(facts.bounds[0], facts.bounds[1]), 0.5) : frame.origin_W;
    this.anchor_steps = middle.map((value, axis) => Math.round((value - frame.origin_W[axis]) / frame.step_m));
    this.anchor_W = this.anchor_steps.map((steps, axis) => frame.origin_W[axis] + steps * frame.step_m);
  }

  // One block: an entry of facts.blocks and its base64.
  async unpack(block, base64) {
    const bytes = await inflated(base64);
    const n = block.points;
    if (bytes.length !== this.planes * n) throw new Error("a block of points is damaged");
    const step_m = this.facts.frame.step_m, begin = this.count;
    const low = bytes.subarray.bind(bytes);
    const plane = (index) => low(index * n, (index + 1) * n);
    this.unpackIds(plane, begin, n);
    for (let axis = 0; axis < 3; ++axis) {
      const first = PLANES.position + 4 * axis;
      const [b0, b1, b2, b3] = [plane(first), plane(first + 1), plane(first + 2), plane(first + 3)];
      let steps = block.base[axis] - this.anchor_steps[axis];
      for (let i = 0, to = 3 * begin + axis; i < n; ++i, to += 3) {
        const coded = b0[i] | b1[i] << 8 | b2[i] << 16 | b3[i] << 24;
        steps += coded >>> 1 ^ -(coded & 1);
        this.positions[to] = steps * step_m;
      }
    }
    const state = plane(PLANES.state), confidence = plane(PLANES.confidence), normal = plane(PLANES.normal);
    const direction = [plane(PLANES.direction), plane(PLANES.direction + 1)];
    const score = [plane(PLANES.score), plane(PLANES.score + 1)];
    for (let i = 0; i < n; ++i) {
      const to = 4 * (begin + i);
      this.looks[to] = state[i];
      this.looks[to + 1] = confidence[i];
      this.looks[to + 2] = normal[i];
      this.directions[begin + i] = direction[0][i] | direction[1][i] << 8;
      this.scores[begin + i] = score[0][i] | score[1][i] << 8;
    }
    if (this.facts.tools) this.unpackTools(plane, begin, n);
    if (hasProbability(this.facts)) this.probabilities.set(plane(this.probability_plane), begin);
    this.begins.push(begin);
    this.count += n;
  }

  unpackTools(plane, begin, n) {
    const [b0, b1, b2, b3] = [0, 1, 2, 3].map((k) => plane(PLANES.tools + k));
    this.states.set(plane(PLANES.state), begin);
    this.stands_for.set(plane(PLANES.tool), begin);
    for (let i = 0; i < n; ++i) this.reached_by[begin + i] = b0[i] | b1[i] << 8 | b2[i] << 16 | b3[i] << 24;
    const widest_m = widestMargin(this.facts);
    if (widest_m === 0) return;
    for (let index = begin; index < begin + n; ++index) {
      const margin_m = this.margin(index);
      this.looks[4 * index + 3] = margin_m === null ? 0 : 2 * (1 + Math.round(126 * margin_m / widest_m));
    }
  }

  // Shows what one of several tools reaches. @param k  -1 for any
  showTool(k) {
    const only_others = LABELS.indexOf("blocked") | REASONS.indexOf("other") << 2, accessible = LABELS.indexOf("accessible");
    for (let index = 0; index < this.count; ++index) {
      const state = this.states[index], lost = k >= 0 && (state & 3) === accessible && !(this.reached_by[index] >>> k & 1);
      this.looks[4 * index] = lost ? only_others : state;
    }
  }

  unpackIds(plane, begin, n) {
    const [b0, b1, b2, b3] = [plane(0), plane(1), plane(2), plane(3)];
    let id = -1;
    for (let i = 0; i < n; ++i) {
      id += (b0[i] | b1[i] << 8 | b2[i] << 16 | b3[i] << 24 >>> 0) + 1;
      this.ids[begin + i] = id;
    }
  }

  // The largest margin with which the tool that stands for the point reaches it; null if it does not.
  margin(index) {
    let most_m = null;
    for (let k = this.stands_for[index]; k < this.facts.tools.length; ++k) {
      const {margin_m} = this.facts.tools[k];
      if (k > this.stands_for[index] && margin_m === 0) break;  // another tool
      if (this.reached_by[index] >>> k & 1) most_m = Math.max(most_m, margin_m);
    }
    return most_m;
  }

  local(index) {
    return [this.positions[3 * index], this.positions[3 * index + 1], this.positions[3 * index + 2]];
  }
  reason(index) { return REASONS[this.looks[4 * index] >> 2]; }
  label(index) { return LABELS[this.looks[4 * index] & 3]; }

  tileOf(index) {
    let block = this.begins.length - 1;
    while (block > 0 && this.begins[block] > index) --block;
    return this.facts.blocks[block].tile;
  }

  // All that the card shows. Steps are whole numbers, so the position has no error but the rounding to a step.
  describe(index) {
    const d = this.directions[index];
    return {
      id: this.ids[index],
      tile: this.tileOf(index),
      position_W: add(this.local(index), this.anchor_W),
      label: this.label(index),
      reason: this.reason(index),
      direction_W: d === NONE ? null : this.facts.directions.slice(3 * d, 3 * d + 3),
      up_W: d === NONE || !this.facts.ups ? null : this.facts.ups.slice(3 * d, 3 * d + 3),
      score: this.scores[index] === NONE ? null : this.scores[index],
      confidence: this.looks[4 * index + 1] / 255,
      probability: this.probabilities[index] === NO_PROBABILITY ? null : this.probabilities[index] / 200,
      tool: this.facts.tools ? this.stands_for[index] : 0,  // to which direction and score belong
      tools: this.facts.tools ? this.facts.tools.map((_, k) => k).filter((k) => this.reached_by[index] >>> k & 1) : null,
      margin_m: this.facts.tools && widestMargin(this.facts) > 0 ? this.margin(index) : null,
    };
  }

  // @return index, or -1 if that point is not drawn
  find(tile, id) {
    for (let index = 0; index < this.count; ++index) {
      if (this.ids[index] === id && this.tileOf(index) === tile) return index;
    }
    return -1;
  }

  // The box that holds all points but a share at each end of each axis: a few far returns must not make the rest small.
  usualBox(share) {
    const low = [0, 0, 0], high = [0, 0, 0];
    if (this.count === 0) return {low: [-1, -1, -1], high: [1, 1, 1]};
    const every = Math.max(1, Math.floor(this.count / 20000));
    for (let axis = 0; axis < 3; ++axis) {
      const values = [];
      for (let index = 0; index < this.count; index += every) values.push(this.positions[3 * index + axis]);
      values.sort((a, b) => a - b);
      low[axis] = values[Math.floor(share * (values.length - 1))];
      high[axis] = values[Math.ceil((1 - share) * (values.length - 1))];
    }
    return {low, high};
  }
}
