// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// A camera that turns around a target. Positions are metres from the points' anchor; z is up.

const FIELD_OF_VIEW = 40 * Math.PI / 180;
const STEEPEST = Math.PI / 2 - 1e-4;

class Camera {
  constructor(box) {
    this.home = box;
    this.width = this.height = 1;
    this.azimuth = -3 * Math.PI / 4;  // of the direction towards the viewer
    this.elevation = 0.5;
    this.fit();
  }

  fit() {
    const {low, high} = this.home;
    this.target = scaled(add(low, high), 0.5);
    this.radius = Math.max(Math.hypot(...subtract(high, low)) / 2, 1e-3);
    // So far away that each corner is in the picture, with a rim.
    const {right, up, back} = this.axes(), half = subtract(high, this.target);
    const steep = 0.93 * Math.tan(FIELD_OF_VIEW / 2), wide = steep * this.width / this.height;
    this.distance = 1.2 * this.radius;
    for (let n = 0; n < 8; ++n) {
      const corner = half.map((value, axis) => n >> axis & 1 ? value : -value);
      const sideways = Math.max(Math.abs(dot(right, corner)) / wide, Math.abs(dot(up, corner)) / steep);
      this.distance = Math.max(this.distance, dot(back, corner) + sideways);
    }
  }

  resize(width, height) {
    this.width = Math.max(width, 1);
    this.height = Math.max(height, 1);
  }

  axes() {
    const [ca, sa, ce, se] =
        [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    const back = [ca * ce, sa * ce, se], right = [-sa, ca, 0];
    return {right, up: cross(back, right), back};
  }

  eye() { return add(this.target, scaled(this.axes().back, this.distance)); }

  // Pixels that a metre at distance 1 takes.
  focal_px() { return this.height / 2 / Math.tan(FIELD_OF_VIEW / 2); }

  depths() {
    const near = Math.max(this.distance / 100, 1e-4);
    return {near, far: this.distance + 20 * this.radius + 100 * near};
  }

  toClip() {
    const {right, up, back} = this.axes();
    const {near, far} = this.depths();
    return product(perspective(FIELD_OF_VIEW, this.width / this.height, near, far),
                   viewMatrix(this.eye(), right, up, back));
  }

  // Where a place is in the picture; null if it is behind the viewer.
  toPixels([x, y, z]) {
    const m = this.toClip(), w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (w <= 0) return null;
    const at_x = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w, at_y = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
    return [(at_x + 1) / 2 * this.width, (1 - at_y) / 2 * this.height];
  }

  turn(dx_px, dy_px) {
    this.azimuth -= dx_px * 0.006;
    this.elevation = clamp(this.elevation + dy_px * 0.006, -STEEPEST, STEEPEST);
  }

  move(dx_px, dy_px) {
    const {right, up} = this.axes();
    const metres = this.distance / this.focal_px();
    this.target = add(this.target, add(scaled(right, -dx_px * metres), scaled(up, dy_px * metres)));
  }

  // What is under the cursor, at the target's distance, stays there.
  zoom(factor, x_px, y_px) {
    const before = this.distance;
    this.distance = clamp(this.distance * factor, 1e-3 * this.radius, 50 * this.radius);
    const {right, up} = this.axes();
    const metres = (before - this.distance) / this.focal_px();
    this.target = add(this.target, add(scaled(right, (x_px - this.width / 2) * metres),
                                       scaled(up, (this.height / 2 - y_px) * metres)));
  }

  // For links: target in the world, distance, angles in degrees.
  text(anchor_W) {
    const degrees = (angle) => (angle * 180 / Math.PI).toFixed(2);
    const target = add(this.target, anchor_W).map((value) => value.toFixed(4));
    return [...target, this.distance.toFixed(4), degrees(this.azimuth), degrees(this.elevation)].join(",");
  }
  // @return false if the text is none
  read(text, anchor_W) {
    const numbers = text.split(",").map(Number);
    if (numbers.length !== 6 || !numbers.every(Number.isFinite) || !(numbers[3] > 0)) return false;
    this.target = subtract(numbers.slice(0, 3), anchor_W);
    this.distance = numbers[3];
    this.azimuth = numbers[4] * Math.PI / 180;
    this.elevation = clamp(numbers[5] * Math.PI / 180, -STEEPEST, STEEPEST);
    return true;
  }
}

// Mouse, touch and keys. `changed` is called after each change; `clicked` and `centred` with a place in pixels.
function steer(canvas, camera, {changed, clicked, centred}) {
  const fingers = new Map();
  let travelled_px = 0;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const middleAndSpan = () => {
    const [a, b] = [...fingers.values()];
    return {middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], span: Math.hypot(a[0] - b[0], a[1] - b[1])};
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, place(event));
    if (fingers.size === 1) travelled_px = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = place(event);
    const two = fingers.size === 2 ? middleAndSpan() : null;
    fingers.set(event.pointerId, now);
    const dx = now[0] - before[0], dy = now[1] - before[1];
    travelled_px += Math.abs(dx) + Math.abs(dy);
    if (two) {
      const next = middleAndSpan();
      camera.move(next.middle[0] - two.middle[0], next.middle[1] - two.middle[1]);
      if (next.span > 0) camera.zoom(two.span / next.span, ...next.middle);
    } else if (event.shiftKey || event.buttons & 6) {
      camera.move(dx, dy);
    } else {
      camera.turn(dx, dy);
    }
    changed();
  });
  const lift = (event) => {
    const known = fingers.delete(event.pointerId);
    if (known && event.type === "pointerup" && event.button === 0 && travelled_px < 5) clicked(...place(event));
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", (event) => centred(...place(event)));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    camera.zoom(Math.exp(clamp(event.deltaY * lines, -300, 300) * 0.0015), ...place(event));
    changed();
  }, {passive: false});
  const keys = {
    ArrowLeft: () => camera.turn(-20, 0),
    ArrowRight: () => camera.turn(20, 0),
    ArrowUp: () => camera.turn(0, 20),
    ArrowDown: () => camera.turn(0, -20),
    "+": () => camera.zoom(0.85, camera.width / 2, camera.height / 2),
    "-": () => camera.zoom(1 / 0.85, camera.width / 2, camera.height / 2),
  };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
    changed();
  });
}
