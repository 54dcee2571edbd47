// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Vectors are arrays of three numbers, matrices 16 numbers in columns, as WebGL takes them.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scaled = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const normalized = (a) => scaled(a, 1 / Math.hypot(...a));
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

function product(a, b) {
  const result = new Float64Array(16);
  for (let column = 0; column < 4; ++column) {
    for (let row = 0; row < 4; ++row) {
      for (let k = 0; k < 4; ++k) result[4 * column + row] += a[4 * k + row] * b[4 * column + k];
    }
  }
  return result;
}

function perspective(fov_rad, aspect, near, far) {
  const f = 1 / Math.tan(fov_rad / 2);
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
}

// From the world to a viewer at `eye` who looks along -back.
function viewMatrix(eye, right, up, back) {
  return [
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ];
}

// A frame with its x axis along `direction` and z up as far as possible: that of the tool at a point.
// @param up  where z goes, roughly; null: as far up as it can
function frameAlong(direction, up) {
  const x = normalized(direction);
  if (up) {
    const y = normalized(cross(up, x));
    return {x, y, z: cross(x, y)};
  }
  const nearly_vertical = Math.abs(x[2]) > 0.999999;
  const y = nearly_vertical ? [0, 1, 0] : normalized(cross([0, 0, 1], x));
  return {x, y, z: cross(x, y)};
}

function frameMatrix(frame, origin) {
  return [...frame.x, 0, ...frame.y, 0, ...frame.z, 0, ...origin, 1];
}
